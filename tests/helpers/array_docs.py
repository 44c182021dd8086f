"""Arrays in the docstrings of Python: shape and unit of each array that a public function takes or returns."""

import ast
import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ARRAY = re.compile(r"\b(Array|ArrayLike|NDArray|ndarray|Tensor)\b")
"""Names of array types in annotations."""
SHAPE = re.compile(r"\(\.\.\.\)|\((\.\.\.|\*?\w+( [+*] \w+)*( \w+)?)?,[^()]*\)|\b(scalar|number|bool)\b")
"""Shape, such as (n,), (num_envs, nq) or (..., 2); or the word for a single number."""
UNIT = re.compile(
    r"(?<![\w-])(m|rad|kg|N|s|J|Hz|kg m2|kg m\^2|m/s|rad/s|N m|N s|m/s\^2|%|(?i:units?|quaternions?|masks?|bool|boolean|indices|index|ids|"
    r"u?int(8|32|64)|integers|whether|flags?|numbers?|scores?|fractions?|shares?|probabilit\w+|standard deviations?|coefficients?|"
    r"logarithms?|colours?|rewards?|observations?|readings?|actions?|controls?|pixels|from 0 to 1|theta|jacobians?|derivatives?|gradients?|"
    r"residuals?|covariances?|weights?|costs?|ratios?|slopes?|matri\w+|vectors?))(?![\w-])"
)
"""Unit, or a quantity that has none or the unit of something else."""
ENTRY = re.compile(r"^ {4}(\*{0,2}\w+(?:, \w+)*): (.*(?:\n {5,}.*)*)", re.MULTILINE)


@dataclass(frozen=True)
class Described:
    """Array of a public function, with the text that describes it."""

    place: str
    text: str

    @property
    def lacks(self) -> list[str]:
        """Missing parts of the description."""
        return [name for name, pattern in (("shape", SHAPE), ("unit", UNIT)) if not pattern.search(self.text)]


def arrays_of(files: Sequence[Path], root: Path) -> Iterator[Described]:
    """Yield the array arguments and results of documented public functions. A method that overrides another inherits its description."""
    trees = {file: ast.parse(file.read_text()) for file in files}
    classes = {node.name: node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    for file, tree in trees.items():
        yield from _inside(tree, str(file.relative_to(root)), classes)


def _inside(node: ast.AST, place: str, classes: dict[str, ast.ClassDef]) -> Iterator[Described]:
    for child in getattr(node, "body", []):
        name = getattr(child, "name", "_")
        if isinstance(child, ast.ClassDef) and not name.startswith("_"):
            yield from _inside(child, f"{place}:{name}", classes)
        is_documented = isinstance(child, ast.FunctionDef) and not name.startswith("_") and ast.get_docstring(child)
        if is_documented and not (isinstance(node, ast.ClassDef) and _inherits(node, name, classes)):
            yield from _of_function(child, f"{place}:{name}")


def _inherits(node: ast.ClassDef, name: str, classes: dict[str, ast.ClassDef]) -> bool:
    """Whether a base class of the package has a method of this name."""
    bases = [classes[base.id] for base in node.bases if isinstance(base, ast.Name) and base.id in classes and base.id != node.name]
    return any(any(getattr(method, "name", "") == name for method in base.body) or _inherits(base, name, classes) for base in bases)


def _of_function(node: ast.FunctionDef, place: str) -> Iterator[Described]:
    text = inspect.cleandoc(ast.get_docstring(node) or "")
    summary = text.partition("\n\n")[0] if "Args:" in text or "Returns:" in text else text
    entries = {name: words for names, words in ENTRY.findall(_section(text, "Args")) for name in names.split(", ")}
    for argument in (*node.args.args, *node.args.kwonlyargs):
        if argument.annotation is not None and _is_array(argument.annotation):
            yield Described(f"{place}({argument.arg})", entries.get(argument.arg, text if not entries else ""))
    if node.returns is not None and _is_array(node.returns):
        yield Described(f"{place} ->", f"{summary}\n{_section(text, 'Returns')}")


def _section(text: str, name: str) -> str:
    found = re.search(rf"^{name}:\n((?: .*\n?|\n)*)", text, re.MULTILINE)
    return found[1] if found else ""


def _is_array(annotation: ast.expr) -> bool:
    """Whether an annotation is an array, or one or None."""
    text = ast.unparse(annotation)
    return bool(ARRAY.match(text.removeprefix("np.").removeprefix("torch.").removesuffix(" | None")))

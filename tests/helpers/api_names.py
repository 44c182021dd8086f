"""Lists of names on pages of the Python reference.

Entries of mkdocstrings are inside of comments (`<!-- api ... -->`), which the build of the site removes. So that the pages read well in the
repository, a list with the first sentence of each docstring precedes them.
"""

import ast
import dataclasses
import enum
import importlib
import inspect
import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
_LIST = re.compile(r"<!-- (names [\w ]+?) -->.*?<!-- end of \1 -->\n\n<!-- api\n(.*?)^-->$", re.MULTILINE | re.DOTALL)
_ENTRY = re.compile(r"^::: ([\w.]+)$((?:\n {4,}.*)*)", re.MULTILINE)


def sections() -> dict[str, tuple[Path, Callable[[], str]]]:
    """Page and text of each list, by the name of its section."""
    found: dict[str, tuple[Path, Callable[[], str]]] = {}
    for page in sorted((ROOT / "docs/reference").rglob("*.md")):
        for match in _LIST.finditer(page.read_text()):
            found[match[1]] = (page, lambda entries=match[2]: listing(entries))  # type: ignore[misc]
    return found


def listing(entries: str) -> str:
    """Table of the names in a block of entries. The only entry of a block is a class, whose members the table has."""
    found = [(name, re.search(r"heading: (\S+)", options)) for name, options in _ENTRY.findall(entries)]
    if len(found) == 1:
        rows = list(_members(_object(found[0][0])))
    else:
        rows = [(heading[1] if heading else name, _summary(name)) for name, heading in found]
    return "\n".join(["| name | |", "|---|---|", *(f"| `{name}` | {text} |" for name, text in rows)])


def _object(name: str) -> Any:
    """Object of a dotted name."""
    owner, _, last = name.rpartition(".")
    return getattr(importlib.import_module(owner), last)


def _summary(name: str) -> str:
    """First sentence of the docstring of a name. Modules of adapters are read without an import, because they need other libraries."""
    owner, _, last = name.rpartition(".")
    if owner == "stepper.adapters":
        return _sentence(ast.get_docstring(ast.parse((ROOT / f"python/stepper/adapters/{last}.py").read_text())))
    return _sentence(_object(name).__doc__)


def _members(owner: Any) -> Iterator[tuple[str, str]]:
    """Public members of a class with the first sentence of their docstrings, in the order of the source if it is known."""
    if dataclasses.is_dataclass(owner):
        attributes = inspect.cleandoc(owner.__doc__ or "").partition("\nAttributes:\n")[2].partition("\n\nRaises:")[0]
        for names, text in re.findall(r"^    ([a-z_]+(?:, [a-z_]+)*): (.*(?:\n {8,}\S.*)*)", attributes, re.MULTILINE):
            yield names.replace(", ", "`, `"), _sentence(text)
        return
    if issubclass(owner, enum.Enum):
        (tree,) = ast.parse(inspect.cleandoc("\n" + inspect.getsource(owner))).body
        body = tree.body  # type: ignore[attr-defined]
        for part, text in itertools.pairwise(body):
            target = part.targets[0] if isinstance(part, ast.Assign) else None
            if isinstance(target, ast.Name) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                yield target.id, _sentence(str(text.value.value))
        return
    for name in sorted(dir(owner)):
        if not name.startswith("_") and name != "geoms_seen_from":
            yield name, _sentence(getattr(owner, name).__doc__)


def _sentence(text: str | None) -> str:
    """First sentence of a docstring, for a cell of a table."""
    first = re.split(r"(?<=\.)\s", " ".join((text or "").strip().split("\n\n")[0].split()), maxsplit=1)[0]
    return first.replace("|", "\\|")

"""Docstrings of the stub, which are those of the binary: written there by `python tests/helpers/stub_docs.py`, compared by a test.

The doc comments in crates/python/src are the source of both.
"""

import ast
import inspect
from pathlib import Path

from stepper import _stepper

STUB = Path(__file__).parents[2] / "python/stepper/_stepper.pyi"


def documented(tree: ast.Module):
    """(node, whose, name, indentation, old docstring's node or None) of everything in the stub that has a name."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node, _stepper, node.name, 4, _docstring(node)
        elif isinstance(node, ast.ClassDef):
            owner = getattr(_stepper, node.name)
            yield node, _stepper, node.name, 4, _docstring(node)
            for item, after in zip(node.body, [*node.body[1:], None], strict=True):
                if isinstance(item, ast.AnnAssign):
                    there = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
                    yield item, owner, item.target.id, 4, after if there else None
                elif isinstance(item, ast.FunctionDef) and not item.name.startswith("__"):
                    yield item, owner, item.name, 8, _docstring(item)


def _docstring(node):
    return node.body[0] if ast.get_docstring(node) is not None else None


def spoken(owner, name: str) -> str:
    """What `help` says of it."""
    return inspect.cleandoc(getattr(owner, name).__doc__ or "")


def rewritten(text: str) -> str:
    """The stub with the docstrings of the binary."""
    lines = text.split("\n")
    for node, owner, name, indent, old in reversed(list(documented(ast.parse(text)))):
        doc = spoken(owner, name)
        if old is None:
            assert not doc, f"{name} is documented in the binary: give it a docstring in the stub, any, and run this again"
            continue
        more = "\n" in doc and not isinstance(node, ast.AnnAssign)
        block = f'"""{doc}\n"""' if more else f'"""{doc}"""'
        lines[old.lineno - 1 : old.end_lineno] = [" " * indent + line if line else "" for line in block.split("\n")]
    return "\n".join(lines)


if __name__ == "__main__":
    STUB.write_text(rewritten(STUB.read_text()))

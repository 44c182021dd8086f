"""Which modules of a Python package import which, read from their text: nothing is run."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path


def sources_of(package: Path) -> dict[str, str]:
    """The text of every module below a package's folder, by its dotted name; a package has its own name."""
    found = {}
    for file in sorted(package.rglob("*.py")):
        parts = [package.name, *file.relative_to(package).with_suffix("").parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file.read_text()
    return found


def _statements(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports anywhere in a module, in functions too. Those for type checkers alone do not count: they never run."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield node
    body = list(ast.iter_child_nodes(node))
    if isinstance(node, ast.If) and ast.unparse(node.test).removeprefix("typing.") == "TYPE_CHECKING":
        body = node.orelse
    for child in body:
        yield from _statements(child)


def _parents(module: str) -> list[str]:
    parts = module.split(".")
    return [".".join(parts[:k]) for k in range(1, len(parts))]


def imports_of(module: str, text: str, known: Mapping[str, object]) -> set[str]:
    """Modules of the same package that a module imports.

    A package comes with each of its modules, because its `__init__` runs first; but not those that the importing module itself is in, which
    are under way by then.

    Args:
        module: Its dotted name.
        text: Its text.
        known: All modules of the package.
    """
    found = set()
    for statement in _statements(ast.parse(text)):
        if isinstance(statement, ast.Import):
            named = {alias.name for alias in statement.names}
        else:
            assert not statement.level, f"{module} imports relative to itself"
            one = str(statement.module)
            named = {f"{one}.{alias.name}" if f"{one}.{alias.name}" in known else one for alias in statement.names}
        named &= known.keys()
        found |= named | {parent for name in named for parent in _parents(name) if parent not in (*_parents(module), module)}
    return found


def graph_of(sources: Mapping[str, str], others: frozenset[str] = frozenset()) -> dict[str, set[str]]:
    """What every module imports. `others` are modules without text, which import nothing."""
    known = {**sources, **dict.fromkeys(others, "")}
    return {module: imports_of(module, text, known) for module, text in known.items()}


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """Names along a circle, the first one again at its end; empty where there is none."""
    done: set[str] = set()

    def follow(path: list[str]) -> list[str]:
        for other in sorted(graph.get(path[-1], ())):
            if other in path:
                return [*path[path.index(other) :], other]
            if other not in done and (found := follow([*path, other])):
                return found
        done.add(path[-1])
        return []

    for start in sorted(graph):
        if start not in done and (found := follow([start])):
            return found
    return []


def trespasses(graph: Mapping[str, set[str]], folders: Mapping[str, set[str]], bottom: set[str], face: set[str]) -> list[str]:
    """Imports that are not declared, and modules that are in no declared folder.

    Args:
        graph: What every module imports.
        folders: Folders right below the package, and the folders that each may import.
        bottom: Modules right below the package that every folder may import, and that import none.
        face: Modules right below the package that may import everything, as the package itself may, and that nothing else imports.
    """
    found = []
    for module, imported in graph.items():
        place = _place(module)
        if place in face or not place:
            continue
        if place not in folders and place not in bottom:
            found.append(f"{module} is in no declared folder")
            continue
        allowed = bottom | ({place, *folders[place]} if place in folders else set())
        found += [f"{module} imports {other}" for other in sorted(imported) if _place(other) not in allowed]
    return found


def _place(module: str) -> str:
    """The folder or module right below the package that a module is in; empty for the package itself."""
    return module.partition(".")[2].partition(".")[0]

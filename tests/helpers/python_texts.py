"""Texts of Python sources: docstrings, comments, and messages of errors, warnings and help."""

import ast
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from rust_comments import Comment, paragraphs

MESSAGES = re.compile(r"(Error|Warning|Exit|warn|refuse|BadParameter|Option|Argument|add_argument|echo)$")
"""Last name of a call whose string arguments are messages or help texts."""
SECTION = re.compile(r"(Args|Returns|Raises|Yields|Attributes|Example|Examples|Note):$")
ENTRY = re.compile(r"\w[\w ,.*]*(\([^)]*\))?: ")
MARKERS = re.compile(r"#\s*(type:|noqa|fmt:|ruff:|mypy:|!|%%|region|endregion)")


def texts_of(file: Path, root: Path) -> Iterator[Comment]:
    """Yield the docstrings, comments and messages of a file."""
    source, place = file.read_text(), file.relative_to(root)
    tree = ast.parse(source)
    for line, text in _docstrings(tree):
        yield Comment(f"{place}:{line}", True, tuple(paragraphs(_without_entries(text))))
    for line, text in _comments(source):
        yield Comment(f"{place}:{line}", False, tuple(paragraphs(text.splitlines())))
    for line, text in _messages(tree):
        yield Comment(f"{place}:{line}", False, (text,))


def _docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Docstrings, and strings below assignments."""
    for node in ast.walk(tree):
        for child in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant) and isinstance(child.value.value, str):
                yield child.lineno, inspect.cleandoc(child.value.value)


def _without_entries(text: str) -> list[str]:
    """Lines of a docstring, with each entry of a section as a paragraph of its own and without the names of sections and entries."""
    lines: list[str] = []
    in_section = False
    for line in text.splitlines():
        if SECTION.match(line):
            in_section = True
            lines.append("")
        elif in_section and line.startswith("    ") and not line.startswith("     "):
            lines += ["", ENTRY.sub("", line.strip(), count=1)]
        elif in_section and line.startswith("     "):
            lines.append(line.strip())
        else:
            in_section = in_section and not line.strip()
            lines.append(line)
    return lines


def _comments(source: str) -> Iterator[tuple[int, str]]:
    """Comments; consecutive lines with nothing but a comment are one."""
    start, last, text = 0, -1, ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or MARKERS.match(token.string):
            continue
        alone = not token.line[: token.start[1]].strip()
        body = token.string.lstrip("#").removeprefix(" ")
        if alone and last == token.start[0] - 1:
            text += "\n" + body
        else:
            if text:
                yield start, text
            start, text = token.start[0], body
        last = token.start[0] if alone else -1
    if text:
        yield start, text


def _messages(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """String arguments of errors, warnings, options and outputs, with each value in a f-string as X."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and MESSAGES.search(_last_name(node.func)):
            for value in [*node.args, *(keyword.value for keyword in node.keywords if keyword.arg in {"help", "epilog", "description"})]:
                if text := _string(value):
                    yield value.lineno, text


def _last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _string(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "X" for part in node.values)
    return ""

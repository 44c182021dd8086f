"""Texts of sources: docstrings, comments and messages of Python, and paragraphs and sentences of the comments of Rust."""

import ast
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMMENT = re.compile(r"^\s*(///|//!|//)(?: (.*))?$")
LIST_ITEM = re.compile(r"^\s*(?:[*-]|\d+\.) ")
MESSAGES = re.compile(r"(Error|Warning|Exit|warn|refuse|BadParameter|Option|Argument|add_argument|echo)$")
"""Last name of a call whose string arguments are messages or help texts."""
SECTION = re.compile(r"(Args|Returns|Raises|Yields|Attributes|Example|Examples|Note):$")
ENTRY = re.compile(r"\w[\w ,.*]*(\([^)]*\))?: ")
MARKERS = re.compile(r"#\s*(type:|noqa|fmt:|ruff:|mypy:|!|%%|region|endregion)")


@dataclass(frozen=True)
class Comment:
    """Consecutive comment lines with one marker."""

    place: str
    is_doc: bool
    paragraphs: tuple[str, ...]
    """Plain text, without code blocks, tables and headings."""


def comments_of(file: Path, root: Path) -> Iterator[Comment]:
    """Yield the comments of a file in order."""
    lines = file.read_text().splitlines()
    k = 0
    while k < len(lines):
        match = COMMENT.match(lines[k])
        if match is None:
            k += 1
            continue
        start, text = k, []
        while k < len(lines) and (line := COMMENT.match(lines[k])) and line[1] == match[1]:
            text.append(line[2] or "")
            k += 1
        yield Comment(f"{file.relative_to(root)}:{start + 1}", match[1] != "//", tuple(paragraphs(text)))


def paragraphs(lines: list[str]) -> Iterator[str]:
    """Yield paragraphs and list items as one line each."""
    current: list[str] = []
    in_code = False
    for line in [*lines, ""]:
        fence = line.strip().startswith("```")
        apart = fence or in_code or not line.strip() or line.startswith(("|", "#", "    "))
        if current and (apart or LIST_ITEM.match(line)):
            yield " ".join(current)
            current = []
        in_code ^= fence
        if not apart:
            current.append(LIST_ITEM.sub("", line).strip())


def prose(paragraph: str) -> str:
    """Paragraph with each piece of code and each link as one X, and without parentheses, which hold citations and units."""
    text = re.sub(r"`[^`]*`", "X", paragraph)
    text = re.sub(r"\[X\](\([^)]*\))?", "X", text)
    return re.sub(r"\([^()]*\)", "", text)


def sentences(paragraph: str) -> list[str]:
    """Sentences of a paragraph; a full stop within a formula or a name ends none."""
    return re.split(r"(?<=[.?!])\s+(?=[A-Z0-9])", prose(paragraph))


def words(sentence: str) -> int:
    """Number of words; symbols and numbers of formulas do not count."""
    return len([word for word in sentence.split() if re.search(r"[A-Za-z]{2}", word)])


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

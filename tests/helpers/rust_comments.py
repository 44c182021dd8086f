"""Comments of Rust sources: their paragraphs and sentences."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMMENT = re.compile(r"^\s*(///|//!|//)(?: (.*))?$")
LIST_ITEM = re.compile(r"^\s*(?:[*-]|\d+\.) ")


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

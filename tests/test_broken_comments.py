"""Comments and docstrings are whole: no line continues in another column or without the marker, and none ends in mid-sentence."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from rust_comments import LIST_ITEM, words

ROOT = Path(__file__).parents[1]
MARKER = {".rs": re.compile(r"^(\s*)(//[/!]?)(?!/)(?: (.*))?$"), ".py": re.compile(r"^(\s*)(#)(?!!)(?: (.*))?$")}
"""Lines with nothing but a comment: indentation, marker and text."""
END = re.compile(r"[.:;?!)\]}>\"'`|*]$|^\[.*\]: \S+$")
"""End of a paragraph, or a reference of a link."""
SECTION = re.compile(r"(Args|Raises|Attributes):$")
ENTRY = re.compile(r"(\*{0,2}\w[\w.*]*, )*\*{0,2}\w[\w.*]*( \([^)]*\))?:( |$)")
LEAST_WORDS = 4
"""Words from which on a paragraph is a sentence, and not a formula, a unit or a heading."""


def cut(lines: list[str]) -> Iterator[int]:
    """Yield the indices of lines that end a paragraph in mid-sentence.

    A formula, code block or list after a paragraph completes it. Items of lists and commands after "Example:" need no full stop.
    """
    in_code, start = False, 0
    for k, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith("```") or in_code or line.startswith(("|", "#", "    ")):
            in_code ^= line.lstrip().startswith("```")
            start = k + 1
            continue
        if k + 1 < len(lines) and lines[k + 1].strip():
            continue
        text = " ".join(lines[start : k + 1]).strip()
        following = next((other for other in lines[k + 1 :] if other.strip()), "")
        is_complete = END.search(text) or following.startswith(("    ", "```", "|")) or LIST_ITEM.match(following)
        if (
            words(text) >= LEAST_WORDS
            and not is_complete
            and not LIST_ITEM.match(lines[start])
            and not text.startswith(("Example: ", "Examples: "))
        ):
            yield k


def blocks(lines: list[str], ending: str) -> Iterator[tuple[int, list[str]]]:
    """Yield index and text lines of each group of comment lines with one indentation and marker."""
    k = 0
    while k < len(lines):
        first = MARKER[ending].match(lines[k])
        start, text = k, []
        while first and k < len(lines) and (match := MARKER[ending].match(lines[k])) and match.group(1, 2) == first.group(1, 2):
            text.append(match[3] or "")
            k += 1
        if text:
            yield start, text
        else:
            k += 1


def broken_comments(lines: list[str], ending: str) -> Iterator[int]:
    """Yield the indices of comment lines that end in mid-sentence, also where the text continues in another column or marker."""
    for start, text in blocks(lines, ending):
        yield from (start + k for k in cut(text))


def broken_docstrings(source: str) -> Iterator[int]:
    """Yield the indices of docstring lines that are left of their column, are no entry of their section, or end in mid-sentence."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        for child in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant) and isinstance(child.value.value, str)):
                continue
            column, first, last = child.col_offset, child.lineno - 1, child.end_lineno or child.lineno
            own = [lines[first].strip().removeprefix("r").removeprefix('"""'), *(line[column:] for line in lines[first + 1 : last])]
            own[-1] = own[-1].removesuffix('"""')
            in_section = False
            for k, line in enumerate(lines[first + 1 : last], first + 1):
                if line[:column].strip():
                    yield k
                text = line[column:]
                in_section = bool(SECTION.match(text)) or (in_section and (not text or text.startswith(" ")))
                if in_section and re.match(r"    \S", text) and not ENTRY.match(text.strip()):
                    yield k
            yield from (first + k for k in cut(own))


def broken_lines(file: Path) -> list[str]:
    """Places and texts of the broken lines of a file."""
    source = file.read_text()
    lines = source.splitlines()
    found = set(broken_comments(lines, ".rs" if file.suffix == ".rs" else ".py"))
    if file.suffix != ".rs":
        found |= set(broken_docstrings(source))
    return [f"{file}:{k + 1}: {lines[k].strip()}" for k in sorted(found)]


@pytest.mark.parametrize("folder", ["crates", "python", "examples", "benches", "tests"])
def test_no_comment_is_broken(folder):
    files = [file for file in sorted((ROOT / folder).rglob("*")) if file.suffix in {".rs", ".py", ".pyi"} and "target" not in file.parts]
    assert files
    assert [line for file in files for line in broken_lines(file)] == []


@pytest.mark.parametrize(("name", "text", "broken"), [
    ("a.rs", "/// Speed above which a contact counts as\n/// slipping, m/s.\nconst A: f64 = 1.0;", []),
    ("a.rs", "    /// Speed above which a contact counts as\n/// slipping, m/s.\n    a: f64,", [1]),
    ("a.rs", "/// Speed above which a contact counts as\n// slipping, m/s.\nconst A: f64 = 1.0;", [1]),
    ("a.rs", "/// Speed above which a contact counts as\nconst A: f64 = 1.0;", [1]),
    ("a.rs", "/// Speed above which a contact counts\n///\n/// slipping, m/s.\nconst A: f64 = 1.0;", [1]),
    ("a.rs", "/// The solver finds impulses such that\n///\n///     v = G x\n///\n/// and it stops.\nconst A: f64 = 1.0;", []),
    ("a.py", 'def f():\n    """Speed above which a contact counts as\n    slipping, m/s."""', []),
    ("a.py", 'def f():\n    """Speed above which a contact counts as\nslipping, m/s."""', [3]),
    ("a.py", 'def f():\n    """Speed above which a contact counts as"""', [2]),
    ("a.py", 'def f(a):\n    """Speed.\n\n    Args:\n        a: Speed above which a contact\n            slips.\n    """', []),
    ("a.py", 'def f(a):\n    """Speed.\n\n    Args:\n        a: Speed above which a contact\n        slips.\n    """', [6]),
    ("a.py", "if A:\n    # Speed above which a contact counts as\n# slipping, m/s.\n    pass", [2]),
    ("a.py", "if A:\n    # Speed above which a contact counts as\n    B = 1", [2]),
])  # fmt: skip
def test_a_planted_break_is_found(tmp_path, name, text, broken):
    file = tmp_path / name
    file.write_text(f"{text}\n")
    assert [int(line.removeprefix(f"{file}:").partition(":")[0]) for line in broken_lines(file)] == broken

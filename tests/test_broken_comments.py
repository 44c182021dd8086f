"""Comments and docstrings are whole: no line continues in another column or without the marker, and none ends in mid-sentence."""

import ast
import itertools
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
SECTION = re.compile(r"(Args|Raises|Attributes|Returns|Yields):$")
WITHOUT_ENTRIES = ("Returns:", "Yields:")
ENTRY = re.compile(r"(\*{0,2}\w[\w.*]*, )*\*{0,2}\w[\w.*]*( \([^)]*\))?:( |$)")
LEAST_WORDS = 3
"""Words from which on a paragraph is a sentence, and not a formula, a unit or a heading."""
EARLY = 80
"""Column that the next word exceeds where a line ends. Lines have up to 140 columns; long words and formulas end some of them at 100."""


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


def ends_early(line: str, following: str) -> bool:
    """Whether the next word would have fitted into a line far from the limit. Both lines must belong to one paragraph."""
    if not line.strip() or not following.strip() or LIST_ITEM.match(following) or line.lstrip().startswith(("|", "#", "[", ">>>")):
        return False
    same = len(line) - len(line.lstrip()) == len(following) - len(following.lstrip())
    return same and len(line) + 1 + len(following.split(maxsplit=1)[0]) <= EARLY


def early(lines: list[str], column: int) -> Iterator[int]:
    """Yield the indices of lines of prose that end early. The text of the lines begins at a column."""
    in_code = False
    for k, (line, following) in enumerate(itertools.pairwise(lines)):
        in_code ^= line.lstrip().startswith("```")
        is_prose = not in_code and not line.startswith("    ") and "```" not in f"{line}{following}"
        if is_prose and ends_early(" " * column + line, " " * column + following):
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
    """Yield the indices of comment lines that end early or in mid-sentence, or continue in another column or with another marker."""
    for start, text in blocks(lines, ending):
        yield from (start + k for k in cut(text))
        yield from (start + k for k in early(text, len(lines[start]) - len(text[0])))


def broken_docstrings(source: str) -> Iterator[int]:
    """Yield the indices of docstring lines left of their column, without an entry in a section, or that end early or in mid-sentence."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        for child in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant) and isinstance(child.value.value, str)):
                continue
            column, first, last = child.col_offset, child.lineno - 1, child.end_lineno or child.lineno
            own = [lines[first].strip().removeprefix("r").removeprefix('"""'), *(line[column:] for line in lines[first + 1 : last])]
            own[-1] = own[-1].removesuffix('"""')
            in_section = has_entries = False
            for k, line in enumerate(lines[first + 1 : last], first + 1):
                if line[:column].strip():
                    yield k
                text = line[column:]
                in_section = bool(SECTION.match(text)) or (in_section and (not text or text.startswith(" ")))
                has_entries = text not in WITHOUT_ENTRIES if SECTION.match(text) else has_entries
                if in_section and has_entries and re.match(r"    \S", text) and not ENTRY.match(text.strip()):
                    yield k
                following = lines[k + 1].removesuffix('"""') if k + 1 < last else ""
                is_entry = in_section and ENTRY.match(following.strip())
                if (in_section or not text.startswith(" ")) and not is_entry and ends_early(line, following):
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


LINE = "Speed above which a contact counts as slipping and not as sticking, for contacts of bodies"
"""Line that is long enough to end there."""


@pytest.mark.parametrize(("name", "text", "broken"), [
    ("a.rs", f"/// {LINE}\n/// with friction, m/s.\nconst A: f64 = 1.0;", []),
    ("a.rs", f"    /// {LINE}\n/// with friction, m/s.\n    a: f64,", [1]),
    ("a.rs", f"/// {LINE}\n// with friction, m/s.\nconst A: f64 = 1.0;", [1]),
    ("a.rs", f"/// {LINE}\nconst A: f64 = 1.0;", [1]),
    ("a.rs", f"/// {LINE}\n///\n/// with friction, m/s.\nconst A: f64 = 1.0;", [1]),
    ("a.rs", "/// Speed above which a contact\n/// counts\n/// as slipping, m/s.\nconst A: f64 = 1.0;", [1, 2]),
    ("a.rs", "/// The solver finds impulses such that\n///\n///     v = G x\n///\n/// and it stops.\nconst A: f64 = 1.0;", []),
    ("a.py", f'def f():\n    """{LINE}\n    with friction, m/s."""', []),
    ("a.py", f'def f():\n    """{LINE}\nwith friction, m/s."""', [3]),
    ("a.py", f'def f():\n    """{LINE}"""', [2]),
    ("a.py", 'def f():\n    """Speed.\n\n    It is the speed above which a contact\n    slips.\n    """', [4]),
    ("a.py", f'def f(a):\n    """Speed.\n\n    Args:\n        a: {LINE}\n            with friction.\n    """', []),
    ("a.py", f'def f(a):\n    """Speed.\n\n    Args:\n        a: {LINE}\n        with friction.\n    """', [6]),
    ("a.py", 'def f():\n    """Speed.\n\n    Example:\n\n        a = 1\n        b = 2\n    """', []),
    ("a.py", '"""Report of a study.\n\nstepper report examples/studies/tray.toml\n"""', [3]),
    ("a.py", f"if A:\n    # {LINE}\n# with friction, m/s.\n    pass", [2]),
    ("a.py", f"if A:\n    # {LINE}\n    B = 1", [2]),
])  # fmt: skip
def test_a_planted_break_is_found(tmp_path, name, text, broken):
    file = tmp_path / name
    file.write_text(f"{text}\n")
    assert [int(line.removeprefix(f"{file}:").partition(":")[0]) for line in broken_lines(file)] == broken

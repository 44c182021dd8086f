"""Words of the sources: doc comments begin with a noun and are whole, sentences are short, and one concept has one word."""

import ast
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from source_texts import LIST_ITEM, Comment, comments_of, paragraphs, prose, sentences, texts_of, words

ROOT = Path(__file__).parents[1]
MOST_WORDS = 25
OPENING = re.compile(r"(What|Who|That|Those|The same|One of|It|Its|They|Their|How|Where|Which|Of|See)\b")
"""First words of a doc comment that name no thing."""
WORDS = {
    "demand": r"demand(s|ed|ing)?",
    "strike": r"strikes?|struck|blows?",
    "patch": r"hyperstatic|patch(es)?",
    "table": r"firmness|gauge|crowd|thrown|undecided|recalls?|thereof|anew|renew(s|ed)?|so many|as good as|(to )?look(ed)? at|beside",
    "room": r"rooms?|gives? way|tied|ties",
    "own": r"(its|their|his|her|one's) own",
    "person": r"who|whoever|nobody|somebody|wants?|asks?|asked for|knows?|says?",
    "must": r"(is|are) to (be|have|do|get|give|go|make|meet|read|rest|step|take)",
}
"""Words with a replacement in the language of the field, by the word that they stand for.

They are: target velocity, collision, contact group, various single words, capacity or coupled, separate, an actor, must.
"""
IDENTIFIERS = re.compile(r"(?i)\b\w*(strike|struck|hyperstatic|demand|firmness|undecided|recall|crowd)\w*\b")
CORE = "crates/core/src"
PLAIN = (
    "crates/real",
    "crates/model",
    "crates/solve",
    "crates/derivative",
    "crates/python",
    *(f"{CORE}/{name}.rs" for name in ("lib", "error", "model", "options", "probe", "step", "tuning")),
    *(f"{CORE}/{name}" for name in ("math", "compile", "dynamics", "actuation", "constraints", "sensing")),
    *(f"{CORE}/{name}" for name in ("stages", "integrators", "group_step", "analysis", "batch")),
)
"""Folders and files without any exception."""
REMAINING = {"crates/core/src/collision": (5, 2, 6), "crates/geometry": (11, 16, 29)}
"""Openings, long sentences and words that are left in other folders. The numbers may only fall."""


PYTHON = ("python/stepper", "examples", "benches")
"""Folders whose docstrings, comments and messages are read."""
LEFT = {
    "adapters": (4, 0, 13),
    "api": (22, 0, 53),
    "envs": (19, 0, 30),
    "examples": (3, 0, 10),
    "fuzz": (6, 0, 13),
    "golden": (7, 2, 13),
    "helpers": (19, 5, 22),
    "identification": (5, 0, 18),
    "laws": (26, 11, 99),
    "policies": (2, 0, 2),
    "reference": (6, 7, 19),
    "studies": (13, 0, 28),
    "study_libraries": (0, 0, 5),
    "viewer": (8, 0, 3),
    ".": (4, 0, 14),
    "_stepper.pyi": (0, 3, 1),
}
"""Openings, long sentences and words that are left in folders of tests/, in tests/ itself, and in the stub. The numbers may only fall."""
PAGES = {"docs": (0, 63), "README.md": (0, 0)}
"""Long sentences and words that are left in the documentation. The numbers may only fall."""
STUB = ROOT / "python/stepper/_stepper.pyi"
LINE = "Speed above which a contact counts as slipping and not as sticking, for contacts of bodies"
"""Line that is long enough to end there."""


def comments(place: str) -> list[Comment]:
    path = ROOT / place
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*.rs") if "target" not in file.parts)
    assert files, place
    return [comment for file in files for comment in comments_of(file, ROOT)]


def openings(found: list[Comment]) -> list[str]:
    return [f"{c.place}: {c.paragraphs[0][:60]}" for c in found if c.is_doc and c.paragraphs and OPENING.match(c.paragraphs[0])]


def long_sentences(found: list[Comment]) -> list[str]:
    return [
        f"{c.place}: {words(sentence)} words: {sentence[:60]}"
        for c in found
        if c.is_doc
        for paragraph in c.paragraphs
        for sentence in sentences(paragraph)
        if words(sentence) > MOST_WORDS
    ]


def replaced_words(found: list[Comment]) -> list[str]:
    pattern = re.compile(rf"\b({'|'.join(WORDS.values())})\b", re.I)
    return [f"{c.place}: {match[0]}" for c in found for paragraph in c.paragraphs for match in pattern.finditer(prose(paragraph))]


@pytest.mark.parametrize("place", PLAIN)
def test_comments_are_plain(place):
    found = comments(place)
    assert openings(found) == []
    assert long_sentences(found) == []
    assert replaced_words(found) == []


@pytest.mark.parametrize("place", REMAINING)
def test_the_rest_does_not_grow(place):
    found = comments(place)
    counts = [len(check(found)) for check in (openings, long_sentences, replaced_words)]
    assert all(count <= most for count, most in zip(counts, REMAINING[place], strict=True)), (counts, REMAINING[place])


@pytest.mark.parametrize("place", PLAIN)
def test_identifiers_have_the_words_of_the_field(place):
    path = ROOT / place
    files = [path] if path.is_file() else [file for file in path.rglob("*.rs") if "target" not in file.parts]
    found = [f"{file.relative_to(ROOT)}: {m[0]}" for file in files for m in IDENTIFIERS.finditer(re.sub(r"//.*", "", file.read_text()))]
    assert found == []
    assert not [file for file in files if IDENTIFIERS.search(file.stem)]


def test_every_crate_is_listed():
    """A new folder is either without exception or has its number of them."""
    sources = [
        file
        for crate in ("real", "geometry", "model", "solve", "core", "derivative", "python")
        for file in (ROOT / "crates" / crate / "src").rglob("*.rs")
    ]
    listed = [ROOT / place for place in (*PLAIN, *REMAINING)]
    assert len(sources) > 200
    assert [file for file in sources if not any(file == place or place in file.parents for place in listed)] == []


def python_findings() -> dict[str, list[list[str]]]:
    """Openings, long sentences and replaced words of each folder."""
    findings: dict[str, list[list[str]]] = {}
    for root in PYTHON:
        for file in sorted((ROOT / root).rglob("*.py")):
            inside = file.relative_to(ROOT / root).parts[0]
            found = list(texts_of(file, ROOT))
            kinds = findings.setdefault(f"{root}/{inside}" if (ROOT / root / inside).is_dir() or root == PYTHON[0] else root, [[], [], []])
            for kind, check in zip(kinds, (openings, long_sentences, replaced_words), strict=True):
                kind.extend(check(found))
    return findings


def test_texts_of_tests_and_of_the_stub_do_not_get_worse():
    """The folders that are not listed have none."""
    findings: dict[str, list[int]] = {}
    for file in [STUB, *sorted((ROOT / "tests").rglob("*.py"))]:
        folder = STUB.name if file == STUB else file.relative_to(ROOT / "tests").parts[0] if file.parent != ROOT / "tests" else "."
        found, counts = list(texts_of(file, ROOT)), findings.setdefault(folder, [0, 0, 0])
        for k, check in enumerate((openings, long_sentences, replaced_words)):
            counts[k] += len(check(found))
    assert len(findings) > 10
    worse = {folder for folder, counts in findings.items() if any(n > m for n, m in zip(counts, LEFT.get(folder, (0, 0, 0)), strict=True))}
    assert {folder: findings[folder] for folder in worse} == {}


@pytest.mark.parametrize("place", PAGES)
def test_pages_do_not_get_worse(place):
    files = [ROOT / place] if place.endswith(".md") else sorted((ROOT / place).rglob("*.md"))
    found = [Comment(str(file.relative_to(ROOT)), False, tuple(paragraphs(file.read_text().splitlines()))) for file in files]
    counts = [len(check(found)) for check in (long_sentences, replaced_words)]
    assert all(count <= most for count, most in zip(counts, PAGES[place], strict=True)), (counts, PAGES[place])


def test_python_texts_are_plain():
    findings = python_findings()
    assert len(findings) > 20
    assert {place: kinds for place, kinds in findings.items() if any(kinds)} == {}


@pytest.mark.parametrize(("text", "found"), [
    ("/// What a step reads.", [1, 0, 0]),
    ("/// Whether a step ends.", [0, 0, 0]),
    (f"/// Sum {'of terms ' * 13}.", [0, 1, 0]),
    (f"/// Sum `a` ({'of terms ' * 13}) of x = 1 + 2 + 3.\n///\n/// ```text\n/// {'of terms ' * 13}\n/// ```", [0, 0, 0]),
    ("/// Velocity that a row demands.", [0, 0, 1]),
    ("// Velocity that a row demands, `demands`.", [0, 0, 1]),
    ("/// Sum of terms, see\n/// the module. It is large.", [0, 0, 0]),
    ('"""What a step reads."""', [1, 0, 0]),
    (f'"""Sum {"of terms " * 13}."""', [0, 1, 0]),
    ('def f():\n    """Sum.\n\n    Args:\n        a: Who asks.\n    """', [0, 0, 2]),
    ('A = 1\n"""Its size, m."""', [1, 0, 0]),
    ("# Whoever reads.\n# And writes anew.", [0, 0, 2]),
    ('raise ValueError(f"{n} says no")', [0, 0, 1]),
    ('typer.Option(help="Nobody reads")', [0, 0, 1]),
    ('"""Sum of terms. It is large."""', [0, 0, 0]),
])  # fmt: skip
def test_a_planted_text_is_found(tmp_path, text, found):
    file = tmp_path / ("planted.rs" if text.startswith("//") else "planted.py")
    file.write_text(f"{text}\n")
    planted = list((comments_of if text.startswith("//") else texts_of)(file, tmp_path))
    assert [len(check(planted)) for check in (openings, long_sentences, replaced_words)] == found


# Comments and docstrings are whole: no line continues in another column or without the marker, and none ends in mid-sentence.

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
    """Yield the indices of lines that end a paragraph in mid-sentence."""
    # A formula, code block or list after a paragraph completes it. Items of lists and commands after "Example:" need no full stop.
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

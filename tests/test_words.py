"""Words of the Rust and Python sources: doc comments begin with a noun, sentences are short, and one concept has one word."""

import re
from pathlib import Path

import pytest
from python_texts import texts_of
from rust_comments import Comment, comments_of, paragraphs, prose, sentences, words

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

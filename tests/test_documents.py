"""What documents say exists is there, what they show runs, and their figures are those of the result files."""

import importlib.util
import re
import sys
from pathlib import Path

import command_line
import gymnasium
import page_blocks
import pytest
from field_table import PAGE as FIELDS
from field_table import written

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benches").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
)
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
WITH_CODE = [page for page in PAGES if any(block.language in ("python", "sh") for block in page_blocks.blocks(page.read_text()))]


def named(path):
    return str(path.relative_to(ROOT))


def figures():
    """The module that computes figures of the documentation."""
    spec = importlib.util.spec_from_file_location("figures", ROOT / "docs/hooks/figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_links_and_paths_lead_somewhere(document):
    text = document.read_text()
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", text)
    # Paths of this repository that are named without a link; those that a command writes stand behind a ">" or in "out/".
    paths = re.findall(r"(?<![\w/.>])((?:benches|crates|docs|examples|python|tests)/[\w./-]*\w)", text)
    missing = [link for link in links if not (document.parent / link).exists()]
    missing += [path for path in paths if not (ROOT / path).exists()]
    assert missing == []


def anchors(document):
    """Anchors of the headings of a document, as GitHub and MkDocs make them of plain titles."""
    text = re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title)).strip().lower().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_anchors_of_links_exist(document):
    links = re.findall(r"\]\((?!https?://)([^)#\s]*)#([^)\s]+)\)", document.read_text())
    targets = {(document.parent / path if path else document, anchor) for path, anchor in links}
    missing = [f"{path}#{anchor}" for path, anchor in targets if path.suffix == ".md" and anchor not in anchors(path)]
    assert missing == []


@pytest.mark.parametrize("page", WITH_CODE, ids=named)
@pytest.mark.filterwarnings("ignore::stepper.ModelWarning", "ignore::UserWarning")
def test_code_blocks_run(page, tmp_path, monkeypatch):
    """All code blocks of a page run exactly as shown (page_blocks.py)."""
    page_blocks.prepare(tmp_path)
    monkeypatch.chdir(tmp_path)


from field_table import PAGE as FIELDS
from field_table import written

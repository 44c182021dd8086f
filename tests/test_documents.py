"""What documents say exists is there, and what they show runs."""

import re
from pathlib import Path

import mujoco
import pytest
from field_table import PAGE, written
from models import SOURCES

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benches").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_paths_lead_somewhere(document):
    text = document.read_text()
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", text)
    # Paths of this repository that are named without a link; those that a command writes stand behind a ">" or in "out/".
    paths = re.findall(r"(?<![\w/.>])((?:benches|crates|docs|examples|python|tests)/[\w./-]*\w)", text)
    missing = [link for link in links if not (document.parent / link).exists()]
    missing += [path for path in paths if not (ROOT / path).exists()]
    assert missing == []


def test_the_readmes_snippets_run(tmp_path, monkeypatch):
    """One after the other, as they are, but for the number of environments, with a humanoid that others wrote."""
    snippets = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    humanoid = mujoco.MjSpec.from_file(str(SOURCES["dm_control/humanoid"]))
    humanoid.compile()
    (tmp_path / "humanoid.xml").write_text(humanoid.to_xml())
    monkeypatch.chdir(tmp_path)
    names = {}
    for snippet in snippets:
        exec(compile(snippet.replace("1024", "16"), "README.md", "exec"), names)
    assert names["sim"].sensor_faults.shape == (16, len(names["model"].sensors), 2)


def test_the_table_of_what_can_vary_is_that_of_the_code():
    assert written(PAGE.read_text()) == PAGE.read_text(), "run: PYTHONPATH=python python tests/field_table.py"

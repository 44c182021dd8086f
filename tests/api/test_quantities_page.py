"""What docs/reference/quantities.md shows runs, on a humanoid that others wrote."""

import re
from pathlib import Path

import mujoco
from models import SOURCES

PAGE = (Path(__file__).parents[2] / "docs/reference/quantities.md").read_text()


def test_its_snippets_run(tmp_path, monkeypatch):
    humanoid = mujoco.MjSpec.from_file(str(SOURCES["dm_control/humanoid"]))
    humanoid.compile()
    (tmp_path / "humanoid.xml").write_text(humanoid.to_xml())
    monkeypatch.chdir(tmp_path)
    names = {}
    for snippet in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(compile(snippet, "docs/reference/quantities.md", "exec"), names)
    assert names["depth"].shape == names["geoms"].shape == (64, 187)
    assert len(names["some"]) == 2

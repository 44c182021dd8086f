"""Studies as newcomers write them: modules side by side, functions named by text, furniture with mass."""

from pathlib import Path

import numpy as np
import pytest
from stepper.lab import Outcome, Study
from stepper.lab.comparison import compare
from stepper.lab.study.drives import digest_of, load_file

FURNITURE = """<mujoco><worldbody>
  <body name="shelf" pos="0 0 2"><geom type="box" size=".1 .1 .1" mass="3"/></body>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".05" mass="0.5"/></body>
</worldbody></mujoco>"""


def study(**given: object) -> Study:
    """Study of a ball that falls beside a shelf with mass."""
    return Study(model=FURNITURE, seconds=0.1, outcomes=[Outcome(name="height", measure="body ball z", success=">= 0.5")], **given)


def test_a_start_that_is_text_is_refused_at_once():
    with pytest.raises(TypeError, match="only in TOML files"):
        study(start="cup.py:start")


def test_a_study_imports_a_module_of_its_folder(tmp_path: Path):
    (tmp_path / "shelf_of_a_newcomer.py").write_text(f"SCENE = '''{FURNITURE}'''\n")
    file = tmp_path / "study_of_a_newcomer.py"
    file.write_text("import shelf_of_a_newcomer\nSCENE = shelf_of_a_newcomer.SCENE\n")
    assert load_file(file).SCENE == FURNITURE


def test_a_change_of_a_module_beside_a_study_changes_its_digest(tmp_path: Path):
    """Rows of the journal would be stale otherwise."""
    gains, deeper, file = (tmp_path / f"{name}_of_a_newcomer.py" for name in ("gains", "deeper", "drive"))
    deeper.write_text("KP = 1.0\n")
    gains.write_text("from deeper_of_a_newcomer import KP\n")
    file.write_text("import numpy\nimport gains_of_a_newcomer\ndef drive(now):\n    return gains_of_a_newcomer.KP\n")
    drive = load_file(file).drive
    found = digest_of(drive)
    assert digest_of(drive) == found
    deeper.write_text("KP = 2.0\n")
    assert digest_of(drive) != found


def test_fixed_bodies_have_no_potential_energy_in_any_engine():
    """The shelf has m g z = 59 J. Free fall of two integrators differs by m g^2 h t = 0.01 J."""
    figures = compare(FURNITURE, seconds=0.1, num_envs=2).figures()
    ends = [values["energy at the end, J"] for values in figures.values()]
    assert len(ends) == 3
    np.testing.assert_allclose(ends, ends[0], atol=0.1)

"""benches/terrains: robots start above the ground, and the table has a line for each ground."""

import mujoco
import numpy as np
import pytest
from sections import section_of
from terrains import report
from terrains.grounds import GROUNDS
from terrains.measure import SPREAD
from terrains.report import steps, times


@pytest.mark.parametrize("ground", [g for g in GROUNDS if g.name != "3,000 tiles"], ids=lambda g: g.name)
def test_no_ground_is_higher_than_it_says(ground):
    spec = mujoco.MjSpec()
    ground.add(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-SPREAD, SPREAD, (20, 2)):
        distance = mujoco.mj_ray(model, data, np.array([x, y, 9.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, np.zeros(1, np.int32))
        # Between points of a field the ground is as high as a neighbour at most: a robot's whole footprint is looked at.
        around = x + np.array([-0.1, 0.0, 0.1]), y + np.array([-0.1, 0.0, 0.1])
        highest = np.max(ground.height(*(np.ravel(a) for a in np.meshgrid(*around))))
        assert 9.0 - distance <= highest + 1e-6  # heights of fields are in single precision


THEIRS = {"microseconds": 6.0, "contacts": 1.0, "penetration": 0.0}
OURS = THEIRS | {"microseconds": 2.0, "ratio": 3.0, "flags": {}, "sweeps": 1.0, "newton_steps": 1.0, "unsolved": 0.0}


def test_the_table_compares_with_the_faster_setting():
    row = {
        "scene": "stairs",
        "ours": {"f64 default": OURS},
        "theirs": {"MuJoCo own": THEIRS | {"microseconds": 8.0}, "MuJoCo same": THEIRS},
    }
    assert times([row]).splitlines()[-1] == "| stairs | 2.0 (3.00) | 8.0 | 6.0 |"
    assert len(steps([row]).splitlines()) == 5


def test_a_table_is_written_for_its_cpu_level(tmp_path, monkeypatch):
    page = tmp_path / "terrain.md"
    page.write_text(report.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(report, "PAGE", page)
    rows = [{"scene": "stairs", "ours": {"f64 default": OURS}, "theirs": {"MuJoCo own": THEIRS}}]
    came_from = {"cpu": "a CPU", "cpu_level": "avx512", "utc": "2026-01-01T00:00", "load_average": 0.5}
    before = section_of(page, "times avx2")
    report.update_page(rows, came_from)
    assert "a CPU, CPU level avx512, 2026-01-01, load 0.5." in section_of(page, "times avx512")
    assert section_of(page, "times avx2") == before
    with pytest.raises(ValueError, match=r"terrain\.md has no table for the CPU level 'baseline': set STEPPER_CPU_LEVEL to avx2 or avx512"):
        report.update_page(rows, came_from | {"cpu_level": "baseline"})

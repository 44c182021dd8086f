"""Progress and seed of a sweep on the command line."""

import pytest
import stepper
from stepper.cli import main
from stepper.lab import Outcome, Parameter, Study

BOX = """<mujoco><option timestep=".01"/><worldbody><body name="box"><joint name="slide" type="slide" axis="1 0 0"/>
  <geom size=".1" mass="1"/></body></worldbody><actuator><motor name="push" joint="slide"/></actuator></mujoco>"""
STUDY = f"""
import stepper
study = stepper.lab.Study(model={BOX!r}, name="box", controller="random", seconds=0.1, episodes=2, seed=11,
    outcomes=stepper.lab.Outcome(name="x", measure="joint slide"), parameters={{"m": stepper.lab.Parameter("body_mass[box]", low=1, high=2),
    "g": stepper.lab.Parameter("gravity[0]", low=-1, high=1)}})
"""


def push(now):
    return [[1.0]] * now.num_envs


def cliffs_of(tmp_path, high, resolution=1e-3):
    """Ticks of a sweep whose success ends between two levels of each of two parameters."""
    study = Study(
        model=BOX, name="box", controller=push, seconds=0.2, episodes=1,
        outcomes=Outcome(name="x", measure="joint slide", success=">= 0.012"),
        parameters={name: Parameter("body_mass[box]", low=1.0, high=high) for name in ("one", "other")},
    )  # fmt: skip
    ticks = []
    found = stepper.lab.sweep(study, tmp_path, resolution=resolution, progress=lambda what, done: ticks.append((what, done)))
    return found.sweep.cliffs, [done for what, done in ticks if what.startswith("cliffs")]


@pytest.mark.parametrize(("high", "resolution"), [(3.0, 1e-3), (3.0, 0.2), (2.5, 1e-6)])
def test_the_search_of_all_cliffs_ends_once(tmp_path, high, resolution):
    cliffs, told = cliffs_of(tmp_path, high, resolution)
    assert len(cliffs) == 2
    assert told == sorted(told)
    assert told.count(1.0) == 1
    again, told = cliffs_of(tmp_path, high, resolution)  # Everything is in the journal.
    assert again == cliffs
    assert told == sorted(told)
    assert told.count(1.0) == 1


def test_a_sweep_without_cliffs_tells_nothing_of_them(tmp_path):
    assert cliffs_of(tmp_path, 1.1) == ((), [])


@pytest.mark.parametrize("command", ["sweep", "rank"])
def test_the_seed_is_printed_and_can_be_chosen(tmp_path, capsys, monkeypatch, command):
    pytest.importorskip("typer", reason="typer, which the command line needs, is not installed")
    file = tmp_path / "box.py"
    file.write_text(STUDY)
    few = ["--samples", "2"] if command == "rank" else ["--no-cliffs"]
    tables = []
    for folder, given, said in (("a", [], "box: seed 11, of the study"), ("b", [], "box: seed 11"), ("c", ["--seed", "3"], "box: seed 3")):
        monkeypatch.setattr("sys.argv", ["stepper", command, str(file), "--out", str(tmp_path / folder), *few, *given])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code in (0, None)
        assert said in capsys.readouterr().err
        tables.append(next((tmp_path / folder / "box").glob("*able.csv")).read_text())
    assert tables[0] == tables[1]
    assert tables[0] != tables[2]

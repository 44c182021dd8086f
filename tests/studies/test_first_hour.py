"""Studies as newcomers write them: modules side by side, functions named by text, misspelt names."""

import csv
import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from checks import raises
from stepper.cli import app, main
from stepper.cli.app import COMMANDS, application
from stepper.lab import Outcome, Parameter, PolicyController, Study, sweep
from stepper.lab.demo import Plan, demo
from stepper.lab.study.batches import USUAL, running, world_of
from stepper.lab.study.controllers import digest_of, load_file
from stepper.policies import evaluate
from study_keys import PARTS, attributes, keys
from typer.testing import CliRunner

FURNITURE = """<mujoco><worldbody>
  <body name="shelf" pos="0 0 2"><geom type="box" size=".1 .1 .1" mass="3"/></body>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".05" mass="0.5"/></body>
</worldbody></mujoco>"""
PENDULUM = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 1 0" damping=".1"/><geom size=".02" pos=".3 0 0" mass=".1"/>
  </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
FUNCTIONS = {
    "controller is drive(now, dt), must take 1 argument, now: write def drive(now)": {"controller": lambda now, dt: 0.0},
    "controller is drive(), must take 1 argument, now: write def drive(now)": {"controller": lambda: 0.0},
    "start is drive(now), must take 2 arguments, now, rngs: write def drive(now, rngs)": {"start": lambda now: None},
    "model is drive(name), must take no arguments: write def drive()": {"model": lambda name: PENDULUM},
}
ROOT = Path(__file__).parents[2]


def study(**given: object) -> Study:
    """Study of a ball that falls beside a shelf with mass."""
    return Study(model=FURNITURE, seconds=0.1, outcomes=[Outcome(name="height", measure="body ball z", success=">= 0.5")], **given)


def test_a_start_that_is_text_is_refused_at_once():
    raises(TypeError, "only in TOML files", study, start="cup.py:start")


def test_a_study_imports_a_module_of_its_folder(tmp_path: Path):
    (tmp_path / "shelf_of_a_newcomer.py").write_text(f"SCENE = '''{FURNITURE}'''\n")
    file = tmp_path / "study_of_a_newcomer.py"
    file.write_text("import shelf_of_a_newcomer\nSCENE = shelf_of_a_newcomer.SCENE\n")
    assert load_file(file).SCENE == FURNITURE


def test_a_change_of_a_module_beside_a_study_changes_its_digest(tmp_path: Path):
    """Rows of the journal would be stale otherwise."""
    gains, deeper, file = (tmp_path / f"{name}_of_a_newcomer.py" for name in ("gains", "deeper", "controller"))
    deeper.write_text("KP = 1.0\n")
    gains.write_text("from deeper_of_a_newcomer import KP\n")
    file.write_text("import numpy\nimport gains_of_a_newcomer\ndef drive(now):\n    return gains_of_a_newcomer.KP\n")
    drive = load_file(file).drive
    found = digest_of(drive)
    assert digest_of(drive) == found
    deeper.write_text("KP = 2.0\n")
    assert digest_of(drive) != found


def jerk(now):
    """Random torques, N m, between -1 and 1."""
    return now.rng("jerk").uniform(-1.0, 1.0, 1)


def jerked(**given):
    """Pendulum with random torques."""
    return Study(model=PENDULUM, controller=jerk, seconds=0.1, outcomes=Outcome(name="angle", measure="joint hinge"), **given)


def test_random_numbers_of_a_controller_depend_on_seed_and_episode_alone(tmp_path: Path):
    masses = {"mass": Parameter("body_mass[arm]", low=0.1, high=0.2, values=(0.1, 0.2))}
    study = jerked(parameters=masses, episodes=3)
    angles = [study.episode({"mass": 0.1}, k)["outcomes"]["angle"] for k in range(3)]
    assert len(set(angles)) == 3
    for batch in (1, 256):
        rows = sweep(replace(study, batch=batch), tmp_path / str(batch)).sweep.table
        assert rows["outcome.angle"][rows["parameters.mass"] == 0.1].tolist() == angles
    assert study.episode({"mass": 0.1}, 0, seed=1)["outcomes"]["angle"] not in angles


def test_random_numbers_differ_by_name_and_control_period_and_repeat_within_one():
    world, seen = world_of(jerked(), USUAL, [{}, {}]), []
    for _ in running(jerked(), world, [0, 1]):
        one, again, other = (world.rng(name).uniform(0.0, 1.0, 2) for name in ("gust", "gust", "noise"))
        np.testing.assert_array_equal(one, again)
        seen += [one, other]
    # 2 environments, 2 numbers for each name and control period: all differ, with 53 bits each.
    numbers = np.array(seen)
    assert len(np.unique(numbers)) == numbers.size == 6 * 2 * 4


def test_random_numbers_are_the_same_in_mujoco_and_at_other_time_steps():
    study = jerked(control=0.02, settings={"MuJoCo": {"engine": "mujoco"}, "short": {"timestep": 0.001}})
    drawn = {}
    for setting in (USUAL, *study.settings):
        world = world_of(study, setting, [{}])
        drawn[setting] = [world.rng("jerk").normal(1).item() for _ in running(study, world, [4])]
    assert drawn[USUAL] == drawn["MuJoCo"] == drawn["short"]
    by_step = world_of(study, "short", [{}])
    assert [by_step.rng("jerk").normal(1).item() for looks in running(study, by_step, [4], by_step=True) if looks] == drawn["short"]


REACH = """
model = "arm.xml"
seconds = 0.1
episodes = 2
[[outcomes]]
name = "angle"
measure = "joint hinge"
success = "<= 0.2"
[parameters.friction]
selector = "dof_frictionloss"
operation = "add"
low = 0.0
high = 0.5
[parameters.lost]
selector = "dof_damping"
low = 0.0
high = 0.5
"""


@pytest.fixture
def reach(tmp_path, monkeypatch):
    """Folder of a study in reach.toml, as the working directory."""
    (tmp_path / "arm.xml").write_text(PENDULUM)
    (tmp_path / "reach.toml").write_text(REACH)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def failed(capsys, monkeypatch, *words: str) -> str:
    """Last line on stderr of a command that fails."""
    monkeypatch.setattr("sys.argv", ["stepper", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    return capsys.readouterr().err.partition("stepper: ")[2]


@pytest.mark.parametrize(("text", "hint"), [
    ("body_mas[arm]=0.5..2", "did you mean body_mass"),
    ("body_mas", "did you mean body_mass"),
    ("actuator_kpp[motor]=1..2", "did you mean actuator_kp"),
    ("actuatr.delay[motor]=0..1", "did you mean actuator?"),
    ("frition", "did you mean friction?"),
])  # fmt: skip
@pytest.mark.usefixtures("reach")
def test_a_misspelt_field_is_corrected(capsys, monkeypatch, text, hint):
    assert hint in failed(capsys, monkeypatch, "sweep", "reach.toml", "--parameter", text)


@pytest.mark.parametrize(("values", "told"), [
    (["body_mass[arm]=1", "body_mass[arm]=2"], "'body_mass[arm]' twice, as 1 and as 2"),
    (
        ["body_mass[arm]=1", "body_mass[*]=2"],
        "parameters has 'body_mass[arm]' and 'body_mass[*]', which set the same number of body_mass to 1 and to 2",
    ),
    (
        ["lost=0.1", "dof_damping[hinge]=0.2"],
        "parameters has 'lost' and 'dof_damping[hinge]', which set the same number of dof_damping",
    ),
])  # fmt: skip
@pytest.mark.parametrize("command", [["view", "reach.toml", "--record", "run"], ["chart", "reach.toml", "--quick"]])
@pytest.mark.usefixtures("reach")
def test_two_values_of_one_number_are_an_error_that_names_both(capsys, monkeypatch, command, values, told):
    assert told in failed(capsys, monkeypatch, *command, *(word for value in values for word in ("--values", value)))


def test_values_that_do_not_contradict_each_other_are_taken(reach):
    study = Study.from_file(reach / "reach.toml")
    # "friction" adds to the number, so that both apply; equal values agree.
    for values in ({"friction": 0.1, "dof_frictionloss[hinge]": 0.2}, {"lost": 0.1, "dof_damping": 0.1}, {"lost": 0.1, "friction": 0.1}):
        assert study.episode(values)["parameters"].keys() == values.keys()


@pytest.mark.usefixtures("reach")
def test_a_ranking_of_parameters_of_the_same_number_names_both(capsys, monkeypatch):
    words = ["rank", "reach.toml", "--parameter", "body_mass[arm]=1..2", "--parameter", "body_mass[*]=1..3"]
    assert "parameters has 'body_mass[arm]' and 'body_mass[*]', which set the same number of body_mass: give" in failed(
        capsys, monkeypatch, *words
    )


ERRORS = {
    # Text of a study file, and the lines of the message.
    "from stepper.lab import Study\n\ndef twice(x):\n    return 2 * x['b']\n\nstudy = Study(model='arm.xml', seconds=twice({'a': 1}))\n": [
        "bad.py, line 4, in twice: KeyError: 'b'",
        "  bad.py, line 6: study = Study(model='arm.xml', seconds=twice({'a': 1}))",
        "  bad.py, line 4, in twice: return 2 * x['b']",
    ],
    "from stepper.lab import Outcome, Study\n\ndef drive(now):\n    return now.qpoz\n\n"
    "study = Study(model='arm.xml', seconds=0.1, controller=drive, outcomes=Outcome(name='a', measure='joint hinge'))\n": [
        "bad.py, line 4, in drive: AttributeError: a stepper.lab.World has no attribute 'qpoz'; did you mean qpos?",
        "  bad.py, line 4, in drive: return now.qpoz",
    ],
    "import numpy\nx = (\n": ["bad.py, line 2: SyntaxError: '(' was never closed", "  bad.py, line 2: x = ("],
    "import numpy, no_such_module\n": [
        "bad.py, line 1: ModuleNotFoundError: No module named 'no_such_module'",
        "  bad.py, line 1: import numpy, no_such_module",
    ],
    "import stepper\nstudy = stepper.lab.Study(model='arm.xml', secs=1)\n": [
        "bad.py, line 2: TypeError: Study.__init__() got an unexpected keyword argument 'secs'",
        "  bad.py, line 2: study = stepper.lab.Study(model='arm.xml', secs=1)",
    ],
}


@pytest.mark.parametrize(("text", "lines"), ERRORS.items(), ids=[lines[0].rpartition("Error")[0].split()[-1] for lines in ERRORS.values()])
def test_an_exception_in_a_study_file_is_shown_with_its_lines_alone(reach, capsys, monkeypatch, text, lines):
    (reach / "bad.py").write_text(text)
    assert failed(capsys, monkeypatch, "sweep", "bad.py").splitlines() == lines


def test_an_exception_in_the_controller_of_a_toml_file_names_its_line(reach, capsys, monkeypatch):
    (reach / "control.py").write_text("import numpy as np\n\ndef control(now):\n    return np.zeros(now.num_envs) @ np.zeros((2, 3))\n")
    (reach / "reach.toml").write_text('controller = "control.py:control"\n' + REACH)
    assert failed(capsys, monkeypatch, "sweep", "reach.toml").startswith("control.py, line 4, in control: ValueError: ")


@pytest.mark.parametrize("message", FUNCTIONS)
def test_a_function_of_a_study_with_other_arguments_is_named_with_its_signature(message):
    (function,) = FUNCTIONS[message].values()
    function.__name__ = "drive"
    raises(TypeError, re.escape(message), Study, **{"model": PENDULUM} | FUNCTIONS[message])


def test_a_function_of_an_outcome_or_a_policy_with_other_arguments_is_named():
    with pytest.raises(TypeError, match=r"outcome 'a': measure is <lambda>\(\), must take 1 argument, now: write lambda now: ..."):
        Outcome(name="a", measure=lambda: 0)
    raises(TypeError, "outcome 'a': measure is 3, must be a function of now", Outcome, name="a", measure=3)
    raises(TypeError, r"act is <lambda>\(a, b\), must take 1 argument, observations", PolicyController, lambda a, b: a)
    raises(TypeError, r"policy is <lambda>\(\), must take 1 argument, observations", evaluate, lambda: 0, "stepper/InvertedPendulum-v5")


@pytest.mark.parametrize(("start", "message"), [
    (lambda now, rngs: now.qpos, r"start returned ndarray of shape \(1, 1\), must return qpos \(1, 1\) and qvel \(1, 1\), one row per"),
    (lambda now, rngs: (np.zeros(1), np.zeros(1)), r"start returned \(1,\) and \(1,\), must return qpos \(1, 1\)"),
    (lambda now, rngs: None, r"start returned NoneType of shape \(\), must return"),
])  # fmt: skip
def test_a_wrong_result_of_start_is_named(start, message):
    raises(ValueError, message, lambda: jerked(start=start, episodes=2).episode())


def test_the_error_for_a_period_shorter_than_the_time_step_names_possible_ones():
    with pytest.raises(
        ValueError, match=r"period, 0.0003 s: choose a time step of 0.0003, 0.00015 s|of 0.00015, 0.0003 s|of 0.0003 s, or a"
    ):
        jerked(control=0.0003).episode()


@pytest.mark.parametrize(("shape", "told"), [
    ("(3, 3)", "the controller control.py:control returned the shape (3, 3), must be (num_envs, nu), which is ("),
    ("now.num_envs", "or None; controls[:, None] has this shape\n"), ("(1, now.num_envs)", "or None; controls.T has this shape\n"),
])  # fmt: skip
def test_controls_of_another_shape_name_the_controller_and_the_remedy(reach, capsys, monkeypatch, shape, told):
    (reach / "control.py").write_text(f"import numpy as np\n\ndef control(now):\n    return np.zeros({shape})\n")
    (reach / "reach.toml").write_text('controller = "control.py:control"\n' + REACH)
    assert told in failed(capsys, monkeypatch, "sweep", "reach.toml", "--no-cliffs")


def test_environments_of_a_batch_share_the_options_of_the_step():
    steps = {"step": Parameter("options.timestep", values=(0.001, 0.002))}
    message = "parameter 'step' is 0.001 in environment 0 and 0.002 in environment 2: it is an option of the step, which the environments"
    raises(ValueError, message, lambda: world_of(jerked(parameters=steps), USUAL, [{"step": 0.001}, {"step": 0.001}, {"step": 0.002}]))


def test_an_exception_without_a_file_of_the_user_keeps_its_traceback(monkeypatch):
    monkeypatch.setattr(app, "application", lambda: partial(exec, "1 / 0"))
    with pytest.raises(ZeroDivisionError):
        main()


def test_the_command_sweeps_two_parameters_at_other_values_of_the_others(reach, capsys, monkeypatch):
    words = ["sweep", "reach.toml", "--parameter", "lost", "--parameter", "body_mass[arm]=0.2..0.4", "--no-cliffs"]
    monkeypatch.setattr("sys.argv", ["stepper", *words, "--values", "friction=0.1", "--values", "gravity[2]=-3.7"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0, capsys.readouterr().err
    with (reach / "out/reach/table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["parameters.friction"] for row in rows} == {"0.1"}
    assert {row["parameters.gravity[2]"] for row in rows} == {"-3.7"}
    # Two episodes at the nominal point and at five values of each.
    assert len(rows) == 2 * (1 + 5 + 5)
    assert len({row["parameters.lost"] for row in rows}) == len({row["parameters.body_mass[arm]"] for row in rows}) == 6


@pytest.mark.parametrize("name", COMMANDS)
def test_paths_in_help_exist(name):
    told = CliRunner().invoke(application(), [name, "--help"], env={"COLUMNS": "4000", "TERM": "dumb"})
    assert told.exit_code == 0, told.output
    paths = set(re.findall(r"(?<![\w/])((?:examples|docs|benches|python|tests)/[\w./-]*\w)", told.output))
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("kind", [kind for _, kind in PARTS])
def test_each_key_has_a_description(kind):
    assert [field.name for field in keys(kind)] == list(attributes(kind))


pytest.importorskip("dm_control")


def test_the_demo_prints_the_table_of_all_engines(tmp_path, capsys):
    demo(Plan(num_envs=8, steps=2, rest=1, chunk=1), tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert [cell.strip() for cell in lines[0].split("|")[2:-1]] == [
        "stepper f64",
        "stepper f32",
        "MuJoCo implicitfast, elliptic",
        "MuJoCo defaults",
    ]
    assert next(line for line in lines if line.startswith("| environments")).split("|")[2:-1] == [" 8 ", " 8 ", " 2 ", " 2 "]
    figures = json.loads((tmp_path / "demo.json").read_text())
    assert figures["engines"]["stepper f64"]["solver_statistics"]["rest"]["env_steps"] == 8

"""Runs that take too long or are not finite: what they have seen counts, and their rows say why they ended."""

import math
import time
from dataclasses import replace

import matplotlib.figure
import numpy as np
import pytest
import stepper
from stepper.cli import main
from stepper.lab import Outcome, Parameter, Study
from stepper.lab.accuracy import measure as measured
from stepper.lab.accuracy.candidates import Line
from stepper.lab.accuracy.measure import ChartBasis, measure
from stepper.lab.accuracy.reference import converge
from stepper.lab.accuracy.traces import Distance, run
from stepper.lab.study.failure_causes import DIVERGED
from stepper.lab.study.parameters import check_effects

BALL = """<mujoco><option timestep=".005"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .12"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
MIDPOINT = Line("stepper", "midpoint", {"contact": "hard", "integrator": "midpoint"}, "hard")
BOX = """<mujoco><option timestep=".01"/><worldbody><body name="box"><joint name="slide" type="slide" axis="1 0 0"/>
  <geom size=".1" mass="1"/></body></worldbody><actuator><motor name="push" joint="slide"/></actuator></mujoco>"""
STUDY = f"""
import stepper
study = stepper.lab.Study(model={BOX!r}, name="box", controller="random", seconds=0.1, episodes=2, seed=11,
    outcomes=stepper.lab.Outcome(name="x", measure="joint slide"), parameters={{"m": stepper.lab.Parameter("body_mass[box]", low=1, high=2),
    "g": stepper.lab.Parameter("gravity[0]", low=-1, high=1)}})
"""


class Clock:
    """A clock that goes on by a tenth of a second whenever it is read."""

    def __init__(self):
        self.now = 1000.0

    def time(self):
        self.now += 0.1
        return self.now


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(time, "process_time", made.time)
    return made


def ball(**changed):
    return stepper.lab.Study.from_model(BALL, name="ball", seconds=0.2, qvel_noise=0.1, controller=None, **changed)


def test_a_run_that_the_clock_stops_has_what_it_saw(clock):
    study = ball()
    whole = run(study, range(2))
    # Between steps the clock goes on by a tenth: the end comes after some controls of four steps each.
    part = run(study, range(2), patience=2.5)
    assert part.stopped
    assert not whole.stopped
    assert 0 < len(part.time) < len(whole.time)
    np.testing.assert_array_equal(part.points, whole.points[: len(part.time)])
    assert part.finite.all()
    early, late = Distance("m", part.reached), Distance("m", 0.2)
    np.testing.assert_array_equal(early(part, whole), 0.0)
    assert np.isnan(late(part, whole)).all()


def test_steps_one_by_one_are_those_of_a_control():
    """A run with a limit looks at the clock between steps, and is the same to the bit."""
    np.testing.assert_array_equal(run(ball(), range(2), patience=1e6).points, run(ball(), range(2)).points)


def test_what_is_run_for_its_beginning_alone_has_no_outcome():
    part = run(ball(outcomes=stepper.lab.Outcome(name="height", measure="body ball z")), range(2), until=0.1)
    assert part.reached == pytest.approx(0.1)
    assert not part.stopped
    assert np.isnan(part.outcomes["height"]).all()


def test_an_episode_that_is_not_finite_is_over(tmp_path):
    """A servo of negative stiffness: numbers grow until there are none."""
    wild = """<mujoco><option timestep=".02" integrator="Euler"/><worldbody><body><joint name="j"/><geom size=".1" pos=".1 0 0"/></body>
      <body pos="3 0 0"><joint name="k"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
      <actuator><general joint="j" biastype="affine" biasprm="0 1e7 1e6"/></actuator></mujoco>"""
    study = stepper.lab.Study.from_model(
        wild,
        seconds=1.0,
        controller=None,
        qvel_noise=0.0,
        # The first episode begins at the joint's zero, where nothing grows.
        start=lambda now, rng: (np.array([[0.0, 0.1], [0.1, 0.1]]), np.zeros((2, 2))),
        outcomes=stepper.lab.Outcome(name="other", measure="joint k", success=">= -9"),
    )
    for engine in ("stepper", "mujoco"):
        settings = {"integrator": "euler"} | ({"engine": engine} if engine == "mujoco" else {})
        trace = run(study, range(2), **settings)
        assert trace.finite.tolist() == [True, False]
        assert not trace.stopped
        # What the engine does with the other joint after that, a reset say, is no success.
        assert np.isfinite(trace.outcomes["other"]).tolist() == [True, False]
        assert Distance("m", 1.0)(trace, trace).tolist() == [0.0, math.inf]


def test_rows_say_what_was_stopped(monkeypatch):
    """Short time steps take more than the limit; the row then has the reason in place of a number."""
    study, distance = replace(ball(), threads=1), Distance("m", 0.1)
    right = converge(study, range(2), distance, target=1e-3, most=2)
    monkeypatch.setattr(measured, "patience", lambda study, of, timestep, **_: 0.0 if timestep < 0.005 else math.inf)
    found, skipped, _ = measure(ChartBasis(study, range(2), distance, right, 2), [MIDPOINT], [0.005, 0.0025, 0.001], lambda *_: None)
    assert not skipped
    assert [any("stopped after" in note for note in point.notes) for point in found] == [False, True, True]
    assert [bool(np.isfinite(point.errors["total"]).all()) for point in found] == [True, False, False]


def test_labels_of_a_chart_are_no_wider_than_their_panels(tmp_path, monkeypatch):
    save, found = matplotlib.figure.Figure.savefig, []

    def look(figure, path, **settings):
        save(figure, path, **settings)
        if not found:
            for panel in figure.axes[:2]:
                label, frame = panel.xaxis.label.get_window_extent(), panel.get_window_extent()
                found.append((label.x0 - frame.x0, frame.x1 - label.x1))

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", look)
    stepper.lab.chart(ball(), tmp_path, quick=True, episodes=2, horizon=0.1)
    assert min(margin for pair in found for margin in pair) >= 0


# Episodes that an engine loses: a state that is not finite, or MuJoCo that begins anew by itself. They are no success of anyone.

# MuJoCo's Euler rule takes a spring explicitly: its oscillation grows where kp dt^2 / I is above 4, and it is 4000 here. Stepper's midpoint
# rule takes it implicitly.
STIFF = """<mujoco model="stiff"><option timestep=".002"/><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/>
  <geom size=".01" pos="0 0 -.1" mass=".1"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="1e6"/></actuator></mujoco>"""
MEASURES = (
    stepper.lab.Outcome(name="angle", measure="joint hinge", success="> -1e9"),
    stepper.lab.Outcome(name="widest", measure="joint hinge", reduce="max"),
)


def study(**changed):
    """Whatever is finite is a success."""
    given = {"model": STIFF, "name": "stiff", "outcomes": MEASURES, "seconds": 0.1, "episodes": 3, "qvel_noise": 0.1}
    servo = stepper.lab.Parameter("actuator_kp", operation="scale", low=0.9, high=1.1)
    mass = stepper.lab.Parameter("body_mass", operation="scale", low=0.9, high=1.1)
    engines = {"MuJoCo": {"engine": "mujoco"}, "finer": {"engine": "mujoco", "timestep": 1e-5}}
    return stepper.lab.Study(**(given | {"parameters": {"stiffness": servo, "mass": mass}, "settings": engines} | changed))


def runaway(now):
    """Torque along the velocity, which each control makes many times as much."""
    return 1e4 * now.read("qvel", "hinge")


def test_episodes_that_mujoco_begins_anew_are_failures_of_physics(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = stepper.lab.report(study(parameters={}), tmp_path)
    lost = [row for row in found.sweep.table.rows if row["setting"] == "MuJoCo"]
    assert [row["success"] for row in lost] == [False] * 3
    assert all(math.isnan(value) for row in lost for value in row["outcomes"].values())
    assert {(v.row["setting"], v.cause, v.rule) for v in found.verdicts if v.row["setting"] == "MuJoCo"} == {
        ("MuJoCo", "physics", DIVERGED)
    }
    counts = {level.setting: (level.successes, level.unsolved, level.diverged) for level in found.sweep.levels}
    assert counts.items() >= {"stepper": (3, 0, 0), "finer": (3, 0, 0), "MuJoCo": (0, 3, 3)}.items()
    told = str(found)
    assert "Diverged, and so no success: 3 with MuJoCo" in told
    assert f"| physics | {DIVERGED} |" in told
    # MuJoCo's own handler writes there.
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_episodes_that_stepper_loses_are_failures_of_physics(tmp_path):
    """Euler's rule goes on until a step is not finite, and keeps the state before it, which is a success by its number."""
    spring = STIFF.replace("position", "motor").replace(' kp="1e6"', "")
    found = stepper.lab.report(
        study(model=spring, controller=runaway, parameters={}, settings={}, options=stepper.Options(integrator="euler"), seconds=1.0),
        tmp_path,
    )
    assert {(v.cause, v.rule) for v in found.verdicts if v.row["setting"] in ("stepper", "MuJoCo")} == {("physics", DIVERGED)}
    assert {level.setting: level.diverged for level in found.sweep.levels}.items() >= {"stepper": 3, "MuJoCo": 3}.items()


def test_the_mean_is_of_the_episodes_that_went_on(tmp_path):
    """Those of even numbers are driven away."""
    spring = STIFF.replace("position", "motor").replace(' kp="1e6"', "")
    settings = {"parameters": {}, "settings": {}, "options": stepper.Options(integrator="euler"), "seconds": 1.0}
    given = study(model=spring, controller=lambda now: np.where(now.episodes[:, None] % 2 == 0, runaway(now), 0.0), **settings)
    found = stepper.lab.sweep(given, tmp_path)
    (level,) = found.sweep.levels
    assert (level.successes, level.diverged, level.episodes) == (1, 2, 3)
    assert level.mean == found.sweep.table["outcome.angle"][1]
    assert level.change[0] == 0.0
    # What stands still, or begins anew, is infinitely far from everything.
    trace = run(given, range(3))
    assert np.isinf(Distance("m", 1.0)(trace, trace)).tolist() == [True, False, True]


def test_a_ranking_counts_or_names_them(tmp_path):
    ranked = study(episodes=1, settings={"MuJoCo": {"engine": "mujoco"}})
    with pytest.raises(ValueError, match=r"as many episodes succeed at all 8 points, 0% of them"):
        stepper.lab.rank(ranked, tmp_path, samples=2, setting="MuJoCo")
    angle = stepper.lab.Outcome(name="angle", measure="joint hinge")
    with pytest.raises(ValueError, match=r"angle is not finite in 8 of 8 episodes \(8 of them diverged\)"):
        stepper.lab.rank(study(episodes=1, outcomes=angle), tmp_path / "number", samples=2, setting="MuJoCo")
    # About the stiffness with which the spring of MuJoCo's Euler rule begins to grow: 4 I / dt^2.
    edge = STIFF.replace('kp="1e6"', f'kp="{4 * 0.1 * 0.1**2 / 0.002**2}"')
    found = stepper.lab.rank(study(model=edge, episodes=1, seconds=2.0), tmp_path / "edge", samples=4, setting="MuJoCo")
    lost = int(np.isnan(found.table["outcome.angle"]).sum())
    assert 0 < lost < 16
    assert f"{lost} of 16 episodes diverged, and count as failures" in str(found)


@pytest.mark.parametrize("setting", ["stepper", "MuJoCo"])
def test_controls_that_are_not_finite_are_the_drives(setting):
    def late(now):
        return np.where(now.time < 0.05, 0.0, np.where(now.episodes == 1, np.nan, 0.0))[:, None]

    given = study(model=STIFF.replace("1e6", "1"), controller=late, settings={"MuJoCo": {"engine": "mujoco"}})
    with pytest.raises(ValueError, match=r"late gives actuator 'servo' the control nan at 0\.06 s of episode 1: controls must be finite"):
        given.episode({}, 1, setting=setting)


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


MODEL = stepper.load("""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body><freejoint/><geom name="ball" size=".1"/></body>
</worldbody></mujoco>""")
VARIED = Parameter("geom_friction[*][0]", low=0.2, high=1.0)
ALL, FLOOR, BALL_FRICTION = (Parameter(f"geom_friction[{names}][0]", values=(0.3,), nominal=0.3) for names in ("*", "floor", "ball"))


@pytest.mark.parametrize(("later", "named"), [
    ({"all": ALL}, "because 'all' sets"),
    ({"one": FLOOR, "other": BALL_FRICTION}, "because 'one' and 'other' set"),
])  # fmt: skip
def test_what_sets_all_numbers_of_a_varied_parameter_after_it_is_named(later, named):
    with pytest.raises(ValueError, match=f"a sweep of 'friction' changes nothing, {named}"):
        check_effects(["friction"], {"friction": VARIED, **later}, MODEL)


@pytest.mark.parametrize("parameters", [
    {"friction": VARIED, "one": FLOOR},  # The ball's friction still varies.
    {"all": ALL, "friction": VARIED},  # The varied one applies last.
    {"friction": VARIED, "all": Parameter("geom_friction[*][0]", low=0.1, high=1.0)},  # It applies only where it is varied itself.
    {"friction": VARIED, "all": Parameter("geom_friction[*][0]", values=(0.3,), nominal=0.3, operation="scale")},
])  # fmt: skip
def test_what_leaves_an_effect_is_accepted(parameters):
    check_effects(["friction"], parameters, MODEL)

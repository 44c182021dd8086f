"""Charts and tunings: references that say how well they are known, errors by source, settings that keep a budget."""

import json
import math
import sys
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest
import stepper
from stepper.lab.accuracy.candidates import lines, pareto, timesteps
from stepper.lab.accuracy.costs import saving
from stepper.lab.accuracy.invariants import ANGULAR, CONSERVED, ENERGY, LIMITS, LOOPS, MOMENTUM, NORM, PENETRATION, Invariants
from stepper.lab.accuracy.measure import ChartBasis, chart_reference, measure
from stepper.lab.accuracy.reference import _assessed, converge
from stepper.lab.accuracy.traces import Distance, quantity, run
from stepper.lab.accuracy.tune import Candidate, Tuning, _compared, _lines
from typer.testing import CliRunner

PENDULUM = """<mujoco><option timestep=".005"/><worldbody><body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" contype="0" conaffinity="0"/>{child}</body></worldbody></mujoco>"""
SECOND = """<body pos=".5 0 0"><joint axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" contype="0" conaffinity="0"/></body>"""
# A ball that falls on a floor and rolls on, a second one far away, a sensor, and a hinge that stays far from its limits.
SCENE = """<mujoco><option timestep=".005"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .12"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
  <body name="far" pos="5 0 .1"><freejoint/><geom name="far" size=".1"/></body>
  <body name="arm" pos="0 3 1"><joint name="hinge" axis="0 1 0" range="-90 90"/>
  <geom name="arm" type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/></body></worldbody>
  <actuator><motor name="motor" joint="hinge" ctrlrange="-.02 .02"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
# Damping of 200 N m s/rad on an inertia of 0.05 kg m^2: a rule that takes it explicitly is stable below 0.5 ms alone.
STIFF = """<mujoco><option timestep=".005"/><worldbody><body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" contype="0" conaffinity="0"/></body></worldbody>
  <actuator><position joint="hinge" kp="2000" kv="200"/></actuator></mujoco>"""


def pendulum(**changed):
    given = {"model": PENDULUM.format(child=""), "name": "pendulum", "episodes": 2, "seconds": 0.5, "control": 0.02, "qvel_noise": 0.5}
    return stepper.lab.Study(**(given | changed))


def scene(**changed):
    return stepper.lab.Study.from_model(SCENE, name="scene", seconds=0.2, qvel_noise=0.1, **changed)


def test_a_smooth_motion_is_known_as_well_as_its_reference_says():
    """The estimate of a coarse reference is what it is away from a fine one."""
    study, distance = pendulum(model=PENDULUM.format(child=SECOND)), Distance("m", 0.5)
    coarse = converge(study, range(3), distance, target=1e-12, most=2)
    fine = converge(study, range(3), distance, target=1e-12, most=6)
    np.testing.assert_allclose(coarse.orders, 2.0, atol=0.05)
    assert coarse.extrapolates.all()
    true = distance(coarse.trace, fine.trace)
    # The estimate is of the leading term: within a tenth of the difference from a run with a sixteenth of the step.
    np.testing.assert_allclose(coarse.uncertainty, true, rtol=0.1)
    assert np.all(coarse.methods > coarse.uncertainty)
    assert "no extrapolation" not in coarse.words


def test_across_impacts_it_does_not_extrapolate_and_says_so():
    study = scene(controller=None)
    found = converge(study, range(4), Distance("m", 0.2), target=1e-9, most=4)
    assert not found.extrapolates.all()
    assert "no extrapolation in" in found.words
    finer = converge(study, range(4), Distance("m", 0.2), target=1e-9, most=8)
    # What is not extrapolated is the last difference: a bound in a sum of impacts up to their signs, so of the middle one alone.
    assert np.median(Distance("m", 0.2)(found.trace, finer.trace)) <= 2.0 * np.median(found.uncertainty)
    assert finer.uncertainty.max() < found.uncertainty.max()
    assert np.all(found.known <= 0.2 + 1e-12)


def test_where_the_second_method_is_not_finite_nothing_is_known():
    study, distance = pendulum(seconds=0.1), Distance("m", 0.1)
    runs = [run(study, range(2), timestep=dt) for dt in (0.01, 0.005, 0.0025)]
    lost = replace(runs[-1], points=runs[-1].points.copy())
    lost.points[:, 1] = np.nan
    found = _assessed(runs, [lost, lost], distance, 1e-3)
    assert np.isfinite(found.uncertainty[0])
    assert found.uncertainty[1] == math.inf


def test_where_eulers_rule_diverges_the_implicit_rule_judges():
    study, distance = pendulum(model=STIFF, seconds=0.1), Distance("m", 0.1)
    found = converge(study, range(2), distance, target=1e-5, most=2)
    assert not any(run(study, range(2), integrator="euler", timestep=own.timestep).finite.any() for own in found.runs[-2:])
    assert found.without == ("Euler's rule",)
    assert len(found.second) == 2
    assert "Euler's rule cannot check it" in found.words
    assert "the implicit rule differs" in found.words
    assert found.with_distance(Distance("m", 0.05)).words.count("the implicit rule differs") == 1
    # It is known, and as well as it says.
    finer = converge(study, range(2), distance, target=1e-12, most=6)
    assert np.all(distance(found.trace, finer.trace) <= 1.5 * found.uncertainty)
    assert found.uncertainty.max() < 1e-3


def test_a_rule_that_takes_too_long_is_no_judge(monkeypatch):
    monkeypatch.setattr(sys.modules["stepper.lab.accuracy.reference"], "patience", lambda *_: 0.0)
    found = converge(pendulum(seconds=0.1), range(2), Distance("m", 0.1), target=1e-5, most=2)
    assert found.second == ()
    assert "Euler's rule and the implicit rule cannot check it" in found.words
    assert "and there is no other method" in found.words
    assert np.isfinite(found.uncertainty).all()


def test_a_run_that_takes_too_long_is_stopped_and_told(tmp_path, monkeypatch):
    """As motions that blew up do, whose steps take as many iterations as there may be; here by a clock of its own."""
    for module in ("tune", "measure"):
        patience = lambda study, of, timestep, **_: 0.0 if timestep >= 0.005 else 60.0  # noqa: E731
        monkeypatch.setattr(sys.modules[f"stepper.lab.accuracy.{module}"], "patience", patience)
    found = stepper.lab.tune(scene(), tmp_path, error="0.5 mm", horizon="0.1 s", coverage=0.5, reduce=False)
    assert found.usual.stopped
    assert found.usual.error == math.inf
    assert found.chosen is not None
    assert found.chosen.settings["timestep"] < 0.005
    assert {own.stopped for own in found.candidates if own.settings["timestep"] >= 0.005} == {True}
    told = found.document.markdown()
    assert "With the study's own settings, episodes were stopped" in told
    assert "took far longer than the reference and had to be stopped" in told
    study, distance = replace(scene(), threads=1), Distance("m", 0.1)
    right = converge(study, range(2), distance, target=1e-3, most=2)
    points, _, _ = measure(ChartBasis(study, range(2), distance, right, 2), lines(study, quick=True)[:1], [0.005, 0.0025], lambda *_: None)
    assert "it takes more than 10 times as long as the converged run" in " ".join(points[0].notes)
    assert points[1].notes == ()


def test_distances_are_those_of_bodies_up_to_the_horizon():
    study = pendulum(seconds=0.2)
    one, other = run(study, [0]), run(replace(study, qvel_noise=0.6), [0])
    angle = np.abs(2 * np.arctan2(one.xquat[..., 2], one.xquat[..., 0]) - 2 * np.arctan2(other.xquat[..., 2], other.xquat[..., 0]))
    np.testing.assert_allclose(Distance("rad", 0.1)(one, other), angle[:5, :, 1].max(axis=0), rtol=1e-12)
    assert Distance("rad", 0.1)(one, other) < Distance("rad", 0.2)(one, other)
    # The body's frame is at the hinge, and the middle of its geom a quarter of a metre away: a chord.
    chord = 2 * 0.25 * np.sin(Distance("rad", 0.2)(one, other) / 2)
    np.testing.assert_allclose(Distance("m", 0.2)(one, other), chord, rtol=1e-9)


@pytest.mark.parametrize(("text", "value"), [("1 mm", (1e-3, "m")), ("0.5deg", (math.radians(0.5), "rad")), (" 2 cm ", (0.02, "m"))])
def test_quantities(text, value):
    assert quantity(text, name="error", units=("m", "rad")) == pytest.approx(value)


@pytest.mark.parametrize("text", ["1", "mm", "-1 mm", "0 mm", "1 s", "1e400 mm2", "1e400 mm", "one mm", 1.0, None])
def test_wrong_quantities_are_named(text):
    with pytest.raises(ValueError, match=f"error is {text!r}, must be a number above 0 with a unit"):
        quantity(text, name="error", units=("m", "rad"))


def test_a_chart_and_a_tuning_take_the_same_horizons(tmp_path):
    for horizon in ("100 ms", "0.1 s", 0.1, np.float64(0.1)):
        assert quantity(horizon, name="horizon", units=("s",)) == (pytest.approx(0.1), "s")
    for wrong in ("5", 0.0, -1, math.inf, math.nan, True, [1.0], "1 m"):
        with pytest.raises(ValueError, match=r"horizon is .*, must be a number above 0 with a unit"):
            stepper.lab.chart(scene(), tmp_path, horizon=wrong)
        with pytest.raises(ValueError, match=r"horizon is .*, must be a number above 0 with a unit"):
            stepper.lab.tune(scene(), tmp_path, error="1 mm", horizon=wrong)


def test_time_steps_divide_the_time_of_a_control_and_fronts_are_pareto():
    assert timesteps(pendulum(), coarser=2, finer=2) == [0.02 / 16, 0.02 / 8, 0.02 / 4, 0.02 / 2, 0.02]
    assert pareto([3, 1, 2, 4], [0.1, 1.0, 2.0, 0.1]) == [1, 0]


def test_a_chart_of_a_model_of_ones_own(tmp_path):
    found = stepper.lab.chart(scene(), tmp_path, quick=True, episodes=3, horizon=0.1)
    for name in ("chart.png", "chart.csv", "chart.html", "chart.md"):
        assert (tmp_path / "scene" / name).stat().st_size > 500
    assert found.skipped == ()
    assert {dot.engine for dot in found.dots} == {"stepper", "MuJoCo"}
    assert not any(dot.notes for dot in found.dots)
    for dot in found.dots:
        assert dot.us_single_env > 0
        assert dot.batch > 0
        parts = np.nansum([dot.solver, dot.step, dot.model])
        # Distances obey the triangle inequality; of medians of three episodes that is so within a factor of their number.
        assert dot.error <= 3 * parts + 1e-12
        # Table, page and picture have the same words.
        largest = np.nanargmax([dot.solver, dot.step, dot.model])
        assert dot.row["cause"] == dot.cause == ("solver", "time step", "model")[largest]
        assert dot.row["error from time step"] == dot.step
    assert "| from solver | from time step | from model | cause |" in found.document.markdown()
    hard = [dot for dot in found.dots if dot.engine == "stepper" and "law" not in dot.setting]
    assert all(dot.model == 0 for dot in hard)
    soft = [dot for dot in found.dots if dot.engine == "MuJoCo"]
    assert all(dot.model > 1e-5 for dot in soft)
    single = {dot.timestep: dot for dot in hard if dot.setting == "midpoint, f32"}
    double = {dot.timestep: dot for dot in hard if dot.setting == "midpoint"}
    # 2^-24 of metres, times steps and velocities; and the tolerance of 1e-4 m/s over 0.1 s.
    assert all(1e-9 < single[dt].solver < 1e-4 for dt in single)
    assert all(double[dt].solver < 1e-7 for dt in double)


@pytest.mark.parametrize("options", [stepper.Options(contact="mujoco"), stepper.Options(integrator="midpoint")])
def test_a_chart_has_both_laws_whatever_the_options_of_the_study(options):
    study = replace(scene(options=options), threads=1)
    distance, right = chart_reference(study, [0], 0.1, "m", 4)
    measured, skipped, _ = measure(ChartBasis(study, [0], distance, right, 4), lines(study, quick=True), [0.005], lambda *_: None)
    assert not skipped
    assert {point.line.law for point in measured if point.line.engine == "stepper"} == {"hard", "mujoco"}
    for point in measured:
        # Softness alone makes a tenth of a millimetre here; the converged runs of one law are one.
        if point.line.engine == "stepper":
            assert (point.errors["model"][0] > 1e-5) == (point.line.law != options.contact), point.line.label


def test_a_chart_has_eulers_rule_if_stepper_lacks_the_integrator_of_the_file():
    text = SCENE.replace("<mujoco>", '<mujoco><option integrator="discrete"/>')
    law = [line for line in lines(stepper.lab.Study.from_model(text, name="scene", seconds=0.2), quick=True) if line.law == "mujoco"]
    assert "MuJoCo's law, euler" in {line.name for line in law}


def test_a_tuning_keeps_its_budget_on_episodes_that_it_has_not_seen(tmp_path):
    found = stepper.lab.tune(scene(), tmp_path, error="0.5 mm", horizon="0.1 s", coverage=0.8, reduce=False)
    assert found.chosen is not None
    assert found.trials[-1].share >= 0.8
    assert found.chosen.error <= 5e-4
    assert found.chosen.batch == min(own.batch for own in found.candidates if own.error <= found.chosen.error)
    assert found.usual in found.candidates
    # Steps are tried that are no half of another: the longest that keeps the budget is between two that are.
    steps = [round(0.02 / own.settings["timestep"]) for own in found.candidates]
    assert all(0.02 / own.settings["timestep"] == pytest.approx(n) for own, n in zip(found.candidates, steps, strict=True))
    assert any(n & (n - 1) for n in steps)
    assert str(found.options.timestep) in found.document.markdown()
    study = replace(found.study, options=found.options, precision=found.precision)
    distance, fresh = Distance("m", 0.1), range(5000, 5040)
    right = converge(found.study, fresh, distance, target=5e-5)
    held = np.count_nonzero(distance(run(study, fresh), right.trace) <= 5e-4)
    # At least 80 % do, with the confidence of the tuning: fewer than 26 of 40 are as likely as one in a hundred if it were 80 %.
    assert held >= 26
    # NaN and Infinity are no JSON.
    told = json.loads((tmp_path / "scene/tune.json").read_text(), parse_constant=pytest.fail)
    assert {own["batch"] is None for own in told["candidates"]} == {True, False}
    assert told["settings"] == found.chosen.settings


def tuned(own, *others):
    """What a tuning to 1 mm found; settings are (error, cost), the study's own first."""
    candidates = [Candidate({"timestep": 0.002}, str(k), error, cost, cost) for k, (error, cost) in enumerate((own, *others))]
    kept = sorted(candidates, key=lambda one: (one.error > 1e-3, one.batch))
    given = dict.fromkeys((field.name for field in fields(Tuning)), None)
    given |= {"budget": 1e-3, "distance": Distance("m", 1.0), "usual": candidates[0], "candidates": tuple(kept)}
    return Tuning(**(given | {"chosen": kept[0]}))


def test_the_cost_of_the_own_settings_is_said_with_their_error():
    words = _compared(tuned((3e-3, 10.0), (0.8e-3, 5.0)), "batch")
    assert words == "The study's own settings take 10 us, 2.00 times as much; their error is 0.003 m."
    diverges = tuned((math.inf, math.nan), (0.8e-3, 5.0))
    assert _compared(diverges, "batch") == "With the study's own settings, an episode diverges."
    assert _compared(tuned((0.9e-3, 10.0)), "batch") == "These are the study's own settings."


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_the_own_settings_are_tried_in_both_precisions_and_nothing_is_tried_twice(precision):
    """A line that says nothing of its precision is of 64 bits in a study of 32 too."""
    tried = dict(_lines(scene(options=stepper.Options(integrator="euler", iterations=20), precision=precision)))
    other = {"f32": "f64", "f64": "f32"}[precision]
    assert (tried["the study's own"], tried[f"the study's own, {other}"]) == ({}, {"precision": other})
    assert not {"euler", "euler, f32"} & tried.keys()
    assert tried["midpoint"]["precision"] == "f64"
    assert {"midpoint, f32", "implicit", "rk4"} <= tried.keys()


def test_episodes_that_repeat_those_that_chose_prove_nothing(tmp_path):
    for study in (scene(controller=None), scene(controller=recorded(13))):
        count = 0 if study.controller is None else 1
        with pytest.raises(ValueError, match=f"scene: {count} of 17 held-out episodes are distinct"):
            stepper.lab.tune(replace(study, qvel_noise=0.0), tmp_path, error="1 mm", horizon="0.1 s", coverage=0.8)


def recorded(episodes):
    """Controls for some episodes, after which they repeat."""
    torques = np.random.default_rng(0).uniform(-0.02, 0.02, (episodes, 1))
    return lambda now: torques[now.episodes % episodes]


def test_a_budget_that_nothing_keeps_is_said(tmp_path):
    found = stepper.lab.tune(scene(), tmp_path, error="0.000001 um", horizon="0.2 s", reduce=False)
    assert found.chosen is None
    assert found.options is None
    assert "No settings are proved to keep the budget" in str(found)


@pytest.fixture
def saves(monkeypatch):
    """What taking something out saves, without a clock: a tenth, or what a test says."""
    told = {"share": (0.1, 0.05)}
    monkeypatch.setattr(sys.modules["stepper.lab.accuracy.needs"], "saving", lambda own, less, trace: told["share"])
    return told


def test_pairs_that_a_scene_does_not_need(tmp_path, saves):
    found = stepper.lab.tune(scene(), tmp_path, error="1 mm", horizon="0.1 s", coverage=0.5)
    # Balls and arm meet one another nowhere, nor does the arm the floor; both balls lie on the floor.
    assert (found.unused.count, found.unused.of, found.unused.error) == (4, 6, 0.0)
    assert stepper.load(tmp_path / "scene/smaller.stepper").nv == found.study.loaded[0].nv
    assert "smaller.stepper excludes them" in str(found)
    # What saves nothing, or perhaps nothing, stays.
    saves["share"] = (0.02, -0.01)
    found = stepper.lab.tune(scene(), tmp_path / "nothing", error="1 mm", horizon="0.1 s", coverage=0.5)
    assert found.unused.count == 4
    assert found.smaller is None
    assert not (tmp_path / "nothing/scene/smaller.stepper").exists()
    assert "They stay, because that saves nothing" in str(found)


def test_a_saving_is_timed():
    balls = "".join(f'<body pos="{x} 0 .1"><freejoint/><geom size=".1" {{masks}}/></body>' for x in range(12))
    floor = f'<mujoco><worldbody><geom type="plane" size="9 9 1"/>{balls}</worldbody></mujoco>'
    touching, falling = (scene(model=floor.format(masks=masks)) for masks in ("", 'contype="0" conaffinity="0"'))
    trace = run(touching, range(2))
    # Twelve contacts are more than the rest of the step, on whatever machine.
    median, least = saving((touching, {}), (falling, {}), trace)
    assert median >= least > 0.2
    median, least = saving((falling, {}), (touching, {}), trace)
    assert least <= median < 0


def test_the_commands_run(tmp_path, monkeypatch):
    from stepper.cli.app import application

    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.xml").write_text(SCENE)
    told = CliRunner().invoke(
        application(), ["tune", "scene.xml", "--error", "5 mm", "--horizon", "0.1 s", "--coverage", "0.5", "--no-reduce"]
    )
    assert told.exit_code == 0, told.output
    assert "stepper.Options(" in told.output
    assert (tmp_path / "out/scene/tune.html").exists()
    told = CliRunner().invoke(application(), ["explain", "scene.xml"])
    assert told.exit_code == 0
    assert not (tmp_path / "out/scene/explain.md").exists()
    told = CliRunner().invoke(application(), ["explain", "scene.xml", "--out", "out"])
    assert told.exit_code == 0, told.output
    written = {ending: (tmp_path / f"out/scene/explain.{ending}").read_text() for ending in ("html", "md", "json")}
    assert "<pre>" in written["html"]
    kept = json.loads(written["json"], parse_constant=pytest.fail)
    assert kept["model"] in told.output
    assert kept["model"].rstrip() in written["md"]
    for arguments in (["tune", "scene.xml", "--error", "5", "--horizon", "1 s"], ["chart", "scene.xm"], ["sweep", "scene.xml"]):
        told = CliRunner().invoke(application(), arguments)
        assert isinstance(told.exception, ValueError)


# Invariants of a chart: zero of right motions, what was put in of wrong ones, and why a scene does not have one.

SPACE = """<mujoco><option gravity="0 0 -3"/><worldbody><body><freejoint/><geom type="box" size=".1 .2 .05" contype="0" conaffinity="0"/>
  <body pos=".3 0 0"><joint name="elbow" axis="0 1 1"/><geom size=".1" pos=".2 0 0" contype="0" conaffinity="0"/></body></body></worldbody>
  {more}</mujoco>"""
MOTOR = '<actuator><motor joint="elbow" ctrlrange="-3 3"/><position joint="elbow" kp="2" ctrlrange="-1 1"/></actuator>'
FLOOR = """<mujoco><worldbody><geom type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .3"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
LOOP = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" range="-10 10"/><geom size=".1" pos=".2 0 0"/></body>
  <body name="b" pos="2 0 0"><joint name="s" type="slide" axis="1 0 0" range="-.1 .1"/><geom size=".1"/></body>
  <body name="c" pos="4 0 0"><freejoint/><geom size=".1"/></body></worldbody>
  <equality><weld body1="c" torquescale="0.5"/></equality></mujoco>"""


def study(model, **changed):
    return stepper.lab.Study.from_model(model, **({"seconds": 0.4, "qvel_noise": 1.0, "controller": None} | changed))


def moved(trace, qpos=0.0, qvel=0.0):
    """A run with configurations and velocities that are wrong by something."""
    return replace(trace, path=(trace.path[0] + qpos, trace.path[1] + qvel))


@pytest.mark.parametrize("more", ["", MOTOR])
def test_energy_and_momentum_of_a_right_motion_are_kept(more):
    """Of second order for the midpoint rule, in stepper; the work of motors and servos is the ruler's."""
    own = study(SPACE.format(more=more), controller="random" if more else None)
    found = Invariants(own)
    assert found.kinds == [NORM, CONSERVED, MOMENTUM, ANGULAR]
    assert not found.left_out
    errors = [found.measure(run(own, range(3), timestep=dt, tolerance=1e-10)) for dt in (0.004, 0.002, 0.001)]
    for kind in (CONSERVED, MOMENTUM, ANGULAR):
        coarse, middle, fine = (error[kind].max() for error in errors)
        # A rule of second order leaves a quarter at half the step; a fifth more or less, as leading terms do.
        assert 3.2 < coarse / middle < 4.8
        assert 3.2 < middle / fine < 4.8
    # MuJoCo's Euler is of first order, and looked at in the same way.
    peers = [found.measure(run(own, range(3), engine="mujoco", timestep=dt)) for dt in (0.002, 0.001)]
    for kind in (CONSERVED, MOMENTUM, ANGULAR):
        assert 1.6 < peers[0][kind].max() / peers[1][kind].max() < 2.4
        assert peers[0][kind].max() > 10 * errors[1][kind].max()


def test_what_is_put_in_is_found():
    own = study(SPACE.format(more=""), qvel_noise=0.0)
    trace, found = run(own, range(2)), Invariants(own)
    push = np.zeros(own.loaded[0].nv)
    push[1] = 0.5
    mass = float(np.sum(own.loaded[0].body_mass))
    np.testing.assert_allclose(found.measure(moved(trace, qvel=push))[MOMENTUM], 0.5 * mass, rtol=1e-9)
    # Kinetic energy that nothing gave: it falls along z, and the push is along y.
    np.testing.assert_allclose(found.measure(moved(trace, qvel=push))[CONSERVED], 0.5 * mass * 0.25, rtol=1e-9)
    raised = np.zeros(own.loaded[0].nq)
    raised[2] = 0.2
    np.testing.assert_allclose(found.measure(moved(trace, qpos=raised))[CONSERVED], mass * 3.0 * 0.2, rtol=1e-9)
    longer = np.zeros(own.loaded[0].nq)
    longer[3] = 1e-3
    np.testing.assert_allclose(found.measure(moved(trace, qpos=longer))[NORM], 1e-3, rtol=1e-9)


def test_overlaps_limits_and_loops_are_found():
    own = study(FLOOR, qvel_noise=0.0, seconds=0.04)
    trace, found = run(own, range(1)), Invariants(own)
    assert found.measure(trace)[PENETRATION] == 0.0
    low = np.zeros(7)
    low[2] = 0.07 - trace.path[0][-1, 0, 2]
    np.testing.assert_allclose(found.measure(moved(trace, qpos=low))[PENETRATION], 0.03, atol=1e-12)
    own = study(LOOP, qvel_noise=0.0, seconds=0.04)
    trace, found = run(own, range(1)), Invariants(own)
    assert {*LIMITS.values(), *LOOPS.values()} <= set(found.kinds)
    path = trace.path[0].copy()
    path[-1, 0, :2] = [np.radians(10) + 0.02, -0.104]
    errors = found.measure(replace(trace, path=(path, trace.path[1])))
    assert errors[LIMITS["rad"]] == pytest.approx(0.02)
    assert errors[LIMITS["m"]] == pytest.approx(0.004)


def test_loops_are_measured_in_metres_and_radians():
    own = study(LOOP, qvel_noise=0.0, seconds=0.04)
    trace, found = run(own, range(1)), Invariants(own)
    path = trace.path[0].copy()
    half = 0.005
    path[-1, 0, 2:] = [4.0, 0.003, 0.004, np.cos(half), np.sin(half), 0.0, 0.0]
    errors = found.measure(replace(trace, path=(path, trace.path[1])))
    # The pose that the weld keeps is that of the reference: 5 mm away, turned by 0.01 rad, to the cube of which a sine is its angle.
    assert errors[LOOPS["m"]] == pytest.approx(0.005, abs=1e-9)
    assert errors[LOOPS["rad"]] == pytest.approx(0.01, rel=1e-4)


def test_energy_that_a_contact_takes_is_no_error_and_what_it_gives_is():
    own = study(FLOOR, qvel_noise=0.3, seconds=0.6)
    found = Invariants(own)
    assert ENERGY in found.kinds
    trace = run(own, range(2), timestep=0.002)
    kept = found.measure(trace)[ENERGY]
    # It fell by 0.2 m, and lost most of 8 J; nothing came in but what the midpoint rule makes of turning, and rounding.
    assert kept.max() < 1e-6
    thrown = np.zeros(6)
    thrown[2] = 10.0
    assert found.measure(moved(trace, qvel=thrown))[ENERGY].min() > 1.0


def test_why_a_scene_has_no_energy_or_momentum():
    limited = '<actuator><motor joint="elbow" forcerange="-1 1"/></actuator>'
    assert "force limits" in " ".join(Invariants(study(SPACE.format(more=limited))).left_out)
    assert "bodies may touch the world" in " ".join(Invariants(study(FLOOR)).left_out)
    assert "attached to the world" in " ".join(Invariants(study(LOOP)).left_out)
    saved = Invariants(study(stepper.load(FLOOR)))
    assert saved.kinds == [NORM]
    assert "no source that MuJoCo can read" in saved.left_out[0]


def test_what_a_drive_pushes_with_is_no_error():
    def controller(now):
        now.xfrc_applied[:, 1, 0] = 1.0

    own = study(SPACE.format(more=""), controller=controller)
    errors = Invariants(own).measure(run(own, range(1)))
    assert np.isnan(errors[CONSERVED]).all()
    assert np.isnan(errors[MOMENTUM]).all()


def test_parameters_of_the_nominal_point_are_in_force():
    heavy = stepper.lab.Parameter("body_mass", operation="scale", nominal=2.0, low=1.0, high=2.0)
    own = study(SPACE.format(more=""), parameters={"mass": heavy}, qvel_noise=0.0)
    push = np.zeros(own.loaded[0].nv)
    push[1] = 0.5
    mass = mujoco.MjModel.from_xml_string(SPACE.format(more="")).body_mass.sum()
    np.testing.assert_allclose(Invariants(own).measure(moved(run(own, range(1)), qvel=push))[MOMENTUM], mass, rtol=1e-9)


def filmed(damping, **changed):
    """Pendulum, and measured trajectories of one with a damping of 0.02 N m s/rad, with a noise of 1 mrad."""
    model = PENDULUM.format(child="").replace('axis="0 1 0"', 'axis="0 1 0" damping="{}"')
    given = {"episodes": 6, "outcomes": stepper.lab.Outcome(name="angle", measure=lambda now: now.qpos[:, 0])} | changed
    real = run(pendulum(model=model.format(0.02), **given), range(given["episodes"]), timestep=0.0005)
    qpos = np.moveaxis(real.path[0], 0, 1)
    noisy = qpos + 1e-3 * np.random.default_rng(0).standard_normal(qpos.shape)
    study = pendulum(model=model.format(damping), trajectories=stepper.lab.MeasuredTrajectories(noisy, 1e-3), **given)
    return study, Distance("rad", 0.5)(real, run(study, range(given["episodes"]), timestep=0.0005))


def errors_in_report(study, tmp_path):
    """Error, its parts and the noise floor in rad of the study's own settings, in the section of the report."""
    found = stepper.lab.report(study, tmp_path).document
    section = next(section for section in found.sections if section.title == "Errors from measured trajectories")
    return next(row[2:] for row in section.rows if row[:2] == ["stepper: the study's own", "rad"])


def test_the_right_model_differs_from_measured_trajectories_by_the_noise_floor(tmp_path):
    """The largest of 25 errors of 1 mrad is within 1.2 to 4 mrad, because that of 25 normal deviates is in 99 % of cases."""
    error, solver, step, model, floor = errors_in_report(filmed(0.02)[0], tmp_path)
    assert 1.2e-3 < floor < 4e-3
    assert 0.5 < error / floor < 2.0
    assert model == pytest.approx(error, rel=0.05)
    assert solver + step < 0.01 * floor


def test_the_error_of_a_wrong_model_is_assigned_to_the_model(tmp_path):
    """The model's part equals the distance of the model from the real pendulum to within the noise, 4 mrad."""
    study, apart = filmed(0.0)
    error, solver, step, model, floor = errors_in_report(study, tmp_path)
    assert model == pytest.approx(np.median(apart), abs=4e-3)
    assert error == pytest.approx(model, rel=1e-3)
    assert model > 20 * floor > 100 * (solver + step)


def test_a_tuning_keeps_a_budget_of_distance_from_measured_trajectories(tmp_path):
    """The budget of 10 mrad is kept with the right model, and by no settings with a wrong one, which errs by more than 50 mrad."""
    given = {"error": "10 mrad", "horizon": 0.5, "coverage": 0.3, "episodes": 2, "reduce": False}
    found = {damping: stepper.lab.tune(filmed(damping)[0], tmp_path, **given) for damping in (0.02, 0.0)}
    assert found[0.02].chosen is not None
    assert found[0.0].chosen is None
    assert min(own.error for own in found[0.0].candidates) > 0.05
    assert "measured trajectories, with a noise floor" in str(found[0.0])


def test_a_chart_measures_errors_from_measured_trajectories(tmp_path):
    """The error of fine steps equals the distance of the model from the real pendulum to within the noise, 4 mrad."""
    study, apart = filmed(0.0)
    found = stepper.lab.chart(study, tmp_path, unit="rad", quick=True, episodes=2, horizon=0.5)
    fine = next(dot for dot in found.dots if dot.setting == "midpoint")
    assert fine.error == pytest.approx(np.median(apart[:2]), abs=4e-3)
    assert all(1e-3 < dot.noise_floor < 4e-3 for dot in found.dots)
    assert "noise floor" in next(section.head for section in found.document.sections if section.title == "All points")


def test_measured_trajectories_of_another_shape_are_refused(tmp_path):
    study = pendulum(trajectories=stepper.lab.MeasuredTrajectories(np.zeros((2, 7, 1)), 1e-3))
    with pytest.raises(ValueError, match="must have at least 2 episodes and 25 control periods, and nq = 1 numbers"):
        stepper.lab.chart(study, tmp_path, episodes=2, quick=True)
    with pytest.raises(TypeError, match="trajectories must be"):
        pendulum(trajectories=np.zeros((2, 25, 1)))
    missing = np.zeros((2, 25, 1))
    missing[1, 3] = np.nan
    found = (missing, 0.0, r"episode 1, period 3, qpos\[0\]")
    for qpos, noise, words in (found, (missing[0], 0.0, "must be"), (missing[:1], -1e-3, "noise")):
        with pytest.raises(ValueError, match=words):
            stepper.lab.MeasuredTrajectories(qpos, noise)

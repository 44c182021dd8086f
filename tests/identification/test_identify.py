"""`stepper.sysid.identify`: right, sure, and not silent where data say nothing."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import stepper
from checks import raises
from identification.repetitions import Kept, Row, noisy
from identification.scenes import HARD, by_sensor, held, pushed
from models import mjcf, stepper_model
from sections import section_of
from stepper.shared.rotations import matrices
from stepper.shared.selectors import parse, places
from stepper.sysid import parameters
from stepper.sysid.residuals import Residuals
from stepper.sysid.simulate import Simulator, solved

ARM = mjcf("two_link_arm")


def episode_of(model, ctrl, period, channels, options=HARD, **start):
    """What ideal sensors of a model read."""
    sim = stepper.Stepper(model, options=options, actuators=start.pop("actuators", None))
    sim.set_state(start.get("qpos", model.qpos0), start.get("qvel", np.zeros(model.nv)))
    made = sim.rollout(ctrl, round(period / sim.timestep), fields=("qpos", "qvel", "sensordata"))
    readings = {name: made[name] if name in made else by_sensor(model, made["sensordata"], [name])[name] for name in channels}
    return stepper.sysid.Episode(ctrl, readings, period, **start)


@pytest.mark.parametrize("scene", [pushed(), held()], ids=["pushed", "held"])
def test_mass_and_friction_with_noise(scene):
    """Some of the repetitions that `make identify` makes; two or more of five intervals miss with a chance of 0.02, and seeds are fixed."""
    clean = scene.readings(HARD)
    covered = []
    for seed in range(5):
        episode = stepper.sysid.Episode(scene.ctrl, noisy(clean, scene, seed), scene.period)
        found = stepper.sysid.identify(scene.model(*scene.starts[0]), [episode], scene.parameters, starts=3, threads=1)
        assert (np.abs(found.values / scene.truth - 1) < 0.06).all()  # four standard deviations of the worse of both, 1.5 %
        low, high = found.interval().T
        covered.append((low <= scene.truth) & (scene.truth <= high))
        assert ((high - low) / scene.truth < 0.1).all()
    assert (np.sum(covered, axis=0) >= 4).all()


def test_exact_data_give_exact_numbers_and_the_answer_can_be_used(tmp_path):
    """Without noise what is left is the tolerance of the steps."""
    scene = pushed()
    episode = stepper.sysid.Episode(scene.ctrl, scene.readings(HARD), scene.period)
    found = stepper.sysid.identify(scene.model(1.0, 0.5), [episode], scene.parameters, starts=2)
    np.testing.assert_allclose(found.values, scene.truth, rtol=1e-5)
    assert found.warnings == ()
    assert found["body_mass[box]"] == found.values[0]
    estimate = found.estimate
    assert estimate.body("box").mass == pytest.approx(1.3, rel=1e-5)
    # A body of another mass keeps its shape: the inertia grows with it.
    np.testing.assert_allclose(np.asarray(estimate.body("box").inertia) / scene.model(1.0, 0.5).body("box").inertia, 1.3, rtol=1e-5)
    sim = stepper.Stepper(estimate, 64)
    sim.randomize(**found.sample(64, seed=3))
    drawn = sim.randomized["geom_friction"][:, estimate.geom("floor").id, 0]
    assert abs(drawn.mean() / 0.35 - 1) < 1e-4
    assert drawn.std() > 0
    found.save(tmp_path / "found.json")
    assert str(stepper.sysid.Identification.load(tmp_path / "found.json", found.model)) == str(found)
    raises(ValueError, "of model", stepper.sysid.Identification.load, tmp_path / "found.json", estimate)


def test_the_same_answer_for_any_number_of_threads():
    scene = pushed()
    episode = stepper.sysid.Episode(scene.ctrl[:50], {n: r[:50] for n, r in noisy(scene.readings(HARD), scene, 0).items()}, scene.period)
    one, two = (stepper.sysid.identify(scene.model(1.0, 0.5), [episode], scene.parameters, starts=3, threads=t) for t in (1, 2))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.covariance.tobytes() == two.covariance.tobytes()


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_what_never_moves_is_said(noise):
    """A box that nothing touches: no reading depends on its mass, and only the weight of friction that never slides."""
    scene = pushed()
    still = dataclasses.replace(scene, ctrl=np.full((40, 1), -0.05))
    rng = np.random.default_rng(0)
    readings = {name: rows + noise * rng.standard_normal(rows.shape) for name, rows in still.readings(HARD).items()}
    found = stepper.sysid.identify(scene.model(1.0, 0.5), [stepper.sysid.Episode(still.ctrl, readings, 0.02)], scene.parameters, starts=2)
    assert not found.determined.any()
    assert any("body_mass[box] is not determined" in text and "no reading depends on it" in text for text in found.warnings)
    assert any("geom_friction[floor,box][0] is not determined" in text and "slide" in text for text in found.warnings)
    assert "not determined" in found.table()
    # It is as wide as the bounds, and finite.
    low, high = found.interval()[0]
    assert high / low > 1e3
    assert np.isfinite(found.covariance).all()


def test_a_search_that_begins_where_friction_never_slides():
    """From a friction that holds the box against the finger, the slope is zero; starts far away find the one that slides."""
    scene = pushed()
    model = scene.model(1.3, 5.0)
    soft = model.replace(actuator_gainprm=model.actuator_gainprm / 20, actuator_biasprm=model.actuator_biasprm / 20)
    truth = scene.model(1.3, 0.35)
    truth = truth.replace(actuator_gainprm=truth.actuator_gainprm / 20, actuator_biasprm=truth.actuator_biasprm / 20)
    episode = episode_of(truth, np.linspace(0, 0.6, 60)[:, None], 0.02, ("wrist_force", "box_x"))
    for starts in (1, 6):
        found = stepper.sysid.identify(
            soft, [episode], [stepper.sysid.FitParameter("geom_friction[floor,box][0]", bounds=(0.05, 10))], starts=starts
        )
        # The searches end at a relative change of 1e-8; finite differences have errors of 1e-5.
        assert found.values[0] == pytest.approx(0.35, rel=1e-4)
    # Where the bounds exclude the one that slides, nothing is found, and that is said.
    alone = stepper.sysid.identify(soft, [episode], [stepper.sysid.FitParameter("geom_friction[floor,box][0]", bounds=(2.0, 10))], starts=1)
    assert alone.values[0] == pytest.approx(5.0, rel=0.1)
    assert any("not determined" in text for text in alone.warnings)


def shaken(T=120):
    t = np.arange(T) * 0.01
    return np.stack([np.sin(9 * t), 0.8 * np.sin(7 * t + 1), 0.3 * np.sin(13 * t + 2)], axis=1)


@pytest.mark.parametrize(("text", "change"), [
    ("dof_damping[shoulder]", {"dof_damping": (0, 0.7)}),
    ("dof_armature[shoulder]", {"dof_armature": (0, 0.05)}),
    ("dof_frictionloss[elbow]", {"dof_frictionloss": (1, 0.25)}),
    ("jnt_stiffness[elbow]", {"jnt_stiffness": (1, 4.0)}),
    ("actuator_gainprm[a]", {"actuator_gainprm": ((0, 0), 1.3)}),
    ("actuator_kp[b]", {"actuator_gainprm": ((1, 0), 55.0), "actuator_biasprm": ((1, 1), -55.0)}),
    ("actuator_kv[b]", {"actuator_biasprm": ((1, 2), -2.5)}),
    ("body_mass[fore]", {"body_mass": (2, 0.9)}),
])  # fmt: skip
def test_kinds_of_an_arm(text, change):
    """Each from the model's own number, without noise."""
    model = stepper.load(ARM)
    fields = {}
    for field, (place, value) in change.items():
        array = np.array(getattr(model, field))
        if field == "body_mass":
            fields["body_inertia"] = np.array(model.body_inertia)
            fields["body_inertia"][place] *= value / array[place]
        array[place] = value
        fields[field] = array
    episode = episode_of(model.replace(**fields), shaken(), 0.01, ("qpos", "force"))
    found = stepper.sysid.identify(model, [episode], [text], starts=1)
    place, value = next(iter(change.values()))
    assert found.values[0] == pytest.approx(abs(value), rel=1e-4)


def test_an_inertia_stays_physical_and_is_found():
    """All ten numbers of the load, by the wrist's force and torque, and those that lanes can have of their own."""
    model = stepper.load(ARM)
    body = model.body("load").id
    truth = {name: np.array(getattr(model, name)) for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat")}
    truth["body_mass"][body] = 0.7
    truth["body_ipos"][body] = [0.02, 0.015, -0.01]
    truth["body_inertia"][body] = [0.003, 0.0026, 0.0048]
    truth["body_iquat"][body] = np.array([0.8, 0.3, 0.1, 0.5]) / np.linalg.norm([0.8, 0.3, 0.1, 0.5])
    true = model.replace(**truth)
    episode = episode_of(true, shaken(), 0.01, ("force", "torque", "qpos", "qvel"))
    found = stepper.sysid.identify(model, [episode], ["body_inertial[load]"], starts=1)
    moments = np.asarray(found.estimate.body("load").inertia)
    np.testing.assert_allclose(np.sort(moments), [0.0026, 0.003, 0.0048], rtol=1e-2)
    assert found["body_inertial[load].mass"] == pytest.approx(0.7, rel=1e-3)
    np.testing.assert_allclose([found[f"body_inertial[load].com.{axis}"] for axis in "xyz"], [0.02, 0.015, -0.01], atol=1e-4)
    # Ten numbers of a body are functions of all its parameters, so that their intervals are symmetric about the values.
    np.testing.assert_allclose(found.interval().mean(axis=1), found.values, rtol=1e-12, atol=1e-12)
    raises(ValueError, r"body_iquat.*result\.models", found.sample, 4)
    for drawn in found.models(4):
        a, b, c = np.sort(drawn.body("load").inertia)
        assert a > 0
        assert c < a + b
    true = model.replace(**{name: truth[name] for name in ("body_mass", "body_ipos")}, body_inertia=model.body_inertia)
    episode = episode_of(true, shaken(), 0.01, ("force", "torque", "qpos", "qvel"))
    found = stepper.sysid.identify(model, [episode], ["body_mass[load]", "body_ipos[load]", "body_inertia[load]"], starts=1)
    np.testing.assert_allclose(found.values[:4], [0.7, 0.02, 0.015, -0.01], rtol=1e-3)
    np.testing.assert_allclose(found.values[4:], model.body("load").inertia, rtol=1e-2)
    found.sample(4)


def test_delay_bias_scale_and_lag():
    """Of an actuator a delay between two steps; of sensors what they make of the truth."""
    model = stepper.load(ARM)
    drives = stepper.ActuatorModel({"b": stepper.Drive(delay=0.0132)})
    episode = episode_of(model, shaken(), 0.01, ("force", "torque", "q"), actuators=drives)
    readings = dict(episode.readings)
    readings["force"] = readings["force"] + [0.5, -0.2, 0.1]
    readings["torque"] = 1.1 * readings["torque"]
    readings["q"] = np.concatenate([readings["q"][:1], readings["q"][:-1]])
    episode = dataclasses.replace(episode, readings=readings)
    found = stepper.sysid.identify(
        model, [episode], ["actuator.delay[b]", "sensor.bias[force]", "sensor.scale[torque]", "sensor.delay[q]"], starts=8
    )
    values = dict(zip(found.labels, found.values, strict=True))
    assert values["actuator.delay[b]"] == pytest.approx(0.0132, abs=1e-5)
    assert [values[f"sensor.bias[force][{k}]"] for k in range(3)] == pytest.approx([0.5, -0.2, 0.1], abs=1e-4)
    assert values["sensor.scale[torque]"] == pytest.approx(1.1, rel=1e-4)
    # The first reading was held for a period.
    assert values["sensor.delay[q]"] == pytest.approx(0.01, abs=2e-4)
    assert found.drives().drive_of("b").delay == pytest.approx(0.0132, abs=1e-5)
    known = stepper.ActuatorModel({"a": stepper.Drive(delay=0.02)}, default=stepper.Drive(lag=0.004))
    drives = found.drives(known)
    assert (drives.drive_of("a").delay, drives.drive_of("b").lag, drives.default) == (0.02, 0.004, known.default)
    assert found.sample(5)["actuators"].drive_of("b").delay.shape == (5,)


def test_an_unknown_start_is_estimated():
    """A start whose velocity is off spoils damping, unless it is estimated too."""
    model = stepper.load(ARM)
    # The elbow's dry friction would hold a part of what is off.
    model = model.replace(dof_frictionloss=np.zeros(3))
    episode = episode_of(model, shaken(60), 0.01, ("qpos",), qvel=np.array([0.4, -0.5, 2.0]), qpos=np.array([0.05, 0.02, -0.04]))
    rng = np.random.default_rng(2)
    readings = {"qpos": np.asarray(episode.readings["qpos"]) + 1e-3 * rng.standard_normal((60, 3))}
    given = dataclasses.replace(episode, qpos=None, qvel=None, readings=readings)
    off = stepper.sysid.identify(model, [given], ["dof_damping[roll]"], starts=1)
    found = stepper.sysid.identify(model, [dataclasses.replace(given, start_std=(0.1, 3.0))] * 2, ["dof_damping[roll]"], starts=1)
    assert abs(off.values[0] / 0.05 - 1) > 0.1
    low, high = found.interval()[0]
    assert low < 0.05 < high
    assert abs(found.values[0] / 0.05 - 1) < 0.05


@pytest.mark.parametrize(("name", "text"), [
    ("gymnasium/reacher", "dof_damping[joint1]"),
    ("dm_control/acrobot", "body_mass[lower_arm]"),
    ("dm_control/cartpole", "body_mass[pole_1]"),
])  # fmt: skip
def test_arms_that_others_wrote(name, text):
    """Half as much again as in the file, found from the joints' positions alone, with noise of a milliradian."""
    model = stepper_model(name, strict=False)
    field, place = parse(text).field, places(model, parse(text))
    changed = np.array(getattr(model, field))
    changed[place] *= 1.5
    fields = {field: changed}
    if field == "body_mass":
        fields["body_inertia"] = np.array(model.body_inertia)
        fields["body_inertia"][place] *= 1.5
    t = np.arange(100) * 0.02
    ctrl = np.stack([0.8 * np.sin((5 + 2 * k) * t) for k in range(model.nu)], axis=1)
    episode = episode_of(model.replace(**fields), ctrl, 0.02, ("qpos",))
    rng = np.random.default_rng(0)
    rows = np.asarray(episode.readings["qpos"])
    episode = dataclasses.replace(episode, readings={"qpos": rows + 1e-3 * rng.standard_normal(rows.shape)})
    found = stepper.sysid.identify(model, [episode], [text], starts=1)
    low, high = found.interval(0.999)[0]
    assert low < changed[place] < high
    assert abs(found.values[0] / changed[place] - 1) < 0.05


def test_log_cholesky_gives_bodies():
    """Every number of R^10 is a body: positive moments that hold the triangle inequality, and theta = 0 is the model's."""
    rng = np.random.default_rng(0)
    mass, com, moments, axes = parameters.shape.bodies(rng.normal(0, 1.5, (500, 10)), 2.0, np.array([0.02, 0.03, 0.04]))
    assert (mass > 0).all()
    ordered = np.sort(moments, axis=-1)
    assert (ordered[:, 0] > 0).all()
    assert (ordered[:, 2] <= ordered[:, 0] + ordered[:, 1] + 1e-12 * ordered[:, 2]).all()
    np.testing.assert_allclose(np.linalg.det(axes), 1, rtol=1e-9)
    np.testing.assert_allclose(matrices(parameters.shape.quaternion(axes)), axes, atol=1e-9)
    mass, com, moments, axes = parameters.shape.bodies(np.zeros(10), 2.0, np.array([0.02, 0.03, 0.04]))
    assert mass == pytest.approx(2.0)
    np.testing.assert_allclose(com, 0, atol=1e-15)
    np.testing.assert_allclose(np.sort(moments), [0.02, 0.03, 0.04])


def test_one_sided_differences_have_the_derivatives_of_central_ones():
    """At a point inside the bounds and at upper bounds, also of an uncertain initial state, with one simulation per coordinate."""
    model = stepper.load(
        """<mujoco><option timestep="0.005"/><worldbody><body><joint name="q" axis="0 1 0" damping="0.1" stiffness="2"/>
        <geom size=".05" pos="0 0 -.2" mass=".5"/></body></worldbody></mujoco>"""
    )
    episode = stepper.sysid.Episode(np.zeros((40, 0)), {"qpos": np.zeros((40, 1))}, 0.02, qpos=[0.4], start_std=(0.1, 0.1))
    blocks = parameters.bind(["dof_damping[q]=0.01..1", "jnt_stiffness[q]=0.5..4"], model)
    residuals = Residuals(Simulator(model, [episode.checked(model)], blocks, solved(HARD), threads=1, actuators=None), 1e-5)
    for x in (residuals.start, np.where(np.isfinite(residuals.high), residuals.high, 0.0)):
        simulated = []
        jacobians = []
        for sides in (2, 1):
            before = residuals.simulator.steps
            (at,) = residuals.linearize([x], sides=sides)
            simulated.append(residuals.simulator.steps - before)
            jacobians.append(at.jacobian)
        assert simulated[1] == 5 * 40 * 4 < simulated[0]
        # One-sided differences have an error of half the step times the second derivative, which is about the first one.
        np.testing.assert_allclose(jacobians[1], jacobians[0], rtol=0, atol=1e-4 * np.abs(jacobians[0]).max())


# `benches/identification`: repetitions that are kept, and the tables that they fill.

PAGE = Path(__file__).parents[2] / "docs/benchmarks/identification.md"


def answer(seed):
    return np.array([1.0 + seed, 2.0]), np.array([0.5, 1.5]), np.array([1.5, 2.5])


def refused(seed):
    raise AssertionError(f"repetition {seed} is kept")


def test_a_run_that_was_killed_in_a_line_goes_on(tmp_path):
    path = tmp_path / "own.jsonl"
    kept = Kept(path, resume=False)
    for seed in (0, 1):
        kept.of(Row("box", (1.0, 2.0), answer, 2), seed)
    path.write_text(path.read_text()[:-20])
    again = Kept(path, resume=True)
    np.testing.assert_array_equal(again.of(Row("box", (1.0, 2.0), refused, 2), 0)[0][0], [1.0, 2.0])
    # The second was cut, and is made again, in a line of its own.
    again.of(Row("box", (1.0, 2.0), answer, 2), 1)
    last = Kept(path, resume=True)
    np.testing.assert_array_equal(last.of(Row("box", (1.0, 2.0), refused, 2), 1)[0][0], [2.0, 2.0])


def test_repetitions_of_another_version_are_refused(tmp_path):
    path = tmp_path / "own.jsonl"
    path.write_text('{"version": 0}\n')
    raises(ValueError, "run without --resume", Kept, path, resume=True)
    assert path.read_text() == '{"version": 0}\n'


@pytest.mark.parametrize("name", ["online", "impacts", "matched", "own", "coloured", "determined", "peer"])
def test_tables_have_rows(name):
    """A heading, a rule and a row or more between the marks."""
    lines = section_of(PAGE, name).splitlines()
    assert len(lines) > 2
    assert len({line.count("|") for line in lines}) == 1

"""Derivatives over rollouts, beside differences of whole rollouts and closed forms, and of the nominal mode at kinks and jumps."""

import math
from collections import Counter

import numpy as np
import pytest
import stepper
from checks import every, raises
from models import random_quaternion, simulate, stepper_model
from rollout_gradients import LAWS, Judged, bodies_on_a_floor, judge
from stepper.derivatives import Kink, Smoothing, UndeterminedDerivative, rollout
from stepper.derivatives.kinks import RowGroup
from stepper.derivatives.nominal_mode import WIDTH_RATIO, WIDTHS, Readings, slopes_of
from stepper.derivatives.rollout import from_tangent, to_tangent

SOFT = stepper.Options(contact="mujoco", tolerance=1e-12)
SLIDE = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="1"/></body>
  </worldbody><actuator><motor name="push" joint="j" {}/></actuator></mujoco>"""
MEMORIES = [
    ("", stepper.Drive(delay=0.02)),
    ("", stepper.Drive(lag=0.05)),
    ("", stepper.Drive(servo=stepper.actuators.PID(kp=1.0, ki=50.0))),
    ("", stepper.Drive(servo=stepper.actuators.PID(kp=1.0, period=0.02))),
    ('delay=".02" nsample="4"', None),
]
WIDTH = 1e-6 * WIDTH_RATIO ** np.arange(WIDTHS)


@pytest.fixture(scope="module")
def ants():
    """Ants that touch the floor, and controls."""
    model, rng = stepper_model("gymnasium/ant", strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 3, options=SOFT)
    for _ in range(5):
        sim.step(rng.uniform(-0.3, 0.3, (3, model.nu)), nstep=10)
    return sim, rng.uniform(-0.3, 0.3, (5, 3, model.nu)), rng


def loss_of(sim, weights, nstep, *, qpos=None, qvel=None, parameters=None):
    """The function of controls whose gradient `vjp` takes: sums of the states, weighted."""

    def loss(ctrl):
        other = stepper.Stepper(sim.model, sim.num_envs, options=sim.options)
        other.randomize(**(parameters or {}))
        other.set_state(sim.get_state())
        if qpos is not None or qvel is not None:
            other.set_state(qpos=qpos, qvel=qvel, keep_warmstart=True)
        made = other.rollout(ctrl, nstep, fields=["qpos", "qvel"])
        return sum((made[name] * weights[name]).sum(axis=(0, 2)) for name in weights)

    return loss


def test_gradients_are_those_of_whole_rollouts(ants):
    sim, ctrl, rng = ants
    made = rollout(sim, ctrl, 2, parameters=("body_mass",))
    weights = {name: rng.normal(size=getattr(made, name).shape) for name in ("qpos", "qvel")}
    found = made.vjp(**weights)
    # Whole rollouts bend more than their steps, and cross changes of contacts that no step of 1e-6 does.
    h, same = 1e-6, {"rtol": 1e-3, "atol": 1e-5}
    for t, k in ((0, 0), (2, 3), (4, 7)):
        moved = np.zeros_like(ctrl)
        moved[t, :, k] = h
        loss = loss_of(sim, weights, 2)
        np.testing.assert_allclose(found.ctrl[t, :, k], (loss(ctrl + moved) - loss(ctrl - moved)) / (2 * h), **same)
    direction = rng.normal(size=(3, sim.model.nv))
    ends = [loss_of(sim, weights, 2, qpos=sim.model.integrate_pos(sim.qpos, s * h * direction))(ctrl) for s in (1, -1)]
    by_turn = to_tangent(sim.model, sim.qpos, found.qpos)
    np.testing.assert_allclose((by_turn * direction).sum(axis=1), (ends[0] - ends[1]) / (2 * h), **same)
    ends = [loss_of(sim, weights, 2, qvel=sim.qvel + s * h * direction)(ctrl) for s in (1, -1)]
    np.testing.assert_allclose((found.qvel * direction).sum(axis=1), (ends[0] - ends[1]) / (2 * h), **same)
    mass = np.tile(sim.model.body_mass, (3, 1))
    ends = [loss_of(sim, weights, 2, parameters={"body_mass": mass * (1 + s * h)})(ctrl) for s in (1, -1)]
    np.testing.assert_allclose((found.parameters["body_mass"] * mass).sum(axis=1), (ends[0] - ends[1]) / (2 * h), **same)


@pytest.mark.parametrize("every", [1, 2, 5, 9])
def test_checkpoints_change_no_bit_and_memory_is_what_they_take(ants, every):
    sim, ctrl, _ = ants
    whole, made = rollout(sim, ctrl, every=len(ctrl)), rollout(sim, ctrl, every=every)
    before, weights = sim.get_state(), np.ones_like(made.qvel)
    a, b = whole.vjp(qvel=weights), made.vjp(qvel=weights)
    np.testing.assert_array_equal(a.ctrl, b.ctrl)
    np.testing.assert_array_equal(a.qpos, b.qpos)
    assert sim.get_state() == before
    states = -(-len(ctrl) // every) + min(every, len(ctrl))
    n, nu = 2 * sim.model.nv, sim.model.nu
    assert made.memory == states * sim.get_state().nbytes + 8 * 3 * n * (n + nu)


def test_a_rollout_is_that_of_the_stepper_with_its_drives():
    model = stepper_model("gymnasium/hopper", strict=False)
    drives = stepper.ActuatorModel(default=stepper.Drive(friction=0.05, limits=(-0.5, 0.5)))
    sim, rng = stepper.Stepper(model, actuators=drives), np.random.default_rng(0)
    sim.step(rng.uniform(-1, 1, model.nu), nstep=30)
    ctrl = rng.uniform(-1, 1, (6, model.nu))
    made = rollout(sim, ctrl, 2, sensors=True)
    # Shapes of a single environment.
    assert made.vjp(qpos=np.eye(6, model.nq) * 0 + 1, sensors=np.zeros((6, model.nsensordata))).ctrl.shape == (6, model.nu)
    expected = sim.rollout(ctrl, 2, fields=["qpos", "qvel"])
    np.testing.assert_array_equal(made.qpos, expected["qpos"])
    np.testing.assert_array_equal(made.qvel, expected["qvel"])


def test_a_thrown_body_flies_as_far_as_its_speed():
    model = stepper.load('<mujoco><worldbody><body><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>')
    sim = simulate(model, qvel=[1, 0, 2, 0, 0, 3])
    made = rollout(sim, np.zeros((50, 0)), 2)
    last = np.zeros_like(made.qpos)
    last[-1, 2] = 1.0
    # Height after t: z + v t - g t^2 / 2.
    found, t = made.vjp(qpos=last), 100 * sim.timestep
    np.testing.assert_allclose(found.qpos, [0, 0, 1, 0, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(found.qvel, [0, 0, t, 0, 0, 0], atol=1e-6)


def test_gradients_of_quaternions_are_along_their_tangent_space():
    model = stepper.load(
        '<mujoco><worldbody><body><freejoint/><geom size=".1"/><body><joint type="hinge"/><geom size=".1"/>'
        '<body pos="1 0 0"><joint type="ball"/><geom size=".1"/></body></body></body></worldbody></mujoco>'
    )
    rng = np.random.default_rng(0)
    qpos = np.concatenate([rng.normal(size=3), random_quaternion(rng), rng.normal(size=1), random_quaternion(rng)])
    weights, h = rng.normal(size=model.nq), 1e-6
    numeric = [
        (weights @ model.integrate_pos(qpos, h * d) - weights @ model.integrate_pos(qpos, -h * d)) / (2 * h) for d in np.eye(model.nv)
    ]
    np.testing.assert_allclose(to_tangent(model, qpos, weights), numeric, atol=1e-8)
    back = from_tangent(model, qpos, to_tangent(model, qpos, weights))
    for quat in (slice(3, 7), slice(8, 12)):
        np.testing.assert_allclose(back[quat] @ qpos[quat], 0, atol=1e-12)
    np.testing.assert_allclose(to_tangent(model, qpos, back), to_tangent(model, qpos, weights), atol=1e-12)


@pytest.mark.parametrize(("call", "message"), [
    (lambda sim, ctrl: rollout(sim, ctrl[:, :2]), r"must be \(T, num_envs, nu\)"),
    (lambda sim, ctrl: rollout(sim, ctrl, every=0), "every is 0"),
    (lambda sim, ctrl: rollout(sim, ctrl * np.nan), "not finite"),
    (lambda sim, ctrl: rollout(sim, ctrl, parameters="body_mass"), "parameters is 'body_mass', must be a sequence"),
    (lambda sim, ctrl: rollout(sim, ctrl, parameters=("body_mas",)), "did you mean body_mass"),
    (lambda sim, ctrl: rollout(sim, ctrl, parameters=("dof_damping[y]",)), "no joint 'y'"),
    (lambda sim, ctrl: rollout(sim, ctrl).vjp(qvel=np.zeros(3)), "gradient by qvel has shape"),
    (lambda sim, ctrl: rollout(sim, ctrl).vjp(sensors=np.zeros(3)), "sensors=True"),
    (lambda sim, ctrl: rollout(sim, ctrl).vjp(qvel=[[[0.0]] * 3, [[np.nan]] * 3]), "qvel has a number .* not finite, at control 1"),
    (lambda sim, ctrl: rollout(sim, ctrl).vjp(qvel=np.zeros((2, 3, 1)), smoothing={"samples": 4}), "smoothing is dict"),
    (lambda sim, ctrl: Smoothing(samples=3, qpos=1e-3), "samples is 3, must be an even number"),
    (lambda sim, ctrl: Smoothing(), "all standard deviations are 0"),
    (lambda sim, ctrl: Smoothing(ctrl=-1), "ctrl is -1"),
    (lambda sim, ctrl: Smoothing(ctrl=1, seed=-1), "seed is -1"),
    (lambda sim, ctrl: Smoothing(ctrl=1, seed=1.5), r"seed is 1\.5"),
])  # fmt: skip
def test_wrong_calls_say_what_to_do(call, message):
    sim = stepper.Stepper(stepper.load(SLIDE.format("")), 3)
    raises((ValueError, TypeError), message, call, sim, np.zeros((2, 3, 1)))


def test_a_smoothed_gradient_feels_what_a_gap_hides():
    """v+ = max(v, -gap / h): its slopes by v and by the gap are the shares of the samples on both sides, of normal distribution."""
    model = stepper.load(
        '<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><geom type="plane" size="9 9 1" friction="0"/><body pos="0 0 .1">'
        '<joint type="slide" axis="0 0 1"/><geom type="sphere" size=".1" mass="2" friction="0"/></body></worldbody></mujoco>'
    )
    sim, h = stepper.Stepper(model, 2, options=stepper.Options(integrator="euler")), 0.002
    gap, speed = 1e-3, -0.4
    sim.set_state([[gap], [gap]], [[speed], [speed]])
    made = rollout(sim, np.zeros((1, 2, 0)))
    weights = np.ones((1, 2, 1))
    exact = made.vjp(qvel=weights)
    np.testing.assert_allclose(exact.qvel, 1.0)
    np.testing.assert_allclose(exact.qpos, 0.0, atol=1e-8)  # Noise of a difference.
    samples = 4096
    spread = Smoothing(samples=samples, qpos=2e-4, qvel=0.05)
    found = made.vjp(qvel=weights, smoothing=spread)
    free = 0.5 * (1 + math.erf((speed + gap / h) / math.hypot(2e-4 / h, 0.05) / math.sqrt(2)))
    error = 4 * math.sqrt(free * (1 - free) / samples)  # Four standard deviations of a share.
    np.testing.assert_allclose(found.qvel, free, atol=error)
    np.testing.assert_allclose(found.qpos, -(1 - free) / h, atol=error / h)
    assert np.ptp(found.qvel) > 0  # Environments draw their own.
    np.testing.assert_array_equal(made.vjp(qvel=weights, smoothing=spread).qvel, found.qvel)


def test_a_smoothed_gradient_of_what_is_linear_is_the_gradient():
    model = stepper.load(
        '<mujoco><option timestep="0.002"/><worldbody><body><freejoint/><geom size=".1" mass="2"/></body></worldbody></mujoco>'
    )
    sim = stepper.Stepper(model)
    sim.xfrc_applied[1, 0] = 3.0
    made = rollout(sim, np.zeros((3, 0)), 2)
    weights = np.ones((3, 6))
    plain, smooth = made.vjp(qvel=weights), made.vjp(qvel=weights, smoothing=Smoothing(samples=4, qvel=0.1, qpos=0.1))
    np.testing.assert_allclose(smooth.qvel, plain.qvel, atol=1e-6)  # Noise of differences.
    assert smooth.near_kink.shape == plain.near_kink.shape


def test_a_smoothed_gradient_does_not_depend_on_the_neighbours():
    model = stepper.load("""<mujoco><worldbody><geom type="plane" size="9 9 1"/><body pos="0 0 .1">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/><geom type="sphere" size=".1"/></body></worldbody>
      <actuator><motor joint="x"/></actuator></mujoco>""")
    spread = Smoothing(samples=4, qpos=1e-4, qvel=0.1, ctrl=0.1)
    few, many = (rollout(stepper.Stepper(model, n), np.ones((2, n, 1))).vjp(qvel=np.ones((2, n, 2)), smoothing=spread) for n in (1, 5))
    # Of hard contact where it switches, so that other displacements show.
    np.testing.assert_array_equal(many.qvel[0], few.qvel[0])
    np.testing.assert_array_equal(many.ctrl[:, 0], few.ctrl[:, 0])


@pytest.mark.parametrize(("attribute", "drive"), MEMORIES)
def test_a_rollout_through_an_actuator_with_a_memory_is_refused(attribute, drive):
    """The state of a step has no delay line, lag or integral, so that controls before it would seem to have no effect through them."""
    actuators = stepper.ActuatorModel(default=drive) if drive else None
    sim = stepper.Stepper(stepper.load(SLIDE.format(attribute)), 1, actuators=actuators)
    raises(ValueError, "actuators push have a delay, a lag, a sampled servo or an integral", rollout, sim, np.zeros((3, 1, 1)))


def test_a_rollout_through_a_drive_without_a_memory_has_gradients():
    sim = stepper.Stepper(stepper.load(SLIDE.format("")), 1, actuators=stepper.ActuatorModel(default=stepper.Drive(limits=(-9.0, 9.0))))
    at_the_end = np.zeros((3, 1, 1))
    at_the_end[-1] = 1.0
    # A force on 1 kg for 10 ms.
    assert np.allclose(rollout(sim, np.zeros((3, 1, 1))).vjp(qvel=at_the_end).ctrl, 0.01, atol=1e-9)


# Gradients at kinks and jumps are slopes of the nominal mode, or errors that say where.

PUSHED_BOX = """<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="3 3 1" friction=".4 0 0"/>
  <body pos="-.12 0 .05"><joint name="f" type="slide" axis="1 0 0" damping="3"/><geom size=".03" mass=".4" friction=".4 0 0"/></body>
  <body pos="0 0 .06"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint name="turn" axis="0 1 0"/>
  <geom type="box" size=".06 .06 .06" mass=".6" friction=".4 0 0"/></body></worldbody><actuator><motor joint="f"/></actuator></mujoco>"""
"""A finger pushes a box that just touches the floor, at a distance of exactly 0."""


def last(made: stepper.derivatives.Rollout, place: int) -> np.ndarray:
    """Gradient of one number of the last configuration."""
    gradient = np.zeros_like(made.qpos)
    gradient[-1].reshape(-1)[place] = 1.0
    return gradient


def by_differences(model: stepper.Model, ctrl: np.ndarray, options: stepper.Options, width: float) -> float:
    """Derivative of where the box is in the end by the first control."""
    ends = []
    for sign in (1, -1):
        sim = stepper.Stepper(model, options=stepper.Options(**{**vars(options), "tolerance": 1e-13}))
        moved = ctrl.copy()
        moved[0] += sign * width
        ends.append(sim.rollout(moved, 2, fields=["qpos"])["qpos"][-1, 1])
    return (ends[0] - ends[1]) / (2 * width)


@pytest.mark.parametrize("method", ["fd", "implicit"])
def test_the_push_of_a_box_that_just_touches_the_floor(method):
    model, ctrl, options = stepper.load(PUSHED_BOX), np.full((40, 1), 2.0), stepper.Options(contact="mujoco")
    made = rollout(stepper.Stepper(model, options=options), ctrl, 2)
    found = made.vjp(qpos=last(made, 1), method=method)
    assert found.near_kink.any()
    for width in (1e-2, 1e-3, 1e-4):
        # The differences of three widths agree to 1e-5; a rollout to a tolerance of 1e-6 differs from theirs by 1e-3 of that.
        assert found.ctrl[0, 0] == pytest.approx(by_differences(model, ctrl, options, width), rel=1e-3)


def test_a_parameter_takes_nothing_from_the_other_columns():
    model, ctrl = stepper.load(PUSHED_BOX), np.full((40, 1), 2.0)
    sim = stepper.Stepper(model, options=stepper.Options(contact="mujoco"))
    alone, both = (rollout(sim, ctrl, 2, parameters=names) for names in ((), ("body_mass",)))
    gradient = last(alone, 1)
    found = both.vjp(qpos=gradient)
    np.testing.assert_array_equal(found.ctrl, alone.vjp(qpos=gradient).ctrl)
    h, ends = 1e-4, []
    for factor in (1 + h, 1 - h):
        other = stepper.Stepper(model, options=stepper.Options(contact="mujoco", tolerance=1e-13))
        other.randomize(body_mass=np.asarray(model.body_mass) * factor)
        ends.append(other.rollout(ctrl, 2, fields=["qpos"])["qpos"][-1, 1])
    # As above; differences of masses are relative ones, whose truncation is 1e-8.
    assert found.parameters["body_mass"] @ np.asarray(model.body_mass) == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-3)


@pytest.mark.parametrize("law", list(LAWS))
def test_gradients_of_random_contact_scenes_agree_with_differences_of_whole_rollouts(law):
    judged = Judged(Counter(), [])
    for seed in range(12):
        judge(bodies_on_a_floor(seed, LAWS[law], steps=10), seed, judged)
    _, known, good, wrong = np.sum([judged.row(kind) for kind in ("no kink", "near a kink")], axis=0)
    assert wrong == 0, judged.worst
    # Differences of an hundredth are agreement, and one derivative in a hundred may differ, as docs/how-to/derivatives.md says.
    assert good >= 0.99 * known, judged.worst
    # Nor is it an answer to refuse all: differences judge most derivatives.
    assert known > 0.5 * sum(judged.counts.values()), judged.counts


def read(function, differs=lambda x: np.zeros_like(x, bool)):
    """Slopes of a function of one number, of which `differs` says where it is in another mode than at 0."""
    offsets = np.stack([WIDTH, -WIDTH])[None]
    slopes = (np.vectorize(function)(offsets) - function(0.0)) / offsets
    out, nominal, other = slopes_of(Readings(slopes[..., None], differs(offsets), np.array([1e-15])), offsets, [RowGroup(slice(0, 1))])
    return out[0, 0], bool(nominal[0]), bool(other[0])


@every(place=[1e-7, -1e-7, 1e-12, -1e-12], jump=[0.0, 1.0])
def test_the_slope_on_the_side_of_the_nominal_point_is_found(place, jump):
    def function(x):
        return 2.0 * x if (x - place) * place < 0.0 else jump + 2.0 * place - 5.0 * (x - place)

    # To the rounding of a slope over the narrowest width.
    assert read(function, lambda x: (x - place) * place > 0.0) == (pytest.approx(2.0, abs=1e-6), True, False)


def test_a_switch_without_effect_and_strong_curvature_are_no_kinks():
    assert read(lambda x: 3.0 * x, lambda x: x != 0.0) == (pytest.approx(3.0), False, True)
    # Twice the curvature from which on slopes on both sides count as different.
    assert read(lambda x: 3.0 * x + 3e4 * x * x) == (pytest.approx(3.0), True, False)


def test_a_jump_on_both_sides_has_no_slope():
    assert read(lambda x: float(x != 0.0), lambda x: x != 0.0)[1:] == (False, False)
    assert read(np.sign, lambda x: x != 0.0)[1:] == (False, False)


def test_a_kink_without_a_slope_says_where():
    # Runge and Kutta's method has no derivative at the modes, and a turn either way lets a corner touch.
    model = stepper.load(PUSHED_BOX)
    sim = simulate(model, 2, contact="mujoco", integrator="rk4", qpos=[[0, 0, 0.01, 0], [0, 0, 0, 0]])
    lin = sim.linearize(ctrl=[2.0])
    assert lin.undetermined.tolist() == [False, True]
    assert Kink(int(lin.kinks["qpos"][1, 3])) & Kink.UNDETERMINED
    assert not lin.A[1, :, 3].any()
    made = rollout(sim, np.full((3, 2, 1), 2.0), 2)
    gradient = np.ones_like(made.qpos)
    with pytest.raises(UndeterminedDerivative, match=r"control 0 .* qpos\[\d\] .*environment 1.*CONTACT") as caught:
        made.vjp(qpos=gradient)
    assert (caught.value.env, caught.value.control) == (1, 0)
    found = made.vjp(qpos=gradient, undetermined="zero")
    assert found.undetermined.tolist() == [False, True]
    assert not found.ctrl[:, 1].any() and not found.qpos[1].any()
    alone = stepper.Stepper(model, 1, options=sim.options)
    alone.set_state([[0, 0, 0.01, 0]])
    np.testing.assert_array_equal(found.ctrl[:, :1], rollout(alone, np.full((3, 1, 1), 2.0), 2).vjp(qpos=gradient[:, :1]).ctrl)
    assert not made.vjp(qpos=gradient, smoothing=Smoothing(samples=4, qpos=1e-4)).undetermined.any()
    raises(ValueError, "undetermined is 'skip'", made.vjp, qpos=gradient, undetermined="skip")

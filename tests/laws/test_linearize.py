"""Derivatives of the step: closed forms, MuJoCo's, and what must hold of any."""

import dataclasses
from functools import cache

import mujoco
import numpy as np
import pytest
import scipy.linalg
import stepper
from checks import every, raises
from hypothesis import example, given, strategies as st
from models import SOURCES, afloat, random_quaternion, simulate, stepper_model
from numerics import NOISE, joined, touching
from stepper import Drive, Options
from stepper.derivatives import Kink
from stepper.derivatives.perturbations import step_of

G = 9.81
SCHEMES = ["midpoint", "euler", "implicit", "rk4"]
AT_REST = {"stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0}
SLIDE = '<body pos="0 0 .1"><joint name="x" type="slide" axis="{axis}" {more}/><geom type="sphere" size=".1" mass="1" {friction}/></body>'
SLIDER = '<body><joint name="x" type="slide" axis="1 0 0"/><geom type="sphere" size=".1" mass="2"/></body>'
MOTOR = '<actuator><motor joint="x"/></actuator>'
SERVO = '<actuator><position joint="x" kp="100" forcerange="-5 5" ctrllimited="false"/></actuator>'
LIMITED, SMOOTH = 'range="-1 1" limited="true"', 'friction="0 0 0"'
UPRIGHT = SLIDE.replace("<geom", '<joint type="slide" axis="0 0 1"/><geom')
# A plate, whose largest moment of inertia is the sum of the others.
PLATE = '<body><freejoint/><inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .2"/></body>'


def scene(body: str, *, floor: str = "", options: str = "", more: str = "") -> stepper.Model:
    ground = f'<geom name="floor" type="plane" size="9 9 1" {floor}/>' if floor else ""
    return stepper.load(f'<mujoco><option timestep="0.002" {options}/><worldbody>{ground}{body}</worldbody>{more}</mujoco>')


@cache
def ball() -> stepper.Model:
    """A free body of equal moments of inertia, whose angular velocity stays."""
    return scene('<body><freejoint/><inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .1"/></body>')


def skew(r):
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_ballistic_body_turns_on_its_tangent_space(scheme):
    model, rng = ball(), np.random.default_rng(0)
    sim = stepper.Stepper(model, 5, options=Options(integrator=scheme))
    qpos = np.concatenate([rng.normal(size=(5, 3)), np.stack([random_quaternion(rng) for _ in range(5)])], axis=1)
    sim.set_state(qpos, rng.normal(size=(5, 6)) * [1, 1, 1, 9, 9, 9])
    lin, h = sim.linearize(), sim.timestep
    for A, v in zip(lin.A, sim.qvel, strict=True):
        turn = h * v[3:]
        # R exp(r) exp(h w) = R exp(h w) exp(r'), and the right Jacobian of the exponential map.
        angle, K = np.linalg.norm(turn), skew(turn)
        right = np.eye(3) - (1 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * K @ K
        expected = np.eye(12)
        expected[:3, 6:9] = h * np.eye(3)
        expected[3:6, 3:6] = scipy.linalg.expm(-K)
        expected[3:6, 9:] = h * right
        np.testing.assert_allclose(A, expected, rtol=0, atol=NOISE)
    assert lin.B.shape == (5, 12, 0)
    assert not lin.near_kink.any()
    assert lin.causes == Kink.NONE


def spring(damping: float = 3.0):
    return scene(
        f'<body><joint name="x" type="slide" axis="1 0 0" stiffness="50" damping="{damping}"/><geom size=".1" mass="2"/></body>',
        more='<actuator><motor joint="x" gear="4"/></actuator>',
    )


@pytest.mark.parametrize("scheme", ["midpoint", "implicit"])
def test_a_spring_and_damper_follow_the_schemes_own_linear_map(scheme):
    # The midpoint rule takes a little more than half of a damping, so that its own map is that of the textbook without one.
    damping = 3.0 if scheme == "implicit" else 0.0
    sim, h = stepper.Stepper(spring(damping), options=Options(integrator=scheme)), 0.002
    sim.set_state([0.3], [-2.0])
    F, b = np.array([[0, 1], [-25, -damping / 2]]), np.array([[0], [2.0]])
    if scheme == "midpoint":
        A = np.linalg.solve(np.eye(2) - h / 2 * F, np.eye(2) + h / 2 * F)
        B = np.linalg.solve(np.eye(2) - h / 2 * F, h * b)
    else:
        A, B = np.linalg.inv(np.eye(2) - h * F), np.linalg.solve(np.eye(2) - h * F, h * b)
    lin, many = sim.linearize(ctrl=[0.7]), sim.linearize(ctrl=[0.7], nstep=100)
    np.testing.assert_allclose(lin.A, A, atol=NOISE)
    np.testing.assert_allclose(lin.B, B, atol=NOISE)
    np.testing.assert_allclose(many.A, np.linalg.matrix_power(A, 100), atol=NOISE)


def runge_kutta(contact: str) -> stepper.Stepper:
    return stepper.Stepper(spring(), 2, options=Options(contact=contact, integrator="rk4"))


def test_a_spring_and_damper_follow_the_matrix_exponential():
    sim = stepper.Stepper(spring())
    F = np.array([[0, 1], [-25, -1.5]])
    # The midpoint rule's error is h^2 |F|^3 t / 12, 1e-3 at |F| = 25 and t = 0.2, of numbers of order 1 to 5.
    np.testing.assert_allclose(sim.linearize(nstep=100).A, scipy.linalg.expm(0.2 * F), atol=1e-3)


def test_a_pendulum():
    rod = '<body><joint name="hinge" axis="0 1 0"/><inertial pos="0 0 -.5" mass="3" diaginertia="1e-12 1e-12 1e-12"/></body>'
    sim, h = stepper.Stepper(scene(rod), 3, options=Options(integrator="euler")), 0.002
    sim.set_state([[0.3], [1.5], [-2.8]], [[0.0], [3.0], [-1.0]])
    fall = h * G / 0.5 * np.cos(sim.qpos[:, 0])
    one = np.ones(3)
    expected = np.stack([np.stack([1 - h * fall, h * one], axis=1), np.stack([-fall, one], axis=1)], axis=1)
    np.testing.assert_allclose(sim.linearize().A, expected, atol=NOISE)


def test_activations_and_their_controls():
    model = scene(SLIDER, more='<actuator><general joint="x" dyntype="filter" dynprm=".05" gainprm="6"/></actuator>')
    sim, h = stepper.Stepper(model, options=Options(integrator="euler")), 0.002
    sim.set_state(act=[0.4])
    lin = sim.linearize(ctrl=[1.0])
    assert lin.A.shape == (3, 3)
    np.testing.assert_allclose(lin.A[2], [0, 0, 1 - h / 0.05], atol=NOISE)
    np.testing.assert_allclose(lin.B[2], [h / 0.05], atol=NOISE)
    np.testing.assert_allclose(lin.A[1, 2], 6 / 2 * h, atol=NOISE)


def test_a_box_slides_less_far_by_friction():
    box = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="2" friction=".4 0 0"/></body>'
    sim, v, n = simulate(scene(box, floor=SMOOTH), 2, steps=50), np.array([1.0, 0.8]), 40
    sim.set_state(qvel=np.outer(v, [1, 0, 0, 0, 0, 0]))
    lin = sim.linearize(("geom_friction[box]",), nstep=n)
    t = n * sim.timestep
    slides = lin.blocks["geom_friction[box]"]
    assert slides.shape == (2, 12, 3)
    np.testing.assert_allclose(slides[:, 6, 0], -G * t, rtol=1e-6)
    np.testing.assert_allclose(slides[:, 0, 0], -G * t**2 / 2, rtol=1e-6)
    # To where it stops: v^2 / (2 mu g), but for the last step, a hundredth of all.
    stopped = sim.linearize(("geom_friction[box]",), nstep=200)
    np.testing.assert_allclose(stopped.blocks["geom_friction[box]"][:, 0, 0], -(v**2) / (2 * 0.4**2 * G), rtol=0.02)
    np.testing.assert_allclose(stopped.blocks["geom_friction[box]"][:, 6, 0], 0, atol=1e-6)


def test_a_ball_bounces_higher_by_restitution():
    height, e = 0.5, 0.8
    body = f'<body pos="0 0 {0.1 + height}"><freejoint/><geom name="ball" type="sphere" size=".1" mass="2"/></body>'
    sim = simulate(scene(body, floor=SMOOTH).replace(geom_restitution=[0.0, e]), integrator="midpoint")
    speed = np.sqrt(2 * G * height)
    n = round((1 + e) * speed / G / sim.timestep)
    rise = n * sim.timestep - speed / G
    lin = sim.linearize(("geom_restitution[ball]", "qpos"), nstep=n)
    by_restitution = lin.blocks["geom_restitution[ball]"]
    # The scheme is exact in flight, and bounces at the time of the impact; that ball falls and rises on in the step of it is second order.
    np.testing.assert_allclose(by_restitution[8], speed, rtol=1e-3)
    np.testing.assert_allclose(by_restitution[2], speed * rise, rtol=1e-3)
    # At the apex, which is e^2 height high: met to half a step of a rise of 0.26 s.
    np.testing.assert_allclose(by_restitution[2], 2 * e * height, rtol=5e-3)


def test_gravity_and_mass_are_parameters():
    sim = stepper.Stepper(spring(), 3, options=Options(integrator="implicit"))
    sim.randomize(body_mass=np.array([[0.0, 1.0], [0.0, 2.0], [0.0, 4.0]]))
    sim.set_state(np.full((3, 1), 0.2))
    lin = sim.linearize(("body_mass", "ctrl"), ctrl=[0.5])
    assert lin.blocks["body_mass"].shape == (3, 2, 2)
    assert not lin.blocks["body_mass"][:, :, 0].any()
    m, h = np.array([1.0, 2.0, 4.0]), sim.timestep
    force, mass = 4 * 0.5 - 50 * 0.2, m + h * 3 + h**2 * 50
    np.testing.assert_allclose(lin.blocks["body_mass"][:, 1, 1], -h * force / mass**2, rtol=1e-6)
    np.testing.assert_allclose(lin.B[:, 1, 0], 4 * h / mass, rtol=1e-6)


@pytest.mark.parametrize(("robot", "integrator"), [
    *((robot, scheme) for robot in ("hopper", "half_cheetah", "ant", "walker2d_v5") for scheme in ("Euler", "implicitfast")),
    ("humanoid", "Euler"), ("humanoid", "implicitfast"), ("swimmer", "Euler"),
])  # fmt: skip
def test_mujocos_law_has_mujocos_derivatives(robot, integrator):
    own = mujoco.MjModel.from_xml_path(str(SOURCES[f"gymnasium/{robot}"]))
    own.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    own.opt.tolerance, own.opt.iterations, own.opt.ls_tolerance, own.opt.ls_iterations = 0.0, 100, 1e-14, 200
    own.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model = stepper.load(own, strict=False)
    sim = stepper.Stepper(model, 6, options=dataclasses.replace(Options.from_model(model)))
    rng = np.random.default_rng(1)
    for _ in range(8):
        sim.step(rng.uniform(-0.4, 0.4, (6, model.nu)), nstep=15)
    ctrl = rng.uniform(-0.4, 0.4, (6, model.nu))
    lin, touching = sim.linearize(ctrl=ctrl), len(sim.contacts()) > 0
    assert touching or robot == "swimmer"
    data, worst, smooth = mujoco.MjData(own), [], joined(lin.kinks) == 0
    for env in range(6):
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = sim.qpos[env], sim.qvel[env], 0
        mujoco.mj_forward(own, data)
        data.ctrl[:], n = ctrl[env], 2 * own.nv + own.na
        A, B = np.zeros((n, n)), np.zeros((n, own.nu))
        mujoco.mjd_transitionFD(own, data, 1e-6, 1, A, B, None, None)
        theirs = np.concatenate([A, B], axis=1)
        scale = np.maximum(np.abs(theirs).max(axis=0), 1.0)
        worst.append((np.abs(joined(lin.blocks)[env] - theirs).max(axis=0) / scale)[smooth[env]])
    worst = np.concatenate(worst)
    assert smooth.mean() > 0.9
    # Both take differences of 1e-6: of noise 1e-9 to 1e-7 of their own, and contacts' features may change in between.
    assert np.median(worst) < 1e-8
    assert np.mean(worst < 1e-5) > 0.97


@pytest.mark.parametrize("options", [{"contact": "mujoco"}, AT_REST], ids=["mujoco", "hard"])
@pytest.mark.parametrize("robot", ["gymnasium/ant", "gymnasium/hopper", "dm_control/quadruped"])
def test_two_steps_of_differences_agree_away_from_kinks(robot, options):
    sim, ctrl = touching(robot, **options)
    one, two = sim.linearize(ctrl=ctrl), sim.linearize(ctrl=ctrl, step=0.5 * step_of(1e-13))
    a, b = joined(one.blocks), joined(two.blocks)
    scale = np.maximum(np.abs(a).max(axis=1), 1.0)
    same = (np.abs(a - b).max(axis=1) < 1e-6 * scale)[joined(one.kinks) == 0]
    # What is left are kinks that nothing shows, and midpoint's estimate of the velocity to come, which jumps where its sweeps change.
    assert same.size > 0.7 * scale.size
    assert same.mean() > 0.95


def test_extrapolation_says_how_far_it_is_off():
    sim, ctrl = touching("gymnasium/hopper", contact="mujoco")
    plain = sim.linearize(ctrl=ctrl, step=1e-3)
    fine = sim.linearize(ctrl=ctrl)
    lin = sim.linearize(ctrl=ctrl, step=1e-3, extrapolate=True)
    smooth = (joined(lin.kinks) | joined(plain.kinks)) == 0
    off = np.abs(joined(lin.blocks) - joined(fine.blocks)).max(axis=1)[smooth]
    assert smooth.mean() > 0.5
    before = np.abs(joined(plain.blocks) - joined(fine.blocks)).max(axis=1)[smooth]
    curved = before > 1e-6
    assert curved.mean() > 0.1
    assert np.median(off[curved] / before[curved]) < 0.05
    assert np.mean(off <= joined(lin.errors).max(axis=1)[smooth] + 1e-6) > 0.95


@pytest.mark.parametrize("extrapolate", [False, True])
def test_differences_to_one_side_agree_with_central_ones(extrapolate):
    sim, ctrl = touching("gymnasium/hopper", contact="mujoco")
    central = sim.linearize(ctrl=ctrl)
    # The error of first order is seen at a wider step, and is what extrapolation takes away.
    lin = sim.linearize(ctrl=ctrl, centered=False, step=1e-4, extrapolate=extrapolate)
    smooth = (joined(lin.kinks) | joined(central.kinks)) == 0
    assert smooth.mean() > 0.5
    scale = np.maximum(np.abs(joined(central.blocks)).max(axis=1), 1.0)

    def off(lin):
        return np.quantile((np.abs(joined(lin.blocks) - joined(central.blocks)).max(axis=1) / scale)[smooth], 0.9)

    # Half a curvature of order 1 to 10, over the step; the extrapolation's is of second order.
    assert off(lin) < 1e-6 if extrapolate else 1e-5 < off(lin) < 1e-3
    assert not (joined(lin.kinks) & int(Kink.SLOPE)).any()
    # At a hundredth of the step it is a hundredth.
    assert off(sim.linearize(ctrl=ctrl, centered=False)) < 1e-5


def test_copies_that_are_kept_leave_nothing_to_the_next_linearization():
    sim, ctrl = touching("gymnasium/ant")
    sim.linearize(ctrl=ctrl)
    sim.step(ctrl, nstep=40)
    sim.xfrc_applied[:, 1, 2] = 30.0
    sim.linearize(ctrl=ctrl)
    sim.linearize(("qpos", "body_mass"), ctrl=ctrl)
    sim.xfrc_applied[:] = 0.0
    other = stepper.Stepper(sim.model, 8, options=sim.options)
    other.set_state(sim.get_state())
    ours, theirs = sim.linearize(ctrl=ctrl), other.linearize(ctrl=ctrl)
    np.testing.assert_array_equal(joined(ours.blocks), joined(theirs.blocks))
    np.testing.assert_array_equal(joined(ours.kinks), joined(theirs.kinks))


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_simulation_is_not_touched(precision):
    model = stepper_model("gymnasium/ant", strict=False)
    drives = None if precision == "f32" else stepper.ActuatorModel(default=Drive(delay=0.03, lag=0.01))
    sensors = None if precision == "f32" else stepper.SensorModel(default=stepper.Transfer(noise_std=0.1, delay=0.02))
    sim, rng = stepper.Stepper(model, 4, precision=precision, actuators=drives, sensors=sensors), np.random.default_rng(0)
    sim.randomize(geom_friction=np.tile(model.geom_friction, (4, 1, 1)) * rng.uniform(0.5, 1, (4, 1, 1)))
    sim.step(rng.uniform(-1, 1, (4, model.nu)), nstep=100)
    sim.xfrc_applied[:, 1, 0] = 5.0
    untouched = ("status", "residual", "max_penetration", "ctrl", "xfrc_applied")
    before, there = sim.get_state(), [np.array(getattr(sim, name)) for name in untouched]
    sim.linearize(("qpos", "qvel", "ctrl", "geom_friction"), ctrl=np.zeros(model.nu), nstep=2)
    assert sim.get_state() == before
    for name, value in zip(untouched, there, strict=True):
        np.testing.assert_array_equal(getattr(sim, name), value)


def test_a_batch_is_its_environments_with_their_memory_and_parameters():
    model = stepper_model("gymnasium/half_cheetah", strict=False)
    delays = np.array([0.0, 0.02, 0.05])
    sim, rng = stepper.Stepper(model, 3, actuators=stepper.ActuatorModel(default=Drive(delay=delays, lag=0.02))), np.random.default_rng(0)
    friction = np.tile(model.geom_friction, (3, 1, 1)) * np.array([0.5, 1.0, 2.0])[:, None, None]
    sim.randomize(geom_friction=friction)
    sim.step(rng.uniform(-1, 1, (3, model.nu)), nstep=60)
    sim.qfrc_applied[2, 2] = 3.0
    ctrl = rng.uniform(-1, 1, (3, model.nu))
    batch = sim.linearize(ctrl=ctrl, nstep=3, sensors=True)
    # A delay of two steps of 10 ms lets a control be felt in the third, one of five does not.
    assert np.abs(batch.B[1]).max() > 1e-3
    assert not batch.B[2].any()
    # The memory of the longest delay line fits a stepper that has that drive alone.
    alone = stepper.Stepper(model, 1, actuators=stepper.ActuatorModel(default=Drive(delay=delays[2:], lag=0.02)))
    alone.randomize(geom_friction=friction[2:])
    alone.qfrc_applied[0, 2] = 3.0
    alone.set_state(sim.get_state(env=2))
    lin = alone.linearize(ctrl=ctrl[2], nstep=3, sensors=True)
    for name in ("qpos", "qvel", "ctrl"):
        np.testing.assert_array_equal(lin.blocks[name][0], batch.blocks[name][2])
        np.testing.assert_array_equal(lin.kinks[name][0], batch.kinks[name][2])


def test_a_batch_in_parts_is_the_batch_at_once(monkeypatch):
    # Environments of every part lack what one of another part has: the longest delays, whose sums are not those of the largest terms, lags.
    model = scene(SLIDER, more='<actuator><motor joint="x" gear="4"/></actuator><sensor><jointpos joint="x"/></sensor>')
    drive = Drive(
        delay=np.array([0.0, 0.004, 0.001]), delay_steps=np.array([0.0, 0.0, 4.0]), lag=np.array([0.01, 0.0, 0.0]),
        limits=(np.array([-np.inf, -9, -9]), np.array([np.inf, 9, 9])), servo=stepper.actuators.PID(kp=np.array([3.0, 4.0, 5.0]), ki=2.0),
    )  # fmt: skip
    transfer = stepper.Transfer(
        noise_std=np.array([0.0, 0.0, 0.1]), delay=np.array([0.02, 0.004, 0.0]), jitter=np.array([0.0, 0.004, 0.005])
    )
    sensors = stepper.SensorModel(default=transfer)
    sim, rng = stepper.Stepper(model, 3, actuators=stepper.ActuatorModel(default=drive), sensors=sensors), np.random.default_rng(0)
    for _ in range(20):
        sim.step(rng.uniform(-1, 1, (3, 1)))
    ctrl = rng.uniform(-1, 1, (3, 1))
    whole = sim.linearize(ctrl=ctrl, nstep=6, sensors=True)
    monkeypatch.setattr("stepper.derivatives.copies.COPIES_PER_THREAD", 8)
    parts = sim.linearize(ctrl=ctrl, nstep=6, sensors=True)
    for name in ("A", "B", "C", "D", "qpos", "qvel", "near_kink"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    sim.step(ctrl, nstep=6)
    np.testing.assert_allclose(parts.qvel, sim.qvel, rtol=0, atol=1e-12)  # Tolerances of solvers differ.


@pytest.mark.parametrize("num_envs", [None, 2])
def test_a_mocap_body_at_the_origin_stays_there(num_envs):
    model = scene(
        '<body name="table" mocap="true" pos="0 0 1"><geom type="box" size=".5 .5 .1"/></body>'
        '<body pos="0 0 1.2"><freejoint/><geom type="sphere" size=".1" mass="2"/></body>'
    )
    sim = stepper.Stepper(model, num_envs)
    sim.mocap_pos[...] = 0.0
    lin = sim.linearize()
    sim.step()
    # The table is 1 m below the ball, which falls.
    assert (sim.qvel[..., 2] < 0).all()
    np.testing.assert_array_equal(lin.qvel, sim.qvel)
    np.testing.assert_array_equal(lin.qpos, sim.qpos)


def test_a_single_environment_has_no_leading_axis():
    model = stepper_model("gymnasium/hopper", strict=False)
    single, one = stepper.Stepper(model), stepper.Stepper(model, 1)
    lin, batch = single.linearize(nstep=2, sensors=True), one.linearize(nstep=2, sensors=True)
    for name in ("A", "B", "C", "D", "near_kink", "kinked_steps", "kink_distance", "status", "residual", "qpos", "qvel", "act"):
        np.testing.assert_array_equal(getattr(lin, name), getattr(batch, name)[0])
    assert lin.A.shape == (12, 12)
    assert lin.kinked_steps.shape == (2,)


@example(seed=5135, robot="gymnasium/humanoid")
@given(seed=st.integers(0, 10**6), robot=st.sampled_from(["gymnasium/ant", "dm_control/fish", "gymnasium/humanoid"]))
def test_two_steps_are_the_product_of_one_and_one(seed, robot):
    model, rng = floating(robot), np.random.default_rng(seed)
    sim = simulate(model, qpos=model.integrate_pos(model.qpos0, rng.normal(size=model.nv)), qvel=rng.normal(size=model.nv))
    ctrl = rng.uniform(-0.3, 0.3, model.nu)
    both, first = sim.linearize(ctrl=ctrl, nstep=2), sim.linearize(ctrl=ctrl)
    sim.step(ctrl)
    second = sim.linearize()
    # The terms of a product may cancel, and each errs in proportion to its size: by 5e-6 in the worst of 700 draws of the fish.
    for found, before, own in ((both.A, first.A, 0.0), (both.B, first.B, second.B)):
        size = max(1.0, (np.abs(second.A) @ np.abs(before)).max())
        np.testing.assert_allclose(found, second.A @ before + own, atol=1e-5 * size)
    sim.step()
    np.testing.assert_allclose(both.qvel, sim.qvel)
    # Nothing depends on where a robot floats.
    if model.joint(0).type == "free":
        expected = np.zeros((2 * model.nv + model.na, 3))
        expected[:3] = np.eye(3)
        # Differences err in proportion to the largest entries: seed 5135 has entries of 19, and errs by 1.7e-7.
        np.testing.assert_allclose(first.A[:, :3], expected, atol=1e-7 * max(1.0, np.abs(first.A).max()))


@cache
def floating(robot):
    return stepper.load(afloat(robot, gravity=False), strict=False)


def test_kinks_are_seen():
    model = scene('<body pos="0 0 .1"><freejoint/><geom name="ball" type="sphere" size=".1" mass="2"/></body>', floor='friction=".5"')
    sim = stepper.Stepper(model, 4)
    # Open by far, closing by a step that just touches, sliding, and coming to rest from sliding with less than a step's friction.
    h = sim.timestep
    sim.set_state(qpos=[[0, 0, z, 1, 0, 0, 0] for z in (0.5, 0.1 + 0.5 * h * 1 * 0.0 + 1e-3, 0.1 - 2e-6, 0.1 - 2e-6)])
    sim.set_state(qvel=[[0, 0, 0, 0, 0, 0], [0, 0, -1e-3 / h + G * h / 2, 0, 0, 0], [1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]])
    lin = sim.linearize()
    assert not lin.near_kink[0]
    assert np.isinf(lin.kink_distance[0])
    # A gap of 2e-6 m is two widths from being none.
    np.testing.assert_allclose(lin.kink_distance[2:], 2.0, rtol=0.05)
    wide = sim.linearize(step=4e-6)
    assert wide.near_kink[2:].all()
    assert (wide.kinks["qpos"][2:, 2] & int(Kink.GAP)).all()
    assert wide.kink_distance[2] < 1


def sliding(axis="1 0 0", more="", friction="", drive=MOTOR, body=SLIDE, **settings):
    return scene(body.format(axis=axis, more=more, friction=friction), more=drive, **settings)


@pytest.mark.parametrize(("model", "options", "qpos", "ctrl", "name", "kink"), [
    pytest.param(sliding(drive=SERVO), {}, None, [[0.05], [0.02]], "ctrl", Kink.SATURATION, id="servo that asks for its 5 N"),
    pytest.param(sliding(more='frictionloss="1"'), {}, None, [[1.0], [0.5]], "ctrl", Kink.DRY_FRICTION, id="dry friction that just holds"),
    pytest.param(sliding(more=LIMITED), {"contact": "mujoco"}, [[1 - 1e-7], [0.5]], None, "qpos", Kink.LIMIT, id="limit, inside"),
    pytest.param(sliding(more=LIMITED), {"contact": "mujoco"}, [[1 + 1e-7], [0.5]], None, "qpos", Kink.LIMIT, id="limit, outside"),
    pytest.param(sliding(body=UPRIGHT, friction='friction=".5 0 0"', floor=SMOOTH), AT_REST, None, [[0.5 * G], [1.0]], "qvel", Kink.SLIP,
                 id="friction of half the weight that just sticks"),
    pytest.param(sliding("0 0 1", friction=SMOOTH, floor=SMOOTH), AT_REST, None, [[G], [1.0]], "ctrl", Kink.CONTACT,
                 id="contact that a motor takes all the weight from"),
])  # fmt: skip
def test_a_column_is_flagged_in_the_environment_that_is_at_the_kink(*, model, options, qpos, ctrl, name, kink):
    lin = simulate(model, 2, integrator="euler", **options, qpos=qpos).linearize(ctrl=ctrl)
    assert lin.kink_distance[0] <= 1.0
    np.testing.assert_array_equal(lin.kinks[name][:, 0] & int(kink) != 0, [True, False])
    assert not lin.near_kink[1]


# A string of 2 m over a cylinder of radius 0.1 m in its middle touches it if the end is below this height above the cylinder's axis, m.
TANGENT = 2 * np.tan(np.arcsin(0.1))
ABSENT = 'contype="0" conaffinity="0"'
STRING = scene(
    f'<site name="a" pos="-1 0 0"/><geom name="drum" type="cylinder" size=".1 .2" euler="90 0 0" {ABSENT}/>'
    f'<body pos="1 0 0"><joint name="x" type="slide" axis="0 0 1"/><geom size=".05" mass="1" {ABSENT}/><site name="b"/></body>',
    more='<tendon><spatial name="t" stiffness="1" springlength="1"><site site="a"/><geom geom="drum"/><site site="b"/></spatial></tendon>'
    + MOTOR,
)
CUP = scene(
    '<body name="cup"><joint name="x" type="slide" axis="0 0 1"/><geom type="box" size=".1 .1 .1" mass="1" gap=".01"/></body>',
    floor='friction="0 0 0"', more='<actuator><adhesion body="cup" gain="20" ctrlrange="0 1"/></actuator>',
)  # fmt: skip


@pytest.mark.parametrize("arguments", [{}, {"centered": False}, {"method": "implicit"}], ids=str)
@every(contact=["hard", "mujoco"], kink=[Kink.WRAP, Kink.ADHESION])
def test_a_switch_of_a_tendon_or_of_suction_is_a_kink(kink, contact, arguments):
    """The end of a string and a cup, 3e-7 m from where the string touches a drum and suction begins, and far away."""
    # Differences move them by 1e-6 m. Suction begins at the gap of the cup, with hard contact 1e-5 m above it.
    reach = 1e-5 if contact == "hard" else 0.0
    model, edge = (STRING, TANGENT) if kink == Kink.WRAP else (CUP, 0.11 + reach)
    for side in (3e-7, -3e-7):
        sim = simulate(model, 2, integrator="euler", contact=contact, qpos=[[edge + side], [edge + 0.1]])
        lin = sim.linearize(ctrl=[1.0], **arguments)
        # One-sided differences move the coordinate upwards.
        crosses = side < 0 or arguments != {"centered": False}
        np.testing.assert_array_equal(lin.kinks["qpos"][:, 0] & int(kink) != 0, [crosses, False], err_msg=str(side))
        assert (lin.kink_distance <= 1.0).tolist() == [crosses, False]
        assert not lin.near_kink[1]


def test_a_control_at_its_bound_is_perturbed_inwards():
    motor = '<actuator><motor joint="x" gear="4" ctrlrange="-1 1" ctrllimited="true"/></actuator>'
    sim = stepper.Stepper(scene(SLIDER, more=motor), 4)
    lin = sim.linearize(("ctrl",), ctrl=[[1.0], [-1.0], [0.3], [1.5]])
    np.testing.assert_allclose(lin.B[:, 1, 0], np.array([2, 2, 2, 0]) * sim.timestep, atol=NOISE)
    assert not lin.near_kink.any()


def test_whole_fields_skip_what_the_model_has_none_of():
    slide = '<body><joint name="x" type="slide" axis="1 0 0" damping="1"/><geom size=".1"/></body>'
    body = f'<body><freejoint/><geom size=".1" mass="2"/>{slide}</body>'
    sim = simulate(scene(body, more=MOTOR), qvel=[0, 0, 0, 0, 0, 0, 1.0])
    lin = sim.linearize(("actuator_gainprm", "actuator_biasprm", "dof_damping", "dof_armature"), ctrl=[1.0])
    gain, damping = lin.blocks["actuator_gainprm"], lin.blocks["dof_damping"]
    # A motor's force is its gain times the control, so that both have one derivative.
    np.testing.assert_allclose(gain[:, 0, 0], sim.linearize(("ctrl",), ctrl=[1.0]).B[:, 0], atol=NOISE)
    assert not gain[:, 0, 1:].any()
    assert not lin.blocks["actuator_biasprm"].any()
    assert not damping[:, :6].any()
    assert damping[13, 6] < 0
    raises(ValueError, "of these elements is 0 and cannot be perturbed", sim.linearize, ("dof_damping[0]",))


def test_nothing_to_perturb_is_empty():
    empty = stepper.load('<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>')
    assert stepper.Stepper(empty, 2).linearize(sensors=True).A.shape == (2, 0, 0)
    assert stepper.Stepper(ball(), 2).linearize(("ctrl",)).B.shape == (2, 12, 0)


@pytest.mark.parametrize(("call", "message"), [
    (lambda sim: sim.linearize(method="exact"), "must be 'fd' or 'implicit'"),
    (lambda sim: sim.linearize(("qvl",)), "did you mean qvel"),
    (lambda sim: sim.linearize("qpos"), "sequence of names"),
    (lambda sim: sim.linearize(("dof_damping[y]",)), "no joint 'y'"),
    (lambda sim: sim.linearize(("gravity[x]",)), r"columns are \['x'\], must be numbers, as 'gravity\[0\]'"),
    (lambda sim: sim.linearize(("actuator_kp",)), r"write 'actuator_gainprm\[...\]\[0\]' and 'actuator_biasprm\[...\]\[1\]'"),
    (lambda sim: sim.linearize(ctrl=np.zeros(3)), r"ctrl has shape \(3,\)"),
    (lambda sim: sim.linearize(ctrl=[np.nan]), "not finite"),
    (lambda sim: sim.linearize(nstep=0), "nstep is 0"),
    (lambda sim: sim.linearize(step=-1), "step is -1"),
    (lambda sim: sim.linearize(("qpos", "qvel")).A, "'act' in wrt"),
    (lambda sim: sim.linearize().C, "sensors=True"),
    (lambda sim: stepper.Stepper(scene(PLATE)).linearize(("body_inertia",)), "^a parameter cannot be perturbed: .*wrt"),
    (lambda sim: stepper.Stepper(ball()).linearize(("body_mass[world]",)), "of these elements is 0 and cannot be perturbed"),
    (lambda sim: sim.linearize(("qpos", "body_mass"), method="implicit"), r"body_mass.*method='fd'"),
    (lambda sim: sim.linearize(method="implicit", sensors=True), r"sensors=True.*method='fd'"),
    (lambda sim: sim.linearize(method="implicit", extrapolate=True), "extrapolate"),
    (lambda sim: runge_kutta("hard").linearize(method="implicit"), r"integrator is rk4, must be midpoint, euler or implicit .*method='fd'"),
    (lambda sim: runge_kutta("mujoco").linearize(method="implicit"), "integrator is rk4, must be euler, implicitfast or implicit"),
])  # fmt: skip
def test_wrong_calls_say_what_to_do(call, message):
    raises((ValueError, TypeError, KeyError, stepper.ModelError), message, lambda: call(stepper.Stepper(spring(), 2)))

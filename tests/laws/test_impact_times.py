"""Impacts happen at their own time within a step: second order wherever that is, and no energy comes of it; so are rolling and riding.

The bounds of slopes are 1.8: 2 with what a fit over five time steps of a coarse and a fine end leaves open.
"""

from itertools import pairwise

import numpy as np
import pytest
import stepper
from checks import every
from models import simulate
from numerics import slope

G, R = 9.81, 0.1
FLOOR = '<geom type="plane" size="9 9 1"/>'
ARM = """<mujoco><worldbody><geom type="plane" size="9 9 1" zaxis="-1 0 0" pos=".45 0 0"/>
  <body pos="0 0 1.5"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5" contype="0" conaffinity="0"/>
  <body pos="0 0 -.5"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4" contype="0" conaffinity="0"/>
  <geom size=".05" pos="0 0 -.4" condim="1"/></body></body></worldbody></mujoco>"""


def elastic(text: str, e: float, num_envs: int | None = None, gravity: str = f"0 0 {-G}", **options) -> stepper.Stepper:
    """A world without friction in which everything bounces with `e`."""
    head = f'<mujoco><option gravity="{gravity}"/><default><geom condim="1"/></default>'
    model = stepper.load(f"{head}<worldbody>{text}</worldbody></mujoco>")
    return simulate(model.replace(geom_restitution=np.full(model.ngeom, e)), num_envs, **options)


def ball(x: float = 0.0, y: float = 0.0, z: float = 0.0, r: float = R, more: str = "") -> str:
    return f'<body pos="{x!r} {y!r} {z!r}"><freejoint/><geom size="{r}" mass="1" {more}/></body>'


def pit() -> str:
    """Five balls above a floor between four walls that lean outwards."""
    sides = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    walls = "".join(f'<geom type="plane" size="9 9 1" pos="{-0.6 * x} {-0.6 * y} 0" zaxis="{x} {y} .2"/>' for x, y in sides)
    return FLOOR + walls + "".join(ball(0.25 * (k % 2), 0.25 * (k // 2), 0.5 + 0.25 * (k // 4)) for k in range(5))


def energies(sim: stepper.Stepper) -> np.ndarray:
    return np.atleast_1d(np.sum(sim.energy(), axis=0))


@every(integrator=["midpoint", "rk4"], dt=[2e-3, 1e-2], e=[0.3, 0.5, 0.8, 1.0])
def test_apexes_are_exact_at_every_height(e, dt, integrator):
    """Free fall is a parabola, which the step knows: what is left is rounding."""
    heights = np.linspace(0.5, 1.0, 20, endpoint=False)
    sim = elastic(FLOOR + ball(), e, 20, timestep=dt, integrator=integrator)
    qpos = sim.qpos.copy()
    qpos[:, 2] = R + heights
    sim.set_state(qpos=qpos)
    before, bounces = np.zeros(20), np.zeros(20, int)
    while (bounces < 2).any():
        sim.step()
        z, v = sim.qpos[:, 2] - R, sim.qvel[:, 2]
        top = (before > 0) & (v <= 0) & (bounces < 2)
        bounces[top] += 1
        np.testing.assert_allclose((z + v**2 / (2 * G))[top], (e ** (2 * bounces) * heights)[top], rtol=1e-11)
        before = v


@pytest.mark.parametrize("e", [0.3, 0.5, 0.9])
def test_colliding_spheres_only_lose_energy(e):
    """Sixteen times five spheres in a pit of planes: whenever they strike, in whatever number, energy falls."""
    sim = elastic(pit(), e, 16, timestep=2e-3)
    sim.set_state(qvel=np.random.default_rng(3).normal(scale=2.0, size=(16, 30)))
    first = last = energies(sim)
    for _ in range(600):
        sim.step()
        now = energies(sim)
        # What overlaps by up to the slop is pushed out by a fifth of it a step, against gravity: 1e-5 m * 1 kg * g, for five.
        assert (now < last + 5e-4).all()
        last = now
    assert (now < first).all()


def test_an_oblique_bounce_with_friction_is_of_second_order():
    """A ball with topspin strikes the floor: Coulomb's impulse at the time of the impact, sliding or sticking, by hand."""
    model = stepper.load(f"<mujoco><worldbody>{FLOOR}{ball(z=0.5)}</worldbody></mujoco>")
    model = model.replace(geom_restitution=[0.0, 0.6], geom_friction=[[0.3, 0, 0], [0.3, 0, 0]])
    for vx, spin in [(3.0, 0.0), (0.5, 0.0), (0.2, 20.0)]:
        for dt in (1e-3, 7e-3):
            sim = simulate(model, timestep=dt, qvel=[vx, 0, 0, 0, spin, 0])
            fall = np.sqrt(2 * 0.4 / G)
            sim.step(nstep=round(0.5 / dt))
            time = round(0.5 / dt) * dt
            push = 1.6 * G * fall
            slip, inertia = vx - R * spin, 0.4 * R**2
            drag = -np.sign(slip) * min(0.3 * push, abs(slip) * 2 / 7)
            v, w = vx + drag, spin - R * drag / inertia
            # The step is taken where the straight way would have struck, G dt^2 / 2 too high at the most; the arm is longer by half of
            # that, 2.5 dt^2 of 0.1 m, and more than 3 m/s does not slip. And the solver's tolerance.
            off = 1e-6 + 25 * dt**2
            assert sim.qvel[0] == pytest.approx(v, abs=off)
            assert sim.qvel[4] == pytest.approx(w, abs=off / R * 2.5)
            assert sim.qpos[0] == pytest.approx(vx * fall + v * (time - fall), abs=off)
            assert sim.qpos[2] == pytest.approx(R + 0.6 * G * fall * (time - fall) - G * (time - fall) ** 2 / 2, abs=1e-9)


def test_an_arm_that_strikes_a_wall_converges_with_the_square_of_the_step():
    """Two hinges, inertial forces that jump at the impact, one bounce with e 0.7."""
    model = stepper.load(ARM)
    model = model.replace(geom_restitution=np.full(model.ngeom, 0.7))

    def end(dt):
        sim = simulate(model, timestep=dt, qpos=[0.6, 0.3], qvel=[-2.0, -1.0], steps=round(0.6 / dt))
        return np.concatenate([sim.qpos, sim.qvel])

    # From 1 ms on: after the impact an elbow turns with 15 rad/s, and forces of the velocity after it are taken up to 0.02 rad a step.
    exact, dts = end(1e-5), [1e-3, 5e-4, 2.5e-4, 1.25e-4]
    errors = [np.abs(end(dt) - exact).max() for dt in dts]
    # The phase of the impact in the step differs between them, and with it the constant: 1 is first order.
    assert slope(dts, errors) > 1.6
    assert errors[0] < 5e-3


def test_a_plate_that_is_struck_stays_on_the_floor():
    """The way that an impulse adds within its step is seen by the contacts below: nothing is pushed through."""
    plate = '<body pos="0 0 .02"><freejoint/><geom type="box" size=".2 .2 .02" mass="2"/></body>'
    model = stepper.load(f"<mujoco><worldbody>{FLOOR}{plate}{ball(z=0.64)}</worldbody></mujoco>")
    # The pair takes the larger coefficient: none between plate and floor is meant, so the plate is inelastic.
    model = model.replace(geom_restitution=[0.0, 0.0, 0.8])
    for dt in (1e-3, 5e-3):
        sim = stepper.Stepper(model, options=stepper.Options(timestep=dt))
        lowest = 1.0
        for _ in range(round(2 / dt)):
            sim.step()
            lowest = min(lowest, sim.qpos[2])
        assert lowest > 0.02 - 3e-5  # m: the slop, and what a solution for positions to 1e-4 m/s leaves.


@every(e=[0.1, 0.5, 0.9], dt=[1e-3, 1e-2])
def test_a_ball_that_bounces_comes_to_rest(dt, e):
    """Bounces shorter than a step are none: neither hovering nor sinking. At 10 ms those with e 0.9 last 2 v / g (1 - e) = 4 s."""
    sim = elastic(FLOOR + ball(z=0.3), e, timestep=dt)
    sim.step(nstep=round(6 / dt))
    assert np.abs(sim.qvel).max() < 1e-9
    assert abs(sim.qpos[2] - R) < 2e-5


# Elastic impacts of bodies that turn are of second order: a flight ends at the time of the impact, and velocities jump there.

BOX = '<body pos="0 0 1"><freejoint/><geom type="box" size=".1 .15 .2" mass="1"/></body>'
ENVS = 64


def boxes(timestep: float, *, bodies: int = 1, restitution: float = 1.0, num_envs: int = ENVS, **options) -> stepper.Stepper:
    """Boxes that turn at 5 rad/s about random axes, and fall on a plane without friction."""
    text = "".join(BOX.replace("0 0 1", f"{k} 0 1") for k in range(bodies))
    model = stepper.load(f'<mujoco><default><geom condim="1" friction="0"/></default><worldbody>{FLOOR}{text}</worldbody></mujoco>')
    sim = simulate(model.replace(geom_restitution=np.full(model.ngeom, restitution)), num_envs, timestep=timestep, **options)
    rng = np.random.default_rng(0)
    qpos, qvel = sim.qpos.copy(), rng.normal(size=sim.qvel.shape) * np.tile([1, 1, 1, 5, 5, 5], bodies)
    qpos[:, 2::7] = rng.uniform(0.5, 1.5, qpos[:, 2::7].shape)
    sim.set_state(qpos=qpos, qvel=qvel)
    return sim


def energy_error(sim: stepper.Stepper, seconds: float = 2.0) -> np.ndarray:
    """Largest deviation of the energy of each environment from its first value, as a fraction of it."""
    start, error = np.sum(sim.energy(), axis=0), np.zeros(sim.num_envs)
    for _ in range(round(seconds / sim.timestep)):
        sim.step()
        assert not (sim.status & ~stepper.Status.OK).any()
        error = np.maximum(error, np.abs(np.sum(sim.energy(), axis=0) / start - 1))
    return error


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize(("timestep", "most"), [(2e-3, 1e-4), (1e-2, 1e-3)])
def test_the_energy_of_tumbling_elastic_boxes_is_constant(timestep, most, precision):
    """One impulse for the whole step gives 4e-3 and 2e-2; measured 1e-5 and 2.2e-4."""
    assert np.median(energy_error(boxes(timestep, precision=precision))) < most


def test_the_energy_is_of_second_order():
    """From 10 ms to 2.5 ms the error falls to a sixteenth. Between two steps, other impacts happen: 1.7 of 2 orders are asked for."""
    coarse, fine = (np.median(energy_error(boxes(timestep))) for timestep in (1e-2, 2.5e-3))
    assert coarse / fine > 4**1.7


@every(integrator=["midpoint", "implicit", "rk4"], precision=["f64", "f32"])
def test_parts_of_a_step_depend_on_no_neighbour(integrator, precision):
    """Environments of a batch divide their steps at other times, and have the bits of an environment of their own."""
    settings = {"integrator": integrator, "precision": precision, "restitution": 0.7}
    batch = boxes(5e-3, num_envs=9, **settings)
    qpos, qvel = batch.qpos.copy(), batch.qvel.copy()
    alone = [boxes(5e-3, num_envs=1, **settings) for _ in range(9)]
    for env, sim in enumerate(alone):
        sim.set_state(qpos=qpos[env : env + 1], qvel=qvel[env : env + 1])
    divided = 0
    for _ in range(200):
        batch.step()
        divided += np.unique(batch.substeps).size > 1
        for env, sim in enumerate(alone):
            sim.step()
            np.testing.assert_array_equal(sim.qpos[0], batch.qpos[env])
            np.testing.assert_array_equal(sim.qvel[0], batch.qvel[env])
            assert (sim.substeps[0], sim.status[0]) == (batch.substeps[env], batch.status[env])
            assert sim.contacts(0)["force"].tobytes() == batch.contacts(env)["force"].tobytes()
    assert divided > 20


def test_the_impulses_of_the_parts_are_summed():
    """The momentum that a step gains is the sum of the contact impulses, and of gravity."""
    sim = boxes(1e-2, num_envs=8)
    divided = 0
    for _ in range(100):
        before = sim.qvel[:, 2].copy()
        sim.step()
        divided += int((sim.substeps > 0).sum())
        for env in range(8):
            force = sum(contact["force"][0] for contact in sim.contacts(env))
            # Rounding of a momentum of 10 kg m/s.
            assert sim.qvel[env, 2] - before[env] == pytest.approx((force - 9.81) * 1e-2, abs=1e-12)
    assert divided > 10


def test_an_inelastic_impact_keeps_the_momentum_of_a_mechanism():
    """Momentum after a ball hits floating links has an error of second order: inertial forces are evaluated before and after the jump."""
    link = '<geom type="capsule" size=".05" fromto="0 0 0 .6 0 0" contype="0" conaffinity="0"/>'
    model = stepper.load(
        f"""<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/><geom size=".15" mass="2"/>
        <body pos=".2 0 0"><joint axis="0 1 0"/>{link}<body pos=".6 0 0"><joint axis="0 0 1"/>{link}</body></body></body>
        <body pos=".05 .03 1"><freejoint/><geom size=".1" mass="5"/></body></worldbody></mujoco>"""
    )
    rng, qvel, errors = np.random.default_rng(0), np.zeros((32, model.nv)), []
    qvel[:, 6:8], qvel[:, 10] = rng.uniform(-2, 2, (32, 2)), rng.uniform(-6, -4, 32)
    for h in (1e-3, 5e-4):
        sim = simulate(model, 32, timestep=h, qvel=qvel)
        before = np.concatenate(sim.momentum(), axis=1)
        sim.step(nstep=round(0.5 / h))
        errors.append(np.sqrt(np.mean((np.concatenate(sim.momentum(), axis=1) - before) ** 2)))
    # Of 20 kg m/s. With inertial forces at the mean velocity alone the first error is 2e-2, and the second is half of it.
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 3


def test_a_ball_comes_to_rest_and_its_steps_are_whole_again():
    """Bounces shorter than a step rest: the number of parts of a step is bounded."""
    model = stepper.load(f'<mujoco><worldbody>{FLOOR}<body pos="0 0 .5"><freejoint/><geom size=".1"/></body></worldbody></mujoco>')
    sim = simulate(model.replace(geom_restitution=np.full(model.ngeom, 0.8)), timestep=5e-3)
    most = 0
    for _ in range(2000):
        sim.step()
        most = max(most, int(sim.substeps))
    assert 3 <= most <= 5
    assert sim.substeps == 0
    assert abs(sim.qvel).max() < 1e-9


@pytest.mark.parametrize("error", [1e-3, 1e-5])
def test_steps_that_keep_an_error_end_with_impacts(error):
    """Impacts divide the intervals of step doubling. The energy error of boxes falls with the error that is asked for."""
    sim = boxes(1e-2, num_envs=8, error=error)
    assert np.median(energy_error(sim, 1.0)) < 10 * error
    assert (sim.substeps > 0).all()


def test_a_bounce_beside_a_resting_stack_changes_nothing_of_it():
    """Mechanisms that no impact touches keep their whole step, contacts and impulses included."""
    stack = "".join(f'<body pos="3 0 {0.1 + 0.2 * k}"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>' for k in range(3))
    ball = '<body pos="0 0 .3"><freejoint/><geom name="ball" size=".1" mass="1"/></body>'

    def world(text: str) -> stepper.Stepper:
        model = stepper.load(f"<mujoco><worldbody>{FLOOR}{text}</worldbody></mujoco>")
        restitution = np.array([*[0.0] * (model.ngeom - 1), float("ball" in text)])
        # The tolerance is relative to the speed of the fastest body, unless it is small.
        return simulate(model.replace(geom_restitution=restitution), timestep=5e-3, tolerance=1e-9)

    alone, beside = world(stack), world(stack + ball)
    for _ in range(200):
        alone.step()
        beside.step()
        # The solver stops at the same residual, on rows in another order.
        np.testing.assert_allclose(beside.qpos[:21], alone.qpos, atol=1e-8)
        forces = [sum(c["force"][0] for c in sim.contacts() if 2 < c["pos"][0] < 4 and c["pos"][2] < 0.05) for sim in (alone, beside)]
        np.testing.assert_allclose(forces, 3 * 9.81, atol=0.05)


# Rolling and riding on surfaces that move is of second order: friction asks for the velocity of the place where the contact will be. A
# solid ball's centre moves on a circle in the room, with two sevenths of the table's rate (Weltner 1979, American Journal of Physics 47,
# 984). The bounds of slopes are 1.9: 2 with what a fit leaves open where errors of the next order are still seen.

DTS = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4]
TURN, BALL_RADIUS, START, SPEED, SECONDS = 3.0, 0.05, 0.3, 0.4, 2.0  # rad/s, m, m from the axis, m/s, s
BALL = f'<body pos="{START} 0 {BALL_RADIUS}"><freejoint/><geom size="{BALL_RADIUS}" mass="1"/></body>'
HINGED = '<body pos="0 0 -.1"><joint axis="0 0 1"/><geom type="box" size="3 3 .1" mass="1e6"/></body>'
# The velocity of the ball alone, without slip: v + w x (0, 0, -R) is that of the table there.
ROLLS = [0, SPEED, 0, (TURN * START - SPEED) / BALL_RADIUS, 0, 0]


def start(world: str, dt: float, integrator: str = "midpoint") -> stepper.Stepper:
    model = stepper.load(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    return stepper.Stepper(model, options=stepper.Options(timestep=dt, integrator=integrator))


def on_a_conveyor_that_turns(dt: float, integrator: str = "midpoint") -> float:
    sim = start(f'<geom type="plane" size="9 9 1" surfacevel="0 0 0 0 0 {TURN}"/>' + BALL, dt, integrator)
    sim.set_state(qvel=ROLLS)
    sim.step(nstep=round(SECONDS / dt))
    angle = 2 / 7 * TURN * SECONDS
    return float(np.abs(sim.qvel[:2] - SPEED * np.array([-np.sin(angle), np.cos(angle)])).max()) / SPEED


def on_a_table_of_the_users(dt: float, integrator: str = "midpoint") -> float:
    """From the second call on: before the first one the table had no pose, so that it rests in that."""
    sim = start('<body mocap="true"><geom type="plane" size="9 9 1"/></body>' + BALL, dt, integrator)
    sim.set_state(qvel=ROLLS)
    calls, steps, velocities = 25, round(0.08 / dt), []
    for k in range(calls):
        angle = TURN * steps * dt * k
        sim.mocap_quat[0] = [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]
        sim.step(nstep=steps)
        velocities.append(sim.qvel[:2].copy())
    angle = 2 / 7 * TURN * steps * dt * (calls - 2)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ velocities[1]
    return float(np.abs(velocities[-1] - turned).max()) / SPEED


@every(integrator=["midpoint", "rk4"], measure=[on_a_conveyor_that_turns, on_a_table_of_the_users])
def test_a_ball_on_a_turntable_is_of_second_order(measure, integrator):
    """Scene 33 of the atlas has a table on a hinge."""
    errors = [measure(dt, integrator) for dt in DTS]
    assert slope(DTS, errors) > 1.9
    assert errors[2] < (TURN * DTS[2]) ** 2


def test_a_box_rides_on_a_turntable():
    """It keeps its place, and comes around with the table."""
    ride = '<body pos=".3 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction="2 0 0"/></body>'

    def measure(dt):
        sim = start(HINGED + ride, dt)
        sim.set_state(qvel=[TURN, 0, TURN * 0.3, 0, 0, 0, TURN])
        sim.step(nstep=round(SECONDS / dt))
        angle = TURN * SECONDS
        return float(np.abs(sim.qpos[1:3] - 0.3 * np.array([np.cos(angle), np.sin(angle)])).max())

    errors = [measure(dt) for dt in DTS]
    assert slope(DTS, errors) > 1.9
    assert errors[2] < (TURN * DTS[2]) ** 2


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_a_ball_on_a_ball_is_of_second_order(turn):
    """The place of the contact moves with both centres."""
    top = np.sqrt(0.6**2 - 0.1**2)
    world = '<body><joint axis="0 0 1"/><geom size=".5" mass="1e6"/></body>'
    world += f'<body pos=".1 0 {top}"><freejoint/><geom size=".1" mass="1" friction="2 0 0"/></body>'

    def end(dt):
        sim = start(world, dt)
        # It begins at rest on the other's surface.
        sim.set_state(qvel=[turn, 0, turn * 0.1, 0, 0, 0, turn])
        sim.step(nstep=round(0.4 / dt))
        return np.concatenate([sim.qpos[1:4], sim.qvel[1:4]])

    exact, dts = end(1e-4 / 2), [8e-3, 4e-3, 2e-3, 1e-3]
    assert slope(dts, [np.abs(end(dt) - exact).max() for dt in dts]) > 1.8  # The finest differs from the reference by 1/400 of itself.


def test_a_ball_that_rolls_down_a_slope_is_exact():
    """7/5 of its mass is moved; positions are those of a parabola."""
    for dt in (1e-3, 8e-3):
        model = stepper.load(f"""<mujoco><option gravity="2 0 -9.6"/><worldbody><geom type="plane" size="9 9 1"/>
          <body pos="0 0 {BALL_RADIUS}"><freejoint/><geom size="{BALL_RADIUS}" mass="1"/></body></worldbody></mujoco>""")
        sim = simulate(model, timestep=dt, steps=round(2 / dt))
        assert sim.qvel[0] == pytest.approx(2 * 5 / 7 * 2, abs=1e-9)
        assert sim.qpos[0] == pytest.approx(2 * 5 / 7 * 2, abs=1e-4)  # v t / 2; it begins by settling on the plane.


# The midpoint rule is of second order where contacts hold: what it expects of their impulses is as good as the rule.

ROLLING_BALL = """<mujoco><worldbody><geom type="plane" size="5 5 .1" friction="2"/>
<body pos="0 0 .1"><freejoint/><geom type="sphere" size=".1" friction="2" mass="2"/>
<body><joint type="ball"/><geom type="capsule" fromto="0 0 .15 .1 0 .4" size=".03" mass=".1" contype="0" conaffinity="0"/></body></body>
</worldbody></mujoco>"""
"""A ball that rolls and carries a pendulum that whirls."""

SLIDING_BOX = '<geom type="box" size=".1 .07 .05" friction=".8" mass="1"/>'
STACK = f"""<mujoco><worldbody><body><joint axis="0 0 1"/><geom type="cylinder" size="1 .05" friction=".8" mass="100"/></body>
{"".join(f'<body pos=".3 0 {0.1 + 0.1 * k}"><freejoint/>{SLIDING_BOX}</body>' for k in range(5))}</worldbody></mujoco>"""
"""Five boxes on a turntable."""


@pytest.mark.parametrize(("text", "qvel", "seconds", "steps"), [
    pytest.param(ROLLING_BALL, [0, 0.5, 0, -5, 0, 0, 4, 6, -5], 0.4, 40, id="ball"),
    pytest.param(STACK, [1.0] + 5 * [0, 0.3, 0, 0, 0, 1.0], 1.0, 25, id="stack"),
])  # fmt: skip
def test_half_the_time_step_has_a_quarter_of_the_error(text, qvel, seconds, steps):
    model = stepper.load(text, strict=False)

    # At the default tolerance of 1e-4 m/s, the solver's error exceeds that of short steps: boxes that stick slide by some 1e-5 m.
    def reached(n):
        sim = stepper.Stepper(model, options=stepper.Options(timestep=seconds / n, tolerance=1e-6))
        sim.set_state(qpos=sim.qpos, qvel=qvel)
        sim.step(nstep=n)
        assert sim.status == stepper.Status.OK
        return np.array(sim.qpos)

    exact = reached(64 * steps)
    errors = [np.abs(reached(n) - exact).max() for n in (steps, 2 * steps, 4 * steps)]
    # The next term of the error is half as large a part with half the step: within a tenth of 4 here, where a first order has 2.
    for coarse, fine in pairwise(errors):
        assert 3.6 < coarse / fine < 4.4

"""Impacts happen at their own time within a step: second order wherever that is, and no energy comes of it.

The bounds of slopes are 1.8: 2 with what a fit over five time steps of a coarse and a fine end leaves open.
"""

import numpy as np
import pytest
import stepper
from models import simulate
from numerics import slope

G, R = 9.81, 0.1
FLOOR = '<geom type="plane" size="9 9 1"/>'


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


@pytest.mark.parametrize("integrator", ["midpoint", "rk4"])
@pytest.mark.parametrize("dt", [2e-3, 1e-2])
@pytest.mark.parametrize("e", [0.3, 0.5, 0.8, 1.0])
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
        found = z + v**2 / (2 * G)
        np.testing.assert_allclose(found[top], (e ** (2 * bounces) * heights)[top], rtol=1e-11)
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
            sim = stepper.Stepper(model, options=stepper.Options(timestep=dt))
            sim.set_state(qvel=[vx, 0, 0, 0, spin, 0])
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


ARM = """<mujoco><worldbody><geom type="plane" size="9 9 1" zaxis="-1 0 0" pos=".45 0 0"/>
  <body pos="0 0 1.5"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5" contype="0" conaffinity="0"/>
  <body pos="0 0 -.5"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4" contype="0" conaffinity="0"/>
  <geom size=".05" pos="0 0 -.4" condim="1"/></body></body></worldbody></mujoco>"""


def test_an_arm_that_strikes_a_wall_converges_with_the_square_of_the_step():
    """Two hinges, inertial forces that jump at the impact, one bounce with e 0.7."""
    model = stepper.load(ARM)
    model = model.replace(geom_restitution=np.full(model.ngeom, 0.7))

    def end(dt):
        sim = stepper.Stepper(model, options=stepper.Options(timestep=dt))
        sim.set_state(qpos=[0.6, 0.3], qvel=[-2.0, -1.0])
        sim.step(nstep=round(0.6 / dt))
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


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_a_ball_that_bounces_comes_to_rest(dt, e):
    """Bounces shorter than a step are none: neither hovering nor sinking. At 10 ms those with e 0.9 last 2 v / g (1 - e) = 4 s."""
    sim = elastic(FLOOR + ball(z=0.3), e, timestep=dt)
    sim.step(nstep=round(6 / dt))
    assert np.abs(sim.qvel).max() < 1e-9
    assert abs(sim.qpos[2] - R) < 2e-5

"""Scene 8: a free body with three unequal inertias, spun about its middle axis (Dzhanibekov).

Right answer: energy and angular momentum are constant, and the angular velocity is Jacobi's elliptic functions of time (Landau & Lifshitz,
Mechanics, section 37), so the flips are periodic. Explicit gyroscopic terms gain energy until they blow up.
"""

import mujoco
import numpy as np
import pytest
from atlas.scenes.flight import ENERGY, I1, I2, I3, L2, PERIOD, SPIN, TOUCH, omega
from checks import every
from geometry import about, matrix, product
from models import SOURCES, afloat, simulate
from numerics import slope
from scenes import Heap, heap

BODY = f"""<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>
  <inertial pos="0 0 0" mass="1" diaginertia="{I1} {I2} {I3}"/></body></worldbody></mujoco>"""
OFF_CENTRE = """<mujoco><option gravity="0 0 0"/><worldbody><body pos="0 0 1"><joint type="{kind}" {anchor}/>
  <inertial pos=".05 .02 -.1" mass="1" diaginertia=".01 .02 .026" euler="10 20 30"/></body></worldbody></mujoco>"""
SINGLE = {
    "centred": BODY,
    "off centre": OFF_CENTRE.format(kind="free", anchor=""),
    "ball": OFF_CENTRE.format(kind="ball", anchor='pos=".1 0 .05"'),
}
# Rounding (1e-16) grows by the strikes: each multiplies a difference by about distance over radius, three to five here, a few in a row.
CLOSE = 1e-9


def spun(dt: float, integrator: str, seconds: float):
    return simulate(BODY, timestep=dt, integrator=integrator, qvel=[0, 0, 0, 0, SPIN, TOUCH], steps=round(seconds / dt))


def test_the_closed_form_starts_where_the_body_starts():
    """And flips: after half a period the middle axis has turned over."""
    assert omega(0) == pytest.approx([0, SPIN, TOUCH], abs=1e-12)
    assert omega(PERIOD / 2) == pytest.approx([0, -SPIN, TOUCH], abs=1e-10)


def test_two_flips_are_jacobis():
    """Within 1e-9 of SPIN at every tenth of a period, by a rule of fourth order whose local error (omega h)^5 is 3e-12 a step of 1 ms."""
    sim = simulate(BODY, timestep=PERIOD / 5000, integrator="rk4", qvel=[0, 0, 0, 0, SPIN, TOUCH])
    for k in range(1, 11):
        sim.step(nstep=500)
        assert sim.qvel[3:] == pytest.approx(omega(k * PERIOD / 10), abs=1e-9 * SPIN)


@pytest.mark.parametrize(("integrator", "order", "steps"), [("euler", 1, [4, 2, 1]), ("implicit", 1, [4, 2, 1]), ("rk4", 4, [32, 16, 8])])
def test_energy_and_angular_momentum_are_kept_to_the_order_of_the_rule(integrator, order, steps):
    """Over a whole period, from steps of so many thousandths of a quarter second."""
    dts = [PERIOD / round(PERIOD / (0.25e-3 * n)) for n in steps]
    energies, spins = [], []
    for dt in dts:
        sim = spun(dt, integrator, PERIOD)
        energies.append(abs(sum(sim.energy()) - ENERGY) / ENERGY)
        spins.append(np.linalg.norm(sim.momentum()[1] - [0, I2 * SPIN, I3 * TOUCH]) / np.sqrt(L2))
    assert slope(dts, energies) > order - 0.2
    assert slope(dts, spins) > order - 0.2


@every(dt=[1e-3, 5e-3, 2e-2], body=SINGLE)
def test_the_midpoint_rule_keeps_momentum_exactly_and_energy_without_drift(body, dt):
    """Over a hundred periods, or as long."""
    # A step leaves rounding and what eight iterations leave, (h omega / 2)^8 of 1e-4, in the momentum; energy swings by (h omega)^2 of it,
    # and as much in the second half of the time as in the first.
    sim = simulate(SINGLE[body], timestep=dt, integrator="midpoint")
    sim.set_state(qvel=np.array([0.3, 0.1, -0.2, 0, SPIN, TOUCH])[-sim.model.nv :])
    linear, angular = sim.momentum()
    start, swings = sum(sim.energy()), []
    for _ in range(1200):
        sim.step(nstep=round(PERIOD / 12 / dt))
        swings.append(abs(sum(sim.energy()) / start - 1))
        if body != "ball":
            assert np.abs(sim.momentum()[0] - linear).max() < 1e-11
            assert np.abs(sim.momentum()[1] - angular).max() < 1e-10 * np.linalg.norm(angular)
    assert max(swings) < (dt * SPIN) ** 2
    assert max(swings[600:]) < 2 * max(swings[:600]) + 1e-11


# Not Euler's rule, whose gyroscopic term is explicit: its energy grows as exp(c h t), which is its first order.
@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
def test_runge_and_kuttas_rule_does_not_blow_up_in_a_hundred_periods(dt):
    """A user's largest step, 0.1 rad of spin each: the body still tumbles with the energy that it had, to a tenth."""
    assert sum(spun(dt, "rk4", 100 * PERIOD).energy()) == pytest.approx(ENERGY, rel=0.1)


# Momentum of whole robots that only their own limbs touch.

ORDERS = {"euler": 1, "midpoint": 2, "rk4": 4}


def weightless(name: str, *, within: bool) -> mujoco.MjModel:
    """Robot in space, above the floor, whose limits and contacts among its limbs act; `within` moves its joints into their ranges."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    model.opt.gravity[:] = 0
    model.qpos0[2] += 100
    if within:
        low, high = model.jnt_range[1:].T
        model.qpos0[7:] = np.clip(model.qpos0[7:], low + 0.05, high - 0.05)
    return model


def drifts(model: mujoco.MjModel, steps, **options) -> list[float]:
    """Changes of linear and angular momentum (the larger, per kg) in 0.4 s for every step size, under commands that change every 40 ms."""
    found = []
    for dt in steps:
        sim, rng = simulate(model, timestep=dt, **options), np.random.default_rng(11)
        sim.set_state(qpos=model.qpos0, qvel=rng.normal(scale=0.5, size=model.nv))
        start = sim.momentum()
        for _ in range(10):
            sim.step(rng.uniform(-1, 1, model.nu), nstep=round(0.04 / dt))
        found.append(max(np.abs(b - a).max() for a, b in zip(start, sim.momentum(), strict=True)) / model.body_mass.sum())
    return found


@every(integrator=ORDERS, name=["dm_control/humanoid", "gymnasium/ant"])
def test_internal_torques_leave_momentum_alone(name, integrator):
    """What changes is the truncation error of the rule, so it falls with its order: within 0.2, as in test_order_of_convergence."""
    steps = [1e-3, 5e-4, 2.5e-4]
    assert slope(steps, drifts(afloat(name, gravity=False), steps, integrator=integrator)) > ORDERS[integrator] - 0.2


@pytest.mark.parametrize(("within", "stabilization"), [(True, "split"), (False, "baumgarte")])
@pytest.mark.parametrize("integrator", ORDERS)
def test_limits_and_contacts_among_the_limbs_leave_momentum_alone(integrator, within, stabilization):
    """Impacts jump within a step, which leaves every rule the first order; half of it is what three samples of jumps are worth."""
    # The projection of "split" moves joints at unchanged joint velocities, and momentum is M(q) v. A robot that starts 0.5 rad outside its
    # ranges, as the ant at qpos0, hence changes its momentum by that violation times its speed, whatever the time step.
    steps, model = [4e-3, 2e-3, 1e-3], weightless("gymnasium/ant", within=within)
    assert slope(steps, drifts(model, steps, integrator=integrator, stabilization=stabilization)) > 0.5


# The motion does not depend on where the scene stands, which way it faces, its mirror image, or the order of its bodies.

# Solved far below what is compared, so that only rounding is left of the order in which contacts are visited.
SETTINGS = {"timestep": 2e-3, "iterations": 20_000, "tolerance": 1e-13}
STEPS = 150
SHAPES = [("sphere", 0.1, 1.0), ("capsule", 0.08, 0.5), ("sphere", 0.12, 2.0), ("capsule", 0.1, 1.5)]
TILT = 0.1  # rad, of the floor about the y axis: heaps slide and roll.


def end_of(scene: Heap, qpos=None, qvel=None, *, order=None, floor: np.ndarray | None = None, origin=(0, 0, 0), **options):
    """The state after some steps on a tilted floor, (n, 7) and (n, 6); contacts have acted."""
    tilt = about([0, 1, 0], TILT) if floor is None else floor
    text = scene.xml(order, 'pos="{} {} {}" quat="{} {} {} {}"'.format(*origin, *tilt.tolist()))
    sim = simulate(text, **(SETTINGS | options))
    sim.set_state((scene.qpos if qpos is None else qpos).ravel(), (scene.qvel if qvel is None else qvel).ravel())
    force = 0.0
    for _ in range(STEPS):
        sim.step()
        force += sim.contacts()["force"].sum()
    assert force > 0
    assert sim.residual < 1e-12
    return sim.qpos.reshape(-1, 7), sim.qvel.reshape(-1, 6)


@pytest.fixture(scope="module", params=["euler", "midpoint"])
def case(request):
    """Balls and capsules that strike each other and the floor, and how they end."""
    scene = heap(SHAPES, 0.6, seed=5, spacing=0.24)
    return scene, request.param, end_of(scene, integrator=request.param)


def assert_same(found, expected):
    assert np.abs(found[0] - expected[0]).max() < CLOSE
    assert np.abs(found[1] - expected[1]).max() < 100 * CLOSE


def test_turning_about_the_vertical(case):
    """Everything turned by 1 rad and moved: the end is turned and moved."""
    scene, integrator, (qpos, qvel) = case
    turn, origin = about([0, 0, 1], 1.0), np.array([3.0, -2.0, 1.0])

    def move(q, v):
        q, v = q.copy(), v.copy()
        q[:, :3] = q[:, :3] @ matrix(turn).T + origin
        q[:, 3:] = [product(turn, quat) for quat in q[:, 3:]]
        v[:, :3] = v[:, :3] @ matrix(turn).T
        return q, v

    floor = product(turn, about([0, 1, 0], TILT))
    found = end_of(scene, *move(scene.qpos, scene.qvel), floor=floor, origin=origin.tolist(), integrator=integrator)
    assert_same(found, move(qpos, qvel))


def test_mirror_image(case):
    """Reflected in the x-z plane: velocities change the sign of y, rotations of x and z."""
    scene, integrator, (qpos, qvel) = case
    signs = np.array([1, -1, 1, 1, -1, 1, -1]), np.array([1, -1, 1, -1, 1, -1])
    found = end_of(scene, scene.qpos * signs[0], scene.qvel * signs[1], integrator=integrator)
    assert_same(found, (qpos * signs[0], qvel * signs[1]))


@pytest.mark.parametrize("order", [[3, 2, 1, 0], [1, 3, 0, 2]])
def test_bodies_declared_in_another_order(case, order):
    scene, integrator, (qpos, qvel) = case
    found = end_of(scene, scene.qpos[order], scene.qvel[order], order=order, integrator=integrator)
    assert_same(found, (qpos[order], qvel[order]))

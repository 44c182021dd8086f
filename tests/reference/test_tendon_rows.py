"""Springs, dampers, inertia, limits and dry friction of fixed tendons, and limits of ball joints, against MuJoCo and closed forms."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from contact_problem import equalities
from equalities import KINDS, LINKAGE, rows_of
from models import forward, full_mass_matrix, random_state, simulate
from numerics import acceleration_of_short_steps, relative_error

TREE = """<mujoco><default><geom contype="0" conaffinity="0" density="500"/></default><worldbody>
  <body pos="0 0 1"><joint name="a" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/>
    <body pos=".3 0 0"><joint name="b" axis="0 0 1"/><geom type="capsule" size=".03" fromto="0 0 0 .2 0 0"/></body>
    <body pos="0 .1 0"><joint name="c" type="slide" axis="0 1 1" ref=".2"/><geom type="box" size=".1 .05 .03"/></body></body>
  <body pos="0 0 2"><joint name="d" axis="1 0 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .2"/></body></worldbody>
  <tendon>{tendon}</tendon></mujoco>"""
JOINTS = '<joint joint="a" coef="1.5"/><joint joint="b" coef="-.7"/><joint joint="c" coef="2"/><joint joint="d" coef=".4"/>'
CHAIN = '<joint joint="a" coef="1.5"/><joint joint="b" coef="-.7"/>'
"""In one branch: MuJoCo drops the inertia that a tendon adds between branches, to keep its mass matrix sparse; here it is a row."""
ROWS = {
    "spring": 'stiffness="30"',
    "spring that rests elsewhere": 'stiffness="30" springlength=".3"',
    "slack spring": 'stiffness="30" springlength="-.5 .5"',
    "damper": 'damping="4"',
    "inertia": 'armature=".3"',
    "all of them": 'stiffness="30" springlength="-.1 .2" damping="4" armature=".3"',
}


@pytest.mark.parametrize("name", ROWS)
def test_mass_matrix_and_smooth_acceleration_are_mujocos(name):
    source = TREE.format(tendon=f"<fixed {ROWS[name]}>{CHAIN if 'armature' in ROWS[name] else JOINTS}</fixed>")
    model, sim, rng = mujoco.MjModel.from_xml_string(source), simulate(source), np.random.default_rng(0)
    for _ in range(20):
        state = random_state(model, rng)
        sim.set_state(*state)
        data = forward(model, *state)
        assert relative_error(sim.mass_matrix(), full_mass_matrix(model, data)) < 1e-10
        assert relative_error(sim.qacc_smooth, data.qacc_smooth) < 1e-10
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        assert sim.energy() == pytest.approx(data.energy, rel=1e-10)


@every(integrator=["euler", "midpoint"], name=ROWS)
def test_a_step_tends_to_mujocos_acceleration(name, integrator):
    """The force is taken within the step: extrapolated to steps without a length, the acceleration is MuJoCo's."""
    source = TREE.format(tendon=f"<fixed {ROWS[name]}>{CHAIN if 'armature' in ROWS[name] else JOINTS}</fixed>")
    model, rng = mujoco.MjModel.from_xml_string(source), np.random.default_rng(0)
    for _ in range(5):
        state = random_state(model, rng)
        assert relative_error(acceleration_of_short_steps(source, state, integrator), forward(model, *state).qacc_smooth) < 1e-7


@every(integrator=["euler", "midpoint"], stiffness=[1.0, 1e2, 1e6, 1e10])
def test_a_stiff_tendon_is_stable(stiffness, integrator):
    """Steps h with h sqrt(k / m) from 0.1 to far above 100: no growth of energy in 2000 steps without damping."""
    model = mujoco.MjModel.from_xml_string(TREE.format(tendon=f'<fixed stiffness="{stiffness}">{JOINTS}</fixed>'))
    model.opt.gravity[:] = 0
    sim = simulate(model, integrator=integrator, timestep=5e-3, qpos=np.zeros(4), qvel=[1.0, -2.0, 0.5, 1.0])
    start = sum(sim.energy())
    for _ in range(100):
        sim.step(nstep=20)
        # The joints' own motion is integrated explicitly: its error of energy is of order h.
        assert sim.energy()[1] < 1.2 * start
    assert sim.status == stepper.Status.OK


def test_one_implicit_step_of_an_oscillator():
    """The oscillator m x'' = -k x - d x', with inertia a of the tendon, in closed form for both rules, at h sqrt(k/m) = 100."""
    m, k, d, a, h = 2.0, 5e7, 30.0, 0.5, 0.02
    source = f"""<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="x" type="slide"/>
      <inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/></body></worldbody>
      <tendon><fixed stiffness="{k}" springlength="0" damping="{d}" armature="{a}"><joint joint="x" coef="1"/></fixed></tendon></mujoco>"""
    x, v = 0.3, -2.0
    total = m + a
    for integrator in ("euler", "midpoint"):
        sim = simulate(source, integrator=integrator, timestep=h, qpos=[x], qvel=[v], steps=1)
        if integrator == "euler":
            expected = (total * v - h * k * x) / (total + h * d + h * h * k)
        else:  # between the trapezoidal rule, in which the mean force is the force of the mean, and Euler's from the middle on
            z = (h * h * k / 4 + h * d / 2) / m
            late, early = z * z / (1 + z * z), 1 / (1 + z * z)
            force = h * k * (x + h / 2 * v) + early * (h * d / 2 - h * h * k / 4) * v
            expected = (total * v - force) / (total + h * h * k / 4 * (1 + 3 * late) + h * d / 2 * (1 + late))
        assert sim.qvel[0] == pytest.approx(expected, rel=1e-12)


def test_limits_of_a_tendon_stop_it_and_push_only():
    """A motor pulls the tendon into either end of its range: it rests at the end, and leaves it when the motor turns."""
    source = TREE.format(tendon=f'<fixed name="t" limited="true" range="-.2 .4">{JOINTS}</fixed>')
    source = source.replace("</mujoco>", '<actuator><motor tendon="t"/></actuator></mujoco>').replace(
        "<default>", '<default><joint damping="1"/>'
    )
    model = mujoco.MjModel.from_xml_string(source)
    model.opt.gravity[:] = 0
    sim = simulate(model, timestep=2e-3, qpos=np.zeros(4))
    length = lambda: sim.qpos @ [1.5, -0.7, 2, 0.4]  # noqa: E731
    for force, end in ((3.0, 0.4), (-3.0, -0.2), (3.0, 0.4)):
        sim.step([force], nstep=8000)
        # Above the end by the slop at the most.
        assert length() == pytest.approx(end, abs=2e-5)
        assert np.abs(sim.qvel).max() < 1e-3
    for _ in range(500):
        sim.step([-3.0], nstep=2)
        assert -0.2 - 2e-5 < length() < 0.4 + 2e-5


def test_dry_friction_of_a_tendon_holds_and_slides():
    """A mass on a slope whose tendon has dry friction f: it rests while m g sin < f, else m v' = m g sin - f."""
    m, f = 2.0, 10.0
    for slope, holds in ((0.45, True), (0.6, False)):
        source = f"""<mujoco><option gravity="{9.81 * np.sin(slope)} 0 {-9.81 * np.cos(slope)}"/><worldbody>
          <body><joint name="x" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/></body></worldbody>
          <tendon><fixed frictionloss="{f}"><joint joint="x" coef="1"/></fixed></tendon></mujoco>"""
        sim = simulate(source, timestep=2e-3, steps=500)
        rate = 0.0 if holds else 9.81 * np.sin(slope) - f / m
        assert sim.qvel[0] == pytest.approx(rate * sim.time, rel=1e-12, abs=1e-14)
        assert holds == (m * 9.81 * np.sin(slope) < f)


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_a_ball_joint_stops_at_its_limit(integrator):
    """A pendulum on a ball joint thrown in any direction: the angle of its rotation stays below the range, and no energy is gained."""
    source = """<mujoco><worldbody><body pos="0 0 1"><joint type="ball" limited="true" range="0 40"/>
      <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
    sim, rng = simulate(source, integrator=integrator, timestep=1e-3), np.random.default_rng(2)
    for _ in range(5):
        sim.set_state([1, 0, 0, 0], rng.normal(scale=8, size=3))
        start, reached, fastest = sum(sim.energy()), 0.0, 0.0
        for _ in range(500):
            sim.step()
            angle = 2 * np.arctan2(np.linalg.norm(sim.qpos[1:]), abs(sim.qpos[0]))
            reached = max(reached, angle)
            fastest = max(fastest, np.linalg.norm(sim.qvel))
            # The slop, and the curvature of the way within a step, (w h)^2, gathered until Baumgarte's term removes as much as comes.
            assert angle < np.radians(40) + 1e-5 + (fastest * sim.timestep) ** 2 / sim.options.baumgarte
        assert reached > np.radians(39.9)
        assert sum(sim.energy()) < start + 0.01 * abs(start)


def test_a_ball_at_its_limit_rests_there():
    """Gravity holds a top-heavy ball joint against its limit: at rest its angle is the range's end, in MuJoCo's measure."""
    source = """<mujoco><worldbody><body pos="0 0 1"><joint type="ball" limited="true" range="0 40" damping=".2"/>
      <geom type="capsule" size=".03" fromto="0 0 0 0 0 .4" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
    sim = simulate(source, qvel=[0.1, 0.2, 0.05], steps=10_000)
    angle = 2 * np.arctan2(np.linalg.norm(sim.qpos[1:]), abs(sim.qpos[0]))
    assert angle == pytest.approx(np.radians(40), abs=2e-5)
    assert np.abs(sim.qvel).max() < 1e-6


# Equalities of every kind against one step of the same mathematics in NumPy, with MuJoCo's mass matrix, forces and Jacobians.


@every(h=[1e-3, 1e-2], kind=KINDS)
def test_one_step_is_numpys(kind, h):
    """Euler's rule from random states, with whatever error they have: M (v+ - v) = h f + J^T lambda with J v+ as demanded."""
    source = LINKAGE.format(equality=KINDS[kind])
    model, rng = mujoco.MjModel.from_xml_string(source), np.random.default_rng(3)
    sim = simulate(source, integrator="euler", timestep=h, stabilization="baumgarte")
    for _ in range(10):
        qpos, qvel = random_state(model, rng, speed=1.0)
        data = forward(model, qpos, qvel)
        sim.set_state(qpos, qvel)
        sim.step()
        mass = full_mass_matrix(model, data) + h * np.diag(model.dof_damping)
        free = qvel + h * np.linalg.solve(mass, data.qfrc_passive - data.qfrc_bias)
        rows, asked = equalities(model, data, mass, qvel, sim.options, midpoint=False)
        response = np.linalg.solve(mass, rows.T)
        expected = free + response @ np.linalg.solve(rows @ response, asked - rows @ free)
        scale = np.sqrt(expected @ mass @ expected)
        error = sim.qvel - expected
        # Rounding, times the condition of the rows in the metric of M (1e5 at the most here).
        assert np.sqrt(error @ mass @ error) < 1e-10 * scale
        assert sim.residual < 1e-10
        # States are drawn in which equalities are not met.
        assert not sim.status & ~stepper.Status.EQUALITY_VIOLATED


@pytest.mark.parametrize("kind", KINDS)
def test_errors_go_to_zero_and_stay_there(kind):
    """From reset, where some are torn by a metre, in motion that dampers bring to rest."""
    model = mujoco.MjModel.from_xml_string(LINKAGE.format(equality=KINDS[kind]))
    model.dof_damping[:] = 4.0
    model.opt.gravity[:] = 0
    for integrator in ("euler", "midpoint"):
        for stabilization in ("baumgarte", "split"):
            sim = simulate(model, integrator=integrator, stabilization=stabilization, timestep=5e-3)
            sim.set_state(qvel=np.random.default_rng(5).normal(scale=0.1, size=model.nv))
            sim.step(nstep=4000)
            assert np.abs(rows_of(model, forward(model, sim.qpos, sim.qvel)).error).max() < 1e-9
            assert np.abs(sim.qvel).max() < 1e-6

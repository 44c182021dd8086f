"""Laws of contact, step by step: Signorini, Coulomb, Newton, and the certificate that every step gives; a falling block and bounces."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from contact_problem import problem_of
from hypothesis import example, given, strategies as st
from models import SOURCES, samples, simulate, stepper_model
from scenes import Heap, heaps

GRAVITY = np.array([0, 0, -9.81])
# The reference problem (contact_problem.py) has Baumgarte's target velocities.
EULER = {"integrator": "euler", "timestep": 5e-3, "stabilization": "baumgarte"}
CONVERGED = EULER | {"iterations": 5000}
# Each law is a part of the natural map, so the residual that a step reports bounds its violation, up to the ratio of the parts' norms: 1
# + mu twice over, for De Saxce's term and for the projection.
PARTS = 6.0
ROUNDING = 1e-12
UNSOLVED = 1e-2
"""Residual above which `Status.NOT_CONVERGED` says that the kinetic energy is kept from growing, m/s."""
ENVS = 5
TIED = """<mujoco><default><geom friction=".6 .02 .01" condim="{condim}"/></default><worldbody><geom type="plane" size="5 5 1"/>
  <body name="a" pos="0 0 .5"><freejoint/><geom type="sphere" size=".1"/>
    <body name="b" pos=".3 0 0">
      <joint name="b" axis="0 1 0" limited="true" range="-20 30"/><geom type="capsule" size=".05 .1"/></body></body>
  <body name="c" pos=".3 .4 .5"><freejoint/><geom type="sphere" size=".12"/></body>
  <body name="d" pos="-.4 .4 .5"><freejoint/><geom type="sphere" size=".08"/></body></worldbody>
  <contact><exclude body1="a" body2="b"/></contact>
  <equality><connect body1="b" body2="c" anchor="0 .2 0"/><weld body1="c" body2="d"/><joint joint1="b" active="false"/></equality>
  </mujoco>"""


def steps_of(model: mujoco.MjModel, qpos, qvel, settings, *, steps: int = 60, ctrl=None):
    """Steps a scene; yields the state before, the simulation after, its contacts and their problem, for every step that has contacts."""
    sim = simulate(model, **settings, qpos=np.ravel(qpos), qvel=np.ravel(qvel))
    touched = 0
    for _ in range(steps):
        before = sim.qpos, sim.qvel
        sim.step(ctrl)
        contacts = sim.contacts()
        if len(contacts):
            touched += 1
            yield before, sim, contacts, problem_of(model, before, contacts, sim.options, ctrl)
    assert touched > 0


@given(heaps())
def test_signorini_and_coulomb(scene):
    """Forces push, lie in the circular cone, act only where a gap closes; and friction opposes slip, at its full strength."""
    for _, sim, contacts, problem in steps_of(mujoco.MjModel.from_xml_string(scene.xml()), scene.qpos, scene.qvel, CONVERGED):
        tolerance = PARTS * sim.residual + ROUNDING
        normal, tangent = problem.impulse[:, 0], problem.impulse[:, 1:]
        approach, slip = (problem.contact_velocity + problem.bias)[:, 0], problem.contact_velocity[:, 1:]
        blocks = problem.delassus.reshape(len(contacts), 3, len(contacts), 3)
        size = np.array([np.trace(blocks[i, :, i]) / 3 for i in range(len(contacts))])
        pull, speed = np.linalg.norm(tangent, axis=1), np.linalg.norm(slip, axis=1)

        assert (normal >= 0).all()
        assert (pull <= problem.friction * normal * (1 + 1e-12)).all()  # The cone is met to rounding, whatever the residual.
        assert (approach >= -tolerance).all()
        assert np.minimum(normal * size, approach).max() < tolerance
        assert np.minimum((problem.friction * normal - pull) * size, speed).max() < tolerance
        along = (tangent * slip).sum(axis=1)
        across = tangent[:, 0] * slip[:, 1] - tangent[:, 1] * slip[:, 0]
        reach = np.maximum(np.maximum(pull * size, speed), 1e-300)
        assert (np.abs(across) * size / reach).max() < tolerance
        assert (along * size / reach).max() < tolerance


@given(heaps())
def test_newton(scene):
    """Every body's change of momentum is its weight and the reported forces, times the step; each force acts back on the other body."""
    mass = np.array([m for _, _, m in scene.shapes])
    for before, sim, contacts, _ in steps_of(mujoco.MjModel.from_xml_string(scene.xml()), scene.qpos, scene.qvel, EULER):
        force = mass[:, None] * GRAVITY
        for contact in contacts:
            pull = contact["frame"].T @ contact["force"]
            for body, sign in zip(contact["body"], (-1, 1), strict=True):
                if body > 0:
                    force[body - 1] += sign * pull
        change = mass[:, None] * (sim.qvel - before[1]).reshape(-1, 6)[:, :3]
        # Rounding in sums of impulses of order 10 N s.
        assert np.abs(change - sim.timestep * force).max() < 1e-12 * (1 + np.abs(sim.timestep * force).max())


@given(heaps(), st.sampled_from([1, 3, 50]))
def test_the_residual_is_what_numpy_finds(scene, iterations):
    """Also where the solver was stopped early, so that the residual is large: the certificate is about the impulses that acted."""
    model = mujoco.MjModel.from_xml_string(scene.xml())
    for _, sim, _, problem in steps_of(model, scene.qpos, scene.qvel, EULER | {"iterations": iterations}):
        check_certificate(sim, problem)


def check_certificate(sim, problem):
    """Whether there was something to compare: beyond UNSOLVED the velocity is not that of the impulses."""
    assert (sim.residual > sim.tolerance) == bool(sim.status & stepper.Status.NOT_CONVERGED)
    if sim.residual > UNSOLVED:
        return False
    problem.leave_to_scalars(sim.qvel)
    speed = 1 + np.abs(problem.free_velocity).max()
    assert np.abs(problem.next_velocity - sim.qvel).max() < 1e-11 * speed
    # Velocities of contacts are differences of numbers of order `speed`, through a mass matrix of condition 1e4 or less.
    assert sim.residual == pytest.approx(problem.residual(), rel=1e-6, abs=1e-11 * speed)
    return True


@every(iterations=[1, 4, 50], name=["dm_control/humanoid", "gymnasium/ant", "dm_control/walker"])
def test_the_residual_of_a_falling_robot_is_what_numpy_finds(name, iterations):
    """A robot thrown on the floor with a constant control, into its joint limits."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    model.dof_frictionloss[:] = 0
    rng = np.random.default_rng(3)
    settings = EULER | {"iterations": iterations}
    ctrl = rng.uniform(-1, 1, model.nu)
    steps = steps_of(model, model.qpos0, rng.normal(scale=0.5, size=model.nv), settings, steps=200, ctrl=ctrl)
    compared = sum(check_certificate(sim, problem) for _, sim, _, problem in steps)
    # A single sweep leaves a sixth of the humanoid's steps below UNSOLVED.
    assert compared > 20


def deep_balls() -> Heap:
    """Two balls of a row that overlap by 1 cm in the middle of the first step."""
    qpos = np.array([[0.125, -0.02, 0.27, 1, 0, 0, 0], [0.375, -0.008, 0.27, 1, 0, 0, 0], [0.625, -0.047, 0.27, 1, 0, 0, 0]])
    qvel = np.array([[0.2, -0.2, -1.0, 0.2, -0.8, 0.5], [2.0, 1.4, -1.1, -1.9, -0.9, 0.1], [-3.5, -0.3, -1.9, -1.1, -0.8, -0.5]])
    return Heap((("sphere", 0.125, 1.0),) * 3, 1.0, qpos, qvel)


@given(heaps(kinds=("sphere",)), st.sampled_from([1, 4, 50]))
@example(deep_balls(), 1)  # Deep contacts have no curvature: with it the reference finds a residual of 0.03 m/s.
def test_the_residual_of_the_midpoint_rule_is_what_numpy_finds(scene, iterations):
    """Balls, on which no force depends on the velocity; contacts and mass matrix at q + h/2 v."""
    model = mujoco.MjModel.from_xml_string(scene.xml())
    settings = EULER | {"integrator": "midpoint", "iterations": iterations}
    for _, sim, _, problem in steps_of(model, scene.qpos, scene.qvel, settings):
        check_certificate(sim, problem)


@every(iterations=[1, 4, 100], condim=[3, 4, 6])
def test_the_residual_of_bodies_tied_together_is_what_numpy_finds(condim, iterations):
    """A chain of balls with a connect, a weld and a limit, thrown on the floor, with every kind of friction."""
    model, rng = mujoco.MjModel.from_xml_string(TIED.format(condim=condim)), np.random.default_rng(condim)
    for _ in range(3):
        qvel = rng.normal(size=model.nv)
        for _, sim, _, problem in steps_of(model, model.qpos0, qvel, EULER | {"iterations": iterations}, steps=120):
            check_certificate(sim, problem)


@given(heaps(kinds=("sphere",)), st.sampled_from(["euler", "midpoint"]))
def test_contacts_give_no_energy(scene, integrator):
    """Balls have no gyroscopic terms, so without stabilisation the energy of every step can only fall."""
    # Up to what the residual leaves, an impulse times a velocity of its size. The work of an impulse is its product with the mean of the
    # velocities before and after; the midpoint rule may take one that was leaving, at up to g h / 2, where Euler's rule weighs the free
    # velocity.
    sim = simulate(scene.xml(), integrator=integrator, timestep=5e-3, stabilization="none", iterations=5000)
    sim.set_state(scene.qpos.ravel(), scene.qvel.ravel())
    leaving = 9.81 * sim.timestep / 2 if integrator == "midpoint" else 0.0
    for _ in range(150):
        before = sum(sim.energy())
        sim.step()
        impulse = np.abs(sim.contacts()["force"]).sum() * sim.timestep
        tolerance = (PARTS * sim.residual + leaving) * impulse + ROUNDING * (1 + abs(before))
        assert sum(sim.energy()) <= before + tolerance


@given(heaps(), st.sampled_from(["euler", "midpoint", "rk4"]), st.sampled_from(["baumgarte", "split", "none"]))
def test_a_heap_comes_to_rest_above_the_floor(scene, integrator, stabilization):
    """Whatever is thrown keeps at most the energy it had, and nothing sinks by more than it can move in a step."""
    sim = simulate(scene.xml(), integrator=integrator, timestep=2e-3, stabilization=stabilization, iterations=200)
    sim.set_state(scene.qpos.ravel(), scene.qvel.ravel())
    start = sum(sim.energy())
    for _ in range(50):
        sim.step(nstep=10)
        depth = -sim.contacts()["distance"].min(initial=0.0)
        # Contacts are taken up before they touch, so what remains is the curvature of a corner's path within a step: (omega h)^2 r / 2 with
        # omega below 50 rad/s and r below 0.3 m is 1.5 mm; and the slop. Without stabilization those of many steps add up.
        assert depth < (10e-3 if stabilization == "none" else 1.5e-3 + sim.options.slop)
    # One per cent for what the integration of tumbling boxes adds; Baumgarte's term adds what it takes to lift 1.5 mm out of the floor.
    assert sum(sim.energy()) < 1.01 * start


# A bounce of one sphere by Newton's law, v+ = -e v-; with e = 1 the energy is constant. Scenes 7 and 35 of the atlas have the apexes.

BALL = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 1"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("dt", [5e-4, 2e-3, 1e-2])
def test_an_elastic_sphere_keeps_its_energy_for_twenty_seconds(dt):
    model = stepper.load(BALL).replace(geom_restitution=[0.0, 1.0])  # A pair takes the larger.
    sim = stepper.Stepper(model, options=stepper.Options(timestep=dt, integrator="midpoint"))
    energy = sum(sim.energy())
    sim.step(nstep=round(20 / dt))
    # The midpoint rule reverses the velocity at an unchanged height: what is left is rounding, some 1e-16 a step.
    assert sum(sim.energy()) == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("speed", [5, 15, 30])
def test_an_overlap_elsewhere_takes_no_rebound_away(speed):
    """Baumgarte's bias of the box is no reason to solve the bounce of the ball without its rebound (Euler's rule: both in one solve)."""

    def fastest(more: str) -> float:
        model = stepper.load(
            f"""<mujoco><option timestep=".005"/><worldbody><geom type="plane" size="9 9 1"/>
            <body pos="0 0 .3"><freejoint/><geom size=".1"/></body>{more}</worldbody></mujoco>"""
        )
        restitution = np.zeros(model.ngeom)
        restitution[1] = 0.8
        options = stepper.Options(integrator="euler", stabilization="baumgarte")
        sim = stepper.Stepper(model.replace(geom_restitution=restitution), options=options)
        sim.set_state(qvel=[0, 0, -speed, *[0] * (model.nv - 3)])
        return samples(sim, 30, lambda: sim.qvel[2]).max()

    box = '<body pos="3 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    # The solver's tolerance is at most 1e-4 m/s.
    assert fastest(box) == pytest.approx(fastest(""), abs=1e-3)


# Scene 1: a block falls on the floor in one dimension. Right answer: the textbook's recursion, step for step, contact included: v <- v - g
# dt, then h <- h + v dt; where that is below the floor, h <- 0 and v <- -e v. Height 0.20 m, velocity -0.10 m/s, dt 0.02 s, g 9.81 m/s^2, e
# 0.25: after 8 steps h 0.0427, v -1.6696. Any other order of updates misses it. h is the height of the block's lowest point.

DT, G, E = 0.02, 9.81, 0.25

BLOCK = """<mujoco><option timestep="0.02"/><worldbody><geom type="plane" size="0 0 1"/>
  <body pos="0 0 {half}"><joint type="slide" axis="0 0 1"/><geom {geom}/></body></worldbody></mujoco>"""
SHAPES = {"box": 'type="box" size=".1 .1 .1"', "sphere": 'type="sphere" size=".1"', "capsule": 'type="capsule" size=".1 .2" euler="0 90 0"'}


def recursion(h: float, v: float):
    """The textbook's states, for ever."""
    while True:
        v -= G * DT
        h += v * DT
        if h < 0:
            h, v = 0.0, -E * v
        yield h, v


def block(shape: str, h: float, v: float, **options) -> stepper.Stepper:
    """The block h above the floor; joint position 0 is touching."""
    model = stepper.load(BLOCK.format(half=0.1, geom=SHAPES[shape])).replace(geom_restitution=[E, E])
    return simulate(model, integrator="euler", **options, qpos=[h], qvel=[v])


@every(shape=SHAPES, stabilization=["baumgarte", "split", "none"])
def test_the_recursion_step_for_step(shape, stabilization):
    """A hundred steps with no speed too slow to bounce: falls, and about a dozen bounces down to the recursion's own fixed point."""
    sim = block(shape, 0.20, -0.10, stabilization=stabilization, restitution_threshold=0.0)
    bounces = 0
    for k, (h, v) in zip(range(1, 101), recursion(0.20, -0.10), strict=False):
        sim.step()
        # A hundred additions of numbers of order 1; a bounce divides by the mass and multiplies by it.
        assert sim.qpos[0] == pytest.approx(h, abs=1e-13)
        assert sim.qvel[0] == pytest.approx(v, abs=1e-12)
        bounces += v > 0
        if k == 8:
            assert (round(sim.qpos[0], 4), round(sim.qvel[0], 4)) == (0.0427, -1.6696)
    assert bounces > 12


@pytest.mark.parametrize("shape", SHAPES)
def test_with_default_settings_it_follows_until_it_rests(shape):
    """The recursion never rests: it ends in a bounce of e g dt / (1 + e) every step, 0.039 m/s here."""
    # Blocks that approach more slowly than the threshold (1 cm/s) rest instead, which at a step of 2 ms comes before that bounce of 4 mm/s.
    sim = block(shape, 0.20, -0.10)
    for _, (h, v) in zip(range(20), recursion(0.20, -0.10), strict=False):
        sim.step()
        assert (sim.qpos[0], sim.qvel[0]) == (pytest.approx(h, abs=1e-13), pytest.approx(v, abs=1e-12))
    fine = block(shape, 0.20, -0.10, timestep=2e-3, tolerance=1e-6)
    fine.step(nstep=1000)
    # One row alone is solved to rounding.
    assert fine.qvel[0] == pytest.approx(0.0, abs=1e-12)
    assert -fine.options.slop <= fine.qpos[0] <= 1e-12


@every(shape=SHAPES, stabilization=["baumgarte", "split", "none"])
def test_velocity_after_one_step_into_the_floor(shape, stabilization):
    """Scene 2: h 0.005 m, v -1.5 m/s: v - g dt = -1.6962 m/s before the contact, 0.25 * 1.6962 m/s after it; it ends on the floor."""
    sim = block(shape, 0.005, -1.5, stabilization=stabilization)
    sim.step()
    # A dozen operations on numbers of order 1.
    assert sim.qvel[0] == pytest.approx(0.25 * (1.5 + 9.81 * 0.02), abs=1e-14)
    assert sim.qpos[0] == pytest.approx(0.0, abs=1e-15)
    assert sim.status == stepper.Status.OK


@pytest.mark.parametrize(("name", "low"), [("gymnasium/humanoid", 0.05), ("gymnasium/ant", 0.05), ("dm_control/humanoid", 0.05)])
def test_forces_of_contacts(name, low):
    """By MuJoCo's law and Euler's method, from the same states: forces and torques are the same to round-off of the two solvers."""
    model = stepper_model(name, strict=False)
    options = stepper.Options(contact="mujoco", integrator="euler", tolerance=1e-12, iterations=200, timestep=1e-4)
    sim = stepper.Stepper(model, ENVS, options=options)
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    source.opt.timestep, source.opt.solver, source.opt.tolerance, source.opt.iterations = 1e-4, mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200
    source.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    lowest = np.array(sim.qpos)
    lowest[:, 2] = np.linspace(low, low + 0.25, ENVS)
    rng = np.random.default_rng(0)
    sim.set_state(lowest, rng.normal(0.0, 0.5, (ENVS, model.nv)))
    pull = rng.normal(0.0, 3.0, (ENVS, model.nbody, 6))
    pull[:, 0] = 0.0
    seen = 0
    for env in range(ENVS):
        data = mujoco.MjData(source)
        data.qpos, data.qvel, data.xfrc_applied = sim.qpos[env], sim.qvel[env], pull[env]
        mujoco.mj_forward(source, data)
        mujoco.mj_rnePostConstraint(source, data)
        alone = stepper.Stepper(model, options=options)
        alone.set_state(sim.qpos[env], sim.qvel[env])
        alone.xfrc_applied[...] = pull[env]
        assert not alone.cfrc_ext.any()
        alone.step()
        found = alone.cfrc_ext
        expected = np.array(data.cfrc_ext)
        expected[:, 3:] -= pull[env, :, :3]
        arm = data.xipos - data.subtree_com[source.body_rootid]
        expected[:, :3] -= pull[env, :, 3:] + np.cross(arm, pull[env, :, :3])
        # The reference point moves with the step.
        moved = data.subtree_com[source.body_rootid] - alone.subtree_com[source.body_rootid]
        expected[:, :3] += np.cross(moved, expected[:, 3:])
        scale = 1.0 + np.abs(expected).max()
        np.testing.assert_allclose(found, expected, atol=1e-9 * scale)
        seen += scale > 10.0
    assert seen >= 2

"""The laws of contact, step by step: Signorini, Coulomb, Newton, and the certificate that every step gives itself."""

import mujoco
import numpy as np
import pytest
import stepper
from contact_problem import problem_of
from heaps import Heap, heaps
from hypothesis import example, given
from hypothesis import strategies as st
from models import SOURCES, simulate

GRAVITY = np.array([0, 0, -9.81])
# The reference problem (contact_problem.py) has Baumgarte's target velocities.
EULER = {"integrator": "euler", "timestep": 5e-3, "stabilization": "baumgarte"}
CONVERGED = EULER | {"iterations": 5000}
# Each law is a part of the natural map, so the residual that a step reports bounds its violation, up to the ratio of the parts' norms: 1
# + mu twice over, for De Saxce's term and for the projection.
PARTS = 6.0
ROUNDING = 1e-12


def steps_of(model: mujoco.MjModel, qpos, qvel, settings, *, steps: int = 60, ctrl=None):
    """Steps a scene; yields the state before, the simulation after, its contacts and their problem, for every step that has contacts."""
    sim = simulate(model, **settings)
    sim.set_state(np.ravel(qpos), np.ravel(qvel))
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


UNSOLVED = 1e-2
"""Residual above which `Status.NOT_CONVERGED` says that the kinetic energy is kept from growing, m/s."""


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


@pytest.mark.parametrize("iterations", [1, 4, 50])
@pytest.mark.parametrize("name", ["dm_control/humanoid", "gymnasium/ant", "dm_control/walker"])
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


TIED = """<mujoco><default><geom friction=".6 .02 .01" condim="{condim}"/></default><worldbody><geom type="plane" size="5 5 1"/>
  <body name="a" pos="0 0 .5"><freejoint/><geom type="sphere" size=".1"/>
    <body name="b" pos=".3 0 0">
      <joint name="b" axis="0 1 0" limited="true" range="-20 30"/><geom type="capsule" size=".05 .1"/></body></body>
  <body name="c" pos=".3 .4 .5"><freejoint/><geom type="sphere" size=".12"/></body>
  <body name="d" pos="-.4 .4 .5"><freejoint/><geom type="sphere" size=".08"/></body></worldbody>
  <contact><exclude body1="a" body2="b"/></contact>
  <equality><connect body1="b" body2="c" anchor="0 .2 0"/><weld body1="c" body2="d"/><joint joint1="b" active="false"/></equality>
  </mujoco>"""


@pytest.mark.parametrize("iterations", [1, 4, 100])
@pytest.mark.parametrize("condim", [3, 4, 6])
def test_the_residual_of_bodies_tied_together_is_what_numpy_finds(condim, iterations):
    """A chain of balls with a connect, a weld and a limit, thrown on the floor, with every kind of friction."""
    model, rng = mujoco.MjModel.from_xml_string(TIED.format(condim=condim)), np.random.default_rng(condim)
    for _ in range(3):
        qvel = rng.normal(size=model.nv)
        for _, sim, _, problem in steps_of(model, model.qpos0, qvel, EULER | {"iterations": iterations}, steps=120):
            check_certificate(sim, problem)


@given(heaps(kinds=("sphere",)), st.sampled_from(["euler", "midpoint"]))
def test_contacts_give_no_energy(scene, integrator):
    """Balls have no gyroscopic terms, so without stabilisation the energy of every step can only fall.

    Up to what the residual leaves, an impulse times a velocity of its size. The work of an impulse is its product with the mean of the
    velocities before and after; the midpoint rule may take one that was leaving, at up to g h / 2, where Euler's rule weighs the free
    velocity.
    """
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

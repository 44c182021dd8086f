"""Invariants of a chart: zero of right motions, what was put in of wrong ones, and why a scene does not have one."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import stepper
from stepper.lab.accuracy.invariants import ANGULAR, CONSERVED, ENERGY, LIMITS, LOOPS, MOMENTUM, NORM, PENETRATION, Invariants
from stepper.lab.accuracy.traces import run

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

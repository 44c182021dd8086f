"""Large coefficients of friction: in hard contact those above 30 act as 30, for which stacked cubes settle at steps of 1 to 20 ms.

The bound leaves torsional friction below it alone, and MuJoCo's contact law has no bound.
"""

import functools

import numpy as np
import pytest
import stepper
from stepper import Status

LARGEST = 30.0
"""Coefficient above which larger ones act as this one. Its cone has a half-angle of 88.1 degrees."""


def stack(friction: str, step: float, condim: int = 3) -> stepper.Model:
    """Two cubes of 10 cm on a plane, each tilted by a milliradian about another axis, so that they land on edges."""
    cube = '<freejoint/><geom type="box" size=".05 .05 .05" mass="1"/>'
    return stepper.load(
        f"""<mujoco><option timestep="{step}"/><default><geom friction="{friction}" condim="{condim}"/></default><worldbody>
        <geom type="plane" size="0 0 .1"/><body pos="0 0 .05" euler=".0573 0 0">{cube}</body>
        <body pos="0 0 .15" euler="0 .0573 0">{cube}</body></worldbody></mujoco>"""
    )


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
@pytest.mark.parametrize("friction", ["1", "3", "10", "30", "1e9 1e9 1e9"])
def test_stacked_cubes_settle_at_every_friction(friction, step, precision):
    """Cubes that land on edges lie flat after a second, and move by less than 0.1 mm and 0.2 mrad in the next one.

    A residual of the default tolerance, 1e-4 m/s, at an edge 5 cm from the middle of a face is 2e-3 rad/s.
    """
    sim = stepper.Stepper(stack(friction, step), precision=precision)
    sim.step(nstep=round(1.0 / step))
    # Position correction leaves up to 0.01 mm per contact, thus 0.02 mm of the upper cube. Measured: up to 0.009 mm.
    np.testing.assert_allclose(sim.qpos[[2, 9]], [0.05, 0.15], atol=2.5e-5)
    # Measured: up to 9e-5 in f64, and 3.5e-4 in f32. At the largest friction, short steps bring the cubes to rest: up to 1e-8 and 3e-5.
    rests = friction in ("30", "1e9 1e9 1e9") and step <= 5e-3
    assert np.abs(sim.qvel).max() < ({"f64": 1e-6, "f32": 1e-4}[precision] if rests else 1e-3)
    before = sim.qpos.copy()
    sim.step(nstep=round(1.0 / step))
    np.testing.assert_allclose(sim.qpos, before, atol=1e-4)
    assert not sim.status & ~Status.OK, sim.status


@functools.cache
def sheared(friction: float, condim: int, precision: str) -> np.ndarray:
    """State of the stacked cubes 0.2 s after they were pushed sideways and turned: qpos, then qvel."""
    sim = stepper.Stepper(stack(f"{friction} {friction} {friction}", 5e-3, condim), precision=precision)
    sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
    sim.step(nstep=40)
    return np.concatenate([sim.qpos, sim.qvel])


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("friction", [31.0, 100.0, 1e3, 1e6, 1e9])
@pytest.mark.parametrize("condim", [3, 4, 6])
def test_larger_friction_acts_as_friction_30(condim, friction, precision):
    """States are equal to the last bit, because the solver's cone is the same."""
    np.testing.assert_array_equal(sheared(friction, condim, precision), sheared(LARGEST, condim, precision))


@pytest.mark.parametrize("torsion", [0.01, 20.0])
def test_large_sliding_friction_leaves_torsional_friction_alone(torsion):
    """The torque that brakes a spinning ball is the torsional coefficient times the normal force, whatever the sliding coefficient."""
    spin = 100.0 if torsion < 1 else 2000.0
    for sliding in (0.5, 1e6):
        model = stepper.load(
            f"""<mujoco><default><geom friction="{sliding} {torsion} 0" condim="4"/></default><worldbody><geom type="plane" size="0 0 .1"/>
            <body name="ball" pos="0 0 .05"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody></mujoco>"""
        )
        sim = stepper.Stepper(model)
        sim.set_state(qvel=[0, 0, 0, 0, 0, spin])
        sim.step(nstep=2)
        braking = torsion * 9.81 / model.body("ball").inertia[2]
        # One contact, whose forces are exact up to rounding.
        assert sim.qvel[5] == pytest.approx(spin - braking * 2 * sim.timestep, rel=1e-9)


def test_mujocos_law_keeps_large_friction():
    """The bound belongs to hard contact: by MuJoCo's law the coefficient 1e3 has another effect than 30."""
    positions = []
    for mu in (30, 1e3):
        sim = stepper.Stepper(stack(f"{mu}", 2e-3), options=stepper.Options(timestep=2e-3, contact="mujoco"))
        sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
        sim.step(nstep=20)
        positions.append(np.array(sim.qpos))
    assert (positions[0] != positions[1]).any()

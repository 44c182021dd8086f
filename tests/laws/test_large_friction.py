"""Large coefficients of friction: above 30 they act as 30, for which stacked cubes settle at every time step."""

import numpy as np
import pytest
import stepper
from stepper import Status

PRECISIONS = ["f64", "f32"]
LARGEST = 30
"""Coefficient above which larger ones act as this one. Its cone has a half-angle of 88.1 degrees."""


def stack(friction: str, step: float, condim: int = 3) -> stepper.Model:
    """Two cubes of 10 cm on a plane, each tilted by a milliradian about another axis, so that they land on edges."""
    cube = '<freejoint/><geom type="box" size=".05 .05 .05" mass="1"/>'
    return stepper.load(
        f"""<mujoco><option timestep="{step}"/><default><geom friction="{friction}" condim="{condim}"/></default><worldbody>
        <geom type="plane" size="0 0 .1"/><body pos="0 0 .05" euler=".0573 0 0">{cube}</body>
        <body pos="0 0 .15" euler="0 .0573 0">{cube}</body></worldbody></mujoco>"""
    )


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
@pytest.mark.parametrize("friction", ["30", "1e9 1e9 1e9"])
def test_stacked_cubes_settle_at_large_friction(friction, step, precision):
    sim = stepper.Stepper(stack(friction, step), precision=precision)
    sim.step(nstep=round(1.0 / step))
    # Position correction leaves up to 0.01 mm per contact, and as much may remain of the tilts.
    np.testing.assert_allclose(sim.qpos[[2, 9]], [0.05, 0.15], atol=5e-5)
    # In f32, the tolerance of the solver is 1e-4 m/s.
    assert np.abs(sim.qvel).max() < 2e-4
    sim.step()
    assert not sim.status & ~Status.OK, sim.status


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("friction", [31.0, 100.0, 1e3, 1e6, 1e9])
@pytest.mark.parametrize("condim", [3, 4, 6])
def test_larger_friction_acts_as_friction_30(condim, friction, precision):
    """States are equal to the last bit, because the solver's cone is the same."""
    sims = [stepper.Stepper(stack(f"{mu} {mu} {mu}", 5e-3, condim), precision=precision) for mu in (LARGEST, friction)]
    for sim in sims:
        sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
        sim.step(nstep=40)
    np.testing.assert_array_equal(sims[0].qpos, sims[1].qpos)
    np.testing.assert_array_equal(sims[0].qvel, sims[1].qvel)


@pytest.mark.parametrize("torsion", [0.01, 20.0])
def test_large_sliding_friction_leaves_torsional_friction_alone(torsion):
    """A disc that spins is braked by its torsional friction: the torque is the coefficient times the normal force."""
    sims = []
    for sliding in (0.5, 1e6):
        model = stepper.load(
            f"""<mujoco><default><geom friction="{sliding} {torsion} 0" condim="4"/></default><worldbody><geom type="plane" size="0 0 .1"/>
            <body pos="0 0 .05"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody></mujoco>"""
        )
        sim = stepper.Stepper(model)
        sim.set_state(qvel=[0, 0, 0, 0, 0, 100.0 if torsion < 1 else 2000.0])
        sim.step(nstep=2)
        sims.append(float(sim.qvel[5]))
    # The solver's tolerance of 1e-6 m/s.
    assert sims[0] == pytest.approx(sims[1], rel=1e-6)


def test_mujocos_law_keeps_large_friction():
    """The bound belongs to hard contact: by MuJoCo's law the coefficient 1e3 has another effect than 30."""
    positions = []
    for mu in (30, 1e3):
        sim = stepper.Stepper(stack(f"{mu}", 2e-3), options=stepper.Options(timestep=2e-3, contact="mujoco"))
        sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
        sim.step(nstep=20)
        positions.append(np.array(sim.qpos))
    assert (positions[0] != positions[1]).any()

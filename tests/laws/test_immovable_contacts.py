"""Contacts whose normal passes through a joint, so that no motion can open or close them."""

import numpy as np
import pytest
import stepper
from hypothesis import example, given, settings
from hypothesis import strategies as st

BALL_JOINT = """<mujoco><worldbody><geom type="capsule" size=".01" fromto="0 0 0 0 0 .1"/>
<body pos="0 0 .1"><joint type="ball" damping=".005"/><geom type="capsule" size=".01" fromto="0 0 0 0 .1 .1"/></body>
</worldbody></mujoco>"""

TURNTABLE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".1 .1 .05"/>
<body pos="0 0 .07"><joint axis="{tilt} 0 1"/><geom type="box" size=".02 .02 .02" pos="0 .05 0" condim="{condim}"/></body>
</worldbody></mujoco>"""

TELESCOPE = """<mujoco><worldbody><body euler="{euler}"><joint type="slide" axis="0 0 1" range="0 1" limited="true"/>
<geom type="box" size=".1 .1 .05"/><body><geom size=".001"/><joint type="slide" axis="{axis}" range="0 .1" limited="true"/>
<body pos=".15 0 0"><joint type="slide" axis="{axis}" range="0 .1" limited="true"/>
<geom type="box" size=".1 .1 .05" euler="{turn} 0 0"/></body></body></body></worldbody></mujoco>"""


def test_a_contact_at_the_centre_of_a_ball_joint_does_not_lock_it() -> None:
    """The overlapping ends coincide at the joint's centre up to rounding, and no impulse can act there."""
    sim = stepper.Stepper(stepper.load(BALL_JOINT, strict=False))
    free = stepper.Stepper(stepper.load(BALL_JOINT.replace('size=".01"', 'size=".01" contype="0" conaffinity="0"')))
    for other in (sim, free):
        other.step(nstep=40)
    assert np.linalg.norm(free.qvel) > 0.5
    # The contact has no lever arm: what remains is rounding, amplified over 40 steps.
    assert np.allclose(sim.qvel, free.qvel, atol=1e-9)


@pytest.mark.parametrize("condim", [3, 6])
@pytest.mark.parametrize("tilt", [0.0, 1e-6, 3e-6, 8e-6])
def test_a_contact_along_a_hinge_neither_blocks_it_nor_stops_the_solver(tilt: float, condim: int) -> None:
    """A box slides on a face normal to its hinge's axis, up to a tilt below the least lever arm of 1e-5."""
    sim = stepper.Stepper(stepper.load(TURNTABLE.format(tilt=tilt, condim=condim)))
    sim.set_state(qvel=[-20.0])
    for _ in range(20):
        sim.step()
        # A lever arm above rounding closes the gap slowly. No impulse can stop it, and the residual reports it.
        # A corner of the box is less than 75 mm from the hinge.
        assert sim.status & ~stepper.Status.NOT_CONVERGED == 0
        assert sim.residual <= 20.0 * 0.075 * tilt + 1e-9
    # No impulse acts along an immovable normal, so that the speed is exactly the initial one but for rounding.
    assert sim.qvel[0] == pytest.approx(-20.0, abs=1e-12)


@pytest.mark.parametrize("condim", [3, 6])
def test_a_contact_that_an_equality_unloads_has_no_friction_left(condim: int) -> None:
    """A box slides on a floor until an equality holds its height. The impulse of the last step with a load must not act on."""
    slides = '<joint type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
    box = f'<geom type="box" size=".05 .05 .05" friction=".5 0 0" condim="{condim}"/>'
    model = stepper.load(
        f'<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="0 0 .05">{slides}{box}</body></worldbody>'
        '<equality><joint joint1="z" active="false"/></equality></mujoco>'
    )
    sim = stepper.Stepper(model)
    sim.step(nstep=5)
    sim.set_state(qvel=[1.0, 0.0])
    sim.step(nstep=20)
    speed = sim.qvel[0]
    assert speed < 0.9
    sim.eq_active = np.ones_like(sim.eq_active)
    sim.step(nstep=100)
    # The equality carries the weight, so that no friction acts: the speed is the same but for rounding.
    assert sim.qvel[0] == pytest.approx(speed, abs=1e-12)


ANGLES = st.floats(-180.0, 180.0)


@settings(max_examples=20, deadline=None)
@example(euler=(128.666, -167.909, 82.676), tilt=80.0)
@example(euler=(-72.104, -27.833, -169.805), tilt=80.0)
@given(euler=st.tuples(ANGLES, ANGLES, ANGLES), tilt=st.floats(60.0, 120.0))
def test_a_contact_across_a_telescope_carries_no_load(euler: tuple[float, float, float], tilt: float) -> None:
    """A tube overlaps the lift beside it, across its slides, which are inclined to the lift. The lever arms are rounding error."""
    axis = f"0 {np.sin(np.radians(tilt))} {np.cos(np.radians(tilt))}"
    sim = stepper.Stepper(stepper.load(TELESCOPE.format(euler=" ".join(map(str, euler)), axis=axis, turn=tilt - 90.0)))
    for _ in range(50):
        sim.step()
        assert not sim.status & (stepper.Status.NOT_CONVERGED | stepper.Status.UNRESOLVED)
        # Nothing else loads the contacts. Through lever arms of 1e-16 they pushed with 1e17 N.
        assert np.abs(sim.contacts()["force"]).max(initial=0.0) == 0.0

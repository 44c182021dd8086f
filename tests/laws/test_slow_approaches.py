"""Contacts that no impulse can stop: slow approaches are at rest, faster ones and growing overlaps are reported."""

import numpy as np
import pytest
import stepper
from hypothesis import example, given
from hypothesis import strategies as st
from models import flags_of
from stepper import Status

TOLERANCE, SLOP = 1e-6, 1e-5
"""Tolerance of the solver, m/s, and overlap that stabilisation leaves, m."""
RESTING = 10 * TOLERANCE
"""Normal speed below which a touching contact counts as resting, m/s."""
REPORTED = 1e-4 + SLOP
"""Overlap whose correction exceeds 1 cm/s, so that it is reported as infeasible, m: 1e-2 m/s * 2 ms / 0.2, and the slop."""
REACH = float(np.hypot(0.02, 0.07))
"""Distance of the box's farthest corner from the hinge, m."""

HINGE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".1 .1 .05"/>
<body pos="0 0 {height}"><joint axis="{slope} 0 1"/><geom type="box" size=".02 .02 .02" pos="0 .05 0" condim="{condim}"/></body>
</worldbody></mujoco>"""
SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".5 .1 .05"/>
<body pos="0 0 {height}"><joint type="slide" axis="1 0 {slope}"/><geom type="box" size=".02 .02 .02" condim="{condim}"/></body>
</worldbody></mujoco>"""
PRESS = """<mujoco><option gravity="0 0 0"/><worldbody><body mocap="true"><geom type="box" size=".1 .1 .05"/></body>
<body pos="0 0 {height}"><joint type="slide" axis="1 0 0"/><geom type="box" size=".02 .02 .02"/></body></worldbody></mujoco>"""

JOINTS = st.sampled_from(["hinge", "slide"])
SLOPES = st.floats(-6.5, -5.1).map(lambda x: 10.0**x)
"""Slopes of a surface below the least lever arm of 1e-5."""


def mover(joint: str, slope: float, speed: float, *, overlap: float, condim: int = 3, timestep: float = 2e-3) -> stepper.Stepper:
    """A box that a joint moves along a face at `speed`, m/s, while the face approaches it at `slope` times that speed."""
    xml = (HINGE if joint == "hinge" else SLIDE).format(height=0.07 - overlap, slope=-slope, condim=condim)
    sim = stepper.Stepper(stepper.load(xml), options=stepper.Options(timestep=timestep, tolerance=TOLERANCE))
    sim.set_state(qvel=[speed / REACH if joint == "hinge" else speed])
    return sim


@given(joint=JOINTS, slope=SLOPES, approach=st.floats(0.0, 0.9), overlap=st.floats(0.0, 0.8), condim=st.sampled_from([3, 6]))
@example(joint="slide", slope=3.67e-6, approach=0.17, overlap=0.5, condim=3)
@example(joint="hinge", slope=8e-6, approach=0.33, overlap=0.4, condim=3)
def test_a_slow_approach_within_the_slop_is_not_reported(joint, slope, approach, overlap, condim):
    """Angles of a model file with six digits, as 1.5708 for a right angle, tilt a face by 4e-6."""
    speed = approach * RESTING / slope
    sim = mover(joint, slope, speed, overlap=overlap * SLOP, condim=condim)
    # In 20 steps of 2 ms the overlap grows by 4e-7 m at most, and stays below the slop.
    assert flags_of(sim, 20) == Status.OK
    # No impulse acts. The velocity is the initial one but for rounding.
    assert abs(sim.qvel[0]) * (REACH if joint == "hinge" else 1.0) == pytest.approx(speed, rel=1e-12)


@given(slope=SLOPES, approach=st.floats(0.0, 0.9), overlap=st.floats(2.0, 90.0))
@example(slope=3.67e-6, approach=0.17, overlap=84.6)
def test_a_slow_approach_in_an_infeasible_overlap_has_one_flag(slope, approach, overlap):
    """The overlap of a lift with its mast is millimetres deep. It is reported as infeasible, whether the lift moves or not."""
    sim = mover("slide", slope, approach * RESTING / slope, overlap=overlap * REPORTED)
    assert flags_of(sim, 20) & ~Status.DEEP == Status.INFEASIBLE


@given(joint=JOINTS, slope=SLOPES, more=st.floats(0.0, 1.0), overlap=st.floats(0.0, 0.8))
def test_a_faster_approach_is_reported(joint, slope, more, overlap):
    """The corners of the box on a hinge that approach do so at 0.9 of the speed of the farthest one, for a turn of less than 0.1 rad."""
    least = 1.1 * RESTING / slope / (0.9 if joint == "hinge" else 1.0)
    sim = mover(joint, slope, least * (500.0 / least) ** more, overlap=overlap * SLOP, timestep=1e-5)
    assert flags_of(sim, 1) == Status.NOT_CONVERGED
    assert sim.residual >= 1.09 * RESTING


@given(slope=SLOPES, approach=st.floats(1.2, 9.0), overlap=st.floats(1.1, 10.0))
def test_a_slow_approach_beyond_the_slop_is_reported(slope, approach, overlap):
    """The correction of such an overlap is too slow to be reported as infeasible. Its growth is not silent."""
    sim = mover("slide", slope, approach * TOLERANCE / slope, overlap=overlap * SLOP)
    assert flags_of(sim, 1) == Status.NOT_CONVERGED
    assert sim.residual == pytest.approx(approach * TOLERANCE, rel=1e-6)


@given(speed=st.floats(-4.9, 0.0).map(lambda x: 10.0**x), overlap=st.floats(0.0, 9.0))
def test_a_plate_pressed_into_a_box_is_reported(speed, overlap):
    """A moving plate presses a box across its slide, so that the contact has no lever arm at all."""
    sim = stepper.Stepper(stepper.load(PRESS.format(height=0.07 - overlap * SLOP)), options=stepper.Options(tolerance=TOLERANCE))
    sim.step()
    for k in range(3):
        sim.mocap_pos = np.array([[0.0, 0.0, 2e-3 * speed * (k + 1)]])
        sim.step()
        assert sim.status & (Status.NOT_CONVERGED | Status.INFEASIBLE)

"""`stepper.load(urdf, actuators=...)`: servos and motors for the joints of a URDF."""

import math

import numpy as np
import pytest
import stepper
from loading_scenes import LIMIT, arm, joint, link, robot
from stepper.loading.urdf_actuators import POSITION_FREQUENCY, VELOCITY_FREQUENCY


def test_a_urdf_has_none_of_its_own():
    assert stepper.load(arm()).nu == 0


@pytest.mark.parametrize("element", ["transmission", "ros2_control"])
def test_an_element_that_names_motors_points_to_actuators_unless_there_are_some(element):
    urdf = robot(link("base"), link("arm"), joint("j", "base", "arm", kind="continuous"), f'<{element} name="x"/>')
    hint = 'stepper.load(..., actuators="position") adds actuators'
    reasons = [[why for kind, _, why in model.omitted if kind == f"URDF {element}"] for model in (stepper.load(urdf), driven(urdf))]
    assert [len(own) for own in reasons] == [1, 1]
    assert [hint in own[0] for own in reasons] == [True, False]


def driven(urdf):
    return stepper.load(urdf, actuators="position")


def test_bounds_are_those_of_the_file():
    position, velocity, torque = (stepper.load(arm(), actuators=kind) for kind in ("position", "velocity", "torque"))
    assert position.actuator_names == ["shoulder", "elbow"]
    assert position.actuator_ctrlrange.tolist() == [[-1, 2]] * 2
    assert velocity.actuator_ctrlrange.tolist() == [[-3, 3]] * 2
    assert torque.actuator_ctrlrange.tolist() == [[-10, 10]] * 2
    assert all(model.actuator_forcerange.tolist() == [[-10, 10]] * 2 for model in (position, velocity, torque))


def test_gains_follow_from_the_inertia_at_the_reference_pose():
    model = stepper.load(arm(), actuators="position")
    inertia = np.diag(stepper.Stepper(model).mass_matrix())
    w = 2 * math.pi * POSITION_FREQUENCY
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], inertia * w**2, rtol=1e-12)  # Rounding.
    np.testing.assert_allclose(model.actuator_biasprm[:, 2], -2 * inertia * w, rtol=1e-12)
    velocity = stepper.load(arm(), actuators="velocity")
    np.testing.assert_allclose(velocity.actuator_gainprm[:, 0], inertia * 2 * math.pi * VELOCITY_FREQUENCY, rtol=1e-12)


def one_joint(more="", kind="continuous"):
    return robot(link("base"), link("arm"), joint("j", "base", "arm", kind=kind, more=more))


def test_a_position_servo_is_critically_damped():
    """Alone and without bounds its angle is that of x'' + 2 w x' + w^2 x = w^2."""
    model = stepper.load(one_joint(), actuators="position")
    sim = stepper.Stepper(model, options=stepper.Options(timestep=1e-4))
    sim.step([1.0], nstep=500)
    w, t = 2 * math.pi * POSITION_FREQUENCY, 0.05
    # Second order in w h = 3e-3; 1e-4 leaves an order of magnitude.
    assert sim.qpos[0] == pytest.approx(1 - (1 + w * t) * math.exp(-w * t), abs=1e-4)


def test_a_velocity_servo_reaches_its_speed():
    model = stepper.load(one_joint(), actuators="velocity")
    sim = stepper.Stepper(model)
    sim.step([0.7], nstep=100)
    # exp(-w t) of its time constants is left, w t = 2 pi 50 Hz * 0.2 s = 63.
    assert sim.qvel[0] == pytest.approx(0.7, rel=1e-9)


def test_joints_that_follow_another_have_none_and_count():
    follower = joint("g", "arm", "hand", kind="continuous", more='<mimic joint="j" multiplier="2"/>')
    text = robot(link("base"), link("arm"), link("hand"), joint("j", "base", "arm", kind="continuous"), follower)
    model = stepper.load(text, actuators="position")
    assert model.actuator_names == ["j"]
    # Of 1 kg m^2 each: the hand turns three times as fast as the arm.
    assert model.actuator_gainprm[0, 0] == pytest.approx((1 + 3**2) * (2 * math.pi * POSITION_FREQUENCY) ** 2, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "said"),
    [("velocity", "velocity limit j: the file has no velocity limit"), ("torque", "effort limit j: the file has no effort limit")],
)
def test_controls_without_bounds_have_a_line(kind, said):
    assert said in stepper.load(one_joint(), actuators=kind).explain()


def test_errors_say_what_to_do():
    with pytest.raises(ValueError, match="actuators is 'servo', must be None or one of 'position'"):
        stepper.load(arm(), actuators="servo")
    with pytest.raises(ValueError, match="needs a URDF, and the source is not one"):
        stepper.load("<mujoco/>", actuators="torque")
    with pytest.raises(stepper.ModelError, match="has no revolute, continuous or prismatic joint; omit the argument actuators"):
        stepper.load(robot('<link name="world"/>', link("a"), joint("f", "world", "a", kind="floating")), actuators="torque")


def test_actuators_are_saved(tmp_path):
    model = stepper.load(arm(), actuators="torque")
    model.save(tmp_path / "arm")
    assert stepper.load(tmp_path / "arm") == model
    assert stepper.load(one_joint(LIMIT, "revolute"), actuators="torque").nu == 1

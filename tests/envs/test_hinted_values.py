"""Hints for attributes of Gymnasium's environments give Gymnasium's values."""

import gymnasium
import mujoco
import numpy as np
import pytest
import stepper.envs
from cases import needs_gymnasiums
from stepper._other_names import NEW_NAMES

EQUAL = {"rtol": 1e-12, "atol": 1e-12}  # Lengths of about 1 m, computed in another order: some units in the last place.
HINTS, OF_STEPPER = NEW_NAMES["StepperEnv"], NEW_NAMES["Stepper"]


def twins(name):
    """An environment of Gymnasium and one of stepper in the same state, at random joint angles."""
    theirs, ours = (gymnasium.make(f"{prefix}{name}-v5").unwrapped for prefix in ("", "stepper/"))
    theirs.reset(seed=1)
    ours.reset(seed=1)
    theirs.set_state(theirs.data.qpos, theirs.data.qvel)
    # Stepper normalises quaternions.
    ours.set_state(theirs.data.qpos, theirs.data.qvel)
    theirs.set_state(ours.sim.qpos[0], ours.sim.qvel[0])
    return theirs, ours


def hinted(hint, ours, **names):
    """Value of the expression of a hint."""
    return eval(hint, {"sim": ours.sim, "task": ours.task, **names})


@needs_gymnasiums
@pytest.mark.parametrize("name", ["Ant", "HalfCheetah", "Pusher"])
def test_values_are_gymnasiums(name):
    theirs, ours = twins(name)
    assert name in stepper.envs.TASKS
    np.testing.assert_array_equal(hinted(HINTS["init_qpos"], ours), gymnasium.make(f"{name}-v5").unwrapped.init_qpos)
    np.testing.assert_array_equal(np.concatenate([ours.sim.qpos[0], ours.sim.qvel[0]]), theirs.state_vector())
    assert HINTS["state_vector"] == "sim.qpos and sim.qvel"
    assert hinted(HINTS["frame_skip"], ours) == theirs.frame_skip
    for body in filter(None, ours.sim.model.body_names):
        found = hinted(HINTS["get_body_com"], ours, name=body)[0]
        np.testing.assert_allclose(found, theirs.get_body_com(body), **EQUAL)
        np.testing.assert_array_equal(found, hinted(f"sim.{OF_STEPPER['get_body_com']}", ours, name=body)[0])


@needs_gymnasiums
@pytest.mark.parametrize("name", ["Ant", "HalfCheetah"])
def test_values_of_the_stepper_are_mujocos(name):
    theirs, ours = twins(name)
    model, data, sim = theirs.model, theirs.data, ours.sim
    np.testing.assert_allclose(hinted(f"sim.{OF_STEPPER['body_xpos']}", ours)[0], data.xpos, **EQUAL)
    np.testing.assert_allclose(hinted(f"sim.{OF_STEPPER['body_xquat']}", ours)[0], data.xquat, **EQUAL)
    for body in range(1, model.nbody):
        velocity = np.zeros(6)  # angular and linear, in world axes
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        np.testing.assert_allclose(hinted(f"sim.{OF_STEPPER['xvelr']}", ours)[0, body], velocity[:3], **EQUAL)
        np.testing.assert_allclose(hinted(f"sim.{OF_STEPPER['xvelp']}", ours)[0, body], velocity[3:], **EQUAL)
        inertial, rotated = np.zeros(4), np.zeros(9)
        mujoco.mju_mulQuat(inertial, sim.xquat[0, body], sim.model.body_iquat[body])
        mujoco.mju_quat2Mat(rotated, inertial)
        np.testing.assert_allclose(rotated, data.ximat[body], **EQUAL)
    for body in np.flatnonzero(model.body_jntnum):
        joint, arm = model.body_jntadr[body] + model.body_jntnum[body] - 1, np.zeros(3)  # Later joints of a body move earlier anchors.
        mujoco.mju_rotVecQuat(arm, sim.model.joint(joint).pos, sim.xquat[0, body])
        np.testing.assert_allclose(sim.xpos[0, body] + arm, data.xanchor[joint], **EQUAL)

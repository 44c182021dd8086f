"""Views of tasks and of studies are one: quantities of a robot take both, and a study measures them in both engines."""

import numpy as np
import pytest
from envs.test_terms import ROBOT, made
from stepper.envs import BatchView
from stepper.envs.quantities import base_height, base_linvel, gravity, joint_pos
from stepper.lab import Outcome, Study
from stepper.lab.study.batches import USUAL, begin, run_episodes, world_of


def world(engine, **given):
    study = Study(model=ROBOT, outcomes=[Outcome(name="height", measure=base_height)], keyframe="stance", seconds=0.1, **given)
    found = world_of(study, USUAL, [{}, {}], engine=engine)
    begin(study, found, [0, 1])
    return study, found


@pytest.mark.parametrize("engine", ["stepper", "mujoco"])
def test_quantities_of_a_robot_take_the_view_of_a_study(engine):
    """They equal those of a task in the same state bit for bit, because positions and velocities are the same numbers."""
    _, found = world(engine)
    assert isinstance(found, BatchView)
    np.testing.assert_allclose(joint_pos(found), 0.0, atol=1e-15)  # the stance, rounded once
    found.advance(np.zeros((2, 2)), 5)
    envs = made(2)
    envs.reset(seed=0)
    envs.set_state(qpos=found.qpos, qvel=found.qvel)
    for quantity in (base_height, base_linvel, gravity, joint_pos):
        np.testing.assert_array_equal(quantity(found), quantity(envs.now))
    assert base_linvel(found) is base_linvel(found)
    before = base_linvel(found)
    found.advance(None, 1)
    assert not np.array_equal(base_linvel(found), before)


def test_a_study_measures_the_height_of_a_base():
    """The trunk of 7 kg stays between 0.1 and 1 m for 0.1 s, because the servos hold the stance at 0.35 m."""
    study, _ = world("stepper")
    (row,) = run_episodes(study, USUAL, [{}], [0])
    assert 0.1 < row["outcomes"]["height"] < 1.0

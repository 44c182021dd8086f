"""A port of mjlab's Go1 velocity task: at most 100 lines, groups with errors, and a robot that stands with the action zero."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from envs.go1_flat import LEGS, Go1Flat
from stepper.envs import StepperVectorEnv
from stepper.envs.quantities import gravity, site_linvel

needs_mjlab = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab is not installed, whose robot the task reads")


def test_the_task_and_its_robot_have_at_most_100_lines():
    assert len(Path(__file__).with_name("go1_flat.py").read_text().splitlines()) <= 100


@needs_mjlab
def test_the_robot_stands_and_its_terms_are_in_the_info():
    """The trunk stays within 10 degrees of level for 0.4 s, before the first push, because the servos hold the stance."""
    envs = StepperVectorEnv(Go1Flat(), 8, groups=True)
    observation, _ = envs.reset(seed=0)
    assert {name: value.shape for name, value in observation.items()} == {"policy": (8, 48), "critic": (8, 60)}
    for _ in range(20):
        observation, _, terminated, _, info = envs.step(np.zeros((8, 12)))
    assert not terminated.any()
    assert (gravity(envs.now)[:, 2] < -np.cos(np.radians(10.0))).all()
    assert {f"return_{name}" for name in envs.task.rewards()} <= info.keys()
    assert (info["reward_upright"] > 0.9 * envs.dt).all()
    np.testing.assert_array_equal(observation["critic"][:, :3] != observation["policy"][:, :3], True)


@needs_mjlab
def test_velocities_of_sites_are_those_of_their_positions():
    """They equal differences of positions over 1e-5 s within 0.01 m/s, because accelerations of the feet are below 1000 m/s^2."""
    envs = StepperVectorEnv(Go1Flat(), 4)
    envs.reset(seed=0)
    envs.step(np.ones((4, 12)))
    sim = envs.sim
    velocity, before, qpos = site_linvel(envs.now, LEGS), envs.now.read("site_xpos", LEGS), np.array(sim.qpos)
    sim.set_state(qpos=np.stack([sim.model.integrate_pos(q, 1e-5 * v) for q, v in zip(qpos, sim.qvel, strict=True)]))
    np.testing.assert_allclose((envs.now.read("site_xpos", LEGS) - before) / 1e-5, velocity, atol=0.01)

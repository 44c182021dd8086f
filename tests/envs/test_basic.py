"""Tasks of stepper's own: the textbook's block falls as the textbook says, and a grasp holds where friction allows it."""

import falling_block
import gymnasium
import numpy as np
import pytest
from envs.cases import same
from gymnasium.vector import AutoresetMode
from stepper.envs import StepperVectorEnv
from stepper.envs.basic import FallingBlock, Grasp
from stepper.envs.basic.grasp import FORCE, FRICTION, GRAVITY, MASS, OPTIONS

NAMES = ["stepper/FallingBlock-v0", "stepper/Grasp-v0"]


def test_it_is_the_textbooks_recursion():
    envs = gymnasium.make_vec(NAMES[0], num_envs=6)
    _, info = envs.reset(seed=1)
    e, h, v = info["restitution"], np.full(6, 0.20), np.full(6, -0.10)
    assert len(np.unique(e)) == 6
    for _ in range(50):
        observation, reward, *_ = envs.step(np.zeros((6, 1)))
        v = v - 9.81 * 0.02
        h = h + v * 0.02
        v, h = np.where(h < 0, -e * v, v), np.where(h < 0, 0.0, h)
        np.testing.assert_allclose(observation, np.stack([h, v], axis=1), atol=1e-12)
        np.testing.assert_array_equal(reward, h > 0.05)


def test_the_example_that_writes_it_out_says_the_same():
    own, theirs = StepperVectorEnv(FallingBlock(restitution=(0.3, 0.3)), 2, options=falling_block.OPTIONS), falling_block.FallingBlocks(2)
    theirs.reset(seed=0)
    theirs._restitution[:, 1] = 0.3
    theirs._sim.randomize(geom_restitution=theirs._restitution)
    own.reset(seed=0)
    for action in np.random.default_rng(2).uniform(-1, 1, (30, 2, 1)):
        same(own.step(action)[:3], theirs.step(action)[:3])


def test_sensors_may_be_noisy_and_rewards_are_of_the_truth():
    envs = gymnasium.make_vec(NAMES[0], num_envs=400, noise=0.5)
    observation, info = envs.reset(seed=0)
    assert observation[:, 0].std() == pytest.approx(0.5, rel=0.2)
    observation, reward, *_, info = envs.step(np.zeros((400, 1)))
    assert (reward == 1.0).all()
    assert (observation[:, 0] < 0.0).any()
    assert (info["height"] > 0.05).all()


def squeezed(force, **settings):
    """How high the box is at the end of an episode in which the fingers press with a force, N."""
    task = Grasp(**settings)
    envs = StepperVectorEnv(task, 32, options=OPTIONS, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=0)
    for k in range(50):
        lift = 0.0 if k < 10 else 0.3
        *_, info = envs.step(np.tile([lift, force / FORCE, force / FORCE], (32, 1)))
    return info["rise"]


def test_a_box_is_held_where_friction_allows_it():
    least = MASS * GRAVITY / (2.0 * FRICTION)
    assert (squeezed(1.25 * least) > 0.02).all()
    assert (squeezed(0.8 * least) < 0.001).all()
    # With friction of its own, of an interval about what the force needs, some hold and some do not.
    held = squeezed(1.1 * least, friction=(0.4, 0.8)) > 0.02
    assert 0 < held.sum() < 32
    heavy = squeezed(0.8 * least, mass_scale=(0.4, 1.1)) > 0.02
    assert 0 < heavy.sum() < 32

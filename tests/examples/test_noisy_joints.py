"""Joint noise costs a balancing controller its score, by a difference that is there for every seed and is the same every time."""

import noisy_joints
import numpy as np
import pytest
from dm_control.suite import cartpole
from noisy_joints import IDEAL, NOISY, STEPS, scores


@pytest.mark.parametrize("seed", range(3))
def test_perfect_sensors_inflate_the_score(seed):
    ideal, noisy = scores(IDEAL, seed, 16), scores(NOISY, seed, 16)
    # With ideal sensors the pole stands: all but a thousandth of the score, in every episode.
    assert ideal.min() > 0.99 * STEPS
    # 0.01 rad are 1.4 rad/s on a rate that is a difference over 10 ms: the controller loses in every episode, from the same starts, and by
    # ten standard errors on the mean.
    lost = ideal - noisy
    assert lost.min() > 0
    assert lost.mean() > 10 * lost.std() / np.sqrt(len(lost))


def test_it_is_reproducible():
    first, again, other = scores(NOISY, 7, 8), scores(NOISY, 7, 8), scores(NOISY, 8, 8)
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)
    table = noisy_joints.table(range(1))
    assert table == noisy_joints.table(range(1))


class Physics:
    """What dm_control's task asks of its physics, of one state."""

    def __init__(self, qpos, qvel, ctrl):
        self.cart_position = lambda: qpos[0]
        self.pole_angle_cosine = lambda: np.cos(qpos[1:])
        self.angular_vel = lambda: qvel[1:]
        self.control = lambda: ctrl


def test_the_reward_is_dm_controls():
    task = cartpole.Balance(swing_up=False, sparse=False, random=0)
    rng = np.random.default_rng(0)
    for _ in range(100):
        qpos, qvel, ctrl = rng.normal(size=2), 3 * rng.normal(size=2), rng.uniform(-1, 1, 1)
        found = noisy_joints.reward(qpos[None], qvel[None], ctrl)
        np.testing.assert_allclose(found, task.get_reward(Physics(qpos, qvel, ctrl)), rtol=1e-14)

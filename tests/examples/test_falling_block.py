"""The falling block obeys Gymnasium's interface, alone and many at once, and the textbook's recursion."""

import falling_block
import gymnasium
import numpy as np
import pytest
import stepper
from checks import raises
from falling_block import FallingBlock, FallingBlocks
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

N = 5


def test_gymnasiums_checker_accepts_it():
    check_env(gymnasium.make("examples/FallingBlock-v0", disable_env_checker=True).unwrapped, skip_render_check=True)


def test_it_is_the_textbooks_recursion_with_the_restitution_drawn():
    env = FallingBlock()
    drawn = []
    for seed in range(20):
        (h, v), info = env.reset(seed=seed)
        e = info["restitution"]
        drawn.append(e)
        assert (h, v) == (0.20, -0.10)
        for k in range(50):
            (found_h, found_v), reward, terminated, truncated, _ = env.step(np.zeros(1))
            v -= 9.81 * 0.02
            h += v * 0.02
            if h < 0:
                h, v = 0.0, -e * v
            # Fifty additions of numbers of order 1; a bounce divides by the mass and multiplies by it.
            assert (found_h, found_v) == (pytest.approx(h, abs=1e-13), pytest.approx(v, abs=1e-12))
            assert reward == float(found_h > 0.05)
            assert (terminated, truncated) == (False, k == 49)
    assert min(drawn) >= 0.1
    assert max(drawn) <= 0.5
    # Twenty uniform numbers lie within 0.3 of one another once in 5e4 sets.
    assert np.ptp(drawn) > 0.3 * 0.4


def test_rewards_count_true_heights_and_observations_are_the_sensors():
    env = FallingBlock(stepper.SensorModel(default=stepper.Transfer(noise_std=1.0)))
    first, _ = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    np.testing.assert_array_equal(first, again)
    assert np.all(first != [0.20, -0.10])
    assert env.step(np.zeros(1))[1] == 1.0


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded):
        FallingBlock().step(np.zeros(1))


def episode(env, seed=0, steps=50, action=0.5):
    """Everything that so many steps say after a reset."""
    observation, info = env.reset(seed=seed)
    rows = [(observation, None, None, info)]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(np.full((env.num_envs, 1), action))
        assert not terminated.any()
        assert env.observation_space.contains(observation)
        assert reward.shape == truncated.shape == (env.num_envs,)
        rows.append((observation, reward, truncated, info))
    return rows


def test_many_blocks_bounce_as_single_ones_of_their_restitution():
    rows = episode(FallingBlocks(N), seed=4)
    for env in range(N):
        model = stepper.load(falling_block.SCENE).replace(geom_restitution=[0.0, rows[0][3]["restitution"][env]])
        sim = stepper.Stepper(model, options=falling_block.OPTIONS)
        sim.reset(qpos=[0.2], qvel=[-0.1])
        for row in rows:
            np.testing.assert_array_equal(sim.sensordata, row[0][env])
            sim.step([0.5])


def test_every_episode_of_every_block_has_its_own_restitution():
    rows = episode(FallingBlocks(2000, autoreset_mode=AutoresetMode.SAME_STEP), seed=1)
    first, second = rows[0][3]["restitution"], rows[50][3]["restitution"]
    for drawn in (first, second):
        assert 0.1 <= drawn.min() < 0.11
        assert 0.49 < drawn.max() <= 0.5
        # Five standard deviations of the mean of 2,000 uniform numbers.
        assert abs(drawn.mean() - 0.3) < 5 * 0.4 / np.sqrt(12 * 2000)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(2000)


def test_the_next_step_resets_what_is_over():
    rows = episode(FallingBlocks(N), steps=52)
    start, last, over, first = rows[0], rows[50], rows[51], rows[52]
    assert last[2].all()
    # The call after the end ignores the action: reward 0, the first observation, not over.
    np.testing.assert_array_equal(over[0], start[0])
    assert not over[1].any()
    assert not over[2].any()
    assert over[3]["_restitution"].all()
    assert np.all(first[0] != start[0])
    assert not first[2].any()


def test_the_same_step_resets_and_hands_over_the_last_observation():
    next_step = episode(FallingBlocks(N))
    rows = episode(FallingBlocks(N, autoreset_mode="SameStep"), steps=51)
    assert rows[50][2].all()
    np.testing.assert_array_equal(rows[50][0], rows[0][0])
    np.testing.assert_array_equal(rows[50][3]["final_obs"], next_step[50][0])
    np.testing.assert_array_equal(rows[50][3]["_final_obs"], rows[50][2])
    np.testing.assert_array_equal(rows[50][1], next_step[50][1])
    assert "final_obs" not in rows[51][3]


def test_without_autoreset_a_mask_says_which():
    env = FallingBlocks(N, autoreset_mode=AutoresetMode.DISABLED)
    last = episode(env)[50]
    raises(gymnasium.error.ResetNeeded, "0, 1, 2, 3, 4", env.step, np.zeros((N, 1)))
    mask = np.arange(N) < 3
    observation, info = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation[~mask], last[0][~mask])
    np.testing.assert_array_equal(observation[mask], np.tile([0.20, -0.10], (3, 1)))
    np.testing.assert_array_equal(info["_restitution"], mask)
    raises(gymnasium.error.ResetNeeded, "3, 4", env.step, np.zeros((N, 1)))
    env.reset(options={"reset_mask": ~mask})
    env.step(np.zeros((N, 1)))
    raises(ValueError, "reset_mask has shape", env.reset, options={"reset_mask": np.ones(2, dtype=bool)})


def test_blocks_at_different_moments_of_their_episodes_are_reset_alone():
    env = FallingBlocks(N)
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros((N, 1)))
    env.reset(options={"reset_mask": np.arange(N) == 2})
    for _ in range(30):
        truncated = env.step(np.zeros((N, 1)))[3]
    np.testing.assert_array_equal(truncated, np.arange(N) != 2)
    before = env.step(np.zeros((N, 1)))
    np.testing.assert_array_equal(before[4]["_restitution"], np.arange(N) != 2)
    for _ in range(19):
        truncated = env.step(np.zeros((N, 1)))[3]
    np.testing.assert_array_equal(truncated, np.arange(N) == 2)


def test_seeds_and_threads():
    rows = {key: episode(FallingBlocks(40, threads=threads), seed=seed) for key, seed, threads in [("a", 1, 1), ("b", 1, 2), ("c", 2, 1)]}
    for a, b in zip(rows["a"], rows["b"], strict=True):
        np.testing.assert_array_equal(a[0], b[0])
    restitution = {key: row[0][3]["restitution"] for key, row in rows.items()}
    np.testing.assert_array_equal(restitution["a"], restitution["b"])
    assert not np.any(restitution["a"] == restitution["c"])


def test_gymnasium_makes_many():
    env = gymnasium.make_vec("examples/FallingBlock-v0", num_envs=3, vectorization_mode="vector_entry_point")
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    observation, _ = env.reset(seed=0)
    assert observation.shape == (3, 2)

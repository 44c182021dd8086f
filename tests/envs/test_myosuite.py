"""Tasks of MyoSuite have its models, observations, rewards and terminations, and starts of its distribution.

MyoSuite asks for an older MuJoCo, and works with this one: `pip install --no-deps myosuite myo-sim termcolor colorednoise`.
"""

import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import stepper
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.myosuite import MYOSUITE

pytest.importorskip("myo_sim")
pytest.importorskip("colorednoise")
pytest.importorskip("myosuite")


def pair(name):
    """MyoSuite's environment and ours, both with solvers that converge, in the same state with the same target."""
    with warnings.catch_warnings(action="ignore"):
        theirs = gymnasium.make(f"myo{name}-v0").unwrapped
    theirs.model.opt.tolerance, theirs.model.opt.iterations = 1e-14, 200
    kind, arguments = MYOSUITE[name]
    task = kind(**arguments)
    ours = StepperEnv(task, options=replace(stepper.Options.from_model(task.model()), tolerance=1e-12, iterations=200))
    theirs.reset(seed=0), ours.reset(seed=0)
    ours.now.episode_state["target"][0] = theirs.target_jnt_value
    ours.set_state(theirs.data.qpos.copy(), theirs.data.qvel.copy())
    return theirs, ours


@pytest.mark.parametrize("name", ["ElbowPose1D6MFixed", "ElbowPose1D6MRandom", "HandPoseFixed", "HandPose3Fixed", "HandPoseRandom"])
def test_episodes_are_myosuites(name):
    """For 100 random actions. MyoSuite rounds excitations and observations to 32 bits, by 6e-8, which muscles multiply by less than 10."""
    theirs, ours = pair(name)
    rng, returns = np.random.default_rng(0), np.zeros(2)
    for _ in range(100):
        action = rng.uniform(-1, 1, theirs.model.nu).astype(np.float32)
        expected, found = theirs.step(action), ours.step(action.astype(np.float64))
        np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=6e-7)
        assert found[1] == pytest.approx(expected[1], abs=6e-7 * np.sqrt(theirs.model.nv))
        assert found[2] == expected[2]
        assert found[4]["solved"] == expected[4]["solved"]
        returns += found[1], expected[1]
    assert returns[0] == pytest.approx(returns[1], rel=1e-6)


def test_a_pose_far_from_the_target_ends_the_episode():
    theirs, ours = pair("HandPoseFixed")
    theirs.target_jnt_value = theirs.target_jnt_value + 2.0
    ours.now.episode_state["target"][0] = theirs.target_jnt_value
    action = np.zeros(theirs.model.nu, np.float32)
    expected, found = theirs.step(action), ours.step(action)
    assert found[2]
    assert expected[2]
    assert found[1] == pytest.approx(expected[1], rel=1e-6)
    assert found[1] < -50


@pytest.mark.parametrize("name", sorted(MYOSUITE))
def test_starts_and_targets_are_of_myosuites_distribution(name):
    """Fixed values are equal, and the ends of ranges are those of 400 draws: each misses an end by 2 % of the range or more in 3e-4."""
    theirs, _ = pair(name)
    kind, arguments = MYOSUITE[name]
    envs = StepperVectorEnv(kind(**arguments), 400)
    envs.reset(seed=0)
    targets, starts = theirs._target_jnt_range, theirs.model.jnt_range if theirs.reset_type == "random" else None
    for found, ends, fixed in (
        (envs.now.episode_state["target"], targets, theirs.target_jnt_value),
        (envs.sim.qpos, starts, theirs._init_qpos),
    ):
        low, high = (fixed, fixed) if ends is None else ends.T
        assert (found >= low).all()
        assert (found <= high).all()
        assert (found.min(axis=0) <= low + 0.02 * (high - low)).all()
        assert (found.max(axis=0) >= high - 0.02 * (high - low)).all()
    assert not envs.sim.qvel.any()
    assert not envs.sim.act.any()

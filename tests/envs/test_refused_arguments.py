"""Arguments and calls that environments refuse: arrays that are not of real numbers, infinite bounds, and calls after `close`."""

from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
from cases import Slide
from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box
from hypothesis import given
from hypothesis.extra import numpy as arrays
from stepper._arrays import array_of
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.policies.ppo_settings import check_bounds

WRONG = {
    "complex": np.array([[1.0 + 0.0j]]),
    "masked": np.ma.array([[1.0]], mask=[[True]]),
    "masked without a mask": np.ma.array([[1.0]]),
    "objects": np.array([[1.0]], dtype=object),
    "texts": np.array([["1.0"]]),
    "times": np.array([[1]], dtype="m8[s]"),
    "nothing": None,
    "ragged": [[1.0], [1.0, 2.0]],
}


@pytest.mark.parametrize("kind", WRONG)
def test_actions_that_are_no_real_numbers_are_refused(kind):
    """NumPy would drop imaginary parts and masks, and convert texts and objects."""
    single, batch = StepperEnv(Slide()), StepperVectorEnv(Slide(), 1)
    single.reset(seed=0)
    batch.reset(seed=0)
    with pytest.raises(TypeError, match=r"^action is "):
        single.step(WRONG[kind] if kind in ("nothing", "ragged") else WRONG[kind][0])
    with pytest.raises(TypeError, match=r"^actions is "):
        batch.step(WRONG[kind])
    assert batch.sim.time[0] == 0.0


@given(arrays.arrays(arrays.scalar_dtypes(), arrays.array_shapes(min_dims=0, max_dims=3, min_side=1)))
def test_an_array_is_converted_without_a_change_or_refused(values):
    """Integers beyond 2^53 are rounded, as everywhere in NumPy."""
    if values.dtype.kind in "fiub":
        np.testing.assert_array_equal(array_of("x", values), values.astype(np.float64))
    else:
        with pytest.raises(TypeError, match=r"^x is "):
            array_of("x", values)


@dataclass(frozen=True, kw_only=True)
class Unbounded(Slide):
    """A task whose only action has no bounds."""

    def action_bounds(self, model):
        return np.full(1, -np.inf), np.full(1, np.inf)


def test_an_action_of_an_infinite_range_that_is_nan_has_its_cause():
    """Learners scale actions to their bounds: the middle of infinite ones is NaN."""
    envs = StepperVectorEnv(Unbounded(), 2)
    envs.reset(seed=0)
    space = envs.single_action_space
    with np.errstate(invalid="ignore"):
        action = np.tile((space.low + space.high) / 2, (2, 1))
    with pytest.raises(
        ValueError, match=r"is nan in column 0 .* The bounds of this action are -inf to inf, .*: define finite ones by action_bounds"
    ):
        envs.step(action)
    bounded = StepperVectorEnv(Slide(), 2)
    bounded.reset(seed=0)
    with pytest.raises(ValueError, match="Check the policy's weights"):
        bounded.step(np.full((2, 1), np.nan))


def test_a_training_with_infinite_bounds_ends_before_it_starts():
    """The message names an action and its bounds, and where to define finite ones; all registered tasks have finite ones."""
    space = Box(np.array([-1.0, -np.inf, -1.0]), np.array([1.0, np.inf, np.inf]), dtype=np.float32)
    with pytest.raises(
        ValueError, match=r"^action 1 of me/Reach-v0 has the bounds -inf to inf, and 1 more actions? .*action_bounds.*ctrlrange"
    ):
        check_bounds("me/Reach-v0", space)
    check_bounds("stepper/HalfCheetah-v5", StepperVectorEnv("HalfCheetah", 1).single_action_space)


CALLS = {
    "reset": lambda env: env.reset(seed=0),
    "step": lambda env: env.step(np.zeros(env.action_space.shape)),
    "set_state": lambda env: env.set_state(np.array(env.sim.qpos) if isinstance(env, StepperVectorEnv) else env.sim.qpos[0]),
    "render": lambda env: env.render(),
}


@pytest.mark.parametrize("make", [lambda: StepperEnv(Slide()), lambda: StepperVectorEnv(Slide(), 2)], ids=["single", "vector"])
@pytest.mark.parametrize("call", CALLS)
def test_a_closed_environment_refuses_calls(make, call):
    env = make()
    env.reset(seed=0)
    CALLS[call](env)
    env.close()
    env.close()
    with pytest.raises(ClosedEnvironmentError, match=f"^{call} was called after close: "):
        CALLS[call](env)
    assert len(env.sim.qpos) == env.sim.num_envs


def test_a_closed_environment_behind_wrappers_refuses_steps():
    env = gymnasium.make("stepper/HalfCheetah-v5")
    env.reset(seed=0)
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.step(np.zeros(6))

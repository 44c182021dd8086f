"""Vector environment with the interface `VecEnv` of rsl_rl, with observation groups, time-outs and logs of reward terms."""

from __future__ import annotations

from typing import Any

import numpy as np

from stepper.adapters.native import Env, make_native, with_autoreset
from stepper.envs.task import Array
from stepper.shared.machine import require

require("rsl_rl", "for stepper.adapters.rsl_rl")

import torch  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from rsl_rl.env import VecEnv  # noqa: E402
from tensordict import TensorDict  # noqa: E402


class StepperRslRlEnv(VecEnv):  # type: ignore[misc]
    """`VecEnv` of rsl_rl. Observations are a `TensorDict` of all observation groups of the task; a task without groups has "policy".

    Actions are clipped to the bounds of the task. On the CPU, observations share memory with NumPy arrays, which later steps do not change.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        seed: Seed of the first episodes: environment i has `seed` + i. None draws a random seed.
        device: Device of the tensors.
        cfg: Configuration that rsl_rl stores with its logs.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. The default `dtype` of observations is float32.

    Attributes:
        envs: The vector environment.
        num_actions: Number of actions.
        max_episode_length: Number of actions after which an episode is truncated.

    Raises:
        ValueError: The episodes have no limit.
    """

    def __init__(
        self,
        env: Env,
        num_envs: int = 1,
        *,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        cfg: Any = None,
        **settings: Any,
    ):
        settings = with_autoreset({"dtype": "float32", **settings, "groups": True}, AutoresetMode.SAME_STEP, "rsl_rl")
        self.envs = make_native(env, num_envs, **settings, episode_statistics=True)
        limit = self.envs.max_episode_steps
        if limit is None:
            raise ValueError(f"episodes of {env} have no limit, which rsl_rl needs: give max_episode_steps, or the task episode_seconds")
        self.num_envs, self.max_episode_length, self.device = num_envs, limit, device
        self.num_actions = int(self.envs.single_action_space.shape[0])  # type: ignore[index]
        self.cfg = {} if cfg is None else cfg
        self._observation = self._tensors(self.envs.reset(seed=seed)[0])

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Number of actions of each running episode so far, (num_envs,) int64. Setting it sets the lengths, as rsl_rl does at the start."""
        return torch.from_numpy(self.envs.episode_lengths).to(self.device)

    @episode_length_buf.setter
    def episode_length_buf(self, lengths: torch.Tensor) -> None:
        self.envs.set_episode_lengths(lengths.cpu().numpy())

    def get_observations(self) -> TensorDict:
        """Returns the present observations, (num_envs, n) by group."""
        return self._observation

    def reset(self) -> tuple[TensorDict, dict[str, Any]]:
        """Begins new episodes in all environments, and returns observations and an empty dictionary."""
        self._observation = self._tensors(self.envs.reset()[0])
        return self._observation, {}

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Advances every environment by one action, which may be several time steps.

        Args:
            actions: Actions, (num_envs, num_actions), in the units of the task.

        Returns:
            Observations, (num_envs, n) by group, of the new episode if one has ended; rewards (num_envs,) float32; whether episodes have
            ended, (num_envs,) int64; and extras. Extras have "time_outs", the truncated episodes, (num_envs,) bool. If episodes have
            ended, "log" has the means of their weighted reward terms and of other infos with one number per environment.
        """
        space: Any = self.envs.action_space
        given = np.clip(actions.detach().cpu().numpy(), space.low, space.high)
        observation, reward, terminated, truncated, infos = self.envs.step(given)
        self._observation = self._tensors(observation)
        over = terminated | truncated
        extras: dict[str, Any] = {"time_outs": self._tensor(truncated & ~terminated)}
        if over.any():
            extras["log"] = _means(infos["final_info"], over)
        return self._observation, self._tensor(reward).float(), self._tensor(over).long(), extras

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

    def _tensor(self, values: Array) -> torch.Tensor:
        """A tensor with the values of an array, on the device."""
        return torch.from_numpy(np.ascontiguousarray(values)).to(self.device)

    def _tensors(self, observation: dict[str, Array]) -> TensorDict:
        """Observations as tensors, (num_envs, n) by group."""
        return TensorDict({name: self._tensor(value) for name, value in observation.items()}, [self.num_envs], device=self.device)


def _means(infos: dict[str, Any], over: Array) -> dict[str, float]:
    """Means of infos with one number per environment over the environments of a mask, by name in rsl_rl's logs.

    Sums of reward terms over the episodes have names such as "Episode_Reward/pose", other infos "Episode/tracking_error".
    """
    means = {}
    for name, value in infos.items():
        if name[0] != "_" and isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype != object and name[:7] != "reward_":
            kind, key = ("Episode_Reward", name.removeprefix("return_")) if name.startswith("return_") else ("Episode", name)
            means[f"{kind}/{key}"] = float(value[over].mean())
    return means

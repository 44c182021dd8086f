"""Vector environment with PufferLib's interface `PufferEnv`, which writes to the buffers that PufferLib shares between processes."""

from __future__ import annotations

from typing import Any

from stepper.adapters.native import Env, make_native, with_autoreset
from stepper.envs.task import Array
from stepper.shared.machine import require

require("pufferlib", "for stepper.adapters.pufferlib")

import numpy as np  # noqa: E402
import pufferlib  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402


class StepperPufferEnv(pufferlib.PufferEnv):  # type: ignore[misc]
    """`PufferEnv` whose agents are environments of one task. PufferLib's autoreset is the mode that Gymnasium calls SAME_STEP.

    After a step in which episodes ended, the info has the means of their return and length, "episode_return" and "episode_length".

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments, `num_agents` to PufferLib.
        buf: PufferLib's buffers, arrays by name; None allocates them.
        seed: Seed. Environment i has the seed `seed * num_envs + i` at the first reset. PufferLib gives its workers successive seeds, so
            that no seed occurs twice.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. Observations are float32.
    """

    def __init__(self, env: Env, num_envs: int = 1, buf: dict[str, Array] | None = None, seed: int = 0, **settings: Any):
        settings = with_autoreset(settings, AutoresetMode.SAME_STEP, "PufferLib")
        self.envs = make_native(env, num_envs, **settings, dtype="float32", episode_statistics=True)
        self.single_observation_space, self.single_action_space = self.envs.single_observation_space, self.envs.single_action_space
        self.num_agents, self._seed = num_envs, seed  # type: int, int | None
        super().__init__(buf)

    def reset(self, seed: int | None = None) -> tuple[Array, list[dict[str, Any]]]:
        """Begins new episodes. Environment i has the seed `seed * num_agents + i`.

        With None, the first reset uses the seed of the constructor, and later resets continue the random numbers.

        Returns:
            PufferLib's buffer of observations, (num_agents, n), and an empty list of infos.
        """
        given, self._seed = self._seed if seed is None else seed, None
        self.envs.reset(seed=None if given is None else given * self.num_agents, out=self.observations)
        self.rewards[:], self.terminals[:], self.truncations[:] = 0.0, False, False
        return self.observations, []

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, list[dict[str, Any]]]:
        """Advances every environment by one action, which may be several time steps.

        Args:
            actions: Actions, (num_agents, nu), in the units of the task.

        Returns:
            PufferLib's buffers: observations (num_agents, n), rewards, terminations and truncations (num_agents,), and a list with at
            most one info.
        """
        _, self.rewards[:], self.terminals[:], self.truncations[:], infos = self.envs.step(actions, out=self.observations)
        over = infos.get("_episode")
        if over is None:
            return self.observations, self.rewards, self.terminals, self.truncations, []
        episode = infos["episode"]
        means = {"episode_return": float(np.mean(episode["r"][over])), "episode_length": float(np.mean(episode["l"][over]))}
        return self.observations, self.rewards, self.terminals, self.truncations, [means]

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

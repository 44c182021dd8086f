"""EnvPool's environments as a Gymnasium vector environment with autoreset within the step, as `stepper train` needs it.

EnvPool resets a finished environment in the next call of `step`. This wrapper resets it within the step that ends the episode.
"""

import importlib
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

Array = NDArray[Any]


class EnvPoolVectorEnv(VectorEnv[Array, Array, Array]):
    """Vector environment of one of EnvPool's tasks, stepped by EnvPool's threads.

    Args:
        name: Name of EnvPool's task, such as "HalfCheetah-v5".
        num_envs: Number of environments.
        num_threads: Number of EnvPool's threads.
        autoreset_mode: Autoreset mode; only SAME_STEP is available.
    """

    def __init__(self, name: str, num_envs: int, *, num_threads: int = 1, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP):
        if autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {autoreset_mode}, must be {AutoresetMode.SAME_STEP}: EnvPoolVectorEnv has no other mode")
        self.metadata = {"autoreset_mode": autoreset_mode}
        self._name, self._threads, self.num_envs = name, num_threads, num_envs
        self._envs = self._make(seed=0)
        self.single_observation_space, self.single_action_space = self._envs.observation_space, self._envs.single_action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def _make(self, seed: int) -> Any:
        """New environments of EnvPool with a seed."""
        envpool: Any = importlib.import_module("envpool")
        return envpool.make_gymnasium(self._name, num_envs=self.num_envs, num_threads=self._threads, seed=seed % 2**31)

    def reset(
        self, *, seed: int | list[int | None] | np.integer[Any] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Reset all environments. A seed recreates them, as EnvPool accepts seeds at construction alone."""
        super().reset(seed=None)
        if isinstance(seed, int | np.integer):
            self._envs = self._make(int(seed))
        elif seed is not None:
            raise ValueError(f"seed is {seed!r}, must be one integer: EnvPool has one seed for all environments")
        return self._envs.reset()[0], {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Step all environments and reset the finished ones; info["final_obs"] has their last observations."""
        observation, reward, terminated, truncated, _ = self._envs.step(np.ascontiguousarray(actions, dtype=np.float64))
        over = terminated | truncated
        if not over.any():
            return observation, reward, terminated, truncated, {}
        ended = np.flatnonzero(over)
        final = np.full(self.num_envs, None, dtype=object)
        final[ended] = np.fromiter(observation[ended], dtype=object, count=len(ended))
        first, info = self._envs.reset(ended)
        observation = observation.copy()  # EnvPool may reuse the array.
        observation[info["env_id"]] = first
        return observation, reward, terminated, truncated, {"final_obs": final, "_final_obs": over, "final_info": {}, "_final_info": over}


def register(name: str) -> str:
    """Register the EnvPool task `name` with Gymnasium. Returns the id in Gymnasium, "envpool/" and the name."""
    known = f"envpool/{name}"
    if known not in gymnasium.registry:
        gymnasium.register(known, vector_entry_point=f"{__name__}:{EnvPoolVectorEnv.__name__}", kwargs={"name": name})
    return known

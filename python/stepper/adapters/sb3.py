"""Vector environment with the interface `VecEnv` of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from stepper.adapters.native import Env, make_native, with_autoreset
from stepper.envs.task import Array
from stepper.shared.machine import require

require("stable_baselines3", "for stepper.adapters.sb3")

from gymnasium.vector import AutoresetMode  # noqa: E402
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn  # noqa: E402


class StepperVecEnv(VecEnv):  # type: ignore[misc]
    """`VecEnv` of Stable-Baselines3. Later calls do not overwrite returned arrays.

    Results are identical bit for bit to those of a `DummyVecEnv` of single environments.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        seed: Seed of the first episodes: environment i has `seed` + i. None draws a random seed.
        infos: Environments whose info dictionaries are filled: "all" environments, or with "ended" only those whose episode ended in the
            step. With a thousand environments, "all" takes a tenth to a third of the time of a step.
        episode_statistics: Whether the info of an ended episode has the entry "episode", in the format of `Monitor`.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. With `groups=True`, observations are a dictionary of the
            observation groups, for the policies "MultiInputPolicy".

    Raises:
        ValueError: `infos` is neither "all" nor "ended".
    """

    def __init__(
        self,
        env: Env,
        num_envs: int = 1,
        *,
        seed: int | None = None,
        infos: Literal["all", "ended"] = "all",
        episode_statistics: bool = True,
        **settings: Any,
    ):
        if infos not in ("all", "ended"):
            raise ValueError(f'infos is {infos!r}, must be "all" or "ended"')
        settings = with_autoreset(settings, AutoresetMode.SAME_STEP, "Stable-Baselines3")
        self.envs = make_native(env, num_envs, episode_statistics=episode_statistics, **settings)
        self._monitored, self._all = episode_statistics, infos == "all"
        self._actions: Array | None = None
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        if seed is not None:
            self.seed(seed)

    def reset(self) -> Any:
        """Begins new episodes, with the seeds that the method `seed` has set, and returns observations, (num_envs, n) or by group.

        Raises:
            ValueError: Options were set; the environments have no options.
        """
        if any(self._options):
            raise ValueError(f"unknown options {self._options[0]}; the environments have no options")
        observation, infos = self.envs.reset(seed=self._seeds)
        self.reset_infos = _rows(infos, np.arange(self.num_envs), self.num_envs)
        self._reset_seeds()
        self._actions = None
        return observation

    def step_async(self, actions: Array) -> None:
        """Stores the actions of the next `step_wait`.

        Args:
            actions: Actions, (num_envs, nu), in the units of the task.
        """
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advances every environment by its stored action, which may be several time steps.

        Returns:
            Observations (num_envs, n), of the new episode if one has ended; rewards (num_envs,) float32; whether episodes have ended,
            (num_envs,) bool; and infos, with "terminal_observation" if an episode has ended.

        Raises:
            RuntimeError: No actions were given.
        """
        if self._actions is None:
            raise RuntimeError("call step_async before step_wait")
        actions, self._actions = self._actions, None
        observation, reward, terminated, truncated, infos = self.envs.step(actions)
        over = terminated | truncated
        ended = np.flatnonzero(over)
        final, final_infos, episodes = infos.pop("final_obs", None), infos.pop("final_info", {}), infos.pop("episode", None)
        result = _rows(infos, np.flatnonzero(~over), self.num_envs) if self._all else [{} for _ in range(self.num_envs)]
        if self._all:
            for info in result:
                info["TimeLimit.truncated"] = False
        if ended.size:
            final_infos.pop("episode", None)  # The entry "episode" of the step has it too.
            begun, last = _rows(infos, ended, self.num_envs), _rows(final_infos, ended, self.num_envs)
            for k in ended.tolist():
                self.reset_infos[k] = begun[k]
                result[k] = last[k] | {"TimeLimit.truncated": bool(truncated[k] and not terminated[k]), "terminal_observation": final[k]}
                if episodes is not None:
                    result[k]["episode"] = {name: value[k].item() for name, value in episodes.items()}
        return observation, reward.astype(np.float32), over, result

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the `StepperVectorEnv` (`envs`), one reference per selected environment."""
        value = getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets an attribute of the `StepperVectorEnv` (`envs`), which applies to all environments.

        Raises:
            ValueError: `indices` does not select all environments.
        """
        self._check_all(indices)
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any) -> list[Any]:
        """Calls a method of the `StepperVectorEnv` (`envs`) once, and returns the result once per environment.

        Raises:
            ValueError: `indices` does not select all environments, on which the method acts.
        """
        self._check_all(indices)
        result = getattr(self.envs, method_name)(*method_args, **method_kwargs)
        return [result] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """Whether the environments do the work of a wrapper: True for the class `Monitor` if `episode_statistics` is set, otherwise False.

        Returns:
            The same value for each selected environment.
        """
        return [self._monitored and issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Array | None]:
        """One picture per environment, (height, width, 3) uint8; or None per environment without `render_mode="rgb_array"`."""
        return list(self.envs.render() or [None] * self.num_envs)

    def _check_all(self, indices: VecEnvIndices) -> None:
        """Raises a ValueError unless the indices select all environments."""
        if len(set(self._get_indices(indices))) != self.num_envs:
            raise ValueError(
                "environments cannot be selected here, because they are one batch: omit indices, or use the masks of the methods of `envs`"
            )


def _rows(infos: dict[str, Any], envs: Array, num_envs: int) -> list[dict[str, Any]]:
    """Converts infos of a batch to one dictionary per environment.

    `envs` are the indices of the environments to convert, (n,). Dictionaries of other environments are empty.
    """
    rows: list[dict[str, Any]] = [{} for _ in range(num_envs)]
    for name, value in infos.items():
        if name.startswith("_"):
            continue
        has = envs[infos[f"_{name}"][envs]]
        found = value[has]
        for k, number in zip(has.tolist(), found.tolist() if found.ndim == 1 else found, strict=True):
            rows[k][name] = number
    return rows

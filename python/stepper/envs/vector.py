"""Vector environment as a `gymnasium.vector.VectorEnv`."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper._options import Options, Precision
from stepper._stepper import Model, selected
from stepper.envs.batch import Batch, each_group
from stepper.envs.environment import Environment, RenderMode, autoreset, camera_settings, make_task
from stepper.envs.task import Array, Camera, Contact, Task, Terms
from stepper.shared.arguments import check_mapping


class StepperVectorEnv(Environment, VectorEnv[Array, Array, Array]):
    """Vector environment of one task. Later steps do not change returned arrays. A pickle contains the states of the environments.

    If a step would give an environment a state that is not finite, its episode is terminated, and its info has "non_finite". The bodies
    concerned keep their last finite state, and so do all bodies to which constraints connect them.

    Args:
        task: A `Task`, a class of tasks, or a name in `stepper.envs.TASKS`. For a class or a name, `arguments` go to its constructor.
        num_envs: Number of environments.
        autoreset_mode: Gymnasium's `AutoresetMode` or its name: when an environment starts its next episode.

            * "NEXT_STEP": at the next call of `step`, which ignores the action.
            * "SAME_STEP": within the step that ends the episode. The infos then have the last observation of the episode as "final_obs",
              and its last info as "final_info".
            * "DISABLED": only at `reset(options={"reset_mask": mask})`.
        contact: Contact law: "mujoco", with the integrator of the model's file, or "hard"; None selects `task.contact`.
        options: Options of the step, which replace `contact`.
        precision: "f64" or "f32".
        threads: Number of threads; 0 uses all cores that this process may use. The results are the same, bit for bit, for any number.
        dtype: Scalar type of observations, float64 or float32; None selects the type that `precision` names.
        max_episode_steps: Number of actions after which an episode is truncated; None means no limit. `gymnasium.make_vec` passes the
            registered limit.
        rewards: Weights that replace those of terms of the reward (`Task.rewards`), by name, as {"action_rate": -0.2}.
        groups: Whether observations are a dictionary with all observation groups of the task. Otherwise they are the group "policy".
        episode_statistics: Whether infos of ended episodes have "episode": return "r", length "l" and duration "t" in s, in the format of
            Gymnasium's `RecordEpisodeStatistics`. With "SAME_STEP", "final_info" has it too.
        render_mode: "rgb_array" for a picture of every environment by `render()`, or None for no pictures. `stepper.viewer.Renderer` lists
            the requirements.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera_id: Index of a camera of the model's file, or -1 for the task's free camera. The default is the file's camera
            "track", or without one the task's free camera.
        camera_name: Name of a camera of the model's file.
        default_camera_config: Settings of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,), m, and trackbodyid,
            the followed body.
        model: Model of the scene, which several vector environments can share; None calls `task.model()`.
        **arguments: Arguments of the task's constructor, if `task` is a class or a name.

    Raises:
        ValueError: A setting is out of its range, or the task or render mode is unknown.
        TypeError: The task does not have one of the `arguments`.
    """

    def __init__(
        self,
        task: Task | type[Task] | str,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        contact: Contact | None = None,
        options: Options | None = None,
        precision: Precision = "f64",
        threads: int = 1,
        dtype: Any = None,
        max_episode_steps: int | None = None,
        rewards: Mapping[str, float] | None = None,
        groups: bool = False,
        episode_statistics: bool = False,
        render_mode: RenderMode | None = None,
        width: int = 480,
        height: int = 480,
        camera_id: int | None = None,
        camera_name: str | None = None,
        default_camera_config: Camera | None = None,
        model: Model | None = None,
        **arguments: Any,
    ):
        settings: dict[str, Any] = {"contact": contact, "options": options, "precision": precision, "threads": threads, "dtype": dtype}
        settings |= {"max_episode_steps": max_episode_steps, "rewards": rewards, "groups": groups, "model": model}
        batch = Batch(make_task(task, arguments, StepperVectorEnv), num_envs, **settings)
        camera = camera_settings(width, height, camera_id, camera_name, default_camera_config)
        spaces = self._set_up(batch, render_mode, camera)
        self.render_mode = render_mode
        self.num_envs, self.autoreset_mode = num_envs, autoreset(autoreset_mode)
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self.single_observation_space, self.single_action_space = spaces
        self.observation_space, self.action_space = (batch_space(space, num_envs) for space in spaces)
        self._statistics = episode_statistics
        self._over, self._any_over = np.zeros(num_envs, dtype=bool), False
        self._every, self._since = np.ones(num_envs, dtype=bool), np.zeros(num_envs)

    @property
    def episode_returns(self) -> Array:
        """Sum of the rewards of each running episode so far, (num_envs,)."""
        return self._batch.returns.copy()

    @property
    def episode_lengths(self) -> Array:
        """Number of actions of each running episode so far, (num_envs,)."""
        return self._batch.lengths.copy()

    def set_episode_lengths(self, lengths: ArrayLike) -> None:
        """Sets the number of actions of each running episode so far, so that first episodes of a training end at different times.

        Args:
            lengths: Numbers of actions, (num_envs,) int, at least 0.

        Raises:
            ValueError: A wrong shape, or a negative number.
        """
        given = np.asarray(lengths)
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu" or (given < 0).any():
            raise ValueError(f"lengths is {lengths!r}, must be {self.num_envs} whole numbers of at least 0")
        self._batch.lengths[:] = given

    @property
    def max_episode_steps(self) -> int | None:
        """Number of actions after which an episode is truncated; None means no limit."""
        return self._batch.max_episode_steps

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
        envs: ArrayLike | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Starts new episodes in all or some environments.

        Args:
            seed: An int gives environment i the seed `seed + i`. With the seeds 0 and 1, all environments except one therefore have the
                same seeds, in other places of the batch; `stepper.envs.seeds` returns independent seeds. A sequence has one seed per
                environment, where None continues the random numbers of the environment. All random numbers of an environment follow from
                its seed. Without a seed, the random numbers of all environments continue.
            options: May contain Gymnasium's "reset_mask", (num_envs,) bool with at least one True: the environments to start.
            envs: The environments to start, in place of `options`: a boolean mask (num_envs,) or integer indices (k,), each once.
                None selects all environments; an empty selection does nothing. With indices, a sequence of seeds has k entries in the
                order of the indices.

        Returns:
            Observations of all environments (num_envs, n), or with `groups` a dictionary of such arrays; and the info dict with entries
            for the started environments.

        Raises:
            TypeError: A reset_mask is not an array of bool, or indices are not integers.
            ValueError: A wrong shape, a duplicate index, an unknown option, or a wrong number of seeds.
            IndexError: An index is out of range.
            ResetNeeded: Only some environments are selected, and there was no reset of all environments before.
        """
        self._check_open("reset")
        mask = self._begins(options, envs)
        if seed is not None and not isinstance(seed, int | np.integer) and envs is not None and np.asarray(envs).dtype != np.bool_:
            seed = _scattered(list(seed), np.array(selected(envs, self.num_envs)), self.num_envs)
        seeds = seeds_of(seed, self.num_envs)
        if not self._begun and not mask.all():
            raise ResetNeeded("some environments have no episode yet: call reset without envs or reset_mask first")
        if not mask.any():
            return self._batch.observation(), {}
        super().reset(seed=seed if isinstance(seed, int) else None)
        given = np.array([value is not None for value in seeds]) & mask
        if given.any():
            self._batch.seed(np.flatnonzero(given), [value for value, take in zip(seeds, given, strict=True) if take and value is not None])
        self._batch.begin(mask)
        self._begun = True
        self._over[mask] = False
        self._any_over = bool(self._over.any())
        self._since[mask] = time.perf_counter()
        return self._batch.observation(), _infos(self._batch.info(), mask)

    def step(self, actions: Array) -> tuple[Any, Array, Array, Array, dict[str, Any]]:
        """Advances every environment by one action.

        Args:
            actions: Actions, (num_envs, nu), in the units of the task. A task with `action_bounds` may have another number than nu.

        Returns:
            Observations in the format of `reset`, rewards (num_envs,) float64, terminations and truncations (num_envs,) bool, infos.

        Raises:
            ValueError: `actions` has a wrong shape, or an action is not finite; then nothing is stepped. Or a reward is not finite.
            ResetNeeded: `reset` was not called yet; or, with `AutoresetMode.DISABLED`, the episode of an environment has ended.
            ClosedEnvironmentError: `close` was called.
        """
        self._check_open("step")
        batch = self._batch
        action = array_of("actions", actions)
        if action.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {action.shape}, must be {self.action_space.shape}")
        if not self._begun:
            raise ResetNeeded("call reset before step")
        begins = self._over if self._any_over else None
        if begins is not None and self.autoreset_mode == AutoresetMode.DISABLED:
            raise ResetNeeded(f'episodes of environments {np.flatnonzero(begins)[:10].tolist()} are over: reset them with "reset_mask"')
        reward, terminated, truncated, terms = batch.step(action, begins)
        over = terminated | truncated
        infos: dict[str, Any] = {}
        if begins is not None:
            self._since[begins] = time.perf_counter()
        self._over, self._any_over = over, bool(np.count_nonzero(over))
        if self._any_over and self._statistics:
            infos = self._episodes(over)
        if self._any_over and self.autoreset_mode == AutoresetMode.SAME_STEP:
            final = np.full(self.num_envs, None, dtype=object)
            last = batch.observation()
            for env in np.flatnonzero(over):
                final[env] = each_group(last, itemgetter(env))
            ended = _infos(batch.info() | terms, over) | dict(infos)
            batch.begin(over)
            self._since[over] = time.perf_counter()
            infos |= {"final_obs": final, "_final_obs": over, "final_info": ended, "_final_info": over.copy()}
            self._over, self._any_over, begins = np.zeros_like(over), False, over
        if begins is None:
            infos |= _infos(batch.info() | terms, self._every)
        else:
            infos |= _infos(batch.info(), self._every) | _infos(terms, ~begins)
        return batch.observation(), reward, terminated, truncated, infos

    def set_state(self, qpos: Array | None = None, qvel: Array | None = None, envs: ArrayLike | None = None) -> Any:
        """Sets positions and velocities. The episodes go on: lengths, episode_state and random numbers stay.

        Args:
            qpos: Positions, (num_envs, nq) or (nq,), m and rad; None keeps them.
            qvel: Velocities, (num_envs, nv) or (nv,), m/s and rad/s; None keeps them.
            envs: Environments to change, a boolean mask (num_envs,) or integer indices (k,), each once; None selects all environments.
                With indices, positions and velocities have one row per index, in the order of the indices.

        Returns:
            Observations, (num_envs, n).

        Raises:
            ValueError: A shape is wrong, or a number is not finite. Nothing is changed.
            TypeError, IndexError: An index is not an integer, or out of range.
        """
        self._check_open("set_state")
        self._batch.set_state(qpos, qvel, _mask_of(envs, self.num_envs), None if envs is None else np.asarray(envs))
        return self._batch.observation()

    def render(self) -> tuple[Array, ...] | None:
        """Returns pictures of all environments, (height, width, 3) uint8 each; None without a render mode.

        `stepper.viewer.Renderer` makes pictures of some environments.

        Raises:
            stepper.viewer.LooksError: The task's model did not come from MJCF, so that its visual elements are unknown.
            RuntimeError: MuJoCo's renderer cannot draw on this machine; the message lists what to install.
        """
        self._check_open("render")
        return None if self.render_mode is None or self._drawing is None else self._drawing.frames(range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer. Later calls of `reset`, `step`, `set_state` and `render` raise gymnasium.error.ClosedEnvironmentError."""
        self._close()

    def __getstate__(self) -> dict[str, Any]:
        # Start times are stored as elapsed times, because another process has another clock.
        return self.__dict__ | {"_since": time.perf_counter() - self._since}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state | {"_since": time.perf_counter() - state["_since"]}

    def _begins(self, options: dict[str, Any] | None, envs: ArrayLike | None) -> Array:
        """Mask (num_envs,) of the environments that `reset` starts, from its argument `options` or `envs`."""
        if envs is None:
            return reset_mask(options, self.num_envs)
        if options:
            raise ValueError(f"options has {sorted(options)} and envs is given too: give one of them")
        return _mask_of(envs, self.num_envs)

    def _episodes(self, over: Array) -> dict[str, Any]:
        """Return, length and duration of the episodes in the mask `over`, as in Gymnasium's `RecordEpisodeStatistics`."""
        batch = self._batch
        duration = np.round(time.perf_counter() - self._since, 6)
        sums = {"r": np.where(over, batch.returns, 0.0), "l": np.where(over, batch.lengths, 0), "t": np.where(over, duration, 0.0)}
        return {"episode": sums, "_episode": over.copy()}


def _infos(terms: Terms, mask: Array) -> dict[str, Any]:
    """Info dict of a vector environment: each array of `terms`, with zeros outside the mask (num_envs,), and the mask as "_name"."""
    infos: dict[str, Any] = {}
    if not terms or not (count := np.count_nonzero(mask)):
        return infos
    mask, others = mask.copy(), () if count == len(mask) else (~mask).nonzero()[0]
    for name, term in terms.items():
        infos[name], infos[f"_{name}"] = np.array(term), mask
        if len(others):
            infos[name][others] = np.zeros((), dtype=term.dtype)
    return infos


def seeds_of(seed: int | Sequence[int | None] | None, num_envs: int) -> list[int | None]:
    """List with a seed or None for each environment, from the argument `seed` of `reset`."""
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, int | np.integer):
        return [int(seed) + k for k in range(num_envs)]
    if isinstance(seed, str) or not isinstance(seed, Iterable):
        raise TypeError(f"seed is {seed!r}, must be a whole number, or a sequence with one for each environment")
    seeds = list(seed)
    if len(seeds) != num_envs:
        raise ValueError(f"there are {len(seeds)} seeds, must be {num_envs}: one for each environment, or None for those without")
    for env, value in enumerate(seeds):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | np.integer)):
            raise TypeError(f"the seed of environment {env} is {value!r}, must be a whole number, or None to keep its random numbers")
    return [None if value is None else int(value) for value in seeds]


def _mask_of(envs: ArrayLike | None, num_envs: int) -> Array:
    """Mask (num_envs,) of the environments that the argument `envs` selects: a mask, indices, or None for all."""
    mask = np.zeros(num_envs, dtype=bool)
    mask[selected(envs, num_envs)] = True
    return mask


def _scattered(seeds: list[int | None], ids: Array, num_envs: int) -> list[int | None]:
    """List of num_envs seeds, with `seeds` at the environments `ids` (indices, one per seed), and None elsewhere."""
    if len(seeds) != len(ids):
        raise ValueError(f"there are {len(seeds)} seeds, must be {len(ids)}: one for each environment of envs")
    every: list[int | None] = [None] * num_envs
    for k, seed in zip(ids.tolist(), seeds, strict=True):
        every[k] = seed
    return every


def reset_mask(options: dict[str, Any] | None, num_envs: int) -> Array:
    """Mask (num_envs,) of the environments that `reset` starts, from Gymnasium's "reset_mask" in the options; all if it is absent."""
    if options is not None:
        check_mapping("options", options, '{"reset_mask": mask}')
    if unknown := set(options or {}) - {"reset_mask"}:
        raise ValueError(f"unknown options {sorted(map(str, unknown))}, the only option is 'reset_mask'; reset(envs=...) takes indices")
    if options is None or "reset_mask" not in options:
        return np.ones(num_envs, dtype=bool)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"reset_mask is {mask!r}, must be an array of bool")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"reset_mask has shape {mask.shape} and {mask.sum()} true entries, must be ({num_envs},) with at least one True")
    return mask

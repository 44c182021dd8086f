"""Vector environment as a `gymnasium.vector.VectorEnv`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from stepper._hints import no_attribute
from stepper._options import Options, Precision
from stepper._stepper import Model, Stepper, selected
from stepper.envs.batch import Batch
from stepper.envs.drawing import RENDER_MODES, Drawing, RenderMode, camera_settings
from stepper.envs.making import autoreset
from stepper.envs.state import EnvState
from stepper.envs.task import Array, Camera, Contact, Moment, Task, Terms


class StepperVectorEnv(VectorEnv[Array, Array, Array]):
    """Vector environment of one task. Returned arrays belong to the caller. It pickles with its state.

    If a step would give a state that is not finite, the environment keeps its last finite state, its episode is terminated, and its info
    has "non_finite".

    Args:
        task: A `Task`, a class of tasks, or a name in `stepper.envs.TASKS`. For the latter two, `arguments` are those of the task.
        num_envs: Number of environments.
        autoreset_mode: Gymnasium's `AutoresetMode` or its name: when an environment starts its next episode.

            * "NEXT_STEP": at the next call of `step`, which ignores the action.
            * "SAME_STEP": within the step that ends the episode; "final_obs" and "final_info" of the infos have its last observation.
            * "DISABLED": only at `reset(options={"reset_mask": mask})`.
        contact: Law of contact: "mujoco", with the integrator of the model's file, or "hard"; None is the task's.
        options: Options of the step, in place of those of `contact`.
        precision: "f64" or "f32".
        threads: Number of threads; 0 is all cores that this process may use. The bits are the same for any number.
        dtype: Scalar type of observations, float64 or float32; None is that of the precision.
        max_episode_steps: Actions after which an episode is truncated; None is no limit. `gymnasium.make_vec` gives the registered one.
        episode_statistics: Whether infos have "episode" where one is over: its return "r", length "l" and duration "t" in s, as
            `RecordEpisodeStatistics` writes them.
        render_mode: "rgb_array" for a picture of every environment by `render()`, or None for no pictures. `stepper.viewer.Renderer` lists
            the
            requirements.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera_id: Index of a camera of the model's file, or -1 for the task's free camera. The default is the file's camera "track", or the
            task's free camera.
        camera_name: Name of a camera of the model's file.
        default_camera_config: Settings of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,), m, and trackbodyid,
            the followed body.
        model: What `task.model()` makes, where it is made already: several batches can share it.
        **arguments: Arguments of a task that is given by its class or name.

    Raises:
        ValueError: A setting out of its range, no task of that name, another render mode.
        TypeError: Arguments that the task does not have.
    """

    _drawing: Drawing | None = None
    """None until the constructor has made it: Gymnasium closes an environment whose constructor raised."""

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
        settings["model"] = model
        self._batch = Batch(task, num_envs, arguments, max_episode_steps=max_episode_steps, **settings)
        self.num_envs, self.autoreset_mode = num_envs, autoreset(autoreset_mode)
        camera = camera_settings(width, height, camera_id, camera_name, default_camera_config)
        self.render_mode, self._drawing = render_mode, Drawing(self._batch, render_mode, **camera)
        frames = {"render_modes": [*RENDER_MODES], "render_fps": round(1 / self._batch.dt)}
        self.metadata = {"autoreset_mode": self.autoreset_mode, **frames}
        self.single_observation_space, self.single_action_space = self._batch.observation_space, self._batch.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_structure = self._batch.structure
        self._statistics, self._begun = episode_statistics, False
        self._over, self._any_over = np.zeros(num_envs, dtype=bool), False
        self._since = np.zeros(num_envs)

    def __getattr__(self, name: str) -> Any:
        raise no_attribute(StepperVectorEnv, name)

    @property
    def sim(self) -> Stepper:
        """The stepper: to read from, and to randomize."""
        return self._batch.sim

    @property
    def now(self) -> Moment:
        """Quantities after the last step or reset, as the task sees them."""
        return self._batch.now

    @property
    def task(self) -> Task:
        """The task."""
        return self._batch.task

    @property
    def dt(self) -> float:
        """Time of an action, s."""
        return self._batch.dt

    @property
    def episode_returns(self) -> Array:
        """Sums of the rewards of the episodes that are under way, (num_envs,)."""
        return self._batch.returns.copy()

    @property
    def episode_lengths(self) -> Array:
        """Actions of the episodes that are under way, (num_envs,)."""
        return self._batch.lengths.copy()

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
        envs: ArrayLike | None = None,
        out: Array | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: Environment i has the seed `seed + i`, or that of a sequence; what it draws follows from it alone. None goes on with the
                random numbers as they are.
            options: Gymnasium's "reset_mask", (num_envs,) bool: the environments that begin, at least one.
            envs: The environments that begin, in place of `options`: a boolean mask (num_envs,) or integer indices (k,), each once;
                None is all, and none of them does nothing. With indices a sequence of seeds has k, in their order.
            out: Array that observations are written to, (num_envs, n) of their type; None is a new one.

        Returns:
            Observations of all environments (num_envs, n), and infos of those that began.

        Raises:
            TypeError: A reset_mask that is no array of bool, or indices that are no integers.
            ValueError: Another shape, an index twice, other options, seeds for another number of environments.
            IndexError: An index out of range.
            ResetNeeded: A mask before all environments began once.
        """
        room, mask = self._batch.room(out), self._begins(options, envs)
        if seed is not None and _are_indices(envs) and not isinstance(seed, int | np.integer):
            seed = _scattered(list(seed), np.array(selected(envs, self.num_envs)), self.num_envs)
        seeds = _seeds(seed, self.num_envs)
        if not self._begun and not mask.all():
            raise ResetNeeded("call reset without envs or reset_mask first: not all environments have begun")
        if not mask.any():
            return self._batch.observation(room), {}
        super().reset(seed=seed if isinstance(seed, int) else None)
        given = np.array([value is not None for value in seeds]) & mask
        if given.any():
            self._batch.seed(np.flatnonzero(given), [value for value, take in zip(seeds, given, strict=True) if take and value is not None])
        self._batch.begin(mask)
        self._begun = True
        self._over[mask] = False
        self._any_over = bool(self._over.any())
        self._since[mask] = time.perf_counter()
        return self._batch.observation(room), _shown(self._batch.info(), mask)

    def step(self, actions: Array, *, out: Array | None = None) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Makes the steps of one action in every environment.

        Args:
            actions: Actions, (num_envs, nu), in the units of the task.
            out: Array that observations are written to, (num_envs, n) of their type; None is a new one.

        Returns:
            Observations (num_envs, n), rewards (num_envs,) float64, terminations and truncations (num_envs,) bool, infos.

        Raises:
            ValueError: Actions of another shape, an `out` of another shape or type, an action that is not finite; nothing is stepped then.
                A reward that is not finite.
            ResetNeeded: Before the first reset; or, with `AutoresetMode.DISABLED`, for environments whose episode is over.
        """
        batch = self._batch
        action = np.asarray(actions, dtype=np.float64)
        if action.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {action.shape}, must be {self.action_space.shape}")
        if not self._begun:
            raise ResetNeeded("call reset before step")
        room = batch.room(out)
        begins = self._over if self._any_over else None
        if begins is not None and self.autoreset_mode == AutoresetMode.DISABLED:
            raise ResetNeeded(f'episodes of environments {np.flatnonzero(begins)[:10].tolist()} are over: reset them with "reset_mask"')
        reward, terminated, truncated, terms = batch.step(action, begins)
        over = terminated | truncated
        infos: dict[str, Any] = {}
        if begins is not None:
            self._since[begins] = time.perf_counter()
        self._over, self._any_over = over, bool(over.any())
        if self._any_over and self._statistics:
            infos = self._episodes(over)
        if self._any_over and self.autoreset_mode == AutoresetMode.SAME_STEP:
            final = np.full(self.num_envs, None, dtype=object)
            final[over] = np.fromiter(batch.observation()[over], dtype=object, count=int(over.sum()))
            ended = _shown(batch.info() | terms, over)
            batch.begin(over)
            self._since[over] = time.perf_counter()
            infos |= {"final_obs": final, "_final_obs": over, "final_info": ended, "_final_info": over.copy()}
            self._over, self._any_over, begins = np.zeros_like(over), False, over
        if begins is None:
            infos |= _shown(batch.info() | terms, np.ones(self.num_envs, dtype=bool))
        else:
            infos |= _shown(batch.info(), np.ones(self.num_envs, dtype=bool)) | _shown(terms, ~begins)
        return batch.observation(room), reward, terminated, truncated, infos

    def get_state(self) -> EnvState:
        """State of all environments, for `set_state`; an environment continues from it with the same bits.

        The state contains that of the stepper, parameters of `Stepper.randomize`, applied forces, mocap poses and active equalities. It
        also contains the episodes: the task's episode_state, random number generators of initial states and sensors, returns, lengths,
        and which have ended. It does not contain the counters of wrappers or the random number generator of `action_space`.

        Raises:
            ResetNeeded: `reset` was not called yet.
        """
        if not self._begun:
            raise ResetNeeded("call reset before get_state")
        state = self._batch.get_state()
        return replace(state, episodes=state.episodes | {"over": self._over.copy(), "elapsed": time.perf_counter() - self._since})

    def set_state(self, qpos: Array | EnvState | None = None, qvel: Array | None = None, envs: ArrayLike | None = None) -> Array:
        """Sets positions and velocities, or restores a state of `get_state`.

        Positions and velocities leave the episodes as they are: lengths, episode_state and random numbers. A state replaces everything: the
        same actions then give the same observations, rewards, terminations and resets, bit for bit. The state may be from another
        `StepperVectorEnv` with the same task, settings and number of environments, also from another process.

        Args:
            qpos: Positions, (num_envs, nq) or (nq,), m and rad; None keeps them. Or a state, whose row i belongs to environment i.
            qvel: Velocities, (num_envs, nv) or (nv,), m/s and rad/s; None keeps them. Leave it out with a state.
            envs: Environments to change, a boolean mask (num_envs,) or integer indices (k,), each once; None is all. With indices,
                positions and velocities have a row for each index, in their order.

        Returns:
            Observations, (num_envs, n).

        Raises:
            ValueError: A wrong shape, a number that is not finite, or velocities together with a state. Or a state of another task or with
                other arguments of the task or options of the step. Nothing is changed.
            TypeError, IndexError: Indices that are not integers, or out of range.
            ResetNeeded: A state for some environments before the first `reset`.
        """
        mask = _mask_of(envs, self.num_envs)
        if not isinstance(qpos, EnvState):
            self._batch.set_state(qpos, qvel, mask, None if envs is None else np.asarray(envs))
            return self._batch.observation()
        if qvel is not None:
            raise ValueError("qvel is given together with a state, which contains velocities: leave it out")
        if not self._begun and not mask.all():
            raise ResetNeeded("call reset before set_state with a state of some environments: the others have not begun")
        self._batch.restore(qpos, mask)
        episodes = qpos.episodes
        # States of a `StepperEnv` have neither.
        self._over[mask] = episodes["over"][mask] if "over" in episodes else False
        self._since[mask] = time.perf_counter() - (episodes["elapsed"][mask] if "elapsed" in episodes else 0.0)
        self._any_over, self._begun = bool(self._over.any()), True
        return self._batch.observation()

    def render(self) -> tuple[Array, ...] | None:
        """A picture of every environment, (height, width, 3) uint8 each; None without a render mode. `stepper.viewer.Renderer` draws some.

        Raises:
            stepper.viewer.LooksError: The task's model did not come from MJCF, so that its visual elements are unknown.
            RuntimeError: MuJoCo's renderer cannot draw on this machine; the message lists what to install.
        """
        return None if self.render_mode is None or self._drawing is None else self._drawing.frames(range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer."""
        if self._drawing is not None:
            self._drawing.close()

    def __getstate__(self) -> dict[str, Any]:
        # Another process has another clock.
        return self.__dict__ | {"_since": time.perf_counter() - self._since}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state | {"_since": time.perf_counter() - state["_since"]}

    def _begins(self, options: dict[str, Any] | None, envs: ArrayLike | None) -> Array:
        """Mask of the environments that `reset` begins."""
        if envs is None:
            return _mask(options, self.num_envs)
        if options:
            raise ValueError(f"options has {sorted(options)} and envs is given too: give one of them")
        return _mask_of(envs, self.num_envs)

    def _episodes(self, over: Array) -> dict[str, Any]:
        """Statistics of the episodes that are over."""
        batch = self._batch
        duration = np.round(time.perf_counter() - self._since, 6)
        sums = {"r": np.where(over, batch.returns, 0.0), "l": np.where(over, batch.lengths, 0), "t": np.where(over, duration, 0.0)}
        return {"episode": sums, "_episode": over.copy()}


def _shown(terms: Terms, mask: Array) -> dict[str, Any]:
    """Terms as infos of the environments of a mask: zero in the others, and a mask for each."""
    if mask.all():
        return {key: value for name, term in terms.items() for key, value in ((name, np.array(term)), (f"_{name}", mask))}
    if not mask.any():
        return {}
    infos: dict[str, Any] = {}
    for name, term in terms.items():
        infos[name] = np.where(mask.reshape(-1, *[1] * (term.ndim - 1)), term, np.zeros((), dtype=term.dtype))
        infos[f"_{name}"] = mask.copy()
    return infos


def _seeds(seed: int | Sequence[int | None] | None, num_envs: int) -> list[int | None]:
    """A seed, or None, for each environment."""
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, int | np.integer):
        return [int(seed) + k for k in range(num_envs)]
    seeds = list(seed)
    if len(seeds) != num_envs:
        raise ValueError(f"there are {len(seeds)} seeds, must be {num_envs}: one for each environment, or None for those without")
    return seeds


def _mask_of(envs: ArrayLike | None, num_envs: int) -> Array:
    """Selected environments as a mask, (num_envs,)."""
    mask = np.zeros(num_envs, dtype=bool)
    mask[selected(envs, num_envs)] = True
    return mask


def _are_indices(envs: ArrayLike | None) -> bool:
    return envs is not None and np.asarray(envs).dtype != np.bool_


def _scattered(seeds: list[int | None], ids: Array, num_envs: int) -> list[int | None]:
    """Seeds of some environments as those of all, of which the others have none."""
    if len(seeds) != len(ids):
        raise ValueError(f"there are {len(seeds)} seeds, must be {len(ids)}: one for each environment of envs")
    every: list[int | None] = [None] * num_envs
    for k, seed in zip(ids.tolist(), seeds, strict=True):
        every[k] = seed
    return every


def _mask(options: dict[str, Any] | None, num_envs: int) -> Array:
    """Environments that `reset` begins."""
    if unknown := set(options or {}) - {"reset_mask"}:
        raise ValueError(f"unknown options {sorted(unknown)}, there is: 'reset_mask'; reset(envs=...) takes indices")
    if options is None or "reset_mask" not in options:
        return np.ones(num_envs, dtype=bool)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"reset_mask is {mask!r}, must be an array of bool")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"reset_mask has shape {mask.shape} and {mask.sum()} of True, must be ({num_envs},) with one at least")
    return mask

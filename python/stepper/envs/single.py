"""Single environment as a `gymnasium.Env`."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from stepper._arrays import array_of
from stepper._options import Options, Precision
from stepper.envs.batch import Batch, each_group
from stepper.envs.environment import RENDER_MODES, Environment, RenderMode, camera_settings, make_task
from stepper.envs.task import Array, Camera, Contact, Task, Terms


class StepperEnv(Environment, gymnasium.Env[Array, Array]):
    """Single environment of a task. A `StepperVectorEnv` gives an environment with the same seed the same results, bit for bit.

    A pickled environment contains its state.

    If a step would give a state that is not finite, the episode is terminated, and its info has "non_finite". The bodies concerned keep
    their last finite state, and so do all bodies to which constraints connect them.

    Args:
        task: A `Task`, a class of tasks, or a name in `stepper.envs.TASKS`. For a class or a name, `arguments` go to its constructor.
        contact: Contact law: "mujoco", with the integrator of the model's file, or "hard"; None selects `task.contact`.
        options: Options of the step, which replace `contact`.
        precision: "f64" or "f32".
        dtype: Scalar type of observations, float64 or float32; None selects the type that `precision` names.
        max_episode_steps: Number of actions after which an episode is truncated; None means no limit. With `gymnasium.make`, the wrapper
            `TimeLimit` truncates instead.
        rewards: Weights that replace those of terms of the reward (`Task.rewards`), by name, as {"action_rate": -0.2}.
        groups: Whether observations are a dictionary with all observation groups of the task. Otherwise they are the group "policy".
        render_mode: "rgb_array" for pictures by `render()`, or None for no pictures. `stepper.viewer.Renderer` lists the requirements.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera_id: Index of a camera of the model's file, or -1 for the task's free camera. The default is the file's camera
            "track", or without one the task's free camera.
        camera_name: Name of a camera of the model's file.
        default_camera_config: Settings of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,), m, and trackbodyid,
            the followed body.
        **arguments: Arguments of the task's constructor, if `task` is a class or a name.

    Raises:
        ValueError: A setting is out of its range, or the task or render mode is unknown.
        TypeError: The task does not have one of the `arguments`.
    """

    metadata = {"render_modes": [*RENDER_MODES]}  # noqa: RUF012

    def __init__(
        self,
        task: Task | type[Task] | str,
        *,
        contact: Contact | None = None,
        options: Options | None = None,
        precision: Precision = "f64",
        dtype: Any = None,
        max_episode_steps: int | None = None,
        rewards: Mapping[str, float] | None = None,
        groups: bool = False,
        render_mode: RenderMode | None = None,
        width: int = 480,
        height: int = 480,
        camera_id: int | None = None,
        camera_name: str | None = None,
        default_camera_config: Camera | None = None,
        **arguments: Any,
    ):
        settings: dict[str, Any] = {"contact": contact, "options": options, "precision": precision, "dtype": dtype}
        settings |= {"max_episode_steps": max_episode_steps, "rewards": rewards, "groups": groups}
        batch = Batch(make_task(task, arguments, StepperEnv), 1, **settings)
        camera = camera_settings(width, height, camera_id, camera_name, default_camera_config)
        self.observation_space, self.action_space = self._set_up(batch, render_mode, camera)
        self.render_mode = render_mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Starts a new episode.

        Args:
            seed: Seed of all random numbers of the environment; None continues the current stream of random numbers.
            options: Must be None or empty, because there are no options.

        Returns:
            Observation (n,), or with `groups` a dictionary of such arrays, and the info dict.

        Raises:
            ValueError: `options` is not empty.
        """
        self._check_open("reset")
        if options:
            raise ValueError(f"options is {options!r}, but this environment has no options: leave options out")
        super().reset(seed=seed)
        if seed is not None:
            self._batch.seed(np.zeros(1, dtype=np.int64), [int(seed)])
        self._batch.begin(np.ones(1, dtype=bool))
        self._begun = True
        return self._observation(), _info_of_one(self._batch.info())

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advances the environment by one action.

        Args:
            action: Action, (nu,), in the units of the task. A task with `action_bounds` may have another number than nu.

        Returns:
            Observation (n,), reward, terminated, truncated, and the info dict.

        Raises:
            ValueError: The action has a wrong shape or is not finite; then nothing is stepped. Or the reward is not finite.
            ResetNeeded: `reset` was not called yet.
            ClosedEnvironmentError: `close` was called.
        """
        self._check_open("step")
        batch = self._batch
        action = array_of("action", action)
        if action.shape != self.action_space.shape:
            raise ValueError(f"the action has shape {action.shape}, must be {self.action_space.shape}")
        if not self._begun:
            raise ResetNeeded("call reset before step")
        reward, terminated, truncated, terms = batch.step(action[None])
        return self._observation(), float(reward[0]), bool(terminated[0]), bool(truncated[0]), _info_of_one(batch.info() | terms)

    def set_state(self, qpos: Array | None = None, qvel: Array | None = None) -> Array:
        """Sets positions and velocities. The episode goes on: length, episode_state and random numbers stay.

        Args:
            qpos: Positions (nq,), m and rad; None keeps them.
            qvel: Velocities (nv,), m/s and rad/s; None keeps them.

        Returns:
            The observation, (n,), in the units of the task.

        Raises:
            ValueError: A shape is wrong, or a number is not finite. Nothing is changed.
        """
        self._check_open("set_state")
        self._batch.set_state(qpos, qvel, np.ones(1, dtype=bool))
        return self._observation()

    def _observation(self) -> Array:
        """Present observation, (n,), or a dictionary of such arrays by group."""
        observation: Array = each_group(self._batch.observation(), itemgetter(0))
        return observation

    def render(self) -> Array | None:
        """Returns a picture of the environment, (height, width, 3) uint8; None without a render mode.

        Raises:
            stepper.viewer.LooksError: The task's model did not come from MJCF, so that its visual elements are unknown.
            RuntimeError: MuJoCo's renderer cannot draw on this machine; the message lists what to install.
        """
        self._check_open("render")
        return None if self.render_mode is None or self._drawing is None else self._drawing.frames([0])[0]

    def close(self) -> None:
        """Frees the renderer. Later calls of `reset`, `step`, `set_state` and `render` raise gymnasium.error.ClosedEnvironmentError."""
        self._close()


def _info_of_one(terms: Terms) -> dict[str, Any]:
    """Info dict of a single environment from arrays (1, ...) by name. Values are copies, which later steps do not change."""
    return {name: term[0] if term.ndim == 1 else term[0].copy() for name, term in terms.items()}

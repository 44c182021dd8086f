"""Single environment as a `gymnasium.Env`."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from stepper._arrays import array_of
from stepper._hints import hint_keywords
from stepper._options import Options, Precision
from stepper._stepper import Stepper
from stepper.envs.batch import Batch
from stepper.envs.checked_environment import CheckedEnvironment
from stepper.envs.drawing import RENDER_MODES, Drawing, RenderMode, camera_settings
from stepper.envs.groups import each_group
from stepper.envs.making import make_task
from stepper.envs.state import EnvState
from stepper.envs.task import Array, Camera, Contact, Task, TaskView, Terms


class StepperEnv(CheckedEnvironment, gymnasium.Env[Array, Array]):
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
        self._batch = Batch(make_task(task, arguments, vector=False), 1, **settings)
        camera = camera_settings(width, height, camera_id, camera_name, default_camera_config)
        self.render_mode, self._drawing = render_mode, Drawing(self._batch, render_mode, **camera)
        self.metadata = {"render_modes": [*RENDER_MODES], "render_fps": round(1 / self._batch.dt)}
        observations = self._batch.observations
        self.observation_space, self.observation_structure = observations.space, observations.structure
        self.action_space = self._batch.action_space
        self._begun = False

    @property
    def sim(self) -> Stepper:
        """Stepper of the environment, whose arrays have a leading axis of length 1."""
        return self._batch.sim

    @property
    def now(self) -> TaskView:
        """View of the environment after the last step or reset, from which the task computes observations and rewards."""
        return self._batch.now

    @property
    def task(self) -> Task:
        """Task that defines scene, observations and rewards."""
        return self._batch.task

    @property
    def reward_weights(self) -> dict[str, float]:
        """Weight of each term of the reward (`Task.rewards`), by name."""
        return dict(self._batch.terms.rewards.weights)

    @property
    def dt(self) -> float:
        """Simulated time per action, s: the time step times `task.frame_skip`."""
        return self._batch.dt

    @hint_keywords("StepperEnv.reset")
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

    @hint_keywords("StepperEnv.step")
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

    def get_state(self) -> EnvState:
        """Returns the state of the environment, for `set_state`.

        Steps after `set_state` give the same results as steps after `get_state`, bit for bit.

        The state contains the stepper's state, parameters of `Stepper.randomize`, applied forces, mocap poses and active equalities. It
        also contains the episode: the task's episode_state, random number generators of initial states and sensors, return and length. It
        does not contain the counters of wrappers, such as `TimeLimit` of `gymnasium.make`, or the random number generator of
        `action_space`.

        Raises:
            ResetNeeded: `reset` was not called yet.
        """
        if not self._begun:
            raise ResetNeeded("call reset before get_state")
        return self._batch.get_state()

    @hint_keywords("StepperEnv.set_state")
    def set_state(self, qpos: Array | EnvState | None = None, qvel: Array | None = None) -> Array:
        """Sets positions and velocities, or restores a state of `get_state`.

        Positions and velocities do not change the episode: length, episode_state and random numbers stay. An `EnvState` replaces
        everything: the same actions then give the same observations, rewards, terminations and resets, bit for bit. It may come from
        another `StepperEnv` with the same task and settings, also from another process.

        Args:
            qpos: Positions (nq,), m and rad; None keeps them. Or an `EnvState` of `get_state`.
            qvel: Velocities (nv,), m/s and rad/s; None keeps them. Must be None if `qpos` is an `EnvState`.

        Returns:
            The observation, (n,), in the units of the task.

        Raises:
            ValueError: A shape is wrong, a number is not finite, or `qvel` is given with an `EnvState`. Or the `EnvState` comes from
                another task, other arguments of the task or other options of the step. Nothing is changed.
        """
        self._check_open("set_state")
        mask = np.ones(1, dtype=bool)
        if not isinstance(qpos, EnvState):
            self._batch.set_state(qpos, qvel, mask)
        elif qvel is not None:
            raise ValueError("qvel is given together with a state, which contains velocities: leave it out")
        else:
            self._batch.restore(qpos, mask)
            self._begun = True
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
        return None if self.render_mode is None else self._drawing.frames([0])[0]

    def close(self) -> None:
        """Frees the renderer. Later calls of `reset`, `step`, `set_state` and `render` raise gymnasium.error.ClosedEnvironmentError."""
        self._drawing.close()
        self._closed = True


def _info_of_one(terms: Terms) -> dict[str, Any]:
    """Info dict of a single environment from arrays (1, ...) by name. Values are copies, which later steps do not change."""
    return {name: term[0] if term.ndim == 1 else term[0].copy() for name, term in terms.items()}

"""One environment as a `gymnasium.Env`."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from stepper._hints import no_attribute
from stepper._options import Options, Precision
from stepper._stepper import Stepper
from stepper.envs.batch import Batch
from stepper.envs.drawing import RENDER_MODES, Drawing, RenderMode, camera_settings
from stepper.envs.state import EnvState
from stepper.envs.task import Array, Camera, Contact, Moment, Task, Terms


class StepperEnv(gymnasium.Env[Array, Array]):
    """One environment of a task: the bits of an environment of `StepperVectorEnv` with the same seed. It pickles with its state.

    Where its state would not be finite, it keeps its last finite one, and the episode is terminated: info has "non_finite".

    Args:
        task: A `Task`; or the class of one, or the name of one of `stepper.envs.TASKS`, whose arguments are then given here too.
        contact: Law of contact: "mujoco", with the integrator of the model's file, or "hard"; None is the task's.
        options: Settings of the step in place of those of `contact`.
        precision: "f64" or "f32".
        dtype: Scalar type of observations, float64 or float32; None is that of the precision.
        max_episode_steps: Actions after which an episode is truncated; None is no limit. `gymnasium.make` has a wrapper for it.
        render_mode: "rgb_array", and `render()` gives a picture; None, and it gives none. See `stepper.viewer.Renderer` for what
            pictures need.
        width: Width of a picture in pixels.
        height: Its height.
        camera_id: Index of a camera of the model's file, or -1 for a free one as the task has it. Without any camera given it is the file's
            camera "track", and where there is none, the task's.
        camera_name: Name of a camera of the model's file.
        default_camera_config: Numbers of a free camera: distance, azimuth, elevation, lookat, trackbodyid, the body that it follows.
        **arguments: Arguments of a task that is given by its class or name.

    Raises:
        ValueError: A setting out of its range, no task of that name, another render mode.
        TypeError: Arguments that the task does not have.
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
        render_mode: RenderMode | None = None,
        width: int = 480,
        height: int = 480,
        camera_id: int | None = None,
        camera_name: str | None = None,
        default_camera_config: Camera | None = None,
        **arguments: Any,
    ):
        settings: dict[str, Any] = {"contact": contact, "options": options, "precision": precision, "dtype": dtype}
        self._batch = Batch(task, 1, arguments, max_episode_steps=max_episode_steps, **settings)
        camera = camera_settings(width, height, camera_id, camera_name, default_camera_config)
        self.render_mode, self._drawing = render_mode, Drawing(self._batch, render_mode, **camera)
        self.metadata = {"render_modes": [*RENDER_MODES], "render_fps": round(1 / self._batch.dt)}
        self.observation_space, self.action_space = self._batch.observation_space, self._batch.action_space
        self.observation_structure = self._batch.structure
        self._begun = False

    def __getattr__(self, name: str) -> Any:
        raise no_attribute(StepperEnv, name)

    @property
    def sim(self) -> Stepper:
        """The stepper, of one environment: its arrays have an axis of length 1 in front."""
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

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begins a new episode.

        Args:
            seed: What it draws follows from it alone. None goes on with the random numbers as they are.
            options: There are none.

        Raises:
            ValueError: Options.
        """
        if options:
            raise ValueError(f"unknown options {sorted(options)}, there are none")
        super().reset(seed=seed)
        if seed is not None:
            self._batch.seed(np.zeros(1, dtype=np.int64), [int(seed)])
        self._batch.begin(np.ones(1, dtype=bool))
        self._begun = True
        return self._batch.observation()[0], _of_one(self._batch.info())

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Makes the steps of one action, (nu,).

        Raises:
            ValueError: An action of another shape, or one that is not finite; nothing is stepped then. A reward that is not finite.
            ResetNeeded: Before the first reset.
        """
        batch = self._batch
        action = np.asarray(action, dtype=np.float64)
        if action.shape != self.action_space.shape:
            raise ValueError(f"the action has shape {action.shape}, must be {self.action_space.shape}")
        if not self._begun:
            raise ResetNeeded("call reset before step")
        reward, terminated, truncated, terms = batch.step(action[None])
        return batch.observation()[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _of_one(batch.info() | terms)

    def get_state(self) -> EnvState:
        """State of the environment, from which it goes on with the same bits: `set_state` restores it.

        It has the state of the stepper, parameters of `Stepper.randomize`, applied forces, mocap poses, and the episode: episode_state of
        the task, random numbers of starts and sensors, return and length. Wrappers have separate counts (`TimeLimit`, which
        `gymnasium.make` puts around an environment), and so have the random numbers of `action_space`.

        Raises:
            ResetNeeded: Before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("call reset before get_state")
        return self._batch.get_state()

    def set_state(self, qpos: Array | EnvState | None = None, qvel: Array | None = None) -> Array:
        """Sets positions and velocities, or restores a state of `get_state`.

        Positions and velocities leave the episode as it is: length, episode_state and random numbers. A state replaces everything: the same
        actions then give the same observations, rewards, terminations and resets, bit for bit. The state may be from another
        `StepperEnv` with the same task and settings, also from another process.

        Args:
            qpos: Positions (nq,), None keeps them; or a state.
            qvel: Velocities (nv,); None keeps them. Leave it out with a state.

        Returns:
            The observation, (n,).

        Raises:
            ValueError: A wrong shape, a number that is not finite, velocities together with a state, or a state of another task or with
                other arguments of the task or options of the step. Nothing is changed.
        """
        mask = np.ones(1, dtype=bool)
        if not isinstance(qpos, EnvState):
            self._batch.set_state(qpos, qvel, mask)
        elif qvel is not None:
            raise ValueError("qvel is given together with a state, which contains velocities: leave it out")
        else:
            self._batch.restore(qpos, mask)
            self._begun = True
        observation: Array = self._batch.observation()[0]
        return observation

    def render(self) -> Array | None:
        """A picture, (height, width, 3) uint8; None without a render mode.

        Raises:
            stepper.viewer.LooksError: The task's model did not come from MJCF, so that its looks are unknown.
            RuntimeError: MuJoCo's renderer cannot draw on this machine; the message lists what to install.
        """
        return None if self.render_mode is None else self._drawing.frames([0])[0]

    def close(self) -> None:
        """Frees what pictures took."""
        self._drawing.close()


def _of_one(terms: Terms) -> dict[str, Any]:
    """Terms of one environment as its info, which later steps leave as it is."""
    return {name: term[0] if term.ndim == 1 else term[0].copy() for name, term in terms.items()}

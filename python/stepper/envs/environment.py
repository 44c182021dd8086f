"""Base class of single and vector environments: their parts and settings, and the check that an environment is not closed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box

from stepper._stepper import Stepper
from stepper.envs.batch import Batch
from stepper.envs.drawing import RENDER_MODES, Drawing, RenderMode
from stepper.envs.task import Task, TaskView


class Environment:
    """Base class of `StepperEnv` and `StepperVectorEnv`: environments of one task with their pictures."""

    _drawing: Drawing | None = None
    """Renderer of pictures; None until the constructor sets it, because Gymnasium calls `close` after an error in the constructor."""
    _closed = False
    """Whether `close` was called."""

    def _set_up(self, batch: Batch, render_mode: RenderMode | None, camera: Mapping[str, Any]) -> tuple[Any, Box]:
        """Sets the attributes of single and vector environments, and returns the spaces of one observation and of one action.

        Args:
            batch: The environments.
            render_mode: "rgb_array", or None for no pictures.
            camera: Settings of the renderer, from `camera_settings`.
        """
        self._batch, self._drawing = batch, Drawing(batch, render_mode, **camera)
        self.metadata: dict[str, Any] = {"render_modes": [*RENDER_MODES], "render_fps": round(1 / batch.dt)}
        self.observation_structure = batch.observations.structure
        self._begun = False
        return batch.observations.space, batch.action_space

    @property
    def sim(self) -> Stepper:
        """Stepper of all environments, for reading quantities and for `randomize`; that of a `StepperEnv` has one environment."""
        return self._batch.sim

    @property
    def now(self) -> TaskView:
        """View of the batch after the last step or reset, from which the task computes observations and rewards."""
        return self._batch.now

    @property
    def task(self) -> Task:
        """Task that defines scene, observations and rewards."""
        return self._batch.task

    @property
    def dt(self) -> float:
        """Simulated time per action, s: the time step times `task.frame_skip`."""
        return self._batch.dt

    @property
    def reward_weights(self) -> dict[str, float]:
        """Weight of each term of the reward (`Task.rewards`), by name."""
        return dict(self._batch.terms.rewards.weights)

    def _check_open(self, call: str) -> None:
        """Raises ClosedEnvironmentError, Gymnasium's, if the environment was closed; `call` is the name of the method."""
        if self._closed:
            raise ClosedEnvironmentError(f"{call} was called after close: call close last, or make another environment")

    def _close(self) -> None:
        """Frees the renderer, so that later calls raise ClosedEnvironmentError."""
        self._closed = True
        if self._drawing is not None:
            self._drawing.close()

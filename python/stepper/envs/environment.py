"""Base class of single and vector environments: their parts and settings, and the check that an environment is not closed."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from typing import Any, Literal, TypeAlias, get_args

from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from stepper._hints import WrongArgumentError, did_you_mean_or_all, unknown_keyword
from stepper._stepper import Stepper
from stepper.envs.batch import Batch
from stepper.envs.task import Array, Task, TaskView
from stepper.envs.tasks import TASKS
from stepper.loading import origin_of
from stepper.shared.arguments import in_words
from stepper.viewer import Renderer


def make_task(task: Task | type[Task] | str, arguments: Mapping[str, Any], environment: type) -> Task:
    """Task from the arguments of an environment. If `task` is a class or a name, the function calls the class with `arguments`.

    Args:
        task: Task, class of tasks, or name in `stepper.envs.TASKS`.
        arguments: Arguments of the task's constructor; must be empty if `task` is a task.
        environment: Class of the environment, whose arguments error messages list too.
    """
    if not isinstance(task, Task | str) and not (isinstance(task, type) and issubclass(task, Task)):
        raise TypeError(f"the task is {in_words(task)}, must be a stepper.envs.Task, the class of one, or the name of one")
    if isinstance(task, str) and task not in TASKS:
        raise ValueError(f"there is no task {task!r}{did_you_mean_or_all(task, sorted(TASKS))}; or give a stepper.envs.Task")
    kind = TASKS[task] if isinstance(task, str) else task if isinstance(task, type) else type(task)
    known = inspect.signature(kind).parameters
    if not any(parameter.kind == inspect.Parameter.VAR_KEYWORD for parameter in known.values()):
        for name in arguments:
            if name not in known:
                settings = [name for name in inspect.signature(environment).parameters if name not in ("task", "arguments")]
                raise WrongArgumentError(unknown_keyword(environment.__name__, name, [*settings, *known]))
    for name, value in arguments.items():
        default = known[name].default if name in known else None
        if isinstance(value, str) and isinstance(default, int | float):
            wanted = "True or False" if isinstance(default, bool) else "a number"
            raise ValueError(f"{name} of {kind.__name__} is {value!r}, must be {wanted}, as the default {default}")
    if not isinstance(task, Task):
        return kind(**arguments)
    if arguments:
        call = f"{kind.__name__}({', '.join(f'{name}=...' for name in arguments)})"
        raise TypeError(f"{kind.__name__} exists already: give {sorted(arguments)} to its constructor, as {call}")
    return task


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """Gymnasium's `AutoresetMode` from the argument `mode`: an `AutoresetMode`, or its name or value as text, in upper or lower case."""
    text = (mode.name if isinstance(mode, AutoresetMode) else str(mode)).lower()
    found = next((each for each in AutoresetMode if text in (each.name.lower(), each.value.lower())), None)
    if found is None:
        raise ValueError(f"autoreset_mode is {mode!r}, must be {', '.join(repr(each.name) for each in AutoresetMode)}, or a member of "
                         "gymnasium.vector.AutoresetMode")  # fmt: skip
    return found


RenderMode: TypeAlias = Literal["rgb_array"]
RENDER_MODES: tuple[str, ...] = get_args(RenderMode)


class Drawing:
    """Pictures of environments, drawn by a renderer that is created for the first picture and is not pickled.

    Args:
        batch: The environments.
        render_mode: "rgb_array", or None for no pictures.
        **settings: `width`, `height`, `camera` and `camera_config` of `stepper.viewer.Renderer`.

    Raises:
        ValueError: An unknown render mode.
    """

    def __init__(self, batch: Batch, render_mode: str | None, **settings: Any):
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(
                f'render_mode is {render_mode!r}, must be "rgb_array", or None for no pictures. To see environments move, make them '
                "without, and call stepper.viewer.view(env.unwrapped.sim); or, for one environment, put it into "
                "gymnasium.wrappers.HumanRendering"
            )
        self._batch, self._settings = batch, settings
        self._origin = None if render_mode is None else origin_of(batch.sim.model)
        self._renderer: Renderer | None = None

    def frames(self, envs: Iterable[int]) -> tuple[Array, ...]:
        """Pictures of the environments with these indices, (height, width, 3) uint8 each."""
        if self._renderer is None:
            batch = self._batch
            task = batch.task
            self._renderer = Renderer(
                batch.sim.model, source=self._origin, default_config=task.camera, add_light=task.lamp, **self._settings
            )
        return tuple(self._renderer.render(self._batch.sim, env) for env in envs)

    def close(self) -> None:
        """Frees the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}


def camera_settings(
    width: int, height: int, camera_id: int | None, camera_name: str | None, camera_config: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Camera settings of a renderer from the camera arguments of Gymnasium's environments.

    Args:
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera_id: Index of a camera; None selects `camera_name` or the default.
        camera_name: Name of a camera; None selects `camera_id` or the default.
        camera_config: Settings of a free camera.

    Returns:
        The settings "width", "height", "camera" and "camera_config" by name.
    """
    if camera_id is not None and camera_name is not None:
        raise ValueError(f"camera_id={camera_id} and camera_name={camera_name!r} were given: give one of them")
    camera = camera_id if camera_name is None else camera_name
    return {"width": width, "height": height, "camera": camera, "camera_config": camera_config}


class Environment:
    """Base class of `StepperEnv` and `StepperVectorEnv`: environments of one task with their pictures."""

    _drawing: Drawing | None = None
    """Renderer of pictures; None until the constructor sets it, because Gymnasium calls `close` after an error in the constructor."""
    _closed = False
    """Whether `close` was called."""

    def _set_up(self, batch: Batch, render_mode: RenderMode | None, camera: Mapping[str, Any]) -> tuple[Any, Box]:
        """Sets the attributes of environments, and returns the spaces of one observation and of one action.

        `camera` has settings of the renderer, from `camera_settings`.
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

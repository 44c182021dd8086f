"""Actions of a policy that are converted to controls: set points of servos with scale, offset, bounds and delay."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepper._hints import WrongArgumentError
from stepper._stepper import Model
from stepper.shared.arguments import check_number
from stepper.shared.selectors import parse, rows_of

if TYPE_CHECKING:
    from stepper.envs.task import TaskView

Array = NDArray[Any]
Scale: TypeAlias = float | Mapping[str, float] | Callable[[Model], Array]
Offset: TypeAlias = float | str | Callable[[Any], Array] | None


@dataclass(frozen=True)
class Servo:
    """Actions that become the controls `offset + scale * action` of some actuators: one action for each of them, in their order.

    Attributes:
        actuators: Names or patterns of the actuators, as in a selector: "*", or "*_hip,*_knee".
        scale: Change of a control by an action of 1, in the unit of the control. It is a number, or numbers by pattern of the actuators'
            names, of which the first that fits counts. Or it is a function of the model that returns a number for each actuator, (nu,).
        offset: Control for the action 0. It is a number, or the name of a keyframe, whose controls count. Or it is a function of a
            `TaskView` that returns numbers (num_envs, nu) or (nu,). None selects the task's `keyframe`, or 0 without one.
        bound: Bound of the magnitude of an action.
        delay: Smallest and largest number of time steps for which the action before still acts. Each episode draws a number.
    """

    actuators: str = "*"
    scale: Scale = 1.0
    offset: Offset = None
    bound: float = 1.0
    delay: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        if isinstance(self.scale, int | float):
            check_number("scale of Servo", self.scale)
        check_number("bound of Servo", self.bound, above=0.0)


class ServoActions:
    """Actions of a task that its `Servo`s convert to controls.

    Args:
        task: The task.
        model: Model of the scene.
        servos: The servos.

    Attributes:
        bounds: Bound of the magnitude of each action, (n,).
        delays: Smallest and largest delay, in time steps.

    Raises:
        ValueError: A pattern fits no actuator, an actuator belongs to two servos, or a keyframe is unknown.
    """

    def __init__(self, task: Any, model: Model, servos: tuple[Servo, ...]):
        where = f"{type(task).__name__}.actions"
        self._columns: list[tuple[NDArray[np.int64], Array, Offset]] = []
        bounds: list[float] = []
        taken: set[int] = set()
        for servo in servos:
            rows = rows_of(model, "actuator", parse(f"actuator_kp[{servo.actuators}]", where).elements, where)
            if twice := taken & set(rows):
                raise ValueError(f"{where} has actuator {model.actuator_names[min(twice)]!r} in two servos: give it to one of them")
            taken |= set(rows)
            offset = servo.offset if servo.offset is not None else task.keyframe
            if isinstance(offset, str):
                if offset not in model.keyframe_names:
                    raise ValueError(
                        f"{where}: the model has no keyframe {offset!r}; keyframes are {', '.join(model.keyframe_names) or 'none'}"
                    )
                controls = np.array(model.keyframe(offset).ctrl)
                offset = lambda now, controls=controls: controls  # noqa: E731
            self._columns.append((np.array(rows), _scale(servo, model, where)[rows], offset))
            bounds += [servo.bound] * len(rows)
        self.bounds, self.delays = np.array(bounds), (min(s.delay[0] for s in servos), max(s.delay[1] for s in servos))

    def controls(self, now: TaskView, action: Array) -> Array:
        """Controls (num_envs, nu) of actions (num_envs, n); actuators of no servo have the control 0."""
        made = np.zeros((len(action), now.sim.model.nu))
        first = 0
        for rows, scale, offset in self._columns:
            base = offset(now)[..., rows] if callable(offset) else offset or 0.0
            made[:, rows] = base + scale * action[:, first : first + len(rows)]
            first += len(rows)
        return made


def _scale(servo: Servo, model: Model, where: str) -> Array:
    """Scale of each actuator of the model, (nu,); 0 for actuators that no pattern fits."""
    if callable(servo.scale):
        scales: Array = np.asarray(servo.scale(model), dtype=np.float64)
        return scales
    if not isinstance(servo.scale, Mapping):
        return np.full(model.nu, float(servo.scale))
    scales = np.full(model.nu, np.nan)
    for pattern, value in servo.scale.items():
        rows = [k for k in rows_of(model, "actuator", (pattern,), where) if np.isnan(scales[k])]
        scales[rows] = value
    chosen = rows_of(model, "actuator", parse(f"actuator_kp[{servo.actuators}]", where).elements, where)
    if missing := [model.actuator_names[k] for k in chosen if np.isnan(scales[k])]:
        raise ValueError(f"{where}: scale has no pattern that fits {missing[0]!r}: add one, such as '*'")
    return np.where(np.isnan(scales), 0.0, scales)


def actions_of(task: Any, model: Model) -> ServoActions | None:
    """Actions of a task by its `Servo`s; None if its actions are controls, or if it converts them itself."""
    given = task.actions
    if given is None:
        return None
    servos = tuple(given) if isinstance(given, tuple | list) else (given,)
    if not servos or not all(isinstance(servo, Servo) for servo in servos):
        raise WrongArgumentError(
            f'{type(task).__name__}.actions is {given!r}, must be a Servo or a tuple of them, as Servo("*", scale=0.25)'
        )
    return ServoActions(task, model, servos)

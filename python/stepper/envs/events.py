"""Random events of a task: parameters that are drawn at the start, at resets or at intervals, and pushes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import WrongArgumentError, unknown_field
from stepper._stepper import Model, Stepper
from stepper.envs.assets import cache_per_model
from stepper.shared.arguments import check_range, in_words
from stepper.shared.draws import Draw
from stepper.shared.fields import COMPOUNDS, RANDOMIZED
from stepper.shared.rotations import matrices
from stepper.shared.selectors import Part, conflict, parse, parts_of
from stepper.shared.streams import Rng

if TYPE_CHECKING:
    from stepper.envs.task import Reset

Array = NDArray[Any]
Range = tuple[float, float]
Target = str | Sequence[str] | Callable[["Reset"], None]


@dataclass(frozen=True)
class Event:
    """Random event of a task, made by `at_start`, `at_reset` or `every`.

    Attributes:
        when: "start", "reset" or "interval".
        target: Selector of the parameters, several selectors that share the random numbers, or a function.
        value: Random values of the parameters; None for a function.
        seconds: Shortest and longest time between two events of an interval, s.
    """

    when: str
    target: Target
    value: Draw | None = None
    seconds: Range | None = None

    def __post_init__(self) -> None:
        name = {"start": "at_start", "reset": "at_reset", "interval": "every"}[self.when]
        if callable(self.target) == isinstance(self.value, Draw) or not (self.value is None or isinstance(self.value, Draw)):
            raise WrongArgumentError(
                f"{name} gets {in_words(self.target)} and {in_words(self.value)}, must get a selector and random values, as "
                f'("geom_friction[foot][0]", uniform(0.3, 1.2)), or a function alone, as (push("trunk", x=(-1, 1)))'
            )
        if self.seconds is not None and not (np.shape(self.seconds) == (2,) and 0.0 < self.seconds[0] <= self.seconds[1]):
            raise ValueError(f"every gets the times {self.seconds!r}, must get the shortest and the longest time in s, as (1.0, 3.0)")


def at_start(target: Target, value: Draw | None = None) -> Event:
    """An event at the first reset of an environment after a seed: its parameters stay until the next seed.

    Args:
        target: Selector of parameters of `Stepper.randomize`, such as "geom_friction[*_foot][0]"; several selectors, which share the random
            numbers; or a function of a `Reset`.
        value: Random values: `uniform`, `log_uniform`, `normal`, `scale` or `add`. None for a function.

    Raises:
        TypeError: The target and the value do not fit.
    """
    return Event("start", target, value)


def at_reset(target: Target, value: Draw | None = None) -> Event:
    """An event at every reset, before `Task.reset`. The arguments are those of `at_start`.

    Raises:
        TypeError: The target and the value do not fit.
    """
    return Event("reset", target, value)


def every(seconds: Range, target: Target, value: Draw | None = None) -> Event:
    """An event at random intervals within an episode, before the action acts.

    Args:
        seconds: Shortest and longest time to the next event, s.
        target: Target as in `at_start`. A function gets a `Reset` with the present state: positions and velocities that it changes become
            those of the stepper.
        value: Random values as in `at_start`.

    Raises:
        TypeError: The target and the value do not fit.
        ValueError: The times are no range of positive numbers.
    """
    return Event("interval", target, value, seconds)


_ZERO = (0.0, 0.0)


def push(
    body: str, *, x: Range = _ZERO, y: Range = _ZERO, z: Range = _ZERO, roll: Range = _ZERO, pitch: Range = _ZERO, yaw: Range = _ZERO
) -> Callable[[Reset], None]:
    """Function for `every` that changes the velocity of a body by random amounts, along axes of the world.

    Args:
        body: Name of a body with a free joint; or of a child of the world with slides, along which the changes act.
        x: Lowest and highest change of the velocity along x, m/s.
        y: The same along y, m/s.
        z: The same along z, m/s.
        roll: Lowest and highest change of the angular velocity about x, rad/s.
        pitch: The same about y, rad/s.
        yaw: The same about z, rad/s.

    Raises:
        TypeError, ValueError: A range is not two finite numbers, the lower one first. When they are made, environments raise KeyError for
            an unknown body, and ValueError for a body without a free joint or slides.
    """
    ranges = {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}
    for name, ends in ranges.items():
        check_range(f"{name} of push", ends)
    low, high = np.array([*ranges.values()], dtype=np.float64).T
    return partial(_push, body=body, low=low, high=high)


def _push(reset: Reset, *, body: str, low: Array, high: Array) -> None:
    """Changes the velocity of a body by random amounts from `low` to `high`, (6,) each, m/s and rad/s."""
    model = reset.sim.model
    changes = low + (high - low) * reset.rng.uniform(0.0, 1.0, 6)
    joint, *others = _pushed_joints(model, body)
    if joint.type == "slide":
        for slide in (joint, *others):
            axis = matrices(np.asarray(model.body(body).quat)) @ slide.axis
            reset.qvel[:, slide.dofadr] += changes[:, :3] @ axis
        return
    at, place = joint.dofadr, joint.qposadr
    reset.qvel[:, at : at + 3] += changes[:, :3]
    if low[3:].any() or high[3:].any():
        # Angular velocities of a free joint are in the frame of the body.
        turned = np.einsum("ni,nij->nj", changes[:, 3:], matrices(reset.qpos[:, place + 3 : place + 7]))
        reset.qvel[:, at + 3 : at + 6] += turned


@cache_per_model
def _pushed_joints(model: Model, body: str) -> list[Any]:
    """Free joint of a body, or slides of a child of the world; a ValueError for another body."""
    owner = model.body(body)
    joints = [joint for joint in map(model.joint, range(model.njnt)) if joint.bodyid == owner.id and joint.type in ("free", "slide")]
    if not joints or (joints[0].type == "slide" and owner.parentid != 0):
        raise ValueError(f"push: body {body!r} has no free joint, and no slide from the world; set velocities in a function of a Reset")
    return joints


class Events:
    """Events of a task, and the parameters that they have drawn.

    Args:
        task: Name of the task's class, for error messages.
        events: Result of `Task.events`.
        sim: The stepper.
        dt: Time of an action, s.

    Attributes:
        left: Number of actions until the next event of each interval, (num_envs,) int64 each.
    """

    def __init__(self, task: str, events: Any, sim: Stepper, dt: float):
        if not isinstance(events, tuple | list) or not all(isinstance(event, Event) for event in events):
            raise WrongArgumentError(f"{task}.events returns {in_words(events)}, must return a tuple of at_start, at_reset and every(...)")
        self._dt, self._num_envs = dt, sim.num_envs or 1
        where = f"{task}.events"
        self._events = [(event, _parts(sim.model, event, where)) for event in events]
        _check_conflicts(self._events, where)
        self._own: dict[str, Array] = {}  # Values of the model by parameter, in the shape of the model's array.
        self._current: dict[str, Array] = {}  # Values of the environments by parameter, (num_envs, n).
        present = sim.randomized if self._events else {}
        for field in dict.fromkeys(part.field for _, selected in self._events for parts in selected for part in parts):
            own = np.asarray(getattr(sim.model, field), np.float64)
            values = np.asarray(present.get(field, np.broadcast_to(own, (self._num_envs, *own.shape))), np.float64)
            self._own[field], self._current[field] = own, values.reshape(self._num_envs, own.size).copy()
        self._intervals = [k for k, (event, _) in enumerate(self._events) if event.when == "interval"]
        self.left = {str(k): np.zeros(self._num_envs, dtype=np.int64) for k in self._intervals}

    def __bool__(self) -> bool:
        return bool(self._events)

    def __getstate__(self) -> dict[str, Any]:
        # Functions of a task may not pickle; `reattach` reads the events again.
        return {name: value for name, value in self.__dict__.items() if name != "_events"}

    def reattach(self, events: Sequence[Event], model: Model) -> None:
        """Reads the events of the task again after unpickling."""
        self._events = [(event, _parts(model, event, "events")) for event in events]

    def parameter(self, sim: Stepper, selector: str) -> Array:
        """Present values of the numbers that a selector selects, (num_envs, n), in their unit."""
        part = parts_of(sim.model, parse(selector), "TaskView.parameter")[0]
        if part.field in self._current:
            values = self._current[part.field]
        else:
            own = np.asarray(getattr(sim.model, part.field), np.float64)
            values = np.asarray(sim.randomized.get(part.field, np.broadcast_to(own, (self._num_envs, *own.shape)))).reshape(-1, own.size)
        selected: Array = part.sign * values[:, part.index.ravel()]
        return selected

    def begin(self, reset: Reset, is_seeded: Array, rng: Rng) -> None:
        """Events of new episodes, in the order of `Task.events`.

        Args:
            reset: The environments that start an episode.
            is_seeded: Environments that have got a new seed, (n,) bool.
            rng: Random number generator of these environments.
        """
        chosen = []
        every_row = np.ones(len(reset.envs), dtype=bool)
        for k, (event, parts) in enumerate(self._events):
            rows = is_seeded if event.when == "start" else every_row
            if event.when == "interval":
                self._wait(k, reset.envs, rng)
            elif rows.any():
                chosen.append((event, parts, rows))
        self._fire(chosen, reset, rng)

    def advance(self, start: Callable[[Array], Reset], fork: Callable[[], Any], begins: Array | None) -> None:
        """Counts down the times of the intervals, and makes the events that are due.

        Args:
            start: Function of the indices of environments that returns a `Reset` with their present state.
            fork: Function that returns streams of random numbers for these events.
            begins: Environments that are reset in this step, (num_envs,) bool; None means no environment.
        """
        for k in self._intervals:
            left = self.left[str(k)]
            left -= 1
            is_due = left <= 0
            if is_due.any():
                envs = np.flatnonzero(is_due if begins is None else is_due & ~begins)
                if len(envs):
                    reset, rng = start(envs), Rng(fork(), envs)
                    event, parts = self._events[k]
                    self._wait(k, envs, rng)
                    self._fire([(event, parts, np.ones(len(envs), dtype=bool))], reset, rng)
                    reset.apply_state()

    def _wait(self, k: int, envs: Array, rng: Rng) -> None:
        """Draws the number of actions until the next event of an interval, event number `k`."""
        low, high = self._events[k][0].seconds or (0.0, 0.0)
        seconds = rng.uniform(low, high, 1)[:, 0]
        self.left[str(k)][envs] = np.maximum(1, np.round(seconds / self._dt)).astype(np.int64)

    def _fire(self, chosen: list[tuple[Event, list[list[Part]], Array]], reset: Reset, rng: Rng) -> None:
        """Makes events: sets all parameters in one call, and then calls functions.

        Each event comes with its selected numbers, and with a mask (n,) of the environments of `reset`.
        """
        envs = reset.envs
        fields: dict[str, Array] = {}
        for event, selected, rows in chosen:
            if event.value is None:
                continue
            numbers = event.value.numbers(rng, selected[0][0].index.shape)
            for part in (part for parts in selected for part in parts):
                if part.field not in fields:
                    fields[part.field] = self._current[part.field][envs]
                values, columns = fields[part.field], part.index.ravel()
                drawn = part.sign * event.value.values(numbers, part.sign * self._own[part.field].reshape(-1)[part.index])
                values[:, columns] = np.where(rows[:, None], drawn.reshape(len(envs), -1), values[:, columns])
        if fields:
            reset.sim.randomize(envs=envs, **{name: rows.reshape(len(envs), *self._own[name].shape) for name, rows in fields.items()})
            for name, rows in fields.items():
                self._current[name][envs] = rows
        for event, _, rows in chosen:
            if callable(event.target):
                reset.call(event.target, rows)


def _parts(model: Model, event: Event, where: str) -> list[list[Part]]:
    """Selected numbers of an event: for each selector a list with one `Part` per field; none for a function.

    The body that a `push` names must exist and be movable.
    """
    if isinstance(event.target, partial) and event.target.func is _push:
        _pushed_joints(model, event.target.keywords["body"])
    if callable(event.target):
        return []
    texts = [event.target] if isinstance(event.target, str) else list(event.target)
    found = []
    for text in texts:
        selector = parse(text, where)
        if selector.field not in RANDOMIZED and selector.field not in COMPOUNDS:
            raise ValueError(unknown_field(where, selector.field, [*RANDOMIZED, *COMPOUNDS], "docs/reference/what_can_vary.md"))
        found.append(parts_of(model, selector, where))
    shapes = [parts[0].index.shape for parts in found]
    if len(set(shapes)) > 1:
        raise ValueError(f"{where} has {texts}, which share random numbers but select {shapes}: select the same number of values")
    return found


def _check_conflicts(events: list[tuple[Event, list[list[Part]]]], where: str) -> None:
    """Raises ValueError if two events set the same number at the same time, so that one of them would have no effect."""
    for k, (one, mine) in enumerate(events):
        for other, theirs in events[:k]:
            if (one.when == "interval") != (other.when == "interval") or "interval" in (one.when, other.when):
                continue
            for part in (part for parts in mine for part in parts):
                for second in (part for parts in theirs for part in parts):
                    if part.field == second.field and np.intersect1d(part.index, second.index).size:
                        raise conflict(where, other.target, one.target, part.field)

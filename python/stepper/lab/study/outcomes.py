"""Outcomes of an episode: measured quantity, reduction over time to one number, and condition of success."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._arrays import array_of
from stepper._hints import unknown
from stepper._stepper import Model
from stepper.shared.arguments import check_number, check_takes

Array = NDArray[np.float64]
Measure = Callable[[Any], Any]
"""Function of a `World` that returns one number per environment, (num_envs,)."""

REDUCTIONS = ("end", "change", "max", "min", "mean")
"""Allowed values of `Outcome.reduce`, the reduction of a measured quantity over an episode to one number."""
_COMPARED = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}
_AXES = {"x": 0, "y": 1, "z": 2}
_QUANTITIES = {
    "body": ("body", "xpos"),
    "site": ("site", "site_xpos"),
    "joint": ("joint", "qpos"),
    "jointvel": ("joint", "qvel"),
    "sensor": ("sensor", "sensordata_ideal"),
    "force": ("body", "body_contact_force"),
}
"""Kind of element, and name of the quantity for `World.read`, by the first word of a measure's text: "body" for "body cube z"."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of an episode: a measured number, and optionally a condition of success.

    Attributes:
        name: Name in tables.
        measure: Function of a `World` that returns one number per environment, (num_envs,). A world has the attributes of a `Stepper`, and
            functions of `stepper.envs.quantities` take it. Or a text:

            * "body NAME x", "site NAME z": coordinate of a position, m
            * "joint NAME", "jointvel NAME": position (m or rad) or velocity of a joint
            * "sensor NAME 0": channel of a sensor, without errors
            * "force NAME x": contact force on a body, world axes, N

            Without an axis or channel, the measure is the norm of a vector, or the value of a scalar. NAME may have spaces. The last word
            is an axis or a channel if the words before it are a name.
        reduce: Reduction of the measure over time to one number. With "end", it is the value at the end of the episode. With "change", it
            is the value at the end minus the value at the start. With "max", "min" or "mean", it is the maximum, minimum or mean of the
            values at the start and after every control period.
        success: Condition of success, a comparison such as ">= 0.05"; None sets no condition.
        margin: Largest distance of a failed outcome from the threshold at which the cause of the failure is "evaluation", in the unit of
            the measure.
        unit: Unit of the measure, for tables.
    """

    name: str
    measure: Measure | str
    reduce: str = "end"
    success: str | None = None
    margin: float = 0.0
    unit: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"the name of an Outcome is {self.name!r}, must be a text")
        if not isinstance(self.unit, str):
            raise TypeError(f"outcome {self.name!r}: unit is {self.unit!r}, must be a text, as 'm'")
        check_number(f"outcome {self.name!r}: margin", self.margin, least=0.0)
        if self.reduce not in list(REDUCTIONS):
            raise ValueError(f"outcome {self.name!r}: reduce is {self.reduce!r}, must be one of: {', '.join(REDUCTIONS)}")
        if self.success is not None:
            _compare(self.success, self.name)
        if isinstance(self.measure, str):
            measure_of(self.measure)
        elif callable(self.measure):
            check_takes(self.measure, ["now"], f"outcome {self.name!r}: measure")
        else:
            raise TypeError(f'outcome {self.name!r}: measure is {self.measure!r}, must be a function of now, or a text as "body box z"')

    def check(self, model: Model) -> None:
        """Checks that the model has the element that the measure names, such as the body "cube" of "body cube z".

        Raises:
            ValueError: The model has no such element.
        """
        if isinstance(self.measure, str):
            try:
                _parse(self.measure, model)
            except ValueError as error:
                raise ValueError(f"outcome {self.name!r}: {error}") from None

    @property
    def threshold(self) -> float | None:
        """Number in the condition of success, such as 0.05 in ">= 0.05"; None if the outcome has no condition."""
        return None if self.success is None else _compare(self.success, self.name)[1]

    def succeeds(self, value: Array) -> NDArray[np.bool_]:
        """Whether each value, (n,), satisfies the condition of success, (n,). Values that are not finite do not."""
        assert self.success is not None
        compare, threshold = _compare(self.success, self.name)
        return np.asarray(np.isfinite(value) & compare(value, threshold))

    def read(self, now: Any) -> Array:
        """Returns the value of the measure in every environment, (num_envs,) float64, in its unit.

        Raises:
            ValueError: The measure has another shape.
        """
        made = measure_of(self.measure)(now) if isinstance(self.measure, str) else self.measure(now)
        value = array_of(f"outcome {self.name!r}: the measure", made)
        if value.shape != (now.num_envs,):
            raise ValueError(
                f"outcome {self.name!r}: the measure has the shape {value.shape}, must be ({now.num_envs},), one number per environment"
            )
        return value


def _compare(text: str, name: str) -> tuple[Any, float]:
    """Comparison operator and threshold from a text such as ">= 0.05"; `name` is the outcome, for error messages."""
    found = re.fullmatch(r"\s*(>=|<=|>|<)\s*(\S+)\s*", text) if isinstance(text, str) else None
    try:
        if found is not None:
            return _COMPARED[found[1]], float(found[2])
    except ValueError:
        pass
    raise ValueError(f'outcome {name!r}: success is {text!r}, must be a comparison such as ">= 0.05"')


def _parse(text: str, model: Model | None = None) -> tuple[str, str, int | None]:
    """First word, name of the element, and index of the axis or channel (None without one), of the text of a measure."""
    word, _, words = text.strip().partition(" ")
    if word not in _QUANTITIES or not words:
        raise ValueError(
            f'the measure is {text!r}, must be a function or a text such as "body cube z": {", ".join(_QUANTITIES)}, a name, an axis'
        )
    words = words.strip()
    first, _, last = words.rpartition(" ")
    first, axis = first.rstrip(), _AXES.get(last, int(last) if last.isdecimal() else None)
    if model is None:
        return word, words, None
    kind, _ = _QUANTITIES[word]
    names = list(getattr(model, f"{kind}_names"))
    if first in names and axis is not None:
        return word, first, axis
    if words in names:
        return word, words, None
    if first in names:
        raise ValueError(f"the measure is {text!r}: its last word is {last!r}, must be x, y, z or a number")
    raise ValueError(f"the measure is {text!r}: {unknown(kind, words if axis is None else first, names)}")


def measure_of(text: str) -> Measure:
    """Measure (a function of a `World`) from its text, such as "body cube z"."""
    _parse(text)

    def measure(now: Any) -> Array:
        word, name, axis = _parse(text, now.model)
        value: Array = np.asarray(now.read(_QUANTITIES[word][1], name), float)
        if word == "force":
            value = value[:, :3]  # The last three columns are the torque.
        if axis is not None and axis >= value.shape[1]:
            raise ValueError(f"the measure is {text!r}: {name!r} has {value.shape[1]} numbers, and the first is 0")
        if axis is not None:
            return value[:, axis]
        return value[:, 0] if value.shape[1] == 1 else np.asarray(np.linalg.norm(value, axis=1))

    return measure


class Watch:
    """Accumulator of the outcomes of a batch of episodes. Create it at the start, and call `record` after every control period.

    Its memory does not grow with the length of an episode.
    """

    def __init__(self, outcomes: tuple[Outcome, ...], now: Any):
        self._outcomes = outcomes
        self._first = [outcome.read(now) for outcome in outcomes]
        self._last, self._count = [x.copy() for x in self._first], 1
        self._low, self._high, self._sum = ([x.copy() for x in self._first] for _ in range(3))

    def record(self, now: Any) -> None:
        """Adds the state at the end of a control period to the maxima, minima and means of the measured quantities.

        Outcomes with the reduction "end" or "change" are not measured here.
        """
        self._count += 1
        for k, outcome in enumerate(self._outcomes):
            if outcome.reduce in ("end", "change"):
                continue
            value = outcome.read(now)
            self._low[k], self._high[k] = np.minimum(self._low[k], value), np.maximum(self._high[k], value)
            self._sum[k] = self._sum[k] + value

    def values(self, now: Any) -> dict[str, Array]:
        """Final value of every outcome by name, (num_envs,), in its unit."""
        found = {}
        for k, outcome in enumerate(self._outcomes):
            if outcome.reduce in ("end", "change"):
                self._last[k] = outcome.read(now)
            found[outcome.name] = {
                "end": lambda k=k: self._last[k],
                "change": lambda k=k: self._last[k] - self._first[k],
                "max": lambda k=k: self._high[k],
                "min": lambda k=k: self._low[k],
                "mean": lambda k=k: self._sum[k] / self._count,
            }[outcome.reduce]()
        return found

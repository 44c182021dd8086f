"""Outcomes of an episode: what is measured, over which part of it, and what counts as a success."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import unknown
from stepper._stepper import Model

Array = NDArray[np.float64]
Measure = Callable[[Any], Any]
"""From a `World`, a number of every environment, (num_envs,)."""

OVER = ("end", "change", "max", "min", "mean")
WHOSE = ("physics", "perception", "policy", "evaluation")
_COMPARED = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}
_AXES = {"x": 0, "y": 1, "z": 2}
_KINDS = {"body": "body", "site": "site", "joint": "joint", "jointvel": "joint", "sensor": "sensor", "force": "body"}
"""Kinds of elements that the first words of measures name."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A number that an episode ends with, and what of it is a success.

    Attributes:
        name: What it is called in tables.
        measure: A function of the world that returns a number of every environment, (num_envs,). The world reads as a `Stepper` does, so
            that a reward or an observed quantity of a task is a measure too. Or words: "body NAME x", "site NAME z",
            "joint NAME" (its position), "jointvel NAME", "sensor NAME 0" (a reading without error), "force NAME x" (of all contacts on a
            body, world axes), without an axis the norm.
        over: Which of its values counts: at the "end", the "change" from the start, the "max", "min" or "mean" of what is seen at the start
            and after every control.
        success: A comparison such as ">= 0.05"; None is a number without success.
        margin: Nearness to the threshold within which the outcome is the evaluation's and not the episode's, in the unit of the measure.
        unit: Of the measure.
        whose: Whose a failure is, where that is known: "physics", "perception", "policy" or "evaluation"; None is told by running the
            episode again (`stepper report`).
    """

    name: str
    measure: Measure | str
    over: str = "end"
    success: str | None = None
    margin: float = 0.0
    unit: str = ""
    whose: str | None = None

    def __post_init__(self) -> None:
        if self.over not in OVER:
            raise ValueError(f"outcome {self.name!r}: over is {self.over!r}, must be of: {', '.join(OVER)}")
        if self.whose is not None and self.whose not in WHOSE:
            raise ValueError(f"outcome {self.name!r}: whose is {self.whose!r}, must be of: {', '.join(WHOSE)}")
        if self.success is not None:
            _compare(self.success, self.name)
        if isinstance(self.measure, str):
            words_of(self.measure)

    def check(self, model: Model) -> None:
        """Checks that the model has the element that the words of the measure name.

        Raises:
            ValueError: It has no such element.
        """
        if isinstance(self.measure, str):
            word, name = self.measure.split()[:2]
            kind = _KINDS[word]
            names = list(getattr(model, f"{kind}_names"))
            if name not in names:
                raise ValueError(f"outcome {self.name!r}: measure is {self.measure!r}: {unknown(kind, name, names)}")

    @property
    def threshold(self) -> float | None:
        """The number that success compares with."""
        return None if self.success is None else _compare(self.success, self.name)[1]

    def succeeds(self, value: Array) -> NDArray[np.bool_]:
        """Which values are a success; what is not finite is none."""
        assert self.success is not None
        compare, threshold = _compare(self.success, self.name)
        return np.asarray(np.isfinite(value) & compare(value, threshold))

    def read(self, now: Any) -> Array:
        """The measure of every environment, (num_envs,) float64.

        Raises:
            ValueError: A measure of another shape.
        """
        value = np.asarray(words_of(self.measure)(now) if isinstance(self.measure, str) else self.measure(now), dtype=np.float64)
        if value.shape != (now.num_envs,):
            raise ValueError(
                f"outcome {self.name!r}: the measure has the shape {value.shape}, must be ({now.num_envs},), one of each environment"
            )
        return value


def _compare(text: str, name: str) -> tuple[Any, float]:
    found = re.fullmatch(r"\s*(>=|<=|>|<)\s*(\S+)\s*", text)
    try:
        if found is not None:
            return _COMPARED[found[1]], float(found[2])
    except ValueError:
        pass
    raise ValueError(f'outcome {name!r}: success is {text!r}, must be a comparison such as ">= 0.05"')


def words_of(text: str) -> Measure:
    """The function that the words of a measure stand for.

    Raises:
        ValueError: They stand for none.
    """
    kind, *rest = text.split()
    readers = {
        "body": lambda now, name: now.read("xpos", name),
        "site": lambda now, name: now.read("site_xpos", name),
        "joint": lambda now, name: now.read("qpos", name),
        "jointvel": lambda now, name: now.read("qvel", name),
        "sensor": lambda now, name: now.read("sensordata_ideal", name),
        "force": lambda now, name: now.read("body_contact_force", name)[:, :3],
    }
    if kind not in readers or not 1 <= len(rest) <= 2:
        raise ValueError(
            f'the measure is {text!r}, must be a function or words such as "body cube z": {", ".join(readers)}, a name, an axis'
        )
    axis = None if len(rest) == 1 else _AXES.get(rest[1], int(rest[1]) if rest[1].isdigit() else None)
    if len(rest) == 2 and axis is None:
        raise ValueError(f"the measure is {text!r}: its last word is {rest[1]!r}, must be x, y, z or a number")

    def measure(now: Any) -> Array:
        value: Array = np.asarray(readers[kind](now, rest[0]), float)
        if axis is not None:
            return value[:, axis]
        return value[:, 0] if value.shape[1] == 1 else np.asarray(np.linalg.norm(value, axis=1))

    return measure


class Watch:
    """What outcomes see of an episode, step by step, in O(1) memory."""

    def __init__(self, outcomes: tuple[Outcome, ...], now: Any):
        self._outcomes = outcomes
        self._first = [outcome.read(now) for outcome in outcomes]
        self._last, self._count = [x.copy() for x in self._first], 1
        self._low, self._high, self._sum = ([x.copy() for x in self._first] for _ in range(3))

    def look(self, now: Any) -> None:
        """Takes in what follows a control."""
        self._count += 1
        for k, outcome in enumerate(self._outcomes):
            if outcome.over in ("end", "change"):
                continue
            value = outcome.read(now)
            self._low[k], self._high[k] = np.minimum(self._low[k], value), np.maximum(self._high[k], value)
            self._sum[k] = self._sum[k] + value

    def values(self, now: Any) -> dict[str, Array]:
        """The value of every outcome at the end, by name, (num_envs,)."""
        found = {}
        for k, outcome in enumerate(self._outcomes):
            if outcome.over in ("end", "change"):
                self._last[k] = outcome.read(now)
            found[outcome.name] = {
                "end": lambda k=k: self._last[k],
                "change": lambda k=k: self._last[k] - self._first[k],
                "max": lambda k=k: self._high[k],
                "min": lambda k=k: self._low[k],
                "mean": lambda k=k: self._sum[k] / self._count,
            }[outcome.over]()
        return found

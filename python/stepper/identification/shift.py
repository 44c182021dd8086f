"""Readings that stand one row too late or too early beside their controls: whether data fit better one sample to either side.

A reading belongs to the end of the period in which its row's control is in force. Logs are often off by one, and then a fit finds numbers
that make up for a delay. A fit that leaves white residuals is not off by one; of others the neighbouring rows are tried.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stepper.identification.data import Episode
from stepper.identification.inertia import Array

LATE, EARLY = 1, -1
RATIO = 0.75
"""Mean square of what a shift leaves, over that without it, below which the shift is reported."""
COLOURED = 0.3
"""Correlation of a residual with the one before it from which on shifts are tried, beside what chance makes,"""
LOUD = 1.5
"""or mean square of residuals over noise that was given."""
RECENT = 15
"""Samples over which a tracker's surprise is averaged,"""
STRANGE = 3.0
"""and the mean above which its model does not explain the readings."""
STRETCH = 100
"""Samples after which what the shifts begin with is taken anew."""
CAUGHT_UP = 2
"""Samples that are tried again with each shift at every update, until they have caught up."""
_WORDS = {
    LATE: "one sample late: the readings of row k + 1 fit the control of row k. Pair ctrl[:-1] with readings[1:]",
    EARLY: "one sample early: the readings of row k fit the control of row k + 1. Pair ctrl[1:] with readings[:-1], from one row later",
}


def finding(shift: int, ratio: float) -> str:
    """What is said of a shift: what is wrong, how sure that is, what to do."""
    return (
        f"readings are {_WORDS[shift]} (residuals shrink to {100 * ratio:.0f} % in mean square), or model the delay of one period; "
        "values and intervals are not to be used before"
    )


def shifted(episode: Episode, shift: int) -> Episode:
    """The episode with the readings of the row after (`LATE`) or before (`EARLY`) in each row; those without one are not measured."""
    moved = {}
    for name, given in episode.readings.items():
        rows = np.full(np.shape(given), np.nan)
        if shift == LATE:
            rows[:-1] = np.asarray(given)[1:]
        else:
            rows[1:] = np.asarray(given)[:-1]
        moved[name] = rows
    return replace(episode, readings=moved)


def suspicious(whitened: list[Array]) -> bool:
    """Whether residuals over their noise, (T, width) by episode, are loud or correlated from row to row."""
    square = np.concatenate([rows[np.isfinite(rows)] for rows in whitened])
    if len(square) and float(np.mean(square**2)) > LOUD:
        return True
    for rows in whitened:
        for column in rows.T:
            one, other = column[:-1], column[1:]
            both = np.isfinite(one) & np.isfinite(other)
            power = float((one[both] ** 2).sum())
            # Chance makes 1 / sqrt(rows); five of them are no chance.
            if both.sum() > 2 and power > 0 and float((one[both] * other[both]).sum()) / power > max(COLOURED, 5 / np.sqrt(both.sum())):
                return True
    return False


class Watch:
    """Follows two twins of a tracker, whose readings are shifted, where the tracker's model does not explain what it is given.

    Attributes:
        found: Shift that was found and the ratio of the mean squares; None is none.
    """

    def __init__(self) -> None:
        self.found: tuple[int, float] | None = None
        self._origin: Any = None
        self._samples: list[tuple[Array, Mapping[str, Array]]] = []
        self._surprise: list[float] = []
        self._twins: dict[int, _Twin] = {}

    def begin(self, tracker: Any) -> None:
        """Called before each sample: every stretch begins with what the tracker knew then."""
        if self._origin is None or (len(self._samples) >= STRETCH and not self._twins):
            self._origin = twin_of(tracker)
            self._samples, self._surprise = [], self._surprise[-RECENT:]

    def look(self, ctrl: Array, readings: Mapping[str, Array], surprise: float) -> bool:
        """Takes a sample; returns whether the model explains the readings of late."""
        self._samples.append((ctrl, readings))
        self._surprise.append(surprise)
        if self.found is not None:
            return False
        recent = self._surprise[-RECENT:]
        strange = len(recent) == RECENT and float(np.mean(recent)) > STRANGE
        if strange and not self._twins:
            self._twins = {shift: _Twin(copy.copy(self._origin), shift) for shift in (LATE, EARLY)}
        if self._twins:
            self._follow()
            return False
        return not strange

    def _follow(self) -> None:
        """Brings the twins on, and compares them once they have caught up."""
        for twin in self._twins.values():
            for _ in range(CAUGHT_UP):
                twin.take(self._samples)
        if not all(twin.done(self._samples) for twin in self._twins.values()):
            return
        own = float(np.mean(self._surprise[-len(self._samples) :]))
        shift, left = min(((shift, twin.left()) for shift, twin in self._twins.items()), key=lambda pair: pair[1])
        if left < RATIO * own:
            self.found = shift, left / own
        self._twins, self._origin = {}, None


class _Twin:
    """A copy of a tracker that is given the readings of the row after or before."""

    def __init__(self, tracker: Any, shift: int):
        self._tracker, self._shift, self._at = twin_of(tracker), shift, 0
        self._surprise: list[float] = []

    def take(self, samples: list[tuple[Array, Mapping[str, Array]]]) -> None:
        """Takes one sample more, if there is one."""
        if self.done(samples):
            return
        k = self._at
        beside = k + self._shift
        absent = {name: np.full(np.shape(row), np.nan) for name, row in samples[k][1].items()}
        try:
            now = self._tracker.update(samples[k][0], samples[beside][1] if beside >= 0 else absent)
            self._surprise.append(now.surprise)
        except (FloatingPointError, np.linalg.LinAlgError):
            self._surprise.append(np.inf)
        self._at += 1

    def done(self, samples: list[tuple[Array, Mapping[str, Array]]]) -> bool:
        """Whether it has taken all that there are: of those that are late, the last row has no reading yet."""
        return self._at >= len(samples) - (self._shift == LATE)

    def left(self) -> float:
        """Mean surprise."""
        return float(np.mean(self._surprise)) if self._surprise else np.inf


def twin_of(tracker: Any) -> Any:
    """A copy of a tracker that goes on by itself: both use the same environments, which each sets before use."""
    twin = copy.copy(tracker)
    twin._watch = None
    twin._samples, twin._bounds = copy.copy(tracker._samples), dict(tracker._bounds)
    return twin

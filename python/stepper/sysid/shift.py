"""Detection of readings that are one row late or early relative to their controls.

The readings in a row of a log belong to the end of the period in which the control in the same row acts. In many logs, the readings are
shifted by one row, and then a fit finds parameters that imitate a delay. Small and uncorrelated residuals of a fit show that the rows are
right. Otherwise the fit is compared with fits to the readings of the next row and of the previous row.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stepper.sysid.data import Episode
from stepper.sysid.inertia import Array

LATE, EARLY = 1, -1
"""Shifts of readings by one row of a log: readings in row k + 1 (`LATE`) or in row k - 1 (`EARLY`) belong to the control in row k."""
RATIO = 0.75
"""Mean square residual with shifted readings, divided by the mean square residual without a shift, below which the shift is reported."""
COLOURED = 0.3
"""Correlation of consecutive residuals above which `identify` tests whether readings are shifted by one sample.

It tests only if the correlation is also statistically significant.
"""
LOUD = 1.5
"""Mean square residual, in units of the squared noise, above which `identify` tests whether readings are shifted by one sample."""
RECENT = 15
"""Number of samples over which a tracker's normalised innovation squared is averaged."""
UNEXPLAINED = 3.0
"""Mean normalised innovation squared (squared prediction error over its variance) above which a tracker's model does not fit readings."""
COPY_INTERVAL = 100
"""Number of samples after which a tracker's stored copy is replaced. Trackers of shifted readings start from this copy."""
SAMPLES_PER_UPDATE = 2
"""Number of past samples that a tracker of shifted readings processes per update, until it has reached the newest sample.

It processes fewer if the update has no predictions left.
"""
FREED_STD = (0.1, 1.0)
"""Standard deviations of displacement (m, rad) and velocity (m/s, rad/s) of an uncertain initial state.

A fit that estimates such a state shows whether a wrong initial state explains the readings as well as a shift.
"""
OF_TRACKER = "A wrong initial state can look the same: stepper.sysid.identify with the same readings tries both, and says which fits better"
"""Remark about initial states in the warning of a tracker, which does not estimate its initial state again."""
_WORDS = {
    LATE: ("late: the readings of row k + 1 fit the control of row k", "Pair ctrl[:-1] with readings[1:]"),
    EARLY: (
        "early: the readings of row k fit the control of row k + 1",
        "Pair ctrl[1:] with readings[:-1], and give the initial state one row later",
    ),
}
"""Description of each shift in a warning, and the remedy."""


def finding(shift: int, ratio: float, remark: str = OF_TRACKER) -> str:
    """Warning that readings are one sample early or late relative to the controls, with the evidence and the remedy.

    Args:
        shift: `LATE` or `EARLY`.
        ratio: Mean square residual of a fit with shifted readings, divided by the mean square residual without the shift.
        remark: Last sentence of the warning, about wrong initial states, without its full stop.
    """
    problem, remedy = _WORDS[shift]
    return (
        f"readings are one sample {problem} (the mean square residual falls to {_percent(ratio)}). {remedy}, or model the delay of one "
        f"period. Do not use these values and intervals. {remark}"
    )


def finding_of_fit(shift: int, ratio: float, freed: float | None) -> str:
    """Warning about a shift of the readings or a wrong initial state, whichever explains the readings better.

    If both explain the readings about equally well, the warning names both.

    Args:
        shift: `LATE` or `EARLY`.
        ratio: Mean square residual of a fit with shifted readings, divided by that of the original fit.
        freed: Mean square residual of a fit that also estimates the initial state, without a shift, divided by that of the original fit.
            None if the original fit already estimated the initial state, NaN if there are too few readings for such a fit.
    """
    if freed is not None and math.isnan(freed):
        return finding(shift, ratio, "A wrong initial state may be the cause instead: there are too few readings to estimate it")
    if freed is None:
        return finding(shift, ratio, "A wrong initial state is not the cause: it was estimated")
    if ratio < RATIO * freed:
        return finding(shift, ratio, f"A wrong initial state explains less: with an estimated one the residual falls to {_percent(freed)}")
    remedy = (
        f"Correct qpos and qvel of the episode, or estimate them with Episode(start_std={FREED_STD}). Do not use these values and intervals"
    )
    evidence = (
        f"the mean square residual falls to {_percent(freed)} with an estimated initial state, and to {_percent(ratio)} with the shift"
    )
    if freed < RATIO * ratio:
        return f"the initial state is wrong, which looks like a shift of the readings by one sample ({evidence}). {remedy}"
    problem, pairing = _WORDS[shift]
    return (
        f"the initial state is wrong, or readings are one sample {problem}; these data do not tell which ({evidence}). {remedy}. For a "
        f"shift: {pairing[0].lower()}{pairing[1:]}"
    )


def _percent(ratio: float) -> str:
    """Text of a ratio as a percentage with two digits."""
    return f"{100 * ratio:.2g} %"


def shifted(episode: Episode, shift: int) -> Episode:
    """Copy of an episode whose row k has the readings of row k + 1 (shift `LATE`) or k - 1 (`EARLY`), or NaN if there is no such row."""
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
    """Whether residuals are so large or so correlated in time that readings may be shifted.

    Args:
        whitened: Residuals in units of their noise, (T, width), by episode.
    """
    square = np.concatenate([rows[np.isfinite(rows)] for rows in whitened])
    if len(square) and float(np.mean(square**2)) > LOUD:
        return True
    for rows in whitened:
        for column in rows.T:
            one, other = column[:-1], column[1:]
            both = np.isfinite(one) & np.isfinite(other)
            power = float((one[both] ** 2).sum())
            # The correlation of white residuals has the standard deviation 1 / sqrt(rows); five of these are significant.
            if both.sum() > 2 and power > 0 and float((one[both] * other[both]).sum()) / power > max(COLOURED, 5 / np.sqrt(both.sum())):
                return True
    return False


class Watch:
    """Detector of shifted readings for a tracker.

    When the tracker's model does not explain the readings, two copies of the tracker process them with shifts of one sample.

    Attributes:
        found: Detected shift (`LATE` or `EARLY`), and the mean squared prediction error with this shift divided by that without a shift.
            None if no shift is detected.
    """

    def __init__(self) -> None:
        self.found: tuple[int, float] | None = None
        self._origin: Any = None
        self._samples: list[tuple[Array, Mapping[str, Array]]] = []
        self._surprise: list[float] = []
        self._twins: dict[int, _Twin] = {}

    def begin(self, tracker: Any) -> None:
        """Stores a copy of the tracker every `COPY_INTERVAL` samples. Call it before each sample.

        No copy is stored while earlier copies process readings that are shifted by one sample, to test whether these fit better.
        """
        if self._origin is None or (len(self._samples) >= COPY_INTERVAL and not self._twins):
            self._origin = twin_of(tracker)
            self._samples, self._surprise = [], self._surprise[-RECENT:]

    def add(self, ctrl: Array, readings: Mapping[str, Array], surprise: float) -> bool:
        """Adds a sample, and returns whether the model explains the recent readings.

        The result is also False while shifts are tested, and after a shift is detected.

        Args:
            ctrl: Controls, (nu,).
            readings: Readings of the sample by channel.
            surprise: Normalised innovation squared of the sample, per reading.
        """
        self._samples.append((ctrl, readings))
        self._surprise.append(surprise)
        if self.found is not None:
            return False
        recent = self._surprise[-RECENT:]
        unexplained = len(recent) == RECENT and float(np.mean(recent)) > UNEXPLAINED
        if unexplained and not self._twins:
            self._twins = {shift: _Twin(copy.copy(self._origin), shift) for shift in (LATE, EARLY)}
        if self._twins:
            self._follow()
            return False
        return not unexplained

    def _follow(self) -> None:
        """Processes past samples with two copies of the tracker, which get readings that are shifted by one sample.

        When the copies have processed all samples, the method compares them with the tracker. If a copy predicts the readings much better
        than the tracker, the method sets `found` to the shift of this copy.
        """
        for _ in range(SAMPLES_PER_UPDATE):
            for twin in self._twins.values():
                twin.take(self._samples)
        if not all(twin.done(self._samples) for twin in self._twins.values()):
            return
        own = float(np.mean(self._surprise[-len(self._samples) :]))
        shift, left = min(((shift, twin.mean_innovation()) for shift, twin in self._twins.items()), key=lambda pair: pair[1])
        if left < RATIO * own:
            self.found = shift, left / own
        self._twins, self._origin = {}, None


class _Twin:
    """Copy of a tracker that processes each control with the readings of the next or the previous sample.

    Args:
        tracker: The tracker, which does not change.
        shift: `LATE` for the readings of the next sample, `EARLY` for those of the previous one.
    """

    def __init__(self, tracker: Any, shift: int):
        self._tracker, self._shift, self._at = twin_of(tracker), shift, 0
        self._surprise: list[float] = []

    def take(self, samples: list[tuple[Array, Mapping[str, Array]]]) -> None:
        """Processes the next stored sample that this copy of the tracker has not processed yet, if there is one."""
        if self.done(samples) or self._tracker._problem.budget.left <= 0:
            return
        k = self._at
        neighbour = k + self._shift
        absent = {name: np.full(np.shape(row), np.nan) for name, row in samples[k][1].items()}
        try:
            self._tracker._take(samples[k][0], samples[neighbour][1] if neighbour >= 0 else absent)
            self._surprise.append(self._tracker._hypotheses[0].normalized_innovation)
            self._tracker._leave()
        except (FloatingPointError, np.linalg.LinAlgError):
            self._surprise.append(np.inf)
        self._at += 1

    def done(self, samples: list[tuple[Array, Mapping[str, Array]]]) -> bool:
        """Whether this copy of the tracker has processed all samples for which the shifted readings are known.

        With `LATE`, the readings of the last sample come with the next sample.
        """
        return self._at >= len(samples) - (self._shift == LATE)

    def mean_innovation(self) -> float:
        """Mean normalised innovation squared of the samples that this copy has processed; infinite before the first."""
        return float(np.mean(self._surprise)) if self._surprise else np.inf


def twin_of(tracker: Any) -> Any:
    """Independent copy of a tracker.

    The copy and the original can use the same simulated environments, because each sets the state of the environments before use.
    """
    twin = copy.copy(tracker)
    twin._watch = None
    twin._hypotheses = [hypothesis.copy() for hypothesis in tracker._hypotheses]
    return twin

"""Detection of readings that are one row late or early relative to their controls.

The readings in a row of a log belong to the end of the period in which the control in the same row acts. In many logs, the readings are
shifted by one row, and then a fit finds parameters that imitate a delay. Small and uncorrelated residuals of a fit show that the rows are
right. Otherwise the fit is compared with fits to the readings of the next row and of the previous row.
"""

from __future__ import annotations

import math
from dataclasses import replace

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
FREED_STD = (0.1, 1.0)
"""Standard deviations of displacement (m, rad) and velocity (m/s, rad/s) of an uncertain initial state.

A fit that estimates such a state shows whether a wrong initial state explains the readings as well as a shift.
"""
_WORDS = {
    LATE: ("late: the readings of row k + 1 fit the control of row k", "Pair ctrl[:-1] with readings[1:]"),
    EARLY: (
        "early: the readings of row k fit the control of row k + 1",
        "Pair ctrl[1:] with readings[:-1], and give the initial state one row later",
    ),
}
"""Description of each shift in a warning, and the remedy."""


def _finding(shift: int, ratio: float, remark: str) -> str:
    """Warning that readings are one sample early or late relative to the controls, with the evidence and the remedy.

    `ratio` is the mean square residual of a fit with shifted readings, divided by that of the fit. `remark` is a sentence about wrong
    initial states.
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
        return _finding(shift, ratio, "A wrong initial state may be the cause instead: there are too few readings to estimate it")
    if freed is None:
        return _finding(shift, ratio, "A wrong initial state is not the cause: it was estimated")
    if ratio < RATIO * freed:
        return _finding(shift, ratio, f"A wrong initial state explains less: with an estimated one the residual falls to {_percent(freed)}")
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

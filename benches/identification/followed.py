"""Runs of `stepper.sysid.Tracker`, whose estimated parameters are compared with the true ones."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper

Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Followed:
    """Results of a run of a `Tracker` with n parameters at its marks, the samples after which estimates are compared with the truth.

    Attributes:
        error: Logarithms of estimate over truth, (marks, n).
        std: Standard deviations of the estimates by the tracker, as logarithms, (marks, n).
        covers: Whether the interval contains the truth, (marks, n).
        width: Half widths of the intervals, as logarithms, (marks, n).
        determined: Whether the tracker marks the value as determined, (marks, n).
        seconds: Processor time of each update, s.
    """

    error: Array
    std: Array
    covers: Array
    width: Array
    determined: Array
    seconds: Array


def followed(tracker: stepper.sysid.Tracker, ctrl: Array, readings: Mapping[str, Array], truths: Mapping[int, Array]) -> Followed:
    """Run a tracker over all samples, and compare its estimates with the truth after some of the samples, the keys of `truths`.

    Args:
        tracker: Tracker before its first sample.
        ctrl: Controls, (T, nu).
        readings: Readings by channel, (T, dim) each.
        truths: True values of the parameters, (n,), by the number of samples after which the estimates are compared with them.
    """
    kept, seconds = [], []
    for k, row in enumerate(ctrl):
        began = time.process_time()
        now = tracker.update(row, {name: rows[k] for name, rows in readings.items()})
        seconds.append(time.process_time() - began)
        if k + 1 in truths:
            truth, (low, high) = truths[k + 1], now.interval.T
            std = np.sqrt(np.diag(now.covariance))
            with np.errstate(divide="ignore"):  # Intervals of undetermined values begin at 0.
                width = (np.log(high) - np.log(low)) / 2
            kept.append((np.log(now.values / truth), std, (low <= truth) & (truth <= high), width, now.determined))
    error, std, covers, width, determined = (np.stack(column) for column in zip(*kept, strict=True))
    return Followed(error, std, covers, width, determined, np.array(seconds))

"""Differences of single columns of single environments, at several widths, with the mode of every copy."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.derivatives.copies import ROOM, Nominal, copies_of, ends_of
from stepper.derivatives.kinks import SOLVED, Kink, Watch
from stepper.derivatives.nominal_mode import WIDTHS, Pairs, Read, Readings
from stepper.derivatives.perturbations import Array, Block, Stencil


@dataclass(frozen=True)
class Settings:
    """Settings of differences.

    Attributes:
        nstep: Number of steps.
        tolerance: Residual to which copies are solved, m/s.
        sensors: Whether readings of ideal sensors are rows.
    """

    nstep: int
    tolerance: float
    sensors: bool


SAME_STEP = 1e-6
"""Difference of velocities, m/s, within which the step that is smooth at rest is the step itself: the default tolerance of the solver. At
2 ms it is a gap of 2 nm."""


def reader(sim: Stepper, nominal: Nominal, blocks: Sequence[Block], end: Mapping[str, Array], settings: Settings) -> Read:
    """The function that steps copies for `nominal_mode.settle`; `end` is the nominal state after the steps."""
    most = max(1, ROOM * (sim.threads or os.cpu_count() or 1) // (1 + 2 * WIDTHS))
    plain = replace(sim.options, tolerance=settings.tolerance)
    smooth = replace(plain, stabilization="baumgarte", baumgarte=1.0, slop=0.0)

    def read(pairs: Pairs, at_rest: bool) -> Iterator[tuple[Pairs, Readings]]:
        if at_rest and sim.options.contact != "hard":
            return
        for first in range(0, len(pairs), most):
            some = pairs[first : first + most]
            yield some, _read(sim, nominal, blocks, some, end, settings, smooth if at_rest else plain)

    return read


def _read(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], pairs: Pairs, end: Mapping[str, Array], settings: Settings, options: Options
) -> Readings:
    offsets = pairs.offsets.reshape(len(pairs), -1)
    copies, ctrl = copies_of(sim, nominal, blocks, pairs.env, pairs.column, offsets, options)
    # Every copy is a column of its own here, displaced to one side.
    to_one_side = np.ones(offsets.shape, np.bool_)
    watch = Watch(copies, Stencil(offsets[:, None, None], np.abs(offsets)[:, None], ~to_one_side, to_one_side), settings.nstep)
    for k in range(settings.nstep):
        copies.step(ctrl if k == 0 else None)
        watch.look(k)
    ends, changes = ends_of(copies, 1 + offsets.shape[1], sensors=settings.sensors)
    slopes = changes[:, 1:] / np.where(offsets == 0.0, np.inf, offsets)[..., None]
    # A residual that leaves the modes certain is noise, whatever the tolerance.
    residual = np.asarray(copies.residual).reshape(len(pairs), -1).max(axis=1)
    causes = np.bitwise_or.reduce(watch.report.causes, axis=1)
    harmless = np.where(residual < SOLVED, np.uint32(Kink.UNSOLVED), np.uint32(0))[:, None]
    differs = (causes & ~harmless) != 0
    apart = np.abs(ends["qvel"][:, 0] - end["qvel"][pairs.env]).max(axis=1, initial=0.0)
    differs |= (apart > SAME_STEP)[:, None]
    return Readings(slopes.reshape(*pairs.offsets.shape, -1), differs.reshape(pairs.offsets.shape), np.maximum(residual, settings.tolerance))

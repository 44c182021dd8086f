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
from stepper.derivatives.nominal_mode import WIDTHS, Pairs, Readings
from stepper.derivatives.perturbations import Array, Block, Stencil

SAME_STEP = 1e-6
"""Difference of velocities, m/s, within which the step that is smooth at rest is the step itself: the default tolerance of the solver. At
2 ms it is a gap of 2 nm."""


@dataclass(frozen=True)
class Reader:
    """The function that steps copies for `nominal_mode.settle`.

    Attributes:
        sim: The stepper, which is only read.
        nominal: State of the nominal environments.
        blocks: Perturbed quantities.
        end: Nominal state after the steps.
        nstep: Number of steps.
        tolerance: Residual to which copies are solved, m/s.
        sensors: Whether readings of ideal sensors are rows.
    """

    sim: Stepper
    nominal: Nominal
    blocks: Sequence[Block]
    end: Mapping[str, Array]
    nstep: int
    tolerance: float
    sensors: bool

    def __call__(self, pairs: Pairs, at_rest: bool) -> Iterator[tuple[Pairs, Readings]]:
        """Steps the copies of some pairs, some of them at a time; `at_rest` by the step that is smooth at rest, if there is one."""
        options = replace(self.sim.options, tolerance=self.tolerance)
        if at_rest:
            if options.contact != "hard":
                return
            options = replace(options, stabilization="baumgarte", baumgarte=1.0, slop=0.0)
        most = max(1, ROOM * (self.sim.threads or os.cpu_count() or 1) // (1 + 2 * WIDTHS))
        for first in range(0, len(pairs), most):
            some = pairs[first : first + most]
            yield some, self._read(some, options)

    def _read(self, pairs: Pairs, options: Options) -> Readings:
        offsets = pairs.offsets.reshape(len(pairs), -1)
        copies, ctrl = copies_of(self.sim, self.nominal, self.blocks, pairs, options)
        # Every copy is a separate column here, displaced to one side.
        to_one_side = np.ones(offsets.shape, np.bool_)
        watch = Watch(copies, Stencil(offsets[:, None, None], np.abs(offsets)[:, None], ~to_one_side, to_one_side), self.nstep)
        for k in range(self.nstep):
            copies.step(ctrl if k == 0 else None)
            watch.look(k)
        ends, changes = ends_of(copies, 1 + offsets.shape[1], sensors=self.sensors)
        slopes = changes[:, 1:] / np.where(offsets == 0.0, np.inf, offsets)[..., None]
        # A residual that leaves the modes certain is noise, whatever the tolerance.
        residual = np.asarray(copies.residual).reshape(len(pairs), -1).max(axis=1)
        causes = np.bitwise_or.reduce(watch.report.causes, axis=1)
        harmless = np.where(residual < SOLVED, np.uint32(Kink.UNSOLVED), np.uint32(0))[:, None]
        apart = np.abs(ends["qvel"][:, 0] - self.end["qvel"][pairs.env]).max(axis=1, initial=0.0)
        differs = ((causes & ~harmless) != 0) | (apart > SAME_STEP)[:, None]
        shape = pairs.offsets.shape
        return Readings(slopes.reshape(*shape, -1), differs.reshape(shape), np.maximum(residual, self.tolerance))

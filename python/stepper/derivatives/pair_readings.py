"""Finite differences of single columns of derivative matrices, at several widths.

Each perturbed copy is checked for the nominal mode, which is the set of active constraints of the unperturbed step.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.derivatives.copies import COPIES_PER_THREAD, Nominal, copies_of, ends_of
from stepper.derivatives.kinks import SOLVED, Kink, KinkDetector
from stepper.derivatives.nominal_mode import WIDTHS, Pairs, Readings
from stepper.derivatives.perturbations import Array, Block, Stencil

SAME_STEP = 1e-6
"""Largest difference between the velocities after two steps that differ only in the method of stabilization, m/s or rad/s.

For contacts at rest, derivatives are computed with a stabilization that is smooth at rest, in place of the stabilization of the stepper.
These derivatives are used only if the velocities differ by no more than this. Contacts at rest are solved far below this value.
"""


@dataclass(frozen=True)
class Reader:
    """Callable that steps copies of environments in which one number (a column of the derivative matrix) is displaced.

    It yields the results for pairs of an environment and a column. For bodies at rest it can use Baumgarte stabilization with factor 1 and
    no slop. Gaps and overlaps then behave alike, so that the step is smooth for contacts at rest.

    Attributes:
        sim: The stepper; it does not change.
        nominal: State of the unperturbed environments.
        blocks: Perturbed quantities.
        end: State of the unperturbed environments after the steps.
        nstep: Number of steps.
        tolerance: Residual to which copies are solved, m/s.
        sensors: Whether results include readings of ideal sensors.
    """

    sim: Stepper
    nominal: Nominal
    blocks: Sequence[Block]
    end: Mapping[str, Array]
    nstep: int
    tolerance: float
    sensors: bool

    def __call__(self, pairs: Pairs, at_rest: bool) -> Iterator[tuple[Pairs, Readings]]:
        """Steps copies of environments with one displaced number each, and yields the results for some pairs at a time.

        Args:
            pairs: Pairs of an environment and a displaced number (column of the derivative matrix), with the displacements.
            at_rest: Whether to use Baumgarte stabilization with factor 1 and no slop, for which contacts at rest are smooth. It exists
                for hard contact only; with another contact law the generator yields nothing.
        """
        options = replace(self.sim.options, tolerance=self.tolerance)
        if at_rest:
            if options.contact != "hard":
                return
            options = replace(options, stabilization="baumgarte", baumgarte=1.0, slop=0.0)
        most = max(1, COPIES_PER_THREAD * (self.sim.threads or os.cpu_count() or 1) // (1 + 2 * WIDTHS))
        for first in range(0, len(pairs), most):
            some = pairs[first : first + most]
            yield some, self._read(some, options)

    def _read(self, pairs: Pairs, options: Options) -> Readings:
        """Steps copies of environments in which one number (a column of the derivative matrix) is displaced, and returns the results.

        Each pair of an environment and a column has copies with several displacements. All copies use the same options of the step.
        """
        offsets = pairs.offsets.reshape(len(pairs), -1)
        copies, ctrl = copies_of(self.sim, self.nominal, self.blocks, pairs, options)
        # Every copy is a separate column here, displaced to one side.
        to_one_side = np.ones(offsets.shape, np.bool_)
        detector = KinkDetector(copies, Stencil(offsets[:, None, None], np.abs(offsets)[:, None], ~to_one_side, to_one_side), self.nstep)
        for k in range(self.nstep):
            copies.step(ctrl if k == 0 else None)
            detector.compare(k)
        ends, changes = ends_of(copies, 1 + offsets.shape[1], sensors=self.sensors)
        slopes = changes[:, 1:] / np.where(offsets == 0.0, np.inf, offsets)[..., None]
        # Above the tolerance but below `SOLVED`, the residual is only noise: the mode is certain.
        residual = np.asarray(copies.residual).reshape(len(pairs), -1).max(axis=1)
        causes = np.bitwise_or.reduce(detector.report.causes, axis=1)
        harmless = np.where(residual < SOLVED, np.uint32(Kink.UNSOLVED), np.uint32(0))[:, None]
        apart = np.abs(ends["qvel"][:, 0] - self.end["qvel"][pairs.env]).max(axis=1, initial=0.0)
        differs = ((causes & ~harmless) != 0) | (apart > SAME_STEP)[:, None]
        shape = pairs.offsets.shape
        return Readings(slopes.reshape(*shape, -1), differs.reshape(shape), np.maximum(residual, self.tolerance))

"""Slopes of the nominal mode, for columns whose finite difference crosses a kink or a jump.

The mode of a step is its set of active constraints (docs/how-to/derivatives.md, "Kinks"), and the nominal mode that of the unperturbed
step. A difference between two modes is a derivative of neither; at a jump it is jump / (2 h). Such columns are differentiated again within
the nominal mode: by the implicit function theorem, or by the widest difference whose copies stay in that mode. Columns that allow neither
get `Kink.UNDETERMINED`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.derivatives.kinks import CURVATURE, Bools, Kink, Rows
from stepper.derivatives.perturbations import Array, Stencil

WIDTHS = 6
"""Number of widths to try, each a quarter of the last. The narrowest is 1/1024 of the difference; rounding is then 1e-6 of a slope."""

NARROWER = 0.25

SHRINKS = 0.5
"""Ratio of the slope differences at a quarter of the width and at the full width below which they count as curvature. In theory it is
a quarter for curvature and 1 at a corner."""

HARMLESS = np.uint32(Kink.CONTACT | Kink.SLOPE | Kink.UNSOLVED)
"""Kinks that may have no effect, such as a contact without force that begins. Slopes decide."""

LARGEST_BEND = 0.1
"""Relative difference of slopes up to which it may be curvature."""


@dataclass(frozen=True)
class Pairs:
    """Columns that are differentiated again, one of one environment each.

    Attributes:
        env: Index of the environment, (pairs,).
        column: Index of the column, (pairs,).
        offsets: Displacements, (pairs, 2, WIDTHS): upwards, then downwards; 0 where there must be none.
    """

    env: NDArray[np.int64]
    column: NDArray[np.int64]
    offsets: Array

    def __len__(self) -> int:
        return len(self.env)

    def __getitem__(self, chosen: Any) -> Pairs:
        return Pairs(self.env[chosen], self.column[chosen], self.offsets[chosen])


@dataclass(frozen=True)
class Readings:
    """Differences of some pairs.

    Attributes:
        slopes: Slopes from the nominal point to each copy, (pairs, 2, WIDTHS, rows).
        differs: Whether a copy is in another mode than the nominal step, or is not solved, (pairs, 2, WIDTHS).
        noise: Noise of where copies end, (pairs,).
    """

    slopes: Array
    differs: Bools
    noise: Array


def pairs_of(flagged: Bools, stencil: Stencil) -> Pairs:
    """Pairs for the columns that are flagged, (num_envs, columns), with the points of a stencil and nearer ones."""
    env, column = np.nonzero(flagged & (stencil.step[:, 0] > 0.0))
    width = stencil.step[env, 0, column, None] * NARROWER ** np.arange(WIDTHS)
    first = np.sign(stencil.offsets[env, 0, 0, column])[:, None]
    # A column at a bound goes to one side only; differences to one side by choice may go to both.
    bounded = stencil.bounded[env, column][:, None]
    return Pairs(env, column, np.stack([first * width, np.where(bounded, 0.0, -first * width)], axis=1))


def slopes_of(readings: Readings, offsets: Array, groups: Sequence[Rows]) -> tuple[Array, Bools, Bools]:
    """Slopes of the nominal mode, from the copies that stay in it.

    A difference is valid if its copies are in the nominal mode, on both sides or on one. A quarter of its width must give the same slope; a
    jump would make that slope four times as large. The widest valid difference counts. Without one, a slope counts that is the same on both
    sides and at two widths.

    Args:
        readings: Differences of some pairs.
        offsets: Displacements, (pairs, 2, WIDTHS), in the unit of the column, as in `Pairs`.
        groups: Rows that are compared with one another.

    Returns:
        Slopes, (pairs, rows), whether they are of copies in the nominal mode, and whether they are of others, (pairs,) bool.
    """
    slopes, noise, width = readings.slopes, readings.noise, np.abs(offsets)
    # Of every width but the last, with the one after it.
    steady = (width[..., 1:] > 0.0) & _agree(slopes[:, :, :-1], slopes[:, :, 1:], width[..., :-1], groups, noise)
    inside = steady & ~readings.differs[:, :, :-1] & ~readings.differs[:, :, 1:]
    level = steady.all(axis=1) & _agree(slopes[:, 0], slopes[:, 1], width[:, 0], groups, noise)[:, :-1]
    middle = 0.5 * (slopes[:, 0, :-1] + slopes[:, 1, :-1])
    beside = (slopes[:, :, 1:] - NARROWER * slopes[:, :, :-1]) / (1.0 - NARROWER)
    out, found = np.zeros((len(slopes), slopes.shape[-1])), np.zeros(len(slopes), np.bool_)

    def take(chosen: Bools, value: Array) -> None:
        new = chosen & ~found
        out[new] = value[new]
        found[new] = True

    for k in range(WIDTHS - 1):
        take(level[:, k] & inside[:, :, k].all(axis=1), middle[:, k])
        for side in (0, 1):
            take(inside[:, side, k] & ~inside[:, 1 - side, k], beside[:, side, k])
    nominal = found.copy()
    for k in range(WIDTHS - 1):
        take(level[:, k], middle[:, k])
    return out, nominal, found & ~nominal


def _agree(a: Array, b: Array, width: Array, groups: Sequence[Rows], noise: Array) -> Bools:
    """Whether slopes, (..., widths, rows), differ by no more than curvature and noise explain.

    Curvature of any size makes a difference that shrinks with the width; that of a corner stays, and a jump's grows.
    """
    good = np.ones(a.shape[:-1], np.bool_)
    safe = np.where(width > 0.0, width, 1.0)
    floor = 4.0 * noise.reshape(-1, *[1] * (width.ndim - 1)) / (NARROWER * safe)
    for group in groups:
        own, other = a[..., group.where], b[..., group.where]
        size = np.abs([own, other]).max(axis=(0, -1), initial=group.least)
        apart = np.abs(own - other).max(axis=-1, initial=0.0)
        shrinks = np.zeros_like(good)
        falls = apart[..., 1:] <= SHRINKS * apart[..., :-1] + floor[..., 1:]
        shrinks[..., :-1] = falls & (apart[..., :-1] <= LARGEST_BEND * size[..., :-1])
        good &= shrinks | (apart <= np.minimum(CURVATURE * safe, LARGEST_BEND) * size + floor)
    return good


Read = Callable[[Pairs, bool], Iterator[tuple[Pairs, Readings]]]
"""Steps the copies of some pairs, some of them at a time; with True by the step that is smooth at rest."""


def settle(
    whole: dict[str, NDArray[Any]],
    stencil: Stencil,
    groups: Sequence[Rows],
    *,
    solved: dict[str, NDArray[Any]] | None,
    read: Read,
) -> None:
    """Puts slopes of the nominal mode into the flagged columns of differences, and flags those that have none.

    Args:
        whole: "slopes", "causes" and what else `linearize` puts together; changed in place.
        stencil: Points of the differences.
        groups: Rows that are compared with one another.
        solved: Derivatives of all environments at the modes of the solution; None where there are none.
        read: Steps copies.
    """
    left = whole["causes"] != 0
    if solved is not None:
        sure = (solved["causes"] & np.uint32(Kink.SLOPE | Kink.UNSOLVED)) == 0
        chosen = left & sure & solved["implicit"][:, None]
        np.moveaxis(whole["slopes"], 2, 1)[chosen] = solved["slopes"][:, 0][chosen][:, None]
        left &= ~chosen
    for pairs, readings in read(pairs_of(left, stencil), False):
        slopes, nominal, other = slopes_of(readings, pairs.offsets, groups)
        causes = whole["causes"][pairs.env, pairs.column]
        at_rest = ~nominal & ((causes & np.uint32(Kink.GAP)) != 0)
        places = iter(np.flatnonzero(at_rest))
        for some, smooth in read(pairs[at_rest], True):
            own, found, _ = slopes_of(smooth, some.offsets, groups)
            for k in range(len(some)):
                place = next(places)
                if found[k]:
                    slopes[place], nominal[place] = own[k], True
        whole["slopes"][pairs.env, :, pairs.column] = slopes[:, None]
        lost = ~nominal & ~(other & ((causes & ~HARMLESS) == 0))
        whole["causes"][pairs.env[lost], pairs.column[lost]] |= np.uint32(Kink.UNDETERMINED)

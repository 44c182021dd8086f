"""Slopes of the nominal mode, for columns whose finite difference crosses a kink or a jump.

The mode of a step is its set of active constraints (docs/how-to/derivatives.md, "Kinks"), and the nominal mode that of the unperturbed
step. A finite difference between states of two modes is the derivative of neither mode. Such columns are differentiated again within the
nominal mode: by the implicit function theorem, or by the widest difference whose copies stay in that mode. Columns for which neither is
possible get `Kink.UNDETERMINED`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.derivatives.kinks import CURVATURE, Bools, Kink, RowGroup
from stepper.derivatives.perturbations import Array, Stencil

WIDTHS = 6
"""Number of half widths at which a column is differentiated.

The narrowest half width is 1/1024 of the widest. Rounding causes an error of about 1e-6 in the narrowest difference.
"""

WIDTH_RATIO = 0.25
"""Ratio of each half width of a difference to the next wider one."""

CURVATURE_RATIO = 0.5
"""Largest ratio at which a difference between two slopes (derivatives) counts as curvature and not as a kink.

The ratio is the difference between slopes at a quarter of a width, divided by their difference at the whole width. In theory it is 1/4 for
curvature and 1 at a kink.
"""

HARMLESS = np.uint32(Kink.CONTACT | Kink.SLOPE | Kink.UNSOLVED)
"""Flags of kinks that may have no effect on the derivative, such as a contact that begins without force.

A column without other flags may use the slope of another mode (set of active constraints), if it is equal on both sides and at two widths.
"""

LARGEST_BEND = 0.1
"""Largest relative difference of two slopes that may count as curvature and not as a kink."""


@dataclass(frozen=True)
class Pairs:
    """Columns of derivative matrices that must be differentiated again because their finite difference crossed a kink.

    Each entry of the arrays is a pair of an environment and a column.

    Attributes:
        env: Index of the environment, (pairs,).
        column: Index of the column, (pairs,).
        offsets: Displacements of the perturbed number, (pairs, 2, WIDTHS), in its unit. The middle axis is the direction. A displacement is
            0 if a bound of the number forbids that direction.
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
    """Results of stepping displaced copies, for pairs of an environment and a column of the derivative matrix.

    A result is the state after the steps, and the sensor readings if they are differentiated. Each pair has copies on two sides of the
    nominal value, at WIDTHS different distances.

    Attributes:
        slopes: Difference between the results of each copy and the unperturbed results, divided by the displacement of the copy,
            (pairs, 2, WIDTHS, rows). The rows are those of the derivative matrix.
        differs: Whether a copy was not solved, or has other active constraints than the unperturbed step, (pairs, 2, WIDTHS) bool. It is
            also True for all copies of a pair whose unperturbed copy moved otherwise than the environment (`SAME_STEP`).
        noise: Error of the results due to the solver's tolerance, (pairs,), in SI units.
    """

    slopes: Array
    differs: Bools
    noise: Array


def pairs_of(flagged: Bools, stencil: Stencil) -> Pairs:
    """Pairs of an environment and a column of its derivative matrix for which the finite difference crossed a kink.

    These columns must be differentiated again. Each is displaced by the half width of the first difference, and by WIDTHS - 1 smaller ones.

    Args:
        flagged: Mask of the columns with kinks, (num_envs, columns).
        stencil: Displacements of the first differences.
    """
    env, column = np.nonzero(flagged & (stencil.step[:, 0] > 0.0))
    width = stencil.step[env, 0, column, None] * WIDTH_RATIO ** np.arange(WIDTHS)
    first = np.sign(stencil.offsets[env, 0, 0, column])[:, None]
    # Only a column at a bound must stay on one side; with `centered=False` both sides are possible.
    bounded = stencil.bounded[env, column][:, None]
    return Pairs(env, column, np.stack([first * width, np.where(bounded, 0.0, -first * width)], axis=1))


def slopes_of(readings: Readings, offsets: Array, groups: Sequence[RowGroup]) -> tuple[Array, Bools, Bools]:
    """Derivatives of columns in the nominal mode, which is the set of active constraints of the unperturbed step.

    Each column of an environment (a pair) has finite differences of several widths. A difference is valid if its copies are in the
    nominal mode and the difference of a quarter of its width has the same slope. The result for a pair is the slope of the widest valid
    difference. If none is valid, it is the slope of the widest difference that has equal slopes on both sides and at a quarter of its
    width. If there is no such difference, the result is 0.

    Args:
        readings: Results of the displaced copies.
        offsets: Displacements, (pairs, 2, WIDTHS), in the unit of the column.
        groups: Groups of rows of the derivative matrix with the same unit.

    Returns:
        Slopes, (pairs, rows); mask of the pairs with a slope of the nominal mode, (pairs,) bool; mask of the pairs with a slope of another
        mode, (pairs,) bool.
    """
    slopes, noise, width = readings.slopes, readings.noise, np.abs(offsets)
    # Compare every width with the next narrower one.
    constant = (width[..., 1:] > 0.0) & _agree(slopes[:, :, :-1], slopes[:, :, 1:], width[..., :-1], groups, noise)
    inside = constant & ~readings.differs[:, :, :-1] & ~readings.differs[:, :, 1:]
    symmetric = constant.all(axis=1) & _agree(slopes[:, 0], slopes[:, 1], width[:, 0], groups, noise)[:, :-1]
    middle = 0.5 * (slopes[:, 0, :-1] + slopes[:, 1, :-1])
    one_sided = (slopes[:, :, 1:] - WIDTH_RATIO * slopes[:, :, :-1]) / (1.0 - WIDTH_RATIO)
    out, found = np.zeros((len(slopes), slopes.shape[-1])), np.zeros(len(slopes), np.bool_)

    def take(chosen: Bools, value: Array) -> None:
        new = chosen & ~found
        out[new] = value[new]
        found[new] = True

    for k in range(WIDTHS - 1):
        take(symmetric[:, k] & inside[:, :, k].all(axis=1), middle[:, k])
        for side in (0, 1):
            take(inside[:, side, k] & ~inside[:, 1 - side, k], one_sided[:, side, k])
    nominal = found.copy()
    for k in range(WIDTHS - 1):
        take(symmetric[:, k], middle[:, k])
    return out, nominal, found & ~nominal


def _agree(a: Array, b: Array, width: Array, groups: Sequence[RowGroup], noise: Array) -> Bools:
    """Whether slopes at one width, (..., widths, rows), agree with slopes at another width or side; (..., widths) bool.

    Differences due to curvature and noise are allowed. As the width decreases, a difference due to curvature decreases. A difference due to
    a kink stays constant, and a difference due to a jump increases.

    Args:
        a: Slopes from differences of half width `width`.
        b: Slopes from narrower differences, or from the opposite side.
        width: Half widths, (..., widths), in the unit of the column.
        groups: Groups of rows of the derivative matrix with the same unit.
        noise: Error of the results due to the solver's tolerance, (pairs,), in SI units.
    """
    good = np.ones(a.shape[:-1], np.bool_)
    safe = np.where(width > 0.0, width, 1.0)
    floor = 4.0 * noise.reshape(-1, *[1] * (width.ndim - 1)) / (WIDTH_RATIO * safe)
    for group in groups:
        own, other = a[..., group.rows], b[..., group.rows]
        size = np.abs([own, other]).max(axis=(0, -1), initial=group.least_slope)
        apart = np.abs(own - other).max(axis=-1, initial=0.0)
        shrinks = np.zeros_like(good)
        falls = apart[..., 1:] <= CURVATURE_RATIO * apart[..., :-1] + floor[..., 1:]
        shrinks[..., :-1] = falls & (apart[..., :-1] <= LARGEST_BEND * size[..., :-1])
        good &= shrinks | (apart <= np.minimum(CURVATURE * safe, LARGEST_BEND) * size + floor)
    return good


Read = Callable[[Pairs, bool], Iterator[tuple[Pairs, Readings]]]
"""Type of a function that steps displaced copies for pairs of an environment and a column (`Pairs`), and yields their results.

It yields results for some of the pairs at a time. If the second argument is True, steps use a stabilization for which contacts at rest are
no kink: Baumgarte with factor 1 and no slop.
"""


def settle(
    whole: dict[str, NDArray[Any]],
    stencil: Stencil,
    groups: Sequence[RowGroup],
    *,
    solved: dict[str, NDArray[Any]] | None,
    read: Read,
) -> None:
    """Replaces columns of derivative matrices whose finite difference crossed a kink.

    The new columns are derivatives with fixed active constraints: those of the unperturbed step. Columns without such a derivative get the
    flag `Kink.UNDETERMINED`.

    Args:
        whole: Arrays of all environments; "slopes" (num_envs, levels, columns, rows) and "causes" (num_envs, columns) are changed in place.
        stencil: Displacements of the differences.
        groups: Groups of rows of the derivative matrix with the same unit.
        solved: Implicit derivatives of all environments; None if these are not available.
        read: Function that steps displaced copies.
    """
    left = whole["causes"] != 0
    if solved is not None:
        sure = (solved["causes"] & np.uint32(Kink.SLOPE | Kink.UNSOLVED | Kink.WRAP | Kink.ADHESION)) == 0
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

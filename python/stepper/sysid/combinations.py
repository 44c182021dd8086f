"""Combinations of parameters that data determine where they do not determine the parameters: sums, products and ratios, with intervals.

Candidates are sums and products of a few features. Features are values of parameters. For bodies they are mass, first moments and
moments of inertia, in which the equations of motion are linear (Khalil and Dombre, "Modeling, Identification and Control of Robots",
2002). A candidate is determined if its derivative along the null space (nullspace.py) is zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations as subsets
from math import comb

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model
from stepper.shared.rotations import matrices
from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import FlatSet
from stepper.sysid.parameters import Block, derivatives, split, value_slopes, write
from stepper.sysid.uncertainty import VAGUE

LARGEST = 4
"""Largest number of features in a sum or product."""
MOST_CANDIDATES = 5000
"""Largest number of sums, or of products, with the same number of features that are tried."""
INTEGER = 0.02
"""Largest distance of an exponent from a whole number."""
SMALL = 0.01
"""Coefficient below which a feature does not belong to a sum, relative to the largest one."""
NEW = 0.03
"""Part of a candidate's derivative that other combinations do not have already, above which it is a new combination."""


@dataclass(frozen=True)
class Combination:
    """Combination of parameters that the data determine, although they do not determine each of the parameters.

    Attributes:
        text: Expression of the combination, such as "body_mass[a] * body_ipos[a][2]".
        value: Its value, in the units of its parameters.
        std: Its standard deviation, in the same units.
        interval: Its 95 % interval, (low, high).
    """

    text: str
    value: float
    std: float
    interval: tuple[float, float]

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.5g} ({self.interval[0]:.5g} to {self.interval[1]:.5g})"


def combinations_of(
    blocks: Sequence[Block], model: Model, flat: FlatSet, *, scale: Array, covariance: Array, known: Array, quantile: float
) -> tuple[Combination, ...]:
    """Combinations that the data determine, in addition to the parameters that they determine.

    Args:
        blocks: Parameters.
        model: Model that was given to `identify`.
        flat: Equally good estimates.
        scale: Scales of the parameter vector theta, (n,).
        covariance: Covariance of theta, (n, n).
        known: Mask of the values that the data determine, (n,).
        quantile: Half width of a 95 % interval, in standard deviations.
    """
    n, first = len(scale), flat.points[0]
    inside = np.eye(n) - first.null @ first.null.T
    axes, squares, _ = np.linalg.svd(inside @ (covariance / np.outer(scale, scale)) @ inside)
    root = axes * np.sqrt(squares)
    certain = axes[:, (np.sqrt(squares) < VAGUE) & (np.arange(n) < n - first.null.shape[1])]
    basis: list[Array] = []

    def is_new(slope: Array) -> bool:
        """Whether the derivative of a combination, (n,), is none of earlier combinations. If so, it is added to their basis."""
        unit = slope @ certain
        unit /= max(float(np.linalg.norm(unit)), 1e-300)
        for other in basis:
            unit = unit - other * (other @ unit)
        size = float(np.linalg.norm(unit))
        if size > NEW:
            basis.append(unit / size)
        return size > NEW

    for slope in (value_slopes(blocks, first.x[:n] * scale) * scale)[known]:
        is_new(slope)
    out: list[Combination] = []
    for term in _terms(_features(blocks, model, [point.x[:n] * scale for point in flat.points], scale), flat):
        if len(basis) >= certain.shape[1]:
            break
        values, derivative = term.values(), term.derivatives()
        std = float(np.linalg.norm(derivative[0] @ root))
        if std > VAGUE * np.linalg.norm(derivative[0]) or flat.undetermined(values[:, None], derivative[:, None], np.array([std])).any():
            continue
        if is_new(derivative[0]):
            value, spread = float(values[0]), quantile * std
            ends = [value * np.exp(sign * spread / abs(value)) if term.product else value + sign * spread for sign in (-1, 1)]
            out.append(Combination(str(term), value, std, (float(min(ends)), float(max(ends)))))
    return tuple(out)


@dataclass(frozen=True)
class _Features:
    """Features of the parameters at several points.

    Attributes:
        labels: Names of the p features.
        values: Values, (points, p).
        slopes: Derivatives with respect to x, (points, p, n).
    """

    labels: list[str]
    values: Array
    slopes: Array

    def chosen(self, index: NDArray[np.int64]) -> _Features:
        """Features with the given indices, (k,)."""
        return _Features([self.labels[k] for k in index], self.values[:, index], self.slopes[:, index])


@dataclass(frozen=True)
class _Term:
    """Sum or product of k features.

    Attributes:
        features: The features.
        numbers: Coefficients of the sum or exponents of the product, (k,).
        product: Whether it is a product.
    """

    features: _Features
    numbers: Array
    product: bool

    def values(self) -> Array:
        """Values at the points, (points,)."""
        own = self.features.values
        return np.asarray(np.prod(own**self.numbers, axis=1) if self.product else own @ self.numbers)

    def derivatives(self) -> Array:
        """Derivatives with respect to x at the points, (points, n)."""
        slopes = self.features.slopes
        if self.product:
            slopes = slopes / self.features.values[..., None] * self.values()[:, None, None]
        return np.asarray(np.einsum("k,pkn->pn", self.numbers, slopes))

    def __str__(self) -> str:
        if not self.product:
            return _sum(self.features.labels, self.numbers)
        powers = list(zip(self.features.labels, self.numbers, strict=True))
        above, below = (" * ".join(_power(label, abs(e)) for label, e in powers if sign * e > 0) for sign in (1, -1))
        return (above or "1") + (f" / ({below})" if " " in below else f" / {below}" if below else "")


def _features(blocks: Sequence[Block], model: Model, thetas: Sequence[Array], scale: Array) -> _Features:
    """Features at several parameter vectors theta, (n,) each; `scale` has the scales of their numbers, (n,).

    They are values of parameters. Of bodies with an unknown centre of mass or inertia, they are mass, first moments and moments of inertia.
    """
    kinds: dict[int, set[str]] = {}
    for block in blocks:
        for k in block.index if block.kind.element == "body" else ():
            kinds.setdefault(k, set()).add(block.parameter.kind)
    bodies = {k: _anchor(model, k) for k, own in kinds.items() if own != {"body_mass"}}
    plain = [block for block in blocks if block.kind.element != "body" or len(block.index) > 1]
    plain += [block for block in blocks if block not in plain and block.parameter.kind == "body_mass" and block.index[0] not in bodies]
    labels = [label for block in plain for label in block.labels]
    for k, (anchor, where) in bodies.items():
        name = model.body_names[k] or f"#{k}"
        labels.append(f"body_mass[{name}]")
        for j, offset in enumerate(anchor):
            centre = f"body_ipos[{name}][{j}]"
            labels.append(f"body_mass[{name}] * " + (f"({centre} - {offset:g})" if offset else centre))
        labels += [f"I{pair}[{name}] {where}" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")]

    def values_of(theta: Array) -> Array:
        """Values of the features, (count, p), for parameter vectors theta, (count, n)."""
        pieces = dict(zip(blocks, split(blocks, theta), strict=True))
        parts = [block.natural(pieces[block]) for block in plain]
        variants = write(blocks, theta, model)
        for k, (anchor, _) in bodies.items():
            mass, com, moments, quat = (variants.of(f"body_{name}")[:, k] for name in ("mass", "ipos", "inertia", "iquat"))
            apart = com - anchor
            R = matrices(quat)
            I = (R * moments[:, None]) @ R.transpose(0, 2, 1)
            I += mass[:, None, None] * ((apart**2).sum(axis=1)[:, None, None] * np.eye(3) - apart[:, :, None] * apart[:, None])
            parts += [mass[:, None], mass[:, None] * apart]
            parts.append(np.stack([I[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=1))
        return np.concatenate(parts, axis=1)

    slopes = np.stack([derivatives(values_of, theta, scale) * scale for theta in thetas])
    # Features that do not change with the parameters are no part of a combination.
    return _Features(labels, values_of(np.stack(thetas)), slopes).chosen(np.flatnonzero(np.linalg.norm(slopes[0], axis=1) > 0))


def _anchor(model: Model, k: int) -> tuple[Array, str]:
    """Position of a body's first joint in the body's frame, (3,) m, and its description; the origin of a body without joints."""
    for j in range(model.njnt):
        joint = model.joint(j)
        if joint.bodyid == k and joint.type != "free":
            return np.asarray(joint.pos, float), f"about joint {joint.name or j}"
    return np.zeros(3), "about its origin"


def _terms(features: _Features, flat: FlatSet) -> Iterator[_Term]:
    """Sums and products whose derivatives along the null spaces are nearly zero, the shortest first."""
    for size in range(1, LARGEST + 1):
        if comb(len(features.labels), size) > MOST_CANDIDATES:
            break
        for product in (True, False) if size > 1 else (False,):
            yield from _terms_of_size(features, flat, size, product=product)


def _terms_of_size(features: _Features, flat: FlatSet, size: int, *, product: bool) -> Iterator[_Term]:
    """Sums or products of `size` features."""
    values, slopes = features.values, features.slopes
    units = np.broadcast_to(np.abs(values) if product else np.linalg.norm(slopes[:1], axis=2), values.shape)
    usable = (np.sign(values) == np.sign(values[0])).all(axis=0)
    if product:
        usable &= (np.abs(values) > SMALL * np.linalg.norm(slopes, axis=2)).all(axis=0)
    parts = zip(slopes, units, flat.points, strict=True)
    along = np.concatenate([(slope / np.maximum(unit, 1e-300)[:, None]) @ point.null for slope, unit, point in parts], axis=1)
    chosen = np.array(list(subsets(np.flatnonzero(usable), size)), int).reshape(-1, size)
    # The first eigenvector belongs to the sum that changes least along the null spaces.
    squares, vectors = np.linalg.eigh(along[chosen] @ along[chosen].transpose(0, 2, 1))
    for k in np.flatnonzero((size == 1) | (squares[:, 0] <= SMALL**2 * squares[:, -1])):
        part = vectors[k, :, 0]
        if np.abs(part).min() >= SMALL * np.abs(part).max():
            for numbers in _powers(part) if product else _factors(part / units[0, chosen[k]]):
                yield _Term(features.chosen(chosen[k]), numbers, product)


def _powers(part: Array) -> list[Array]:
    """Exponents of a product, (k,), as whole numbers; none if they are not close to small whole numbers in the ratios of `part`, (k,)."""
    least = np.abs(part).argmin()
    power = part / part[least]
    if np.abs(power - np.round(power)).max() >= INTEGER * np.abs(power).max() or np.abs(power).max() >= 2.5:
        return []
    power = np.round(power)
    return [power * np.sign(power.sum() or power[0])]


def _factors(factor: Array) -> list[Array]:
    """Coefficients of a sum, (k,), of which the first is 1; before them whole numbers, if they are close to some."""
    factor = factor / factor[0]
    whole = np.round(factor)
    is_whole = len(factor) > 1 and (whole != 0).all() and np.abs(factor - whole).max() < INTEGER
    return [whole, factor] if is_whole else [factor]


def _power(label: str, exponent: float) -> str:
    """Text of a power of a feature."""
    own = f"({label})" if " " in label and exponent != 1 else label
    return own if exponent == 1 else f"{own}^{exponent:g}"


def _sum(labels: Sequence[str], factors: Array) -> str:
    """Text of a sum of features, of which the first has the factor 1."""
    text = labels[0]
    for label, factor in zip(labels[1:], factors[1:], strict=True):
        size = f"{abs(factor):.4g}"
        text += f" {'+' if factor > 0 else '-'} " + (label if size == "1" else f"{size} {label}")
    return text

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

from stepper._stepper import Model
from stepper.shared.rotations import matrices
from stepper.sysid.findings import VAGUE
from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import FlatSet
from stepper.sysid.parameters import Block, derivatives, split, value_slopes, write

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
    span = _Span(certain)
    slopes = value_slopes(blocks, first.x[:n] * scale) * scale
    for slope in slopes[known]:
        span.add(slope)
    features = _Features(blocks, model, [point.x[:n] * scale for point in flat.points], scale)
    out: list[Combination] = []
    for candidate in features.candidates(flat):
        if span.full():
            break
        values, derivative = candidate.values(features), candidate.slopes(features)
        std = float(np.linalg.norm(derivative[0] @ root))
        if std > VAGUE * np.linalg.norm(derivative[0]) or flat.undetermined(values[:, None], derivative[:, None], np.array([std])).any():
            continue
        if span.add(derivative[0]):
            out.append(candidate.combination(features, float(values[0]), std, quantile))
    return tuple(out)


class _Span:
    """Span of the derivatives of all combinations so far, as an orthonormal basis.

    Args:
        certain: Orthonormal basis of the directions that the data determine, (n, r).
    """

    def __init__(self, certain: Array):
        self._certain = certain
        self._basis: list[Array] = []

    def full(self) -> bool:
        """Whether no direction is left without a combination."""
        return len(self._basis) >= int(self._certain.shape[1])

    def add(self, slope: Array) -> bool:
        """Adds a derivative, (n,), unless the others have it already, and returns whether it is new."""
        unit = slope @ self._certain
        unit /= max(float(np.linalg.norm(unit)), 1e-300)
        for other in self._basis:
            unit = unit - other * (other @ unit)
        size = float(np.linalg.norm(unit))
        if size <= NEW:
            return False
        self._basis.append(unit / size)
        return True


class _Features:
    """Features of the parameters at several points: their values and derivatives.

    Attributes:
        labels: Names of the p features.
        values: Values, (points, p).
        slopes: Derivatives with respect to x, (points, p, n).
    """

    def __init__(self, blocks: Sequence[Block], model: Model, thetas: Sequence[Array], scale: Array):
        self._blocks, self._model = blocks, model
        self.labels = self._names()
        self.values = np.stack([self._of(theta[None])[0] for theta in thetas])
        self.slopes = np.stack([derivatives(self._of, theta, scale) * scale for theta in thetas])
        # Features that do not change with the parameters are no part of a combination.
        used = np.flatnonzero(np.linalg.norm(self.slopes[0], axis=1) > 0)
        self.labels = [self.labels[k] for k in used]
        self.values, self.slopes = self.values[:, used], self.slopes[:, used]

    def _bodies(self) -> dict[int, set[str]]:
        """Kinds of the parameters of each body with an unknown centre of mass or inertia, by index of the body."""
        kinds: dict[int, set[str]] = {}
        for block in self._blocks:
            for k in block.index if block.kind.element == "body" else ():
                kinds.setdefault(k, set()).add(block.parameter.kind)
        return {k: own for k, own in kinds.items() if own != {"body_mass"}}

    def _anchor(self, k: int) -> tuple[Array, str]:
        """Position of a body's first joint in the body's frame, (3,) m, and its description; the origin of a body without joints."""
        for j in range(self._model.njnt):
            joint = self._model.joint(j)
            if joint.bodyid == k and joint.type != "free":
                return np.asarray(joint.pos, float), f"about joint {joint.name or j}"
        return np.zeros(3), "about its origin"

    def _names(self) -> list[str]:
        labels = [label for block in self._blocks if block.kind.element != "body" or len(block.index) > 1 for label in block.labels]
        bodies = self._bodies()
        labels += [b.labels[0] for b in self._blocks if b.parameter.kind == "body_mass" and len(b.index) == 1 and b.index[0] not in bodies]
        for k in bodies:
            name = self._model.body_names[k] or f"#{k}"
            anchor, where = self._anchor(k)
            labels.append(f"body_mass[{name}]")
            for j, offset in enumerate(anchor):
                centre = f"body_ipos[{name}][{j}]"
                labels.append(f"body_mass[{name}] * " + (f"({centre} - {offset:g})" if offset else centre))
            labels += [f"I{axes}[{name}] {where}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
        return labels

    def _of(self, theta: Array) -> Array:
        """Values of the features, (count, p), for parameter vectors theta, (count, n)."""
        bodies = self._bodies()
        parts, alone = [], []
        for block, piece in zip(self._blocks, split(self._blocks, theta), strict=True):
            if block.kind.element != "body" or len(block.index) > 1:
                parts.append(block.natural(piece))
            elif block.parameter.kind == "body_mass" and block.index[0] not in bodies:
                alone.append(block.natural(piece))
        parts += alone
        variants = write(self._blocks, theta, self._model)
        for k in bodies:
            mass, com, moments, quat = (variants.of(f"body_{name}")[:, k] for name in ("mass", "ipos", "inertia", "iquat"))
            apart = com - self._anchor(k)[0]
            R = matrices(quat)
            I = (R * moments[:, None]) @ R.transpose(0, 2, 1)
            I += mass[:, None, None] * ((apart**2).sum(axis=1)[:, None, None] * np.eye(3) - apart[:, :, None] * apart[:, None])
            parts += [mass[:, None], mass[:, None] * apart]
            parts.append(np.stack([I[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=1))
        return np.concatenate(parts, axis=1)

    def candidates(self, flat: FlatSet) -> Iterator[_Candidate]:
        """Sums and products whose derivatives along the null spaces are nearly zero, the shortest first."""
        for size in range(1, LARGEST + 1):
            if comb(len(self.labels), size) > MOST_CANDIDATES:
                break
            for product in (True, False) if size > 1 else (False,):
                yield from self._of_size(flat, size, product=product)

    def _of_size(self, flat: FlatSet, size: int, *, product: bool) -> Iterator[_Candidate]:
        """Sums or products of `size` features."""
        units = np.abs(self.values) if product else np.linalg.norm(self.slopes[:1], axis=2)
        usable = (
            (np.abs(self.values) > SMALL * np.linalg.norm(self.slopes, axis=2)).all(axis=0) if product else np.ones(len(self.labels), bool)
        )
        usable &= (np.sign(self.values) == np.sign(self.values[0])).all(axis=0)
        along = np.concatenate(
            [(slope / np.maximum(unit, 1e-300)[:, None]) @ point.null for slope, unit, point in zip(
                self.slopes, np.broadcast_to(units, self.values.shape), flat.points, strict=True)], axis=1)  # fmt: skip
        chosen = np.array(list(subsets(np.flatnonzero(usable), size)), int).reshape(-1, size)
        if not len(chosen):
            return
        rows = along[chosen]
        if size == 1:
            order, parts = np.arange(len(chosen)), np.ones((len(chosen), 1))
        else:
            values, vectors = np.linalg.eigh(rows @ rows.transpose(0, 2, 1))
            order = np.flatnonzero(values[:, 0] <= SMALL**2 * values[:, -1])
            parts = vectors[:, :, 0]
        for k in order:
            part = parts[k]
            if np.abs(part).min() < SMALL * np.abs(part).max():
                continue
            if product:
                power = part / np.abs(part).min() * np.sign(part[np.abs(part).argmin()])
                if np.abs(power - np.round(power)).max() < INTEGER * np.abs(power).max() and np.abs(power).max() < 2.5:
                    power = np.round(power)
                    power *= np.sign(power.sum() or power[0])
                    yield _Candidate(chosen[k], power, product=True)
                continue
            factor = part / units[0, chosen[k]]
            factor = factor / factor[0]
            whole = np.round(factor)
            if size > 1 and (whole != 0).all() and np.abs(factor - whole).max() < INTEGER:
                yield _Candidate(chosen[k], whole, product=False)
            yield _Candidate(chosen[k], factor, product=False)


@dataclass(frozen=True)
class _Candidate:
    """Sum or product of features.

    Attributes:
        chosen: Indices of the features, (k,).
        numbers: Coefficients of the sum or exponents of the product, (k,).
        product: Whether it is a product.
    """

    chosen: Array
    numbers: Array
    product: bool

    def values(self, features: _Features) -> Array:
        """Values at the points, (points,)."""
        own = features.values[:, self.chosen]
        return np.asarray(np.prod(own**self.numbers, axis=1) if self.product else own @ self.numbers)

    def slopes(self, features: _Features) -> Array:
        """Derivatives with respect to x at the points, (points, n)."""
        slopes = features.slopes[:, self.chosen]
        if self.product:
            slopes = slopes / features.values[:, self.chosen, None] * self.values(features)[:, None, None]
        return np.asarray(np.einsum("k,pkn->pn", self.numbers, slopes))

    def combination(self, features: _Features, value: float, std: float, quantile: float) -> Combination:
        """Combination with its text and interval."""
        labels = [features.labels[k] for k in self.chosen]
        if self.product:
            above, below = (
                " * ".join(_power(label, abs(e)) for label, e in zip(labels, self.numbers, strict=True) if sign * e > 0) for sign in (1, -1)
            )
            text = (above or "1") + (f" / ({below})" if " " in below else f" / {below}" if below else "")
            spread = quantile * std / abs(value)
            ends = sorted(value * np.exp(sign * spread) for sign in (-1, 1))
            return Combination(text, value, std, (float(ends[0]), float(ends[1])))
        return Combination(_sum(labels, self.numbers), value, std, (value - quantile * std, value + quantile * std))


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

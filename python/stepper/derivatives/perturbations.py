"""Perturbed quantities, the sizes of their displacements, and the difference formulas.

A column is one number: a degree of freedom of qpos, a velocity, an activation, a control or an entry of a parameter. It is
displaced to two values, or to one with `centered=False`. With Richardson's extrapolation, it is displaced to twice as many values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepper._hints import unknown_field
from stepper._stepper import Model
from stepper.shared.fields import COMPOUNDS, RANDOMIZED
from stepper.shared.selectors import parse, places

Array = NDArray[np.float64]

STATE: tuple[str, ...] = ("qpos", "qvel", "act")
"""Parts of the state, in the order of the rows of the derivative matrix A."""
NOISE_RATIO = 10.0
"""Noise of a velocity after a step, relative to the tolerance. Light bodies, such as feet, have a larger error than the residual."""
KINK_DENSITY = 1.0
"""Factor k in the error k h that kinks cause in a difference of half width h, SI units; see `step_of`."""
ROUNDING = 2.0**-52
"""Rounding error of a number of order 1: the machine epsilon of float64."""

SIGNED = frozenset({"gravity", "body_ipos", "geom_pos", "jnt_range", "actuator_gainprm", "actuator_biasprm"})
"""Parameters of a model (field names) whose values may be negative; all other parameters must be at least 0."""
ABSENT = frozenset({"body_mass", "body_inertia", "geom_size", "dof_frictionloss", "jnt_stiffness", "actuator_gainprm", "actuator_biasprm"})
"""Parameters (field names) whose zeros cannot be perturbed, because 0 means that the model lacks the property, such as a spring."""
OF_AXES = frozenset({"dof_damping", "dof_armature"})
"""Parameters (field names) whose zeros cannot be perturbed at free and ball joints. All axes of such a joint must have the same value."""


def step_of(tolerance: float) -> float:
    """Half width of a difference for coordinates of order 1, from the tolerance of the solver in m/s.

    A step through contact is smooth between kinks, so that the error of a central difference of width 2 h has three parts, in SI units:

        noise of the solution   e / h           with e = 10 tolerance, 1e-15 at least for rounding
        truncation              h^2 |f'''| / 6
        kinks within the step   k h             the probability is proportional to h, and the change of the slope is not small

    Without kinks h = (3 e / |f'''|)^(1/3) is best. With kinks the third part is larger than the second for all h < 6 k / |f'''|, and
    h = sqrt(e / k) is best. With k = 1 and the default tolerance of 1e-13 m/s, h is 1e-6. The noise is then 1e-6 at worst and 1e-9 in the
    median, because most solutions end far below the tolerance (docs/how-to/derivatives.md).
    """
    return math.sqrt(max(NOISE_RATIO * tolerance, 4.0 * ROUNDING) / KINK_DENSITY)


@dataclass(frozen=True)
class Block:
    """Columns of the derivative matrix for one perturbed quantity: a part of the state, the controls or a parameter.

    Attributes:
        name: Name in the argument `wrt`, for example "qpos", "ctrl" or "geom_friction[floor]".
        field: "qpos", "qvel", "act", "ctrl" or a field of `Stepper.randomize`.
        places: Indices of the columns in the flattened field of one environment, (count,).
        shape: Shape of the columns in the result.
    """

    name: str
    field: str
    places: NDArray[np.int64]
    shape: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of columns, which are the perturbed coordinates or parameter values of this block."""
        return len(self.places)


@dataclass(frozen=True)
class Stencil:
    """Displacements of all columns in all environments, and difference formulas for the results.

    A column is a perturbed number: a component of the state, the controls or a parameter. Its points are the one or two displaced values
    of a finite difference. Its levels are one or two such differences, of different half widths.

    Attributes:
        offsets: Displacements, (num_envs, levels, points, columns), in the unit of the column; level 0 has the smallest half width.
        step: Half widths of the differences, (num_envs, levels, columns); 0 for columns that cannot be perturbed.
        central: Whether a column has points on both sides of the nominal value, (num_envs, columns) bool. Otherwise it has one point, or
            two points on the same side, at one and two half widths.
        bounded: Whether a bound allows displacements to one side only, (num_envs, columns) bool.
    """

    offsets: Array
    step: Array
    central: NDArray[np.bool_]
    bounded: NDArray[np.bool_]

    def slopes(self, changes: Array) -> Array:
        """Derivatives of n results by finite differences: of second order from two points, of first order from one point.

        Args:
            changes: Results at the displaced points minus the nominal results, (num_envs, levels, points, columns, n). The axes are those
                of `offsets`, then the n results (rows of the derivative matrix), in their units.

        Returns:
            Derivatives of each result with respect to each column, (num_envs, levels, columns, n). They are 0 for columns that cannot be
            perturbed.
        """
        first, sign = changes[:, :, 0], np.sign(self.offsets[:, :, 0])[..., None]
        if changes.shape[2] == 1:
            return first * (sign / self._divisor(1.0))
        second = changes[:, :, 1]
        if self.central.all():
            return (first - second) * (sign / self._divisor(2.0))
        both, one = first - second, 4.0 * first - second
        return np.where(self.central[:, None, :, None], both, one) * (sign / self._divisor(2.0))

    def bends(self, changes: Array) -> Array:
        """Absolute differences between the one-sided slopes of every column, which indicate kinks.

        Args:
            changes: Results at the two displaced points minus the nominal results, (num_envs, levels, 2, columns, n), in their units.

        Returns:
            Differences, (num_envs, levels, columns, n), in the unit of the result over that of the column.
        """
        first, second = changes[:, :, 0], changes[:, :, 1]
        bend: Array = np.abs(np.where(self.central[:, None, :, None], first + second, second - 2.0 * first)) / self._divisor(1.0)
        return bend

    def _divisor(self, factor: float) -> Array:
        """Half widths of the differences times a factor, (num_envs, levels, columns, 1); 1 for columns that cannot be perturbed."""
        return np.where(self.step > 0.0, factor * self.step, 1.0)[..., None]


def blocks_of(model: Model, wrt: Sequence[str]) -> list[Block]:
    """Quantities to perturb for finite differences, one `Block` for each name in `wrt`, in the order of the names.

    Names are "qpos", "qvel", "act", "ctrl" and selectors of parameters, such as "geom_friction[floor]".

    Raises:
        TypeError: `wrt` is a string, or an entry is not a string.
        ValueError: `wrt` is empty, or a name is repeated or matches no field or element.
    """
    _check_names("wrt", wrt, "('qpos', 'qvel', 'act', 'ctrl')")
    if not wrt:
        raise ValueError("wrt is (), must have at least one name")
    return [_block(model, name, "wrt") for name in wrt]


def check_parameters(model: Model, parameters: Sequence[str]) -> None:
    """Checks the names of the parameters with respect to which a rollout is differentiated.

    Raises:
        TypeError: `parameters` is a string, or an entry is not a string.
        ValueError: A name is repeated, matches no field or element, or is a part of the state or the controls, whose gradients are always
            computed.
    """
    _check_names("parameters", parameters, "('body_mass', 'geom_friction[floor]')")
    for name in parameters:
        if name in (*STATE, "ctrl"):
            raise ValueError(f"parameters has {name!r}, but gradients by the state and the controls are always computed: remove the name")
        _block(model, name, "parameters")


def _check_names(argument: str, names: Sequence[str], example: str) -> None:
    """Raises an error unless an argument is a sequence of names without repetition."""
    if isinstance(names, str) or not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
        remedy = f"({names!r},)" if isinstance(names, str) else example
        raise TypeError(f"{argument} is {names!r}, must be a sequence of names, for example {remedy}")
    if twice := sorted({name for name in names if list(names).count(name) > 1}):
        raise ValueError(f"{argument} has {twice[0]!r} more than once")


def _block(model: Model, name: str, argument: str) -> Block:
    """Quantity to perturb, by a name such as "qpos" or "geom_friction[floor]".

    `argument` is the name of the user's argument that contains the name, for error messages.
    """
    selector = parse(name, argument)
    field, whole = selector.field, selector.elements is None and selector.columns is None
    sizes = {"qpos": model.nv, "qvel": model.nv, "act": model.na, "ctrl": model.nu}
    if field in sizes:
        if not whole:
            raise ValueError(f"{argument} has {name!r}, but {field} has no named elements: write {field!r} alone")
        return Block(name, field, np.arange(sizes[field]), (sizes[field],))
    if field in COMPOUNDS:
        parts = " and ".join(f"'{part}[...][{column}]'" for part, column, _ in COMPOUNDS[field].parts)
        raise ValueError(f"{argument} has {name!r}, which combines several fields: write {parts}")
    if field not in RANDOMIZED:
        known = [*sizes, *RANDOMIZED] if argument == "wrt" else RANDOMIZED
        raise ValueError(unknown_field(argument, field, known, "docs/reference/what_can_vary.md"))
    index = places(model, selector, argument)
    chosen = index.reshape(-1)
    own = np.asarray(getattr(model, field), np.float64).reshape(-1)[chosen]
    if not whole and ((own == 0.0) & _absent(model, field, chosen)).all():
        raise ValueError(
            f"{argument} has {name!r}, but the {field} of these elements is 0 and cannot be perturbed; set another value with "
            f"model.replace({field}=...)"
        )
    return Block(name, field, chosen, index.shape)


def _absent(model: Model, field: str, places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the numbers in a parameter array that cannot be perturbed while they are 0, (k,) bool."""
    if field in OF_AXES:
        joints = (model.joint(k) for k in range(model.njnt))
        turning = [joint.dofadr + i for joint in joints if joint.type in ("free", "ball") for i in range(joint.nv)]
        return np.isin(places, np.array(turning, dtype=np.int64))
    return np.full(len(places), field in ABSENT)


def stencil_of(model: Model, blocks: Sequence[Block], values: Mapping[str, Array], *, step: float, levels: int, centered: bool) -> Stencil:
    """Displacements of all perturbed columns in all environments.

    Coordinates of the state and controls are displaced by `step` in their SI unit. Parameters are displaced by `step` times their
    absolute value, or by `step` if they are 0. A parameter whose value 0 means that the model lacks the effect is not displaced. A column
    has two displaced values, above and below the nominal value. At a bound (an end of a control's range, or 0 for a parameter) both
    values are on one side, at one and at two times the displacement. The order of accuracy is the same.

    Args:
        model: The model.
        blocks: Perturbed quantities.
        values: Current values of every field except qpos, (num_envs, size), in the field's unit.
        step: Half width for a coordinate of order 1.
        levels: Number of widths: 1, or 2 for extrapolation; the second is twice the first.
        centered: Whether columns have two displaced values. If False they have one, above the nominal value where the bounds allow it.
    """
    widths, signs, central = [], [], []
    for block in blocks:
        low, high = _bounds(model, block)
        now = np.zeros((len(values["qvel"]), block.count)) if block.field == "qpos" else values[block.field][:, block.places]
        size = np.full(now.shape, step)
        if block.field in RANDOMIZED:
            size = step * np.where(now == 0.0, 1.0, np.abs(now))
            size[(now == 0.0) & _absent(model, block.field, block.places)] = 0.0
        reach = size * 2.0 ** (levels - 1)
        up, down = now + reach <= high, now - reach >= low
        # Beyond its range a control has no effect, so that both sides are allowed.
        outside = (now > high) | (now < low)
        widths.append(size)
        central.append((up & down) | outside)
        signs.append(np.where(up | outside, 1.0, -1.0))
    width, sign, both = (np.concatenate(parts, axis=1) for parts in (widths, signs, central))
    step_levels = width[:, None] * 2.0 ** np.arange(levels)[None, :, None]
    first = sign[:, None] * step_levels
    if not centered:
        return Stencil(first[:, :, None], step_levels, np.zeros_like(both, dtype=np.bool_), ~both.astype(np.bool_))
    second = np.where(both[:, None], -first, 2.0 * first)
    return Stencil(np.stack([first, second], axis=2), step_levels, both.astype(np.bool_), ~both.astype(np.bool_))


def _bounds(model: Model, block: Block) -> tuple[Array, Array]:
    """Smallest and largest allowed value of each column of a perturbed quantity, (columns,) each, in its unit; infinite without a bound."""
    low, high = np.full(block.count, -np.inf), np.full(block.count, np.inf)
    if block.field == "ctrl":
        ranges = np.array(model.actuator_ctrlrange, np.float64)
        return ranges[:, 0], ranges[:, 1]
    if block.field in RANDOMIZED and block.field not in SIGNED:
        low[:] = 0.0
    if block.field in ("geom_restitution", "pair_restitution"):
        high[:] = 1.0
    return low, high

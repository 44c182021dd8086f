"""Linearization of the step: matrices A and B in tangent coordinates, for all environments at once."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.derivatives import implicit, nominal_mode
from stepper.derivatives.copies import COPIES_PER_THREAD, Nominal, Part, copies_of, ends_of, nominal_of, parts_of
from stepper.derivatives.kinks import LEAST_SLOPE, SOLVED, Bools, Kink, KinkDetector, RowGroup
from stepper.derivatives.nominal_mode import WIDTHS, Pairs, Readings
from stepper.derivatives.perturbations import ROUNDING, STATE, Array, Block, Stencil, blocks_of, stencil_of, step_of
from stepper.shared.arguments import check_flag, check_kind, check_whole

TOLERANCE = 1e-13
"""Default residual to which perturbed copies are solved, m/s. If the tolerance of the stepper is smaller, it is used instead.

Compared with a residual of 1e-6 m/s, the solver needs two or three more sweeps, and derivatives have less noise.
"""


@dataclass(frozen=True)
class Linearization:
    """Derivatives of the state after `nstep` steps, returned by `Stepper.linearize`.

    A derivative matrix has n = 2 nv + na rows: displacements of qpos (m, rad), then qvel (m/s, rad/s), then act. Displacements of qpos are
    in the coordinates of velocities (`Model.integrate_pos`), in rows and in columns. A rotation of a free or ball joint is a rotation
    vector in the body's frame. With `num_envs=None` in the `Stepper`, the leading axis of all arrays is absent.

    Attributes:
        blocks: Derivatives of the state after the steps, (num_envs, n, *columns). The keys are the names in `wrt`. `columns` is (nv,),
            (na,), (nu,) or the shape of the parameter. The unit of an entry is the unit of its row divided by the unit of its column.
        sensors: Derivatives of the readings of ideal sensors after the steps, (num_envs, nsensordata, *columns), by the names in `wrt`;
            empty unless `sensors=True`.
        errors: Estimated error of every entry of `blocks`, with `extrapolate=True`; otherwise empty.
        kinks: Flags of `Kink` for every column of `blocks`, over all steps, (num_envs, *columns) uint32.
        near_kink: Whether any column of an environment has a flag, (num_envs,) bool. A column with a flag is the derivative for the active
            constraints of the unperturbed step. Without such a derivative the column is 0 (see `undetermined`).
        kinked_steps: Whether any column of an environment has a flag in a step, (num_envs, nstep) bool.
        kink_distance: Estimated distance to the nearest kink, to first order, (num_envs,). It is a multiple of the displacement of the
            copies, which is `step` times the size of the coordinate. Above 1, the copies do not reach the kink. It is infinite if there
            is no estimate.
        step: Half width of the differences for a coordinate of order 1.
        tolerance: Residual to which copies were solved, m/s.
        residual: Largest residual of any copy in the last step, m/s: (num_envs,).
        status: Flags of `stepper.Status` that any copy set in any step, (num_envs,) uint32.
        implicit: Whether the derivatives are those of the implicit function theorem, (num_envs,) bool. It is False with `method="fd"`,
            and in environments that the theorem does not cover, where `method="implicit"` falls back to differences.
        qpos, qvel, act: The nominal state after the steps, (num_envs, nq) m and rad, (num_envs, nv) m/s and rad/s, (num_envs, na).
    """

    blocks: dict[str, Array]
    sensors: dict[str, Array]
    errors: dict[str, Array]
    kinks: dict[str, NDArray[np.uint32]]
    near_kink: Bools
    kinked_steps: Bools
    kink_distance: Array
    step: float
    tolerance: float
    residual: Array
    status: NDArray[np.uint32]
    implicit: Bools
    qpos: Array
    qvel: Array
    act: Array

    @property
    def A(self) -> Array:  # noqa: N802
        """Derivative of the state after the steps with respect to the state before the steps, (num_envs, n, n).

        Raises:
            KeyError: `wrt` lacks "qpos", "qvel" or "act".
        """
        return np.concatenate([self._block(name) for name in STATE], axis=-1)

    @property
    def B(self) -> Array:  # noqa: N802
        """Derivative of the state after the steps with respect to the controls, (num_envs, n, nu).

        Raises:
            KeyError: `wrt` lacks "ctrl".
        """
        return self._block("ctrl")

    @property
    def C(self) -> Array:  # noqa: N802
        """Derivative of the sensor readings after the steps with respect to the state before the steps, (num_envs, nsensordata, n).

        Raises:
            KeyError: `wrt` lacks "qpos", "qvel" or "act".
        """
        return np.concatenate([self._block(name, sensors=True) for name in STATE], axis=-1)

    @property
    def D(self) -> Array:  # noqa: N802
        """Derivative of the sensor readings after the steps with respect to the controls, (num_envs, nsensordata, nu).

        Raises:
            KeyError: `wrt` lacks "ctrl".
        """
        return self._block("ctrl", sensors=True)

    def __getitem__(self, key: Any) -> Array:
        raise TypeError("a Linearization has no parts by index or key, and cannot be unpacked: use its attributes A and B")

    def _block(self, name: str, *, sensors: bool = False) -> Array:
        """Derivative of the state, or of the sensor readings, with respect to the quantity `name`, one of the names in `wrt`."""
        blocks = self.sensors if sensors else self.blocks
        if name not in blocks:
            remedy = "sensors=True" if name in self.blocks else f"{name!r} in wrt"
            raise KeyError(f"{name} was not computed: call linearize with {remedy}")
        return blocks[name]

    @property
    def undetermined(self) -> Bools:
        """Whether an environment has a column without a derivative (`Kink.UNDETERMINED`), (num_envs,) bool. Such columns are 0."""
        undetermined = [(flags & np.uint32(Kink.UNDETERMINED)) != 0 for flags in self.kinks.values()]
        shape = np.shape(self.near_kink)
        found: Bools = np.logical_or.reduce([own.reshape(*shape, -1).any(axis=-1) for own in undetermined], axis=0)
        return found

    @property
    def causes(self) -> Kink:
        """Flags of all kinks in any column of any environment."""
        return Kink(int(np.bitwise_or.reduce([np.bitwise_or.reduce(flags, axis=None) for flags in self.kinks.values()], initial=0)))


def linearize(
    sim: Stepper,
    wrt: Sequence[str] | None = None,
    *,
    ctrl: ArrayLike | None = None,
    nstep: int = 1,
    method: Literal["fd", "implicit"] = "fd",
    step: float | None = None,
    tolerance: float | None = None,
    centered: bool = True,
    extrapolate: bool = False,
    sensors: bool = False,
) -> Linearization:
    """Returns the derivatives of the state after `nstep` steps, in all environments of a stepper.

    `Stepper.linearize` documents the arguments, which are the same. Controls are (num_envs, nu) or (nu,), for example.
    """
    check_kind("sim", sim, Stepper, "stepper.Stepper(model, num_envs)")
    if not isinstance(method, str) or method not in ("fd", "implicit"):
        raise ValueError(f"method is {method!r}, must be 'fd' or 'implicit'")
    if sim.options.error is not None:
        raise ValueError(
            f"Options.error is {sim.options.error!r}, must be None for linearize, because the number of substeps jumps with the state"
        )
    check_whole("nstep", nstep, least=1)
    for name, flag in {"centered": centered, "extrapolate": extrapolate, "sensors": sensors}.items():
        check_flag(name, flag)
    tolerance = min(TOLERANCE, sim.tolerance) if tolerance is None else _positive("tolerance", tolerance)
    blocks = blocks_of(sim.model, (*STATE, "ctrl") if wrt is None else wrt)
    if method == "implicit":
        implicit.check(sim, blocks, extrapolate=extrapolate, sensors=sensors)
    nominal = nominal_of(sim, ctrl, blocks)

    def stencil_with(width: float) -> Stencil:
        return stencil_of(sim.model, blocks, nominal.fields, step=width, levels=2 if extrapolate else 1, centered=centered)

    def differences(stencil: Stencil, envs: slice | None = None) -> dict[str, NDArray[Any]]:
        parts = [
            _differences(part, _rows(stencil, part.envs), int(nstep), tolerance, sensors=sensors)
            for part in parts_of(sim, nominal, blocks, stencil, tolerance, envs=envs)
        ]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    width = step_of(tolerance) if step is None else _positive("step", step)
    if method == "fd":
        stencil = stencil_with(width)
        whole = differences(stencil)
        solved = None
        if (whole["causes"] != 0).any():
            solved = implicit.where_available(sim, nominal, blocks, nstep=int(nstep), tolerance=tolerance, sensors=sensors)
    else:
        stencil = stencil_with(implicit.STEP if step is None else width)
        whole = solved = implicit.derivatives(sim, nominal, blocks, stencil, nstep=int(nstep), tolerance=tolerance)
        for envs in _runs(~whole["implicit"]):
            # Environments that the theorem does not cover use finite differences.
            own = differences(stencil_with(width), envs)
            for name, value in own.items():
                whole[name][envs] = value
        width = implicit.STEP if step is None else width
    read = Reader(sim, nominal, blocks, whole, nstep=int(nstep), tolerance=tolerance, sensors=sensors)
    groups = [*_groups(sim, int(nstep)), RowGroup(slice(_size(sim.model), None))]
    nominal_mode.settle(whole, stencil, groups, solved=solved, read=read)
    # Order of the error in the width, for Richardson's extrapolation; 0 is no extrapolation.
    order = (2 if centered else 1) if extrapolate else 0
    return _result(sim, blocks, whole, width, tolerance, order=order, sensors=sensors)


def _runs(chosen: Bools) -> list[slice]:
    """Slices of consecutive environments that are True in a mask (num_envs,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _positive(name: str, value: float) -> float:
    """Returns an argument as a float; a ValueError unless it is a positive finite number. `name` is the argument's name for the message."""
    if not isinstance(value, int | float | np.number) or not 0.0 < value < np.inf:
        raise ValueError(f"{name} is {value!r}, must be a number above 0")
    return float(value)


def _rows(stencil: Stencil, envs: slice) -> Stencil:
    """Stencil (displacements and half widths) of the environments of a slice."""
    return Stencil(stencil.offsets[envs], stencil.step[envs], stencil.central[envs], stencil.bounded[envs])


def _differences(part: Part, stencil: Stencil, nstep: int, tolerance: float, *, sensors: bool) -> dict[str, NDArray[Any]]:
    """Steps the perturbed copies of n environments, and returns finite differences of the resulting states.

    Returns:
        Arrays by name: "slopes" (n, levels, columns, rows), the derivatives, where a level is a width of the differences; "width"
        (n, columns), the half widths; "noise" (n,), the error of the results; "causes" (n, columns), flags of `Kink`; the nominal state
        after the steps; and other fields of `Linearization`.
    """
    sim, n, count = part.sim, part.envs.stop - part.envs.start, part.count
    detector, status = KinkDetector(sim, stencil, nstep), np.zeros(n * count, np.uint32)
    for k in range(nstep):
        sim.step(part.ctrl if k == 0 else None)
        detector.compare(k)
        status |= np.asarray(sim.status)
    end, whole = ends_of(sim, count, sensors=sensors)
    levels, points, columns = stencil.offsets.shape[1:]
    changes = whole[:, 1:].reshape(n, levels, points, columns, whole.shape[-1])
    slopes = stencil.slopes(changes)
    residual = np.asarray(sim.residual).reshape(n, count).max(axis=1)
    size = np.abs(end["qvel"]).max(axis=(1, 2), initial=1.0)
    detector.compare_slopes(changes, slopes[:, 0], _groups(sim, nstep), tolerance)
    causes = detector.report.causes
    return {
        "slopes": slopes,
        "width": stencil.step[:, 0],
        "noise": residual + ROUNDING * size,
        "causes": np.bitwise_or.reduce(causes, axis=1),
        "kinked_steps": (causes != 0).any(axis=2),
        "kink_distance": detector.report.distance.min(axis=1),
        "residual": residual,
        "status": np.bitwise_or.reduce(status.reshape(n, count), axis=1),
        "implicit": np.zeros(n, np.bool_),
        **{name: value[:, 0] for name, value in end.items()},
    }


def _result(
    sim: Stepper,
    blocks: Sequence[Block],
    whole: dict[str, NDArray[Any]],
    width: float,
    tolerance: float,
    *,
    order: int,
    sensors: bool,
) -> Linearization:
    """Linearization from arrays of slopes and kinks.

    Args:
        sim: The stepper.
        blocks: Quantities of `wrt`.
        whole: Arrays of all environments by name: "slopes" (num_envs, levels, columns, rows), "causes" of kinks (num_envs, columns),
            "width", "noise", the nominal state, and fields of `Linearization`.
        width: Half width of the differences for coordinates of order 1.
        tolerance: Residual to which copies were solved, m/s.
        order: Order of the differences' error, for Richardson's extrapolation; 0 means no extrapolation.
        sensors: Whether the slopes have rows for sensor readings.
    """
    single = sim.num_envs is None

    def shown(array: NDArray[Any]) -> NDArray[Any]:
        return array[0] if single else array

    def split(array: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Splits an array (num_envs, columns, ...) into one array per quantity of `wrt`, with the columns as the last axes."""
        out, place = {}, 0
        for block in blocks:
            own = array[:, place : place + block.count]
            own = np.moveaxis(own, 1, -1)
            out[block.name] = np.ascontiguousarray(shown(own.reshape(*own.shape[:-1], *block.shape)))
            place += block.count
        return out

    slopes = whole["slopes"]
    best, n = slopes[:, 0], _size(sim.model)
    errors = {}
    if order:
        ratio = 2.0**order
        best = (ratio * slopes[:, 0] - slopes[:, 1]) / (ratio - 1.0)
        noise = whole["noise"][:, None] / np.where(whole["width"] > 0.0, whole["width"], np.inf)
        errors = split((np.abs(best - slopes[:, 0]) + 2.0 * noise[..., None])[..., :n])
    return Linearization(
        blocks=split(best[..., :n]),
        sensors=split(best[..., n:]) if sensors else {},
        errors=errors,
        kinks=split(whole["causes"]),
        near_kink=shown((whole["causes"] != 0).any(axis=1)),
        step=width,
        tolerance=tolerance,
        **{name: shown(whole[name]) for name in ("kinked_steps", "kink_distance", "residual", "status", "implicit", *STATE)},
    )


def _groups(sim: Stepper, nstep: int) -> list[RowGroup]:
    """Groups of rows of the derivative matrix of the state that have the same unit: displacements, velocities and activations."""
    nv, duration = sim.model.nv, min(nstep * sim.timestep, 1.0)
    return [RowGroup(slice(0, nv), LEAST_SLOPE * duration), RowGroup(slice(nv, 2 * nv)), RowGroup(slice(2 * nv, _size(sim.model)))]


def _size(model: Model) -> int:
    """Number of rows of A, the derivative matrix of the state: 2 nv + na."""
    return 2 * model.nv + model.na


class UndeterminedDerivative(ArithmeticError):  # noqa: N818
    """Error of `Rollout.vjp` for a step that is at a kink and has no derivative (docs/how-to/derivatives.md).

    Attributes:
        env: Index of the environment.
        control: Index of the control of the rollout, from 0. The kink is in one of the steps in which this control is held.
        coordinate: Name of the coordinate with respect to which the step has no derivative, for example "qvel[3] (joint 'knee')".
        kinks: Flags of the kink.
    """

    def __init__(self, env: int, control: int, coordinate: str, kinks: Kink):
        self.env, self.control, self.coordinate, self.kinks = env, control, coordinate, kinks
        cause = " | ".join(kink.name or "" for kink in kinks & ~Kink.UNDETERMINED)
        super().__init__(
            f"the steps of control {control} have no derivative by {coordinate} in environment {env}: they are at a kink ({cause}). Use "
            "smoothed gradients, vjp(smoothing=Smoothing(...)), or zero gradients for this environment, vjp(undetermined='zero')"
        )


def first_undetermined(part: Linearization, needed: Bools, control: int, model: Model) -> dict[int, UndeterminedDerivative]:
    """Errors for steps without a derivative, by index of the environment; at most one per environment.

    Args:
        part: Linearization of the steps in which one control of a rollout is held.
        needed: Mask of the environments that need the derivative, (num_envs,), because their gradient in the backward pass is not zero.
            Other environments get no error.
        control: Index of this control in the rollout.
        model: The model.
    """
    errors: dict[int, UndeterminedDerivative] = {}
    for name, flags in part.kinks.items():
        rows = flags.reshape(len(needed), -1)
        for env, column in np.argwhere((rows & np.uint32(Kink.UNDETERMINED)) != 0):
            if needed[env] and int(env) not in errors:
                coordinate, kinks = _coordinate(model, name, int(column)), Kink(int(rows[env, column]))
                errors[int(env)] = UndeterminedDerivative(int(env), control, coordinate, kinks)
    return errors


def _coordinate(model: Model, name: str, column: int) -> str:
    """Name of a perturbed coordinate for an error message, with the joint or actuator, such as "qvel[3] (joint 'knee')"."""
    if name in ("qpos", "qvel"):
        joint = max((model.joint(k) for k in range(model.njnt)), key=lambda joint: joint.dofadr if joint.dofadr <= column else -1)
        return f"{name}[{column}] (joint {joint.name!r})" if joint.name else f"{name}[{column}]"
    if name == "ctrl":
        actuator = model.actuator(column).name
        return f"ctrl[{column}] (actuator {actuator!r})" if actuator else f"ctrl[{column}]"
    return f"{name}[{column}]"


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

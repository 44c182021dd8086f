"""Perturbed copies of the environments of a stepper, stepped together as one batch.

The original stepper does not change. Copies start from the full state of its environments: configuration, velocity, activations, applied
forces and mocap poses. They also have the per-environment parameters, the solver's warm start, and the delays and integrals of drives.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper._options import Options
from stepper._stepper import ModelError, Stepper
from stepper.derivatives.nominal_mode import Pairs
from stepper.derivatives.perturbations import STATE, Array, Block, Stencil
from stepper.shared.fields import APPLIED, RANDOMIZED

COPIES_PER_THREAD = 1024
"""Largest number of copies per thread in one batch, so that the copies fit into the cache of a core.

All copies of an environment are in one batch, even if their number is larger than this.
"""

_kept: WeakKeyDictionary[Stepper, dict[tuple[int, float], Stepper]] = WeakKeyDictionary()
"""Steppers of perturbed copies, by original stepper, then by number of copies and solver tolerance; the next linearization reuses them."""


@dataclass(frozen=True)
class Nominal:
    """State of the unperturbed environments. The leading axis of all arrays is the environment.

    Attributes:
        fields: Arrays (num_envs, size) of "qpos", "qvel", "act", "ctrl" and every perturbed parameter, flattened.
        applied: Mocap poses, applied forces and active equalities, by name. Applied forces are absent if all are 0. Active equalities are
            absent if all are as in the model.
        randomized: Parameters per environment, in the format of `randomize`.
    """

    fields: dict[str, Array]
    applied: dict[str, Array]
    randomized: dict[str, Any]

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return len(self.fields["qpos"])


def nominal_of(sim: Stepper, ctrl: ArrayLike | None, blocks: Sequence[Block]) -> Nominal:
    """Snapshot of the environments of a stepper.

    Args:
        sim: The stepper.
        ctrl: Controls, (num_envs, nu) or (nu,); None uses the controls of the last step.
        blocks: Quantities with respect to which derivatives are computed. The snapshot contains the parameters among them.
    """
    model, n = sim.model, sim.num_envs or 1
    if sim.precision == "f32" and sim.actuators is not None:
        raise ValueError(
            "a stepper with precision='f32' and actuators= cannot be linearized: derivatives are computed in f64, and the memory of "
            "its drives cannot be converted; create it with precision='f64'"
        )
    fields = {name: rows(sim, name).astype(np.float64) for name in ("qpos", "qvel", "act")}
    fields["ctrl"] = _controls(sim, ctrl)
    randomized = {name: value if name == "actuators" else np.asarray(value, np.float64) for name, value in sim.randomized.items()}
    if sim.num_envs is None:
        shaped = {name: value.reshape(1, *np.shape(getattr(model, name))) for name, value in randomized.items() if name != "actuators"}
        randomized |= shaped
    for field in {block.field for block in blocks} & RANDOMIZED.keys():
        own = np.asarray(getattr(model, field), np.float64)
        value = randomized.get(field, np.broadcast_to(own, (n, *own.shape)))
        fields[field] = np.array(value).reshape(n, -1)
    applied = {name: rows(sim, name).astype(np.float64) for name in APPLIED}
    # Values that a new stepper has; these need no copying. Mocap poses are always copied.
    initial = {"qfrc_applied": 0.0, "xfrc_applied": 0.0, "eq_active": np.asarray(model.eq_active0)}
    kept = {name: value for name, value in applied.items() if value.size and (name not in initial or (value != initial[name]).any())}
    return Nominal(fields, kept, randomized)


def _controls(sim: Stepper, ctrl: ArrayLike | None) -> Array:
    """Controls of every environment, (num_envs, nu); None selects the controls of the last step."""
    nu, n = sim.model.nu, sim.num_envs
    given = array_of("ctrl", sim.ctrl if ctrl is None else ctrl)
    if given.shape not in ((nu,), (n, nu)):
        must = f"({nu},)" if n is None else f"({n}, {nu}) or ({nu},)"
        raise ValueError(f"ctrl has shape {given.shape}, must be {must}")
    if not np.isfinite(given).all():
        raise ValueError("ctrl has a number that is not finite")
    return np.array(np.broadcast_to(given, (n or 1, nu)))


def rows(sim: Stepper, name: str) -> NDArray[Any]:
    """Attribute `name` of a stepper as an array (num_envs, ...), in the unit of the attribute.

    A stepper with `num_envs=None` has no axis of environments. The result then has the shape (1, ...).
    """
    value = np.asarray(getattr(sim, name))
    return value[None] if sim.num_envs is None else value


@dataclass(frozen=True)
class Part:
    """Batch of perturbed copies of some environments. Row e * count + k is copy k of environment e of the slice; copy 0 is not perturbed.

    Attributes:
        envs: Slice of the environments.
        count: Number of copies of each environment.
        sim: Stepper of the copies, before the first step.
        ctrl: Controls of the copies, (environments * count, nu).
    """

    envs: slice
    count: int
    sim: Stepper
    ctrl: Array


def parts_of(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], stencil: Stencil, tolerance: float, *, envs: slice | None = None
) -> Iterator[Part]:
    """Yields batches of perturbed copies of the environments, ready to be stepped. A batch has all copies of some environments.

    Args:
        sim: The original stepper.
        nominal: State of its environments.
        blocks: Quantities to perturb.
        stencil: Displacements of these quantities.
        tolerance: Residual at which the solver of the copies stops, m/s.
        envs: Slice of the environments; None selects all environments.
    """
    begin, end = (0, nominal.num_envs) if envs is None else (envs.start, envs.stop)
    levels, points, columns = stencil.offsets.shape[1:]
    largest = COPIES_PER_THREAD * (sim.threads or os.cpu_count() or 1)
    most = max(1, largest // (1 + levels * points * columns))
    size = -(-(end - begin) // -(-(end - begin) // most))
    # Steppers are reused only if each linearization overwrites everything in them: no drives, sensors, applied forces or parameters.
    reusable = sim.precision == "f64" and sim.sensors is None and sim.actuators is None and not nominal.applied and not nominal.randomized
    reusable = reusable and not any(block.field in RANDOMIZED for block in blocks)
    kept = _kept.pop(sim, {}) if reusable else {}
    used: dict[tuple[int, float], Stepper] = {}
    for first in range(begin, end, size):
        own = slice(first, min(first + size, end))
        offsets = stencil.offsets[own].reshape(own.stop - first, -1)
        index = np.repeat(np.arange(first, own.stop), 1 + offsets.shape[1])
        key = len(index), tolerance
        copies = used.get(key) or kept.get(key) or _stepper(sim, index, replace(sim.options, tolerance=tolerance))
        column = np.tile(np.arange(columns), (len(offsets), levels * points))
        ctrl = _displace(sim, copies, nominal, blocks, index=index, column=column, offsets=offsets)
        yield Part(own, 1 + offsets.shape[1], copies, ctrl)
        if reusable:
            used[key] = copies
    if reusable:
        _kept[sim] = used


def copies_of(sim: Stepper, nominal: Nominal, blocks: Sequence[Block], pairs: Pairs, options: Options) -> tuple[Stepper, Array]:
    """Perturbed copies for pairs of an environment and a column (one number to perturb).

    Each pair has an unperturbed copy, followed by one copy for each of its displacements, in which the column is displaced.

    Returns:
        Stepper of the copies, and the controls of the copies, (copies, nu).
    """
    offsets = pairs.offsets.reshape(len(pairs), -1)
    index = np.repeat(pairs.env, 1 + offsets.shape[1])
    copies = _stepper(sim, index, options)
    column = np.repeat(pairs.column[:, None], offsets.shape[1], axis=1)
    return copies, _displace(sim, copies, nominal, blocks, index=index, column=column, offsets=offsets)


def _displace(
    sim: Stepper,
    copies: Stepper,
    nominal: Nominal,
    blocks: Sequence[Block],
    *,
    index: NDArray[np.int64],
    column: NDArray[np.int64],
    offsets: Array,
) -> Array:
    """Sets the full state of copies to that of their environments, with one displaced number in each copy except the first of a group.

    Args:
        sim: The original stepper.
        copies: Stepper of the copies, in groups of equal size.
        nominal: State of the original environments.
        blocks: Quantities to perturb.
        index: Environment of each copy, (copies,).
        column: Column (perturbed number) that each copy after the first of its group displaces, (groups, copies of a group - 1).
        offsets: Displacements, in the same format, in the unit of the column.

    Returns:
        Controls of the copies, (copies, nu).
    """
    # The first copy of a group belongs to no column.
    columns, moves = np.insert(column, 0, -1, axis=1).reshape(-1), np.insert(offsets, 0, 0.0, axis=1).reshape(-1)
    flat = {name: value[index] for name, value in nominal.fields.items()}
    place = 0
    for block in blocks:
        moved = np.flatnonzero((columns >= place) & (columns < place + block.count))
        at = block.places[columns[moved] - place]
        if block.field == "qpos":
            displacement = np.zeros((len(moved), sim.model.nv))
            displacement[np.arange(len(moved)), at] = moves[moved]
            flat["qpos"][moved] = sim.model.integrate_pos(flat["qpos"][moved], displacement)
        else:
            flat[block.field][moved, at] += moves[moved]
        place += block.count
    _randomize(copies, nominal, blocks, flat, index)
    _restore(sim, copies, index)
    for name, value in nominal.applied.items():
        getattr(copies, name)[...] = value[index]
    copies.set_state(flat["qpos"], flat["qvel"], act=flat["act"], keep_warmstart=True)
    return flat["ctrl"]


def ends_of(sim: Stepper, count: int, *, sensors: bool) -> tuple[dict[str, Array], Array]:
    """States of copies after their steps, and their differences from the unperturbed first copy of their environment.

    Returns:
        "qpos", "qvel" and "act" by name, (num_envs, count, ...), and differences (num_envs, count, rows). Rows are qpos in tangent
        coordinates, qvel, act and the readings.
    """
    n = len(sim.qpos) // count
    end = {name: np.array(getattr(sim, name)) for name in STATE}
    end = {name: value.reshape(n, count, value.shape[1]) for name, value in end.items()}
    moved = sim.model.differentiate_pos(np.array(np.broadcast_to(end["qpos"][:, :1], end["qpos"].shape)), end["qpos"])
    outputs = [moved, end["qvel"] - end["qvel"][:, :1], end["act"] - end["act"][:, :1]]
    if sensors:
        truth = np.array(sim.sensordata_ideal)
        truth = truth.reshape(n, count, truth.shape[1])
        outputs.append(truth - truth[:, :1])
    return end, np.concatenate(outputs, axis=-1)


def replicas_of(sim: Stepper, nominal: Nominal, count: int, tolerance: float | None = None) -> Stepper:
    """Stepper with `count` unperturbed copies of every environment: all copies of the first one, then those of the second one, and so on.

    A copy has the full state of its environment and the options of the original stepper, except for the tolerance.

    Args:
        sim: The original stepper.
        nominal: State of its environments.
        count: Number of copies of each environment.
        tolerance: Residual at which the solver of the copies stops, m/s; None keeps the tolerance of the original stepper.
    """
    index = np.repeat(np.arange(nominal.num_envs), count)
    copies = _stepper(sim, index, replace(sim.options, tolerance=sim.tolerance if tolerance is None else tolerance))
    _randomize(copies, nominal, (), {}, index)
    _restore(sim, copies, index)
    for name, value in nominal.applied.items():
        getattr(copies, name)[...] = value[index]
    return copies


def _stepper(sim: Stepper, index: NDArray[np.int64], options: Options) -> Stepper:
    """Stepper whose environment k is a copy of environment `index[k]` of `sim`, before its state is set.

    Its drives and sensors have as much memory (delays, filters) as those of `sim`.
    """
    # The length of delay lines is that of the longest delay in any environment of the original, copied or not. The parameters of the
    # sensors do not matter, because only ideal readings are differentiated.

    def memory_of(own: Any) -> Any:
        """Copy of the sensor or actuator model `own` for the new stepper that `_stepper` creates.

        Delays and filters in the copy are as long as the longest ones in the stepper `sim`.
        """
        named = {name: _widest(part, sim, len(index)) for name, part in own.named.items()}
        return type(own)(named, default=_widest(own.default, sim, len(index)))

    sensors = None if sim.sensors is None else memory_of(sim.sensors)
    actuators = None if sim.actuators is None else memory_of(sim.actuators)
    copies = Stepper(sim.model, len(index), options=options, threads=sim.threads, seed=sim.seed, sensors=sensors, actuators=actuators)
    if sim.actuators is not None:
        copies.randomize(actuators=sim.actuators.chosen(index))
    return copies


def _widest(part: Any, sim: Stepper, count: int) -> Any:
    """Copy of an actuator's drive or a sensor's transfer function for `count` environments, with the longest delays and filters in `sim`.

    The first environment has the largest parameters and the longest delay of all environments of `sim`, and the others have the smallest.
    The copy thus has every part (delay, lag, integral) that any environment of `sim` has. Objects of other types are returned unchanged.
    """
    if not is_dataclass(part) or isinstance(part, type):
        return part
    units = {"delay": 1.0, "delay_steps": sim.timestep}
    total = sum((unit * np.asarray(getattr(part, name, 0.0), np.float64) for name, unit in units.items()), np.zeros(1))
    longest = int(np.argmax(total))

    def widest(value: Any, *, delays: bool) -> Any:
        """Values of one attribute for the `count` new environments: the largest value in the first one, the smallest in the others.

        A single number is returned unchanged.

        Args:
            value: Attribute of the drive or transfer function, with a value for each environment of `sim`.
            delays: Whether the first new environment gets the value from the environment with the longest total delay, instead of the
                largest value.
        """
        if isinstance(value, tuple):
            return tuple(widest(end, delays=False) for end in value)
        # A number, or a matrix that mixes the axes of a sensor, applies to all environments. A nested part, such as a motor, is copied.
        if value is None or isinstance(value, str) or is_dataclass(value) or np.size(value) == 1 or np.ndim(value) == 2:
            return _widest(value, sim, count)
        numbers = np.asarray(value, np.float64)
        out = np.full(count, numbers.min())
        out[0] = numbers[longest] if delays else numbers.max()
        return out

    return replace(part, **{field.name: widest(getattr(part, field.name), delays=field.name in units) for field in fields(part)})


def _randomize(copies: Stepper, nominal: Nominal, blocks: Sequence[Block], flat: dict[str, Array], index: NDArray[np.int64]) -> None:
    """Sets parameters of copies of the environments `index`, (copies,), to those of the originals, and perturbed ones to `flat`.

    `flat` has the perturbed arrays by field, one row per copy.
    """
    own: dict[str, Any] = {name: value.chosen(index) if name == "actuators" else value[index] for name, value in nominal.randomized.items()}
    for field in {block.field for block in blocks} & RANDOMIZED.keys():
        own[field] = flat[field].reshape(len(index), *np.shape(getattr(copies.model, field)))
    if own:
        try:
            copies.randomize(**own)
        except ModelError as error:
            # Remove the environment from the message, because it is the index of a copy.
            message = str(error).partition(": ")[2] if str(error).startswith("environment ") else str(error)
            raise ModelError(
                f"a parameter cannot be perturbed: {message}; list only perturbable elements in wrt, for example 'dof_damping[knee]'"
            ) from None


def _restore(sim: Stepper, copies: Stepper, index: NDArray[np.int64]) -> None:
    """Sets the whole state of every copy k to that of environment index[k] of `sim`, including memory that no attribute shows.

    With precision f32 only the time is copied.
    """
    if sim.precision == "f32":
        copies.set_state(time=rows(sim, "time")[index])
        return
    if sim.num_envs is None:
        copies.set_state(sim.get_state())
        return
    for env in np.unique(index):
        copies.set_state(sim.get_state(env=int(env)), envs=index == env)

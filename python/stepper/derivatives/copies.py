"""Perturbed copies of the environments of a stepper, stepped together in lanes and threads.

The stepper itself is only read. Copies start from the full state of its environments: configuration, velocity, activations, applied forces
and mocap poses. They also have its per-environment parameters, the solver's warm start, and the delays and integrals of drives.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._options import Options
from stepper._stepper import Model, ModelError, Stepper
from stepper.derivatives.nominal_mode import Pairs
from stepper.derivatives.perturbations import STATE, Array, Block, Stencil
from stepper.shared.fields import APPLIED, RANDOMIZED

ROOM = 1024
"""Copies that a thread steps in one call at the most, unless one environment alone needs more: that many stay in the caches of its core."""

_kept: WeakKeyDictionary[Stepper, dict[tuple[int, float], Stepper]] = WeakKeyDictionary()
"""Steppers of copies, by their number and tolerance, which the next linearization of the same stepper takes up."""


@dataclass(frozen=True)
class Nominal:
    """State of the nominal environments for copies, with the environments as the leading axis.

    Attributes:
        fields: "qpos", "qvel", "act", "ctrl" and, flat, every parameter that is perturbed.
        applied: Applied forces, unless all are 0, mocap poses, and equalities, unless they are the model's.
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
    """Snapshot of the environments of a stepper, with controls (num_envs, nu) or (nu,).

    Raises:
        ValueError: Controls of a wrong shape; a stepper in f32 whose drives have memory.
    """
    model, n = sim.model, sim.num_envs or 1
    if sim.precision == "f32" and sim.actuators is not None:
        raise ValueError(
            "a stepper with precision='f32' and actuators= cannot be linearized: derivatives are taken in f64, which cannot read "
            "the memory of its drives; make it with precision='f64'"
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
    # What copies begin with, but for mocap poses, which they have where the model has them.
    usual = {"qfrc_applied": 0.0, "xfrc_applied": 0.0, "eq_active": np.asarray(model.eq_active0)}
    kept = {name: value for name, value in applied.items() if value.size and (name not in usual or (value != usual[name]).any())}
    return Nominal(fields, kept, randomized)


def _controls(sim: Stepper, ctrl: ArrayLike | None) -> Array:
    """Controls of every environment, (num_envs, nu); None is those in force."""
    nu, n = sim.model.nu, sim.num_envs
    given = np.asarray(sim.ctrl if ctrl is None else ctrl, np.float64)
    if given.shape not in ((nu,), (n, nu)):
        must = f"({nu},)" if n is None else f"({n}, {nu}) or ({nu},)"
        raise ValueError(f"ctrl has shape {given.shape}, must be {must}")
    if not np.isfinite(given).all():
        raise ValueError("ctrl has a number that is not finite")
    return np.array(np.broadcast_to(given, (n or 1, nu)))


def rows(sim: Stepper, name: str) -> NDArray[Any]:
    """Array of a stepper with the environments as the leading axis, (num_envs, ...), in its unit, also with `num_envs=None`."""
    value = np.asarray(getattr(sim, name))
    return value[None] if sim.num_envs is None else value


@dataclass(frozen=True)
class Part:
    """Some environments and their copies: row e * count + k is copy k of environment e, and copy 0 is the nominal one.

    Attributes:
        envs: Slice of the environments.
        count: Copies of each.
        sim: Stepper of the copies, before the first step.
        ctrl: Their controls, (len * count, nu).
    """

    envs: slice
    count: int
    sim: Stepper
    ctrl: Array


def parts_of(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], stencil: Stencil, tolerance: float, *, envs: slice | None = None
) -> Iterator[Part]:
    """Perturbed copies of all environments or a slice of them, some environments at a time, ready to be stepped."""
    begin, end = (0, nominal.num_envs) if envs is None else (envs.start, envs.stop)
    levels, points, columns = stencil.offsets.shape[1:]
    room = ROOM * (sim.threads or os.cpu_count() or 1)
    most = max(1, room // (1 + levels * points * columns))
    size = -(-(end - begin) // -(-(end - begin) // most))
    # Nothing of a linearization is left in its copies that the next would not replace, except for what is no part of a state.
    plain = sim.precision == "f64" and sim.sensors is None and sim.actuators is None and not nominal.applied and not nominal.randomized
    plain = plain and not any(block.field in RANDOMIZED for block in blocks)
    kept = _kept.pop(sim, {}) if plain else {}
    used: dict[tuple[int, float], Stepper] = {}
    for first in range(begin, end, size):
        own = slice(first, min(first + size, end))
        part = _part(sim, nominal, blocks, stencil.offsets[own], envs=own, tolerance=tolerance, kept={**kept, **used})
        yield part
        if plain:
            used[len(part.ctrl), tolerance] = part.sim
    if plain:
        _kept[sim] = used


def _part(
    sim: Stepper,
    nominal: Nominal,
    blocks: Sequence[Block],
    offsets: Array,
    *,
    envs: slice,
    tolerance: float,
    kept: Mapping[tuple[int, float], Stepper],
) -> Part:
    n, levels, points, columns = offsets.shape
    count = 1 + levels * points * columns
    index = np.repeat(np.arange(envs.start, envs.stop), count)
    copies = kept.get((len(index), tolerance)) or _stepper(sim, index, replace(sim.options, tolerance=tolerance))
    fields = {name: np.repeat(value[envs], count, axis=0).reshape(n, count, value.shape[1]) for name, value in nominal.fields.items()}
    place = 0
    for block in blocks:
        # Copies of the block's columns, (levels, points, block.count), and where each of them is moved.
        copy = 1 + np.arange(levels * points * columns).reshape(levels, points, columns)[..., place : place + block.count].reshape(-1)
        moved = offsets[..., place : place + block.count].reshape(n, -1)
        _move(sim.model, fields, block, copy, moved)
        place += block.count
    flat = {name: value.reshape(n * count, value.shape[2]) for name, value in fields.items()}
    _randomize(copies, nominal, blocks, flat, index)
    _begin(sim, copies, nominal, flat, index)
    return Part(envs, count, copies, flat["ctrl"])


def copies_of(sim: Stepper, nominal: Nominal, blocks: Sequence[Block], pairs: Pairs, options: Options) -> tuple[Stepper, Array]:
    """Copies of environments that are displaced along one column each, and their controls, (rows, nu).

    Row k * count is the environment of pair k itself; the count - 1 rows behind it are displaced along the pair's column.
    """
    env, column, offsets = pairs.env, pairs.column, pairs.offsets.reshape(len(pairs), -1)
    count = 1 + offsets.shape[1]
    index = np.repeat(env, count)
    fields = {name: np.repeat(value[env], count, axis=0).reshape(len(env), count, value.shape[1]) for name, value in nominal.fields.items()}
    place = 0
    for block in blocks:
        own = np.flatnonzero((column >= place) & (column < place + block.count))
        field, at = fields[block.field], block.places[column[own] - place]
        if block.field == "qpos":
            displacement = np.zeros((len(own), count, sim.model.nv))
            displacement[np.arange(len(own)), 1:, at] = offsets[own]
            field[own] = sim.model.integrate_pos(field[own], displacement)
        else:
            field[own, 1:, at] += offsets[own]
        place += block.count
    flat = {name: value.reshape(len(index), value.shape[2]) for name, value in fields.items()}
    copies = _stepper(sim, index, options)
    _randomize(copies, nominal, blocks, flat, index)
    _begin(sim, copies, nominal, flat, index)
    return copies, flat["ctrl"]


def ends_of(sim: Stepper, count: int, *, sensors: bool) -> tuple[dict[str, Array], Array]:
    """Final states of the copies (`count` for each environment), and their differences from the first copy, (num_envs, count, rows)."""
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
    """Stepper with `count` copies of every environment in a row, with its options and the full state of the environments.

    Steps are solved to the stepper's own tolerance, or to another, m/s.
    """
    index = np.repeat(np.arange(nominal.num_envs), count)
    copies = _stepper(sim, index, replace(sim.options, tolerance=sim.tolerance if tolerance is None else tolerance))
    _randomize(copies, nominal, (), {}, index)
    _restore(sim, copies, index)
    for name, value in nominal.applied.items():
        getattr(copies, name)[...] = value[index]
    return copies


def _move(model: Model, fields: dict[str, Array], block: Block, copy: NDArray[np.int64], moved: Array) -> None:
    """Displaces the copies of one block: copy[j] by moved[:, j] in the place of its column."""
    field = fields[block.field]
    if not len(copy):
        return
    place = np.tile(block.places, len(copy) // block.count)
    if block.field == "qpos":
        displacement = np.zeros((len(field), len(copy), model.nv))
        displacement[:, np.arange(len(copy)), place] = moved
        field[:, copy] = model.integrate_pos(field[:, copy], displacement)
    else:
        field[:, copy, place] += moved


def _stepper(sim: Stepper, index: NDArray[np.int64], options: Options) -> Stepper:
    # Delay lines are as long as the longest of all environments, whichever of them are copied; nothing reads what the copies' sensors
    # observe, whose ideal readings are those that are differentiated.
    def memory_of(own: Any) -> Any:
        named = {name: _widest(part, sim, len(index)) for name, part in own.named.items()}
        return type(own)(named, default=_widest(own.default, sim, len(index)))

    sensors = None if sim.sensors is None else memory_of(sim.sensors)
    actuators = None if sim.actuators is None else memory_of(sim.actuators)
    copies = Stepper(sim.model, len(index), options=options, threads=sim.threads, seed=sim.seed, sensors=sensors, actuators=actuators)
    if sim.actuators is not None:
        copies.randomize(actuators=sim.actuators.chosen(index))
    return copies


def _widest(part: Any, sim: Stepper, count: int) -> Any:
    """A drive or transfer for `count` environments whose memory is as large as the stepper's, whatever environments are copied.

    The first has the largest numbers and the longest delay of all, the others the smallest: every stage that any of them has is there.
    """
    if not is_dataclass(part) or isinstance(part, type):
        return part
    units = {"delay": 1.0, "delay_steps": sim.timestep}
    total = sum((unit * np.asarray(getattr(part, name, 0.0), np.float64) for name, unit in units.items()), np.zeros(1))
    longest = int(np.argmax(total))

    def new(value: Any, *, delays: bool) -> Any:
        if isinstance(value, tuple):
            return tuple(new(end, delays=False) for end in value)
        # One number is for all environments, and a matrix mixes the axes of a sensor in all of them.
        if value is None or isinstance(value, str) or is_dataclass(value) or np.size(value) == 1 or np.ndim(value) == 2:
            return _widest(value, sim, count)
        numbers = np.asarray(value, np.float64)
        out = np.full(count, numbers.min())
        out[0] = numbers[longest] if delays else numbers.max()
        return out

    return replace(part, **{field.name: new(getattr(part, field.name), delays=field.name in units) for field in fields(part)})


def _randomize(copies: Stepper, nominal: Nominal, blocks: Sequence[Block], flat: dict[str, Array], index: NDArray[np.int64]) -> None:
    own: dict[str, Any] = {name: value.chosen(index) if name == "actuators" else value[index] for name, value in nominal.randomized.items()}
    for field in {block.field for block in blocks} & RANDOMIZED.keys():
        own[field] = flat[field].reshape(len(index), *np.shape(getattr(copies.model, field)))
    if own:
        try:
            copies.randomize(**own)
        except ModelError as error:
            # The environment that the message names is a copy's.
            said = str(error).partition(": ")[2] if str(error).startswith("environment ") else str(error)
            raise ModelError(f"a parameter cannot be perturbed: {said}; name those that can in wrt, as 'dof_damping[knee]'") from None


def _begin(sim: Stepper, copies: Stepper, nominal: Nominal, flat: dict[str, Array], index: NDArray[np.int64]) -> None:
    """Gives copies the memory and the applied forces of their environments, and separate states."""
    _restore(sim, copies, index)
    for name, value in nominal.applied.items():
        getattr(copies, name)[...] = value[index]
    copies.set_state(flat["qpos"], flat["qvel"], act=flat["act"], keep_warmstart=True)


def _restore(sim: Stepper, copies: Stepper, index: NDArray[np.int64]) -> None:
    """Gives every copy k the whole state of environment index[k], the memory that no attribute shows included.

    A state goes from one environment to a mask of others: environments are copied one by one, and stepped together.
    """
    if sim.precision == "f32":
        copies.set_state(time=rows(sim, "time")[index])
        return
    if sim.num_envs is None:
        copies.set_state(sim.get_state())
        return
    for env in np.unique(index):
        copies.set_state(sim.get_state(env=int(env)), envs=index == env)

"""Measurements: episodes with controls and readings, from recordings, CSV and npz files, and from arrays.

A log (CSV or npz) has one row per sample, at equal intervals of time. Its columns are `time` (s), `ctrl` (the controls from this row's
time to the next row's), and channels, which are readings at this row's time. A channel is named after a sensor of the model, or is "qpos",
"qvel" or "act", or "qpos:elbow" and "qvel:elbow" for one joint. In npz files a channel is an array (rows,) or (rows, dim). In CSV files
every column is a number; columns of a vector are "wrist_force[0]", "wrist_force[1]" ... An empty cell, or NaN, means not measured.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper._stepper import Model
from stepper.recording import HEADER, segments
from stepper.shared.arguments import check_mapping, check_number
from stepper.shared.fields import APPLIED
from stepper.shared.files import existing, read_arrays, read_csv
from stepper.sysid.inertia import Array

COORDINATES = ("qpos", "qvel", "act")
"""Channels that are parts of the state."""
FORCES_AND_POSES = tuple(name for name in APPLIED if name != "eq_active")
"""Names of the applied forces and mocap poses that an episode can have."""


@dataclass(frozen=True)
class Episode:
    """Measured motion from a known or uncertain initial state, with its controls and readings.

    Attributes:
        ctrl: Controls of each of the T periods, (T, nu), in the actuators' units.
        readings: Readings at the end of each period, by channel: (T, dim) or (T,), in the channel's unit; NaN means not measured. A channel
            is the name of a sensor, or "qpos", "qvel", "act", "qpos:JOINT" or "qvel:JOINT".
        period: Control period, s; a whole multiple of the time step.
        qpos, qvel, act: Initial state: (nq,) m and rad, (nv,) m/s and rad/s, (na,). None uses the model's reference pose, zero velocity
            and zero activation.
        start_std: Standard deviations of the initial position (as a displacement in the degrees of freedom, m and rad) and velocity (m/s
            and rad/s), each a number or (nv,). `identify` then estimates the initial state too. None means an exact initial state.
        applied: Applied forces and mocap poses in each period, by name of the attribute of `Stepper`, such as "xfrc_applied". Each is
            (T, ...), with the shape of the attribute in one environment.
        name: Name of the episode in error messages.
        notes: Assumptions that were made when a file was read; `identify` adds them to its warnings.
    """

    ctrl: ArrayLike
    readings: Mapping[str, ArrayLike]
    period: float
    qpos: ArrayLike | None = None
    qvel: ArrayLike | None = None
    act: ArrayLike | None = None
    start_std: tuple[ArrayLike, ArrayLike] | None = None
    applied: Mapping[str, ArrayLike] = field(default_factory=dict)
    name: str = "episode"
    notes: tuple[str, ...] = ()

    def checked(self, model: Model) -> Episode:
        """Returns a copy of this episode with float64 arrays, after a check of their shapes against a model.

        Raises:
            ValueError: A shape is wrong, a control is not finite, or there are no readings. The message has the episode's name.
        """
        try:
            return self._checked(model)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.name}: {error}") from None

    def _checked(self, model: Model) -> Episode:
        """This episode with arrays of float64, after a check against a model; a ValueError for wrong shapes or values."""
        check_number("period (s)", self.period, above=0.0)
        ctrl = array_of("ctrl", self.ctrl)
        if ctrl.ndim != 2 or ctrl.shape[1] != model.nu or not len(ctrl):
            raise ValueError(f"ctrl has shape {ctrl.shape}, must be (T, {model.nu}) with one row or more")
        if not np.isfinite(ctrl).all():
            raise ValueError(f"ctrl of row {int(np.argwhere(~np.isfinite(ctrl))[0, 0])} is not finite; every period needs its control")
        check_mapping("readings", self.readings, "{'qpos': array}")
        check_mapping("applied", self.applied, "{'xfrc_applied': array}")
        if not self.readings:
            raise ValueError("readings is empty; give the readings of a sensor of the model, or of qpos or qvel, as {'qpos': array}")
        readings = {name: _rows(name, given, len(ctrl)) for name, given in self.readings.items()}
        if not any(np.isfinite(array).any() for array in readings.values()):
            raise ValueError("all readings are NaN, which means not measured; give measured ones")
        qpos = vector("qpos", model.qpos0 if self.qpos is None else self.qpos, model.nq)
        qvel = vector("qvel", np.zeros(model.nv) if self.qvel is None else self.qvel, model.nv)
        act = vector("act", np.zeros(model.na) if self.act is None else self.act, model.na)
        std = self.start_std
        if std is not None:
            if not isinstance(std, Sequence) or isinstance(std, str) or len(std) != 2:
                raise TypeError(f"start_std is {std!r}, must be two values, of positions and of velocities, as (0.01, 0.1)")
            std = tuple(array_of("start_std", s) for s in std)  # type: ignore[assignment]
            if any(np.shape(s) not in ((), (model.nv,)) for s in std or ()):
                raise ValueError(f"start_std has shapes {[np.shape(s) for s in std or ()]}, each must be () or ({model.nv},)")
            std = tuple(np.broadcast_to(s, (model.nv,)) for s in std or ())  # type: ignore[assignment]
            if not all(np.isfinite(s).all() and (np.asarray(s) >= 0).all() for s in std or ()):
                raise ValueError("start_std has a standard deviation that is negative or not finite; 0 takes a coordinate as exact")
        applied = {name: array_of(f"applied[{name!r}]", given) for name, given in self.applied.items()}
        for name, array in applied.items():
            if name not in FORCES_AND_POSES:
                raise ValueError(f"applied has {name!r}, there are: {', '.join(FORCES_AND_POSES)}")
            if np.shape(array)[:1] != (len(ctrl),):
                raise ValueError(f"applied[{name!r}] has shape {array.shape}, must have {len(ctrl)} rows, one per row of ctrl")
        return replace(self, ctrl=ctrl, readings=readings, start_std=std, applied=applied, qpos=qpos, qvel=qvel, act=act)


def _rows(name: str, given: ArrayLike, count: int) -> Array:
    """Readings of the channel `name`, (count,) or (count, dim), as an array (count, dim) float64, after a check."""
    array = array_of(f"channel {name!r}", given)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or len(array) != count:
        raise ValueError(f"channel {name!r} has shape {array.shape}, must have {count} rows, one per row of ctrl")
    if np.isinf(array).any():
        row = int(np.argwhere(np.isinf(array))[0, 0])
        raise ValueError(f"channel {name!r} has an infinite reading in row {row}; NaN is not measured")
    return array


def vector(name: str, given: ArrayLike, size: int) -> Array:
    """Initial qpos, qvel or act as an array (size,), in its unit, after a check. `name` is its name in error messages."""
    array = array_of(f"{name} at the start", given)
    if array.shape != (size,):
        raise ValueError(f"{name} at the start has shape {array.shape}, must be ({size},)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}[{int(np.flatnonzero(~np.isfinite(array))[0])}] at the start is not finite; give {size} finite numbers")
    return array


Data = Any
"""An `Episode`, the path of a recording, CSV or npz file, or several of these."""


def episodes_of(
    data: Data,
    model: Model,
    *,
    channels: Sequence[str] | None = None,
    columns: Mapping[str, str] | None = None,
    start: str | tuple[ArrayLike, ArrayLike] | None = None,
) -> list[Episode]:
    """Reads episodes from the argument `data` of `identify`.

    Args:
        data: An episode, a path of a recording, CSV or npz file, or a list of these.
        model: Model with the sensors, joints and actuators of the measurements.
        channels: Names of the channels to use from files. None selects all sensors of a recording, and all channels of a log.
        columns: New names of columns of a CSV file, or of arrays of an npz file: {"Fx [N]": "wrist_force[0]"}.
        start: Initial state of logs whose first row does not have it: name of a keyframe, or (qpos, qvel). None uses the model's reference
            pose at rest, with a note in `Episode.notes`.

    Returns:
        Checked episodes; a recording gives one for each environment and each stretch between resets.

    Raises:
        TypeError: `data` has another type.
        ValueError: A file lacks required data; the message has the file and the place.
        OSError: A file cannot be read.
    """
    parts = data if isinstance(data, list | tuple) else [data]
    found: list[Episode] = []
    for part in parts:
        if isinstance(part, Episode):
            found.append(part.checked(model))
        elif isinstance(part, str | os.PathLike):
            found += [episode.checked(model) for episode in _read(Path(part), model, channels, dict(columns or {}), start)]
        else:
            raise TypeError(
                f"data has {part!r} ({type(part).__name__}), must be a stepper.sysid.Episode, or the path of a recording, .csv or .npz file"
            )
    if not found:
        raise ValueError("data has no episode; give an Episode, or the path of a recording, .csv or .npz file")
    return found


def _read(path: Path, model: Model, channels: Sequence[str] | None, columns: dict[str, str], start: Any) -> list[Episode]:
    """Episodes of one recording, CSV file or npz file; arguments as in `episodes_of`."""
    if os.path.exists(path / HEADER):
        return _of_recording(path, model, channels)
    if os.path.isdir(path) or path.suffix not in (".csv", ".npz"):
        if not os.path.exists(path):
            existing(path, "data")
        raise ValueError(f"{path} is neither a recording (a folder with {HEADER}) nor a .csv or .npz file; give the path of one of these")
    existing(path, "log")
    table = _csv(path) if path.suffix == ".csv" else read_arrays(path, "log")
    if missing := sorted(set(columns) - set(table)):
        raise ValueError(f"{path}: there is no column {missing[0]!r}, there are: {', '.join(table)}")
    table = {columns.get(name, name): values for name, values in table.items()}
    try:
        return [_of_log(path, _gathered(table), model, channels, start)]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _csv(path: Path) -> dict[str, Array]:
    """Columns of a CSV file of numbers, (rows,) each, by heading; empty cells are NaN."""
    rows = read_csv(path, "log")
    if len(rows) < 3:
        raise ValueError(f"{path}: it has {len(rows)} lines, must have a heading and two rows or more")
    head = [name.strip() for name in rows[0]]
    if twice := {name for name in head if head.count(name) > 1}:
        raise ValueError(f"{path}: two columns are called {sorted(twice)[0]!r}")
    table = np.full((len(rows) - 1, len(head)), np.nan)
    for k, row in enumerate(rows[1:]):
        if len(row) != len(head):
            raise ValueError(f"{path}, line {k + 2}: {len(row)} cells, must be {len(head)}, as the heading has")
        for j, cell in enumerate(row):
            try:
                table[k, j] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise ValueError(f"{path}, line {k + 2}, column {head[j]!r}: {cell!r} is no number; leave the cell empty instead") from None
    return {name: table[:, j] for j, name in enumerate(head)}


def _gathered(table: dict[str, Array]) -> dict[str, Array]:
    """Copy of a table in which columns named "name[0]", "name[1]" ... are joined to one array "name", (rows, n)."""
    out: dict[str, Array] = {}
    parts: dict[str, dict[int, Array]] = {}
    for name, values in table.items():
        if match := re.fullmatch(r"(.+)\[(\d+)\]", name):
            parts.setdefault(match[1], {})[int(match[2])] = values
        else:
            out[name] = values
    for name, columns in parts.items():
        if sorted(columns) != list(range(len(columns))) or name in out:
            raise ValueError(f"columns of {name!r} are numbered {sorted(columns)}, must be from [0] on without a gap")
        out[name] = np.stack([columns[k] for k in range(len(columns))], axis=1)
    return out


def _of_log(path: Path, table: dict[str, Array], model: Model, channels: Sequence[str] | None, start: Any) -> Episode:
    """Episode of a log, a CSV or npz file with one row per sample; arguments as in `episodes_of`.

    `table` has the columns by name, (rows,) or (rows, dim) each. "time", "ctrl" and applied forces are removed from it. The episode has
    rows - 1 periods: period k has the controls of row k and the readings of row k + 1.
    """
    if "time" not in table:
        raise ValueError("there is no column 'time'; add one in s, or rename one with columns={...: 'time'}")
    time = np.asarray(table.pop("time"), np.float64).ravel()
    steps = np.diff(time)
    period = float((time[-1] - time[0]) / len(steps)) if len(steps) else 0.0
    if not np.isfinite(time).all() or not (np.abs(steps - period) < 0.01 * period).all():
        worst = int(np.nanargmax(np.abs(steps - period))) if len(steps) else 0
        raise ValueError(f"times are not equally spaced (row {worst + 1}); resample the log to one rate")
    ctrl = np.asarray(table.pop("ctrl", np.zeros((len(time), 0))), np.float64).reshape(len(time), -1)
    if ctrl.shape[1] != model.nu:
        raise ValueError(f"ctrl has {ctrl.shape[1]} columns, must have {model.nu}: {', '.join(model.actuator_names)}")
    applied = {name: np.asarray(table.pop(name))[:-1] for name in FORCES_AND_POSES if name in table}
    state: dict[str, Any] = {}
    notes = []
    given = _start(model, start)
    for name in COORDINATES:
        if name in table and np.isfinite(table[name][0]).all():
            state[name] = np.asarray(table[name][0], np.float64).ravel()
        elif name in given:
            state[name] = given[name]
        elif name != "act" or model.na:
            notes.append(f"{path} has no {name} in its first row: the model's reference is used; give start=, or a column {name}")
    for name in channels or ():
        if name not in table:
            raise ValueError(f"there is no channel {name!r}, there are: {', '.join(table)}")
    readings = {name: np.asarray(values, np.float64)[1:] for name, values in table.items() if channels is None or name in channels}
    return Episode(ctrl[:-1], readings, period, applied=applied, name=str(path), notes=tuple(notes), **state)


def _start(model: Model, start: Any) -> dict[str, Array]:
    """Initial qpos, qvel and act by name, from a keyframe's name or (qpos, qvel); empty for None."""
    if start is None:
        return {}
    if isinstance(start, str):
        key = model.keyframe(start)
        return {"qpos": key.qpos, "qvel": key.qvel, "act": key.act}
    qpos, qvel = start
    return {"qpos": np.asarray(qpos, np.float64), "qvel": np.asarray(qvel, np.float64)}


def _of_recording(path: Path, model: Model, channels: Sequence[str] | None) -> list[Episode]:
    """Episodes of a recording: one for each environment and each stretch between resets; arguments as in `episodes_of`."""
    episodes = []
    for segment in segments(path):
        own = {name: (sensor["adr"], sensor["dim"]) for sensor in segment.model.sensors if (name := sensor["name"])}
        if segment.model.nu != model.nu or segment.model.nq != model.nq or segment.model.nv != model.nv:
            sizes = [f"{m.nq} coordinates and {m.nu} controls" for m in (segment.model, model)]
            raise ValueError(f"{path} was recorded with a model of {sizes[0]}, this one has {sizes[1]}")
        for name in channels or ():
            if name not in own and name not in COORDINATES:
                raise ValueError(f"{path}: there is no channel {name!r}, there are: {', '.join((*own, *COORDINATES))}")
        if not own and channels is None:
            raise ValueError(f"{path}: its model has no sensor with a name; choose channels=['qpos', 'qvel'] instead")
        for env in range(segment.ctrl.shape[1]):
            readings = {}
            for name in own if channels is None else channels:
                rows = (
                    segment.readings["sensordata"][:, env, own[name][0] : sum(own[name])] if name in own else segment.readings[name][:, env]
                )
                readings[name] = rows
            qpos, qvel, act = (segment.start[name][env] for name in COORDINATES)
            applied = {name: array[:, env] for name, array in segment.applied.items()}
            name = f"{path}, from row {segment.row}, environment {env}"
            episodes.append(Episode(segment.ctrl[:, env], readings, segment.period, qpos, qvel, act, applied=applied, name=name))
    return episodes

"""Simulated readings of episodes for many parameter vectors at once.

There is one environment for each pair of parameter vector (variant) and episode. Fields of `Stepper.randomize` differ between environments.
Other fields, such as principal axes of an inertia, get a separate stepper for each value.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper._hints import did_you_mean_or_all
from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.actuators import ActuatorModel, Drive
from stepper.shared.arguments import check_kind
from stepper.shared.fields import RANDOMIZED
from stepper.shared.rotations import rotation_vectors
from stepper.sysid.data import COORDINATES, Episode
from stepper.sysid.inertia import Array
from stepper.sysid.parameters import READING, Block, Variants, split, write

MAX_PREDICTION_BYTES = 64 << 20
"""Largest size of the predictions of one call of `rollout`, bytes. Larger ones are split into several calls."""
TOLERANCE = 1e-9
"""Default solver tolerance, m/s. It is small, because finite differences divide the solver's error by their step."""
UNTRUSTED = Status.NOT_CONVERGED | Status.NON_FINITE | Status.CONTACTS_FULL | Status.TUNNELLED
"""Status flags of time steps with unreliable predictions."""


@dataclass(frozen=True)
class Channel:
    """Channel of the measurements, with the place of its prediction in the results of `Stepper.rollout`.

    Attributes:
        name: Name of the channel.
        field: Name of the array in the results of `Stepper.rollout` that contains the prediction.
        columns: Columns of this array that belong to the channel.
        dofs: For "qpos", degrees of freedom in which the difference of two poses is expressed; otherwise empty.
        quaternion: Whether the reading is a quaternion.
        lines: Columns of the channel in arrays of all readings, (T, width).
        sensor: Index of the sensor; -1 if the channel is a part of the state.
    """

    name: str
    field: str
    columns: tuple[int, ...]
    dofs: tuple[int, ...]
    quaternion: bool
    lines: slice
    sensor: int


def channels_of(model: Model, episodes: Sequence[Episode]) -> list[Channel]:
    """Channels of the readings of some episodes, in order of appearance, with adjacent columns in the array of all readings.

    Raises:
        KeyError: A channel is neither a sensor nor a coordinate of the model.
        ValueError: A channel has another number of columns than in the model.
    """
    found: dict[str, Channel] = {}
    width = 0
    for episode in episodes:
        for name, given in episode.readings.items():
            if name not in found:
                found[name] = _channel(model, name, width)
                width = found[name].lines.stop
            if np.shape(given)[1] != len(found[name].columns):
                raise ValueError(f"{episode.name}: channel {name!r} has {np.shape(given)[1]} columns, must have {len(found[name].columns)}")
    return list(found.values())


def _channel(model: Model, name: str, width: int) -> Channel:
    """Channel of a sensor, "qpos", "qvel", "act", "qpos:JOINT" or "qvel:JOINT"; its first column has the index `width`."""
    if name in model.sensor_names:
        sensor = model.sensor(name)
        quaternion = model.sensors[sensor.id]["datatype"] == "quaternion"
        dim = 3 if quaternion else sensor.dim
        return Channel(
            name, "sensordata", tuple(range(sensor.adr, sensor.adr + sensor.dim)), (), quaternion, slice(width, width + dim), sensor.id
        )
    head, _, joint = name.partition(":")
    if head in COORDINATES and not joint:
        size = {"qpos": model.nq, "qvel": model.nv, "act": model.na}[head]
        dofs = tuple(range(model.nv)) if head == "qpos" else ()
        return Channel(name, head, tuple(range(size)), dofs, False, slice(width, width + (len(dofs) or size)), -1)
    if head in ("qpos", "qvel") and joint in model.joint_names:
        own = model.joint(joint)
        dofs = tuple(range(own.dofadr, own.dofadr + own.nv))
        columns = tuple(range(own.qposadr, own.qposadr + own.nq)) if head == "qpos" else dofs
        return Channel(name, head, columns, dofs if head == "qpos" else (), False, slice(width, width + own.nv), -1)
    known = [*(n for n in model.sensor_names if n), *COORDINATES, *(f"qpos:{n}" for n in model.joint_names if n)]
    raise KeyError(f"no sensor or coordinate is named {name!r}{did_you_mean_or_all(name, known)}")


def find_channels(model: Model, names: Iterable[str]) -> list[Channel]:
    """Channels by name, in order, with adjacent columns in the array of all readings.

    Raises:
        KeyError: A name is neither a sensor nor a coordinate of the model.
    """
    found: list[Channel] = []
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f"channel is {name!r}, must be the name of a sensor of the model, or 'qpos', 'qvel' or 'act'")
        found.append(_channel(model, name, found[-1].lines.stop if found else 0))
    return found


def noise_of(channel: Channel, given: ArrayLike) -> Array:
    """Standard deviation of each column in `Channel.lines`, (dim,); infinite ones mark columns that are ignored.

    Raises:
        ValueError: A standard deviation is not above 0, or their number is wrong.
    """
    value = array_of(f"noise of {channel.name!r}", given)
    size = channel.lines.stop - channel.lines.start
    if value.shape not in ((), (size,)) or not (value > 0).all():
        raise ValueError(f"noise of {channel.name!r} is {value.tolist()}, must be above 0, one number or {size}")
    return np.broadcast_to(value, (size,))


def compared(model: Model, channel: Channel, rows: Array, measured: Array) -> Array:
    """Predictions of a channel, (T, count, dim), in its unit.

    For "qpos" and quaternions they are displacements from the measured values, m or rad.

    Args:
        model: The model.
        channel: The channel.
        rows: Predictions of the channel's field, (T, count, columns), in its unit.
        measured: Readings of the channel, (T, columns of the channel). In rows with NaN, displacements are 0.
    """
    own = rows[..., list(channel.columns)]
    if not channel.dofs and not channel.quaternion:
        return own
    target = measured[:, None]
    target = np.where(np.isfinite(target).all(axis=-1, keepdims=True), target, own)
    if channel.quaternion:
        return rotation_vectors(target, own)
    whole = rows.copy()
    whole[..., list(channel.columns)] = target
    return np.asarray(model.differentiate_pos(whole, rows)[..., list(channel.dofs)])


def solved(options: Options) -> Options:
    """Copy of the user's options of the step, in which `TOLERANCE` is the solver tolerance if the user has not set one."""
    check_kind("options", options, Options, "write stepper.Options(...)")
    return options if options.tolerance is not None else replace(options, tolerance=TOLERANCE)


class Simulator:
    """Simulator of the readings of episodes.

    Arrays of readings are (T, width): one row for each of the T control periods, and the columns of all channels.

    Args:
        model: Model with the unknown parameters at the start of the search.
        episodes: Checked episodes.
        blocks: Unknown parameters.
        options, threads, actuators: Arguments of `Stepper`.

    Attributes:
        measured: Readings of each episode, (T, width); NaN means not measured. Columns of "qpos" and of quaternions contain 0 instead of
            the reading, because their predictions are displacements from the reading.
        untrusted: Fraction of the steps in the last call of `predict` with a flag of `UNTRUSTED`.
        steps: Number of simulated time steps so far, summed over environments.
    """

    def __init__(
        self,
        model: Model,
        episodes: Sequence[Episode],
        blocks: Sequence[Block],
        options: Options,
        *,
        threads: int,
        actuators: ActuatorModel | None,
    ):
        self.model, self.episodes, self.blocks, self.options, self.threads = model, list(episodes), list(blocks), options, threads
        self.channels = channels_of(model, episodes)
        self.width = self.channels[-1].lines.stop
        self.fields = sorted({channel.field for channel in self.channels})
        self._drives = _with_longest_delays(actuators, self.blocks)
        self._known = actuators
        self._steppers: dict[tuple[str, int], Stepper] = {}
        self.timestep = float(Stepper(model, options=options).timestep)
        self._readers = [block for block in self.blocks if block.parameter.kind in READING]
        self._fine = any(block.parameter.kind == "sensor.delay" for block in self.blocks)
        for block in self._readers:
            if unread := [name for name in block.names if name not in {channel.name for channel in self.channels}]:
                raise ValueError(
                    f"{block.parameter}: the data have no channel {unread[0]!r}, there are: {', '.join(c.name for c in self.channels)}"
                )
        self.nstep = [self._nstep(episode) for episode in episodes]
        self.measured = [self._measured(episode) for episode in episodes]
        self.untrusted, self.steps = 0.0, 0

    def with_episodes(self, episodes: Sequence[Episode]) -> Simulator:
        """Simulator with the settings of this one for other episodes."""
        return Simulator(self.model, episodes, self.blocks, self.options, threads=self.threads, actuators=self._known)

    def _nstep(self, episode: Episode) -> int:
        """Number of time steps per control period of an episode; a ValueError if it is no whole number."""
        ratio = episode.period / self.timestep
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-3 * ratio:
            near = episode.period / max(1, round(ratio))
            raise ValueError(
                f"{episode.name}: a sample every {episode.period:g} s is no whole number of time steps of {self.timestep:g} s; "
                f"choose options=stepper.Options(timestep={near:.6g})"
            )
        return round(ratio)

    def _measured(self, episode: Episode) -> Array:
        """Readings of an episode in the columns of all channels, (T, width); NaN means not measured.

        Columns of "qpos" and of quaternions contain 0 instead of the reading, because their predictions are displacements from it.
        """
        out = np.full((len(np.asarray(episode.ctrl)), self.width), np.nan)
        for channel in self.channels:
            given = episode.readings.get(channel.name)
            if given is None:
                continue
            array = np.asarray(given)
            if channel.dofs or channel.quaternion:
                out[:, channel.lines] = np.where(np.isfinite(array).all(axis=1, keepdims=True), 0.0, np.nan)
            else:
                out[:, channel.lines] = array
        return out

    def predict(self, theta: Array, starts: Sequence[tuple[Array, Array] | None] | None = None) -> list[Array]:
        """Predicted readings of every episode, (count, T, width) each, in the units of the channels.

        Args:
            theta: Parameter vectors, (count, n).
            starts: Displacements of the initial positions (count, nv), m and rad, and velocities (count, nv), m/s and rad/s, for each
                episode; None means 0.
        """
        # Variants that differ only in parameters of sensors share one simulation, because these do not change the motion.
        moving = np.array([block.parameter.kind not in READING for block in self.blocks for _ in range(block.size)])
        key = theta * moving
        if starts is not None:
            key = np.concatenate([key, *(np.concatenate(s, axis=1) for s in starts if s is not None)], axis=1)
        _, first, back = np.unique(key, axis=0, return_index=True, return_inverse=True)
        back = back.reshape(-1)
        kept = [None] * len(self.episodes) if starts is None else [None if s is None else (s[0][first], s[1][first]) for s in starts]
        out: list[Array] = [np.empty(0)] * len(self.episodes)
        flagged = total = 0
        for group in self._groups():
            made, bad, all_ = self._run(theta[first], group, [kept[e] for e in group])
            flagged, total = flagged + bad, total + all_
            for e, y in zip(group, made, strict=True):
                out[e] = y
        self.untrusted = flagged / max(total, 1)
        return [self._read(y[back], theta, nstep) for y, nstep in zip(out, self.nstep, strict=True)]

    def _groups(self) -> list[list[int]]:
        """Groups of indices of episodes that one rollout can simulate: equal steps per period and equal kinds of applied forces."""
        groups: dict[Any, list[int]] = {}
        for e, episode in enumerate(self.episodes):
            groups.setdefault((self.nstep[e], tuple(sorted(episode.applied))), []).append(e)
        return list(groups.values())

    def _run(self, theta: Array, group: list[int], starts: list[tuple[Array, Array] | None]) -> tuple[list[Array], int, int]:
        """Predictions of the episodes of a group for all parameter vectors, (count, n).

        `starts` has displacements of the initial positions and velocities of each episode; None means 0. Returns predictions by episode,
        (count, T, width); number of time steps with flags of `UNTRUSTED`; number of all time steps.
        """
        variants = write(self.blocks, theta, self.model)
        shared = {name: array for name, array in variants.fields.items() if name not in RANDOMIZED}
        count = len(theta)
        kinds = np.zeros(count, int)
        if shared:
            rows = np.concatenate([array.reshape(count, -1) for array in shared.values()], axis=1)
            kinds = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
        length = max(len(np.asarray(self.episodes[e].ctrl)) for e in group) * (self.nstep[group[0]] if self._fine else 1)
        size = 8 * length * len(group) * (self.model.nq + self.model.nv + self.model.nsensordata + 2)
        out = [np.empty((count, len(self.measured[e]) * (self.nstep[e] if self._fine else 1), self.width)) for e in group]
        flagged = total = 0
        for kind in range(kinds.max() + 1):
            mine = np.flatnonzero(kinds == kind)
            model = self.model.replace(**{name: array[mine[0]] for name, array in shared.items()}) if shared else self.model
            for part in np.array_split(mine, max(1, -(-size * len(mine) // MAX_PREDICTION_BYTES))):
                bad, all_ = self._roll(model, variants, part, group, starts=starts, out=out)
                flagged, total = flagged + bad, total + all_
        return out, flagged, total

    def _roll(
        self,
        model: Model,
        variants: Variants,
        part: np.ndarray[Any, Any],
        group: list[int],
        *,
        starts: list[tuple[Array, Array] | None],
        out: list[Array],
    ) -> tuple[int, int]:
        """Simulates the variants `part` of a model in all episodes of a group, and writes the predictions to `out`, (count, T, width) each.

        Returns the number of time steps with flags of `UNTRUSTED`, and the number of all time steps. Other arguments are those of `_run`.
        """
        E, episodes, nstep = len(group), [self.episodes[e] for e in group], self.nstep[group[0]]
        index = np.repeat(part, E)
        sim = self._stepper(model, len(index))
        own = {name: array[index] for name, array in variants.fields.items() if name in RANDOMIZED}
        actuators = variants.actuators(self._known, index)
        if own or actuators is not None:
            drawn: dict[str, Any] = {**own, **({} if actuators is None else {"actuators": actuators})}
            sim.randomize(**drawn)
        qpos, qvel, act = (np.tile(np.stack([np.asarray(getattr(e, name)) for e in episodes]), (len(part), 1, 1)) for name in COORDINATES)
        for k, start in enumerate(starts):
            if start is not None:
                qpos[:, k] = model.integrate_pos(qpos[:, k], start[0][part])
                qvel[:, k] += start[1][part]
        sim.reset()
        sim.set_state(*(x.reshape(len(index), -1) for x in (qpos, qvel)), act=act.reshape(len(index), -1), time=0.0)
        T = max(len(np.asarray(e.ctrl)) for e in episodes)

        def padded(arrays: list[Any]) -> Array:
            """Inputs of all episodes for all parameter vectors (variants), (T, variants * episodes, ...).

            Shorter episodes are extended to T periods by repeating their last input.
            """
            rows = np.stack([np.concatenate([a, np.repeat(a[-1:], T - len(a), axis=0)]) for a in map(np.asarray, arrays)], axis=1)
            return np.tile(rows, (1, len(part), *(1,) * (rows.ndim - 2)))

        ctrl = padded([e.ctrl for e in episodes])
        applied = {name: padded([e.applied[name] for e in episodes]) for name in episodes[0].applied}
        made = _rollout(sim, ctrl, nstep, fields=self.fields, applied=applied, fine=self._fine)
        alive = np.stack([np.arange(T) < len(np.asarray(e.ctrl)) for e in episodes], axis=1)
        status = made["status"].reshape(T, -1, len(part), E)
        bad = int((((status & int(UNTRUSTED)) != 0) & alive[:, None, None]).sum())
        self.steps += T * nstep * len(index)
        for k, e in enumerate(group):
            n = len(out[k][0])
            rows = {name: made[name].reshape(-1, len(part), E, made[name].shape[-1])[:n, :, k] for name in self.fields}
            for channel in self.channels:
                given = self.episodes[e].readings.get(channel.name)
                if given is None:
                    out[k][part, :, channel.lines] = 0.0
                    continue
                measured = np.repeat(np.asarray(given), n // len(np.asarray(given)), axis=0)
                value = compared(self.model, channel, rows[channel.field], measured)
                out[k][part, :, channel.lines] = value.transpose(1, 0, 2)
        return bad, int(alive.sum()) * len(part) * (nstep if self._fine else 1)

    def _stepper(self, model: Model, count: int) -> Stepper:
        """Stepper with `count` environments of a model. The method caches up to eight steppers, and returns a cached one if it can."""
        key = (model.digest, count)
        if key not in self._steppers:
            if len(self._steppers) >= 8:
                self._steppers.pop(next(iter(self._steppers)))
            self._steppers[key] = Stepper(model, count, options=self.options, threads=self.threads, actuators=self._drives)
        return self._steppers[key]

    def _read(self, y: Array, theta: Array, nstep: int) -> Array:
        """Applies bias, scale and delay of sensors to predicted readings, in place, and returns one row per sample: (count, T, width)."""
        for block, piece in zip(self.blocks, split(self.blocks, theta), strict=True):
            for channel in self.channels:
                if block not in self._readers or channel.name not in block.names:
                    continue
                lines = channel.lines
                if block.parameter.kind == "sensor.delay":
                    y[..., lines] = _delayed(y[..., lines], piece[:, 0] / self.timestep)
                elif block.parameter.kind == "sensor.scale":
                    y[..., lines] *= block.natural(piece)[:, :, None]
                else:
                    y[..., lines] += piece[:, None, :]
        return y[:, nstep - 1 :: nstep] if self._fine else y


def _rollout(sim: Stepper, ctrl: Array, nstep: int, *, fields: list[str], applied: dict[str, Array], fine: bool) -> dict[str, Any]:
    """Calls `Stepper.rollout` with controls, applied forces and mocap poses that change in each control period, (T, num_envs, ...).

    The arrays `fields` of the result have a row for every period, or with `fine` for every time step.
    """
    held, each = (nstep, 1) if fine else (1, nstep)
    if not applied:
        return sim.rollout(np.repeat(ctrl, held, axis=0), each, fields=fields)
    parts = []
    for k, row in enumerate(ctrl):
        for name, array in applied.items():
            setattr(sim, name, array[k])
        parts.append(sim.rollout(np.repeat(row[None], held, axis=0), each, fields=fields))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _delayed(y: Array, steps: Array) -> Array:
    """Readings y, (count, T, dim), delayed by `steps` samples, (count,), with linear interpolation between samples.

    Until the delay has passed, the value is the first sample.
    """
    at = np.clip(np.arange(y.shape[1]) - steps[:, None], 0, None)
    low = np.minimum(at.astype(int), y.shape[1] - 1)
    part = (at - low)[..., None]
    rows = np.arange(len(y))[:, None]
    return np.asarray((1 - part) * y[rows, low] + part * y[rows, np.minimum(low + 1, y.shape[1] - 1)])


def _with_longest_delays(known: ActuatorModel | None, blocks: Sequence[Block]) -> ActuatorModel | None:
    """Actuator model with the upper bounds of identified delays, so that the stepper allocates delay lines of that length."""
    longest = {name: float(block.high[0]) for block in blocks if block.parameter.kind == "actuator.delay" for name in block.names}
    if not longest:
        return known
    known = known or ActuatorModel()
    delayed = {name: replace(known.drive_of(name) or Drive(), delay=delay) for name, delay in longest.items()}
    return ActuatorModel({**known.named, **delayed}, default=known.default)

"""Sensors that are not ideal: what they make of the truth."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper._tables import by_name, check_names, check_numbers, fitting, named_tables, numbers, read_file

if TYPE_CHECKING:
    from stepper._stepper import Model

Number: TypeAlias = "float | ArrayLike"


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """The transfer function of a sensor, in the order in which it acts. The default is an ideal sensor.

    Truth, scale and misalignment, bias, drift, noise, quantisation, limits, sample and hold, delay, dropout. Every number is one for all
    environments or an array (num_envs,), in the unit of the sensor's readings. Readings that are unit vectors or quaternions are turned by
    bias, drift and noise as a rotation vector in rad; readings that say nothing at 0 and below (touch, rangefinder) are left alone there.

    Attributes:
        scale: Factor of every channel; or a matrix (dim, dim) that mixes them.
        scale_std: Standard deviation of the relative error of each channel's factor, drawn at each reset.
        misalignment_std: Standard deviation of what each channel reads of every other, in rad, drawn at each reset.
        bias: Bias of every channel, the same in every episode.
        bias_std: Standard deviation of what each channel's bias has beside it, drawn at each reset.
        drift_std: Growth of each channel's drift, per sqrt(s); it is 0 at each reset.
        drift_time: Correlation time of the drift in s, which makes it a first-order Gauss-Markov process of standard deviation
            drift_std sqrt(drift_time / 2) in the long run; None is a random walk.
        noise_std: Standard deviation of the white noise of a sample; of uniform noise the half width.
        noise: "gaussian" or "uniform".
        noise_density: Density of Gaussian white noise per sqrt(Hz), as in data sheets: a sample's standard deviation is this over the
            square root of the sampling time, whatever the time step is.
        quantum: Readings are whole multiples of it; 0 is none.
        limits: Lowest and highest reading.
        period: Time between samples in s, held in between; None or 0 is every step.
        delay: s. Between steps readings are interpolated, unless they are held by `period`.
        jitter: Half width of the delay's scatter, uniform and drawn at every step, in s.
        dropout: Probability that a sample is lost and the last one held.
    """

    scale: Number = 1.0
    scale_std: Number = 0.0
    misalignment_std: Number = 0.0
    bias: Number = 0.0
    bias_std: Number = 0.0
    drift_std: Number = 0.0
    drift_time: Number | None = None
    noise_std: Number = 0.0
    noise: str = "gaussian"
    noise_density: Number | None = None
    quantum: Number = 0.0
    limits: tuple[Number, Number] | None = None
    period: Number | None = None
    delay: Number = 0.0
    jitter: Number = 0.0
    dropout: Number = 0.0

    def __post_init__(self) -> None:
        if self.noise not in ("gaussian", "uniform"):
            raise ValueError(f"noise is {self.noise!r}, must be 'gaussian' or 'uniform'")
        if self.noise == "uniform" and self.noise_density is not None:
            raise ValueError("noise_density is that of Gaussian noise; give uniform noise its half width as noise_std")
        check_numbers(self, "noise")

    def _row(self, num_envs: int) -> dict[str, Any]:
        """What the Rust crate's `Transfer` holds."""
        mixes = np.ndim(self.scale) == 2
        low, high = (-math.inf, math.inf) if self.limits is None else self.limits
        plain = ("scale_std", "misalignment_std", "bias", "bias_std", "drift_std", "noise_std", "quantum", "delay", "jitter", "dropout")
        return {
            **{name: numbers(name, getattr(self, name), num_envs) for name in plain},
            "scale": [1.0] if mixes else numbers("scale", self.scale, num_envs),
            "matrix": np.asarray(self.scale, dtype=np.float64).ravel().tolist() if mixes else [],
            "drift_time": numbers("drift_time", math.inf if self.drift_time is None else self.drift_time, num_envs),
            "uniform": self.noise == "uniform",
            "noise_density": numbers("noise_density", 0.0 if self.noise_density is None else self.noise_density, num_envs),
            "low": numbers("limits[0]", low, num_envs),
            "high": numbers("limits[1]", high, num_envs),
            "period": numbers("period", 0.0 if self.period is None else self.period, num_envs),
        }


class SensorModel:
    """Transfer functions of a model's sensors, for `Stepper(..., sensors=)`.

    Args:
        transfers: By the name of the sensor, or a pattern like "*_gyro"; a name goes before patterns, and of patterns the first counts.
        default: For sensors that none of them fits; None leaves those ideal.
    """

    def __init__(self, transfers: Mapping[str, Transfer] | None = None, *, default: Transfer | None = None):
        self.named, self.default = by_name(transfers, default, Transfer, "transfer"), default

    @classmethod
    def from_mjcf(cls, model: Model) -> SensorModel:
        """What the model's source declares of each sensor: noise, cutoff, delay and interval."""
        transfers = {}
        for index, sensor in enumerate(model.sensors):
            cutoff = sensor["cutoff"] if sensor["datatype"] in ("real", "positive") else 0.0
            # A cutoff of distances between geoms is part of the reading itself.
            if cutoff and sensor["type"] not in ("distance", "normal", "fromto"):
                limits = (-cutoff if sensor["datatype"] == "real" else -math.inf, cutoff)
            else:
                limits = None
            made = Transfer(noise_std=sensor["noise"], limits=limits, delay=sensor["delay"], period=sensor["interval"] or None)
            if made != Transfer():
                transfers[sensor["name"] or f"#{index}"] = made
        return cls(transfers)

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> SensorModel:
        """Reads a TOML (.toml) or JSON (.json) file.

        A table `sensors` has a table for every name or pattern, a table `default` may be beside it. Their entries are the attributes of
        `Transfer`; an entry `device` begins with one of `stepper.devices`, e.g. device = "mpu6050_gyro".

        Raises:
            ValueError: An unknown entry or device, named with the file.
        """
        return cls.from_dict(read_file(path), str(path))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "sensors") -> SensorModel:
        """The inverse of `to_dict`, and the contents of a file; `place` begins messages."""
        named = {name: _read(table, f"{place}: sensor {name!r}") for name, table in named_tables(data, "sensors", place).items()}
        return cls(named, default=_read(data["default"], f"{place}: default") if "default" in data else None)

    def to_dict(self) -> dict[str, Any]:
        """The contents of a file that `from_file` reads; arrays become lists."""

        def plain(transfer: Transfer) -> dict[str, Any]:
            given = {name: value for name, value in asdict(transfer).items() if value is not None}
            return {name: np.asarray(value).tolist() if name != "noise" else value for name, value in given.items()}

        out: dict[str, Any] = {"sensors": {name: plain(transfer) for name, transfer in self.named.items()}}
        return out | ({"default": plain(self.default)} if self.default else {})

    def transfers(self, model: Model, num_envs: int) -> list[dict[str, Any] | None]:
        """What the sensors of a model get, one entry for each; None for ideal ones.

        Raises:
            ValueError: A name that no sensor has, a pattern that fits none, a wrong shape.
        """
        names = [sensor["name"] or f"#{index}" for index, sensor in enumerate(model.sensors)]
        check_names(self.named, names, "sensor")
        return [self._row(name, num_envs) for name in names]

    def _row(self, name: str, num_envs: int) -> dict[str, Any] | None:
        transfer = fitting(self.named, self.default, name)
        if transfer is None:
            return None
        try:
            return transfer._row(num_envs)
        except ValueError as error:
            raise ValueError(f"transfer of sensor {name!r}: {error}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SensorModel) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"SensorModel({self.named!r}, default={self.default!r})"


def _read(table: Any, place: str) -> Transfer:
    """A transfer from a table of a file."""
    from stepper import devices  # noqa: PLC0415  (devices are made of transfers)

    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table of entries like noise_std")
    given = dict(table)
    device = given.pop("device", None)
    known = {field.name for field in fields(Transfer)}
    if unknown := set(given) - known:
        raise ValueError(f"{place}: unknown entries {sorted(unknown)}, must be of: {', '.join(sorted(known))}")
    if isinstance(given.get("limits"), list):
        given["limits"] = tuple(given["limits"])
    try:
        return replace(devices.find(device) if device else Transfer(), **given)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{place}: {error}") from None

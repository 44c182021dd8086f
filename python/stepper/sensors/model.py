"""Assignment of transfer functions to the sensors of a model by name, with conversion to and from files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._hints import Hints, hint_keywords
from stepper.sensors import devices
from stepper.sensors.transfer import Transfer
from stepper.shared.tables import by_name, check_names, fitting, named_tables, read_file

if TYPE_CHECKING:
    from stepper._stepper import Model


@hint_keywords("stepper.SensorModel")
class SensorModel(Hints):
    """Transfer functions of a model's sensors, for `Stepper(..., sensors=)`.

    Args:
        transfers: Transfer functions by the name of the sensor, or by a pattern like "*_gyro". Names take precedence over patterns, and
            the first matching pattern counts.
        default: Transfer function of all other sensors; None leaves them ideal.
    """

    named: dict[str, Transfer]
    default: Transfer | None

    def __init__(self, transfers: Mapping[str, Transfer] | None = None, *, default: Transfer | None = None):
        self.named, self.default = by_name(transfers, default, Transfer, "transfer", "stepper.Transfer(noise_std=...)"), default

    @classmethod
    def from_mjcf(cls, model: Model) -> SensorModel:
        """Returns a sensor model with the noise, cutoff, delay and interval that the MJCF file of a model declares for each sensor."""
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

        The table `sensors` has one table per name or pattern; a table `default` is optional. Entries of these tables are the attributes of
        `Transfer`. With an entry like device = "mpu6050_gyro", the defaults are those of that device of `stepper.sensors.devices`.

        Raises:
            ValueError: An unknown entry or device; the message has the entry and the file.
        """
        return cls.from_dict(read_file(path), str(path))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "sensors") -> SensorModel:
        """Returns a sensor model from a dictionary in the format of `to_dict` and of files; error messages begin with `place`."""
        named = {name: _read(table, f"{place}: sensor {name!r}") for name, table in named_tables(data, "sensors", place).items()}
        return cls(named, default=_read(data["default"], f"{place}: default") if "default" in data else None)

    def to_dict(self) -> dict[str, Any]:
        """Returns a dictionary in the format of the files of `from_file`; arrays become lists."""

        def plain(transfer: Transfer) -> dict[str, Any]:
            given = {name: value for name, value in asdict(transfer).items() if value is not None}
            return {name: _plain(value) for name, value in given.items()}

        out: dict[str, Any] = {"sensors": {name: plain(transfer) for name, transfer in self.named.items()}}
        return out | ({"default": plain(self.default)} if self.default else {})

    def transfers(self, model: Model, num_envs: int) -> list[dict[str, Any] | None]:
        """Returns the transfer functions of all sensors of a model, as dictionaries for the Rust library; None for ideal sensors.

        Arrays in a transfer function have one number for each of `num_envs` environments.

        Raises:
            ValueError: A name or pattern matches no sensor, or an array has a wrong shape.
        """
        names = [sensor["name"] or f"#{index}" for index, sensor in enumerate(model.sensors)]
        check_names(self.named, names, "sensor")
        return [self._row(name, num_envs) for name in names]

    def chosen(self, index: np.ndarray[Any, Any]) -> SensorModel:
        """Returns a copy of this sensor model for some environments only: arrays of numbers per environment keep the entries of `index`.

        Args:
            index: Boolean mask (num_envs,), or indices (n,), which may repeat.
        """
        default = None if self.default is None else _chosen(self.default, index)
        return SensorModel({name: _chosen(transfer, index) for name, transfer in self.named.items()}, default=default)

    def _row(self, name: str, num_envs: int) -> dict[str, Any] | None:
        """Transfer function of a sensor, given by name, as a dictionary for the Rust library; None if the sensor is ideal."""
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


def _plain(value: Any) -> Any:
    """Value of a field of a transfer function without arrays: arrays, also those in a pair of limits, become lists."""
    if isinstance(value, tuple):
        return [_plain(end) for end in value]
    return value if isinstance(value, str) else np.asarray(value).tolist()


def _chosen(transfer: Transfer, index: np.ndarray[Any, Any]) -> Transfer:
    """Copy of a transfer function for some environments only, by a mask (num_envs,) or by indices (n,)."""

    def chosen_of(value: Any) -> Any:
        """Value of a field of the transfer function, for the chosen environments only."""
        if isinstance(value, tuple):
            return tuple(chosen_of(end) for end in value)
        # A single number applies to all environments, as does a matrix, which mixes the axes of a sensor.
        shared = value is None or isinstance(value, str) or np.size(value) == 1 or np.ndim(value) == 2
        return value if shared else np.asarray(value, np.float64)[index]

    return replace(transfer, **{field.name: chosen_of(getattr(transfer, field.name)) for field in fields(transfer)})


def _read(table: Any, place: str) -> Transfer:
    """Transfer function from a table of a TOML or JSON file; error messages begin with `place`."""
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table of entries like noise_std")
    given = dict(table)
    device = given.pop("device", None)
    known = {field.name for field in fields(Transfer)}
    if unknown := set(given) - known:
        raise ValueError(f"{place}: unknown entries {sorted(unknown)}, must be one of: {', '.join(sorted(known))}")
    if isinstance(given.get("limits"), list):
        given["limits"] = tuple(given["limits"])
    try:
        return replace(devices.find(device) if device else Transfer(), **given)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{place}: {error}") from None

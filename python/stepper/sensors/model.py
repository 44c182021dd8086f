"""Assignment of transfer functions to the sensors of a model by name, with conversion to and from files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from stepper.sensors import devices
from stepper.sensors.transfer import Transfer
from stepper.shared.named_parts import NamedParts, read_part
from stepper.shared.tables import read_file

if TYPE_CHECKING:
    from stepper._stepper import Model


class SensorModel(NamedParts[Transfer]):
    """Transfer functions of a model's sensors, for `Stepper(..., sensors=)`.

    Args:
        transfers: Transfer functions by the name of the sensor, or by a pattern like "*_gyro". Names take precedence over patterns, and
            the first matching pattern counts.
        default: Transfer function of all other sensors; None leaves them ideal.
    """

    _kind, _element, _part, _example = Transfer, "sensor", "transfer", "stepper.Transfer(noise_std=...)"

    def __init__(self, transfers: Mapping[str, Transfer] | None = None, *, default: Transfer | None = None):
        self._set(transfers, default)

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
    def _read_part(cls, table: Any, place: str) -> Transfer:
        entries, device = table, None
        if isinstance(table, dict):
            entries = {name: value for name, value in table.items() if name != "device"}
            device = table.get("device")
        transfer: Transfer = read_part(
            entries, Transfer, place, make=lambda **given: replace(devices.find(device) if device else Transfer(), **given)
        )
        return transfer

    def transfers(self, model: Model, num_envs: int) -> list[dict[str, Any] | None]:
        """Returns the transfer functions of all sensors of a model, as dictionaries for the Rust library; None for ideal sensors.

        Arrays in a transfer function have one number for each of `num_envs` environments.

        Raises:
            ValueError: A name or pattern matches no sensor, or an array has a wrong shape.
        """
        names = [sensor["name"] or f"#{index}" for index, sensor in enumerate(model.sensors)]
        return self._rows(names, num_envs)

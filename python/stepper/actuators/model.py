"""Assignment of drives to the actuators of a model by name, with conversion to and from files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper.actuators.drives import PID, DCMotor, Drive, Envs
from stepper.shared.named_parts import NamedParts, read_part
from stepper.shared.tables import fitting

if TYPE_CHECKING:
    from stepper._stepper import Model


class ActuatorModel(NamedParts[Drive]):
    """Drives of a model's actuators, for `Stepper(..., actuators=)` and `Stepper.randomize(actuators=)`.

    Args:
        drives: Drives by name of the actuator, or by a pattern like "left_*". Names have precedence over patterns, and the first matching
            pattern counts.
        default: Drive of all other actuators. None leaves these actuators ideal. With `randomize`, None does not change their drives.
    """

    _kind, _element, _part, _example = Drive, "actuator", "drive", "stepper.Drive(delay=...)"

    def __init__(self, drives: Mapping[str, Drive] | None = None, *, default: Drive | None = None):
        self._set(drives, default)

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> ActuatorModel:
        """Reads a TOML (.toml) or JSON (.json) file.

        The table `actuators` has one table per name or pattern; a table `default` is optional. Entries of these tables are the attributes
        of `Drive`, with tables `motor` and `servo` for the attributes of `DCMotor` and `PID`.

        Raises:
            ValueError: An unknown entry; the message has the entry and the file.
        """
        return cls._read_file(path)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "actuators") -> ActuatorModel:
        """Returns an actuator model from a dictionary in the format of `to_dict` and of files; error messages begin with `place`."""
        return cls._read(data, place)

    @classmethod
    def _read_part(cls, table: Any, place: str) -> Drive:
        drive: Drive = read_part(table, Drive, place, nested={"motor": DCMotor, "servo": PID})
        return drive

    def drives(self, model: Model, num_envs: int, envs: Envs = None) -> list[dict[str, Any] | None]:
        """Returns the drives of all actuators of a model, as fields of the Rust crate's `ActuatorSpec`; None for ideal actuators.

        Args:
            model: The model.
            num_envs: Number of environments, for checks of array sizes.
            envs: Mask (num_envs,) or indices of the environments whose numbers are returned; None selects all.

        Raises:
            ValueError: A name or pattern matches no actuator, or an array has a wrong shape.
        """
        return self._rows(_names(model), num_envs, envs)

    def drive_of(self, name: str) -> Drive | None:
        """Returns the drive of an actuator, given by name, or by index in the form "#3" if it has no name.

        The result is None if no name or pattern in this actuator model fits, and there is no default drive.
        """
        return fitting(self.named, self.default, name)

    def spread(self, mask: np.ndarray[Any, Any]) -> ActuatorModel:
        """Returns a copy for all environments of an actuator model that has numbers only for the environments in a mask.

        Other environments get the number 0, which has no effect if the caller uses only the environments in the mask.

        Args:
            mask: Boolean mask (num_envs,). Arrays in this model have one number per True entry; those of the copy have num_envs.
        """

        def spread(x: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
            out = np.zeros(len(mask))
            out[mask] = x
            return out

        return self._changed(spread)

    @classmethod
    def _from_rows(cls, model: Model, rows: list[dict[str, Any] | None]) -> ActuatorModel:
        """Actuator model from one dictionary per actuator, in the format that the method `drives` returns; None for ideal actuators."""
        named = zip(_names(model), rows, strict=True)
        return cls({name: _from_row(row, Drive) for name, row in named if row is not None})


def _names(model: Model) -> list[str]:
    """Names of a model's actuators in their order; unnamed actuators have their index in the form "#3"."""
    return [name or f"#{index}" for index, name in enumerate(model.actuator_names)]


def _from_row(row: dict[str, Any], kind: type[Any]) -> Any:
    """Drive, motor or servo (the class `kind`) from a dictionary of the Rust library. Empty lists and infinite numbers become None."""

    def number(value: Any) -> Any:
        if not isinstance(value, list):
            return value
        return None if value in ([], [math.inf]) else value[0] if len(value) == 1 else np.array(value)

    own = {name: number(value) for name, value in row.items()}
    if kind is Drive:
        low, high = own.pop("low"), own.pop("high")
        unlimited = (row["low"], row["high"]) == ([-math.inf], [math.inf])
        own["limits"] = None if unlimited else (low, math.inf if high is None else high)
        for name, part in (("motor", DCMotor), ("servo", PID)):
            own[name] = None if own[name] is None else _from_row(own[name], part)
    elif kind is DCMotor:
        own["control"] = "voltage" if own.pop("voltage") else "torque"
    return kind(**own)

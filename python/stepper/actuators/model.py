"""Assignment of drives to the actuators of a model by name, with conversion to and from files."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._hints import Hints, hint_keywords
from stepper.actuators.drives import PID, DCMotor, Drive, Envs
from stepper.shared.tables import by_name, check_names, fitting, named_tables, read_file

if TYPE_CHECKING:
    from stepper._stepper import Model


@hint_keywords("stepper.ActuatorModel")
class ActuatorModel(Hints):
    """Drives of a model's actuators, for `Stepper(..., actuators=)` and `Stepper.randomize(actuators=)`.

    Args:
        drives: Drives by name of the actuator, or by a pattern like "left_*". Names have precedence over patterns, and the first matching
            pattern counts.
        default: Drive of all other actuators. None leaves these actuators ideal. With `randomize`, None does not change their drives.
    """

    named: dict[str, Drive]
    default: Drive | None

    def __init__(self, drives: Mapping[str, Drive] | None = None, *, default: Drive | None = None):
        self.named, self.default = by_name(drives, default, Drive, "drive", "stepper.Drive(delay=...)"), default

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> ActuatorModel:
        """Reads a TOML (.toml) or JSON (.json) file.

        The table `actuators` has one table per name or pattern; a table `default` is optional. Entries of these tables are the attributes
        of `Drive`, with tables `motor` and `servo` for the attributes of `DCMotor` and `PID`.

        Raises:
            ValueError: An unknown entry; the message has the entry and the file.
        """
        return cls.from_dict(read_file(path), str(path))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "actuators") -> ActuatorModel:
        """Returns an actuator model from a dictionary in the format of `to_dict` and of files; error messages begin with `place`."""
        tables = named_tables(data, "actuators", place)
        named = {name: _read(table, Drive, f"{place}: actuator {name!r}") for name, table in tables.items()}
        return cls(named, default=_read(data["default"], Drive, f"{place}: default") if "default" in data else None)

    def to_dict(self) -> dict[str, Any]:
        """Returns a dictionary in the format of the files of `from_file`; arrays become lists."""
        out: dict[str, Any] = {"actuators": {name: _plain(drive) for name, drive in self.named.items()}}
        return out | ({"default": _plain(self.default)} if self.default else {})

    def drives(self, model: Model, num_envs: int, envs: Envs = None) -> list[dict[str, Any] | None]:
        """Returns the drives of all actuators of a model, as fields of the Rust crate's `ActuatorSpec`; None for ideal actuators.

        Args:
            model: The model.
            num_envs: Number of environments, for checks of array sizes.
            envs: Mask (num_envs,) or indices of the environments whose numbers are returned; None selects all.

        Raises:
            ValueError: A name or pattern matches no actuator, or an array has a wrong shape.
        """
        names = _names(model)
        check_names(self.named, names, "actuator")
        return [self._row(name, num_envs, envs) for name in names]

    def drive_of(self, name: str) -> Drive | None:
        """Returns the drive of an actuator, given by name, or by index in the form "#3" if it has no name.

        The result is None if no name or pattern in this actuator model fits, and there is no default drive.
        """
        return fitting(self.named, self.default, name)

    def chosen(self, index: np.ndarray[Any, Any]) -> ActuatorModel:
        """Returns a copy of this actuator model for some environments only: arrays of numbers per environment keep the entries of `index`.

        Args:
            index: Boolean mask (num_envs,), or indices, which may repeat.
        """
        return self._changed(lambda x: x[index])

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

    def _changed(self, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> ActuatorModel:
        """Copy of this actuator model in which `change` was applied to every array with one number per environment."""
        default = None if self.default is None else _changed(self.default, change)
        return ActuatorModel({name: _changed(drive, change) for name, drive in self.named.items()}, default=default)

    @classmethod
    def _from_rows(cls, model: Model, rows: list[dict[str, Any] | None]) -> ActuatorModel:
        """Actuator model from one dictionary per actuator, in the format that the method `drives` returns; None for ideal actuators."""
        named = zip(_names(model), rows, strict=True)
        return cls({name: _from_row(row, Drive) for name, row in named if row is not None})

    def _row(self, name: str, num_envs: int, envs: Envs) -> dict[str, Any] | None:
        """Dictionary for the Rust library with the drive of an actuator, given by name; None if the actuator is ideal."""
        drive = self.drive_of(name)
        if drive is None:
            return None
        try:
            return drive._row(num_envs, envs)
        except ValueError as error:
            raise ValueError(f"drive of actuator {name!r}: {error}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ActuatorModel) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"ActuatorModel({self.named!r}, default={self.default!r})"


def _plain(part: PID | DCMotor | Drive) -> dict[str, Any]:
    """Attributes of a drive, motor or servo other than None, as a dictionary of numbers, strings, lists and nested dictionaries."""
    out: dict[str, Any] = {}
    for field in fields(part):
        value = getattr(part, field.name)
        if value is None:
            continue
        if isinstance(value, PID | DCMotor):
            out[field.name] = _plain(value)
        elif field.name == "limits":
            out[field.name] = [np.asarray(end).tolist() for end in value]
        else:
            out[field.name] = value if isinstance(value, str) else np.asarray(value).tolist()
    return out


def _names(model: Model) -> list[str]:
    """Names of a model's actuators in their order; unnamed actuators have their index in the form "#3"."""
    return [name or f"#{index}" for index, name in enumerate(model.actuator_names)]


def _changed(part: Any, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Any:
    """Copy of a drive, motor or servo in which `change` was applied to all arrays with one number per environment."""

    def changed(value: Any) -> Any:
        """Copy of the value of a field, with `change` applied to arrays. Motors, servos and tuples are converted part by part.

        Numbers and texts are returned unchanged.
        """
        if isinstance(value, PID | DCMotor):
            return _changed(value, change)
        if isinstance(value, tuple):
            return tuple(changed(end) for end in value)
        return value if value is None or isinstance(value, str) or np.size(value) == 1 else change(np.asarray(value, np.float64))

    return replace(part, **{field.name: changed(getattr(part, field.name)) for field in fields(part)})


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


def _read(table: Any, kind: type[Any], place: str) -> Any:
    """Drive, motor or servo (the class `kind`) from a table of a TOML or JSON file; error messages begin with `place`."""
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table of entries")
    given = dict(table)
    known = {field.name for field in fields(kind)}
    if unknown := set(given) - known:
        raise ValueError(f"{place}: unknown entries {sorted(unknown)}, must be one of: {', '.join(sorted(known))}")
    if kind is Drive:
        for name, part in (("motor", DCMotor), ("servo", PID)):
            if name in given:
                given[name] = _read(given[name], part, f"{place}: {name}")
        if isinstance(given.get("limits"), list):
            given["limits"] = tuple(given["limits"])
    try:
        return kind(**given)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{place}: {error}") from None

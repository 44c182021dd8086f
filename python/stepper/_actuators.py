"""Actuators that are not ideal: what becomes of a control before it is a force."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper._tables import by_name, check_names, check_numbers, fitting, named_tables, numbers, read_file

if TYPE_CHECKING:
    from stepper._stepper import Model

Number: TypeAlias = "float | ArrayLike"
Envs: TypeAlias = "np.ndarray[Any, Any] | None"


@dataclass(frozen=True, kw_only=True)
class PID:
    """A servo that takes the place of an actuator's own law: the control is a set point of the actuator's length (MJCF's gear included).

    effort = kp (control - length) + integral of ki (control - length) - kd velocity. The integral does not grow where it would drive the
    effort further beyond its bounds. Every number is one for all environments or an array (num_envs,).

    Attributes:
        kp: N or N m per unit of length.
        ki: N or N m per unit of length and second.
        kd: N or N m per unit of velocity.
        integral_limit: Largest effort of the integral, N or N m; None is none.
        period: Time between samples in s, with the effort held in between, as a digital controller does it; never shorter than a step.
            None is a continuous servo: its stiffness and damping are implicit, so that no time step is too long for them.
    """

    kp: Number
    ki: Number = 0.0
    kd: Number = 0.0
    integral_limit: Number | None = None
    period: Number | None = None

    def __post_init__(self) -> None:
        check_numbers(self)

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        limit = math.inf if self.integral_limit is None else self.integral_limit
        return {
            **{name: numbers(name, getattr(self, name), num_envs, envs) for name in ("kp", "ki", "kd")},
            "integral_limit": numbers("integral_limit", limit, num_envs, envs),
            "period": [] if self.period is None else numbers("period", self.period, num_envs, envs),
        }


@dataclass(frozen=True, kw_only=True)
class DCMotor:
    """A DC motor behind a gear without backlash. Its numbers are those of its shaft, which turns `gear` times as fast as the actuator.

    At nominal voltage its torque is stall_torque (1 - speed / no_load_speed): the back-EMF is a damper, and is implicit. Every number but
    rotor_inertia and gear is one for all environments or an array (num_envs,).

    Attributes:
        stall_torque: N m at nominal voltage; None is a motor without a torque-speed curve.
        no_load_speed: rad/s at nominal voltage.
        rotor_inertia: kg m^2; the joint gets gear^2 times as much.
        gear: Turns of the shaft for one of the actuator (rad per unit of its length).
        efficiency: Share of the power that the gear passes on, both ways: it gives efficiency times the torque to what it drives, and
            takes 1 / efficiency times the torque to be driven backwards.
        control: "torque": the effort is a torque that the motor follows as far as its curve, of either sign of the voltage, lets it.
            "voltage": the effort is the share of the nominal voltage, from -1 to 1.
    """

    stall_torque: Number | None = None
    no_load_speed: Number | None = None
    rotor_inertia: float = 0.0
    gear: float = 1.0
    efficiency: Number = 1.0
    control: str = "torque"

    def __post_init__(self) -> None:
        check_numbers(self, "control")
        for name in ("rotor_inertia", "gear"):
            if np.ndim(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)!r}, must be one number for all environments")
        if self.control not in ("torque", "voltage"):
            raise ValueError(f"control is {self.control!r}, must be 'torque' or 'voltage'")
        if (self.stall_torque is None) != (self.no_load_speed is None):
            raise ValueError("stall_torque and no_load_speed go together: give both or none")

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        def curve(name: str) -> list[float]:
            value = getattr(self, name)
            return [] if value is None else numbers(name, value, num_envs, envs)

        return {
            "stall_torque": curve("stall_torque"),
            "no_load_speed": curve("no_load_speed"),
            "rotor_inertia": float(self.rotor_inertia),
            "gear": float(self.gear),
            "efficiency": numbers("efficiency", self.efficiency, num_envs, envs),
            "voltage": self.control == "voltage",
        }


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What lies between the control of an actuator and its force, in the order in which it acts. The default is an ideal actuator.

    Control range, delay, servo, lag, the actuator's own law, limits, torque-speed curve, gear and friction. Every number is one for all
    environments or an array (num_envs,). See docs/actuators.md.

    Attributes:
        delay: s. Between steps the control is what it is on average over the step.
        delay_steps: The same in steps; the two add up.
        lag: Time constant in s of a first-order lag of the control, or of the servo's effort; 0 is none.
        limits: Lowest and highest effort, N or N m, beside the actuator's own.
        motor: A motor with its gear.
        servo: A servo in place of the actuator's own law and control range.
        friction: Dry friction at the actuator's side of its gear, N or N m; the joint has gear times as much.
    """

    delay: Number = 0.0
    delay_steps: Number = 0.0
    lag: Number = 0.0
    limits: tuple[Number, Number] | None = None
    motor: DCMotor | None = None
    servo: PID | None = None
    friction: Number = 0.0

    def __post_init__(self) -> None:
        for name, kind in (("motor", DCMotor), ("servo", PID)):
            given = getattr(self, name)
            if given is not None and not isinstance(given, kind):
                raise TypeError(f"{name} is {given!r}, must be a stepper.{kind.__name__}")
        check_numbers(self, "motor", "servo")

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        """What the Rust crate's `DriveTrain` holds."""
        low, high = (-math.inf, math.inf) if self.limits is None else self.limits
        return {
            **{name: numbers(name, getattr(self, name), num_envs, envs) for name in ("delay", "delay_steps", "lag", "friction")},
            "low": numbers("limits[0]", low, num_envs, envs),
            "high": numbers("limits[1]", high, num_envs, envs),
            "servo": None if self.servo is None else self.servo._row(num_envs, envs),
            "motor": None if self.motor is None else self.motor._row(num_envs, envs),
        }


class ActuatorModel:
    """Drives of a model's actuators, for `Stepper(..., actuators=)` and `Stepper.randomize(actuators=)`.

    Args:
        drives: By the name of the actuator, or a pattern like "left_*"; a name goes before patterns, and of patterns the first counts.
        default: For actuators that none of them fits; None leaves those ideal, or, of `randomize`, as they are.
    """

    def __init__(self, drives: Mapping[str, Drive] | None = None, *, default: Drive | None = None):
        self.named, self.default = by_name(drives, default, Drive, "drive"), default

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> ActuatorModel:
        """Reads a TOML (.toml) or JSON (.json) file.

        A table `actuators` has a table for every name or pattern, a table `default` may be beside it. Their entries are the attributes of
        `Drive`, with tables `motor` and `servo` for those of `DCMotor` and `PID`.

        Raises:
            ValueError: An unknown entry, named with the file.
        """
        return cls.from_dict(read_file(path), str(path))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "actuators") -> ActuatorModel:
        """The inverse of `to_dict`, and the contents of a file; `place` begins messages."""
        tables = named_tables(data, "actuators", place)
        named = {name: _read(table, Drive, f"{place}: actuator {name!r}") for name, table in tables.items()}
        return cls(named, default=_read(data["default"], Drive, f"{place}: default") if "default" in data else None)

    def to_dict(self) -> dict[str, Any]:
        """The contents of a file that `from_file` reads; arrays become lists."""
        out: dict[str, Any] = {"actuators": {name: _plain(drive) for name, drive in self.named.items()}}
        return out | ({"default": _plain(self.default)} if self.default else {})

    def drives(self, model: Model, num_envs: int, envs: Envs = None) -> list[dict[str, Any] | None]:
        """What the actuators of a model get, one entry for each; None where nothing is said. Of all environments, or of some.

        Raises:
            ValueError: A name that no actuator has, a pattern that fits none, a wrong shape.
        """
        names = _names(model)
        check_names(self.named, names, "actuator")
        return [self._row(name, num_envs, envs) for name in names]

    def drive_of(self, name: str) -> Drive | None:
        """The drive of an actuator, by its name or "#3"; None where nothing is said of it."""
        return fitting(self.named, self.default, name)

    def chosen(self, mask: np.ndarray[Any, Any]) -> ActuatorModel:
        """The same with the numbers of some environments alone, a mask (num_envs,)."""
        return self._changed(lambda x: x[mask])

    def spread(self, mask: np.ndarray[Any, Any]) -> ActuatorModel:
        """The inverse of `chosen`: rows of the others are 0."""

        def spread(x: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
            out = np.zeros(len(mask))
            out[mask] = x
            return out

        return self._changed(spread)

    def _changed(self, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> ActuatorModel:
        default = None if self.default is None else _changed(self.default, change)
        return ActuatorModel({name: _changed(drive, change) for name, drive in self.named.items()}, default=default)

    @classmethod
    def _from_rows(cls, model: Model, rows: list[dict[str, Any] | None]) -> ActuatorModel:
        """The inverse of `drives`."""
        named = zip(_names(model), rows, strict=True)
        return cls({name: _from_row(row, Drive) for name, row in named if row is not None})

    def _row(self, name: str, num_envs: int, envs: Envs) -> dict[str, Any] | None:
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
    """Attributes that are given, as plain numbers, lists and tables."""
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
    return [name or f"#{index}" for index, name in enumerate(model.actuator_names)]


def _changed(part: Any, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Any:
    """A part of an actuator model with other arrays of environments; what all of them share stays."""

    def new(value: Any) -> Any:
        if isinstance(value, PID | DCMotor):
            return _changed(value, change)
        if isinstance(value, tuple):
            return tuple(new(end) for end in value)
        return value if value is None or isinstance(value, str) or np.size(value) == 1 else change(np.asarray(value, np.float64))

    return replace(part, **{field.name: new(getattr(part, field.name)) for field in fields(part)})


def _from_row(row: dict[str, Any], kind: type[Any]) -> Any:
    """A part of an actuator model from what the Rust crate holds: no numbers, or infinite ones, are what None says."""

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
    """A part of an actuator model from a table of a file."""
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table of entries")
    given = dict(table)
    known = {field.name for field in fields(kind)}
    if unknown := set(given) - known:
        raise ValueError(f"{place}: unknown entries {sorted(unknown)}, must be of: {', '.join(sorted(known))}")
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

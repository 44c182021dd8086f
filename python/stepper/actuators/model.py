"""Assignment of drives to the actuators of a model by name, with conversion to and from files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper.shared.named_parts import NamedParts, read_part
from stepper.shared.tables import check_numbers, fitting, numbers, read_file

if TYPE_CHECKING:
    from stepper._stepper import Model

Number: TypeAlias = "float | ArrayLike"
Envs: TypeAlias = "np.ndarray[Any, Any] | None"


@dataclass(frozen=True, kw_only=True)
class PID:
    """Servo (PID controller) that replaces the affine force of an actuator. The control is then the target of the actuator's length.

    The length is MJCF's gear times the joint position or tendon length. effort = kp (control - length) + I - kd velocity, where I is the
    sum of ki (control - length) dt. I stays constant in a step in which the effort exceeds a limit and the new I would increase the excess.
    Every number is a scalar for all environments or an array (num_envs,).

    Attributes:
        kp: Proportional gain, N or N m per unit of length.
        ki: Integral gain, N or N m per unit of length and second.
        kd: Derivative gain, N or N m per unit of velocity.
        integral_limit: Largest absolute value of the integral term I, N or N m; None sets no limit.
        period: Sampling period of a digital controller, s; the effort is constant between samples. A period below the time step acts as the
            time step. None makes the servo continuous. The integrators midpoint and implicit then treat kp and kd implicitly and are stable
            for any time step.
    """

    kp: Number
    ki: Number = 0.0
    kd: Number = 0.0
    integral_limit: Number | None = None
    period: Number | None = None

    def __post_init__(self) -> None:
        check_numbers(self)

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        """Dictionary of the servo's numbers for the Rust library, with arguments as in `Drive._row`.

        Each value is a list with one number per environment, or one for all.
        """
        limit = math.inf if self.integral_limit is None else self.integral_limit
        return {
            **{name: numbers(name, getattr(self, name), num_envs, envs) for name in ("kp", "ki", "kd")},
            "integral_limit": numbers("integral_limit", limit, num_envs, envs),
            "period": [] if self.period is None else numbers("period", self.period, num_envs, envs),
        }


@dataclass(frozen=True, kw_only=True)
class DCMotor:
    """DC motor with a gear without backlash. Parameters refer to the motor shaft, which turns `gear` times as fast as the actuator.

    At nominal voltage the torque is stall_torque (1 - speed / no_load_speed). The step treats this back-EMF damping implicitly. Every
    number but rotor_inertia and gear is a scalar for all environments or an array (num_envs,).

    Attributes:
        stall_torque: Torque at standstill and nominal voltage, N m; None leaves the torque-speed curve out.
        no_load_speed: Speed without load at nominal voltage, rad/s.
        rotor_inertia: Inertia of the rotor, kg m^2; the joint's armature gets gear^2 times as much.
        gear: Gear ratio: shaft speed over actuator speed (rad per unit of actuator length).
        efficiency: Fraction of the power that the gear transmits in either direction. The torque at the joint is multiplied by it if the
            motor drives the joint, and divided by it if the joint drives the motor.
        control: Kind of input of the motor. With "torque", the input is a torque, N m, limited to those that voltages up to the nominal
            one, of either sign, produce at the current speed. With "voltage", it is a fraction of the nominal voltage, from -1 to 1.
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
            raise ValueError(f"stall_torque is {self.stall_torque!r} and no_load_speed is {self.no_load_speed!r}: give both, or neither")

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        """Dictionary of the motor's numbers for the Rust library, with arguments as in `Drive._row`.

        Values per environment are lists, with one number if all are equal.
        """

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
    """Model of an actuator with delay, servo, lag, motor, gear and friction. The default is an ideal actuator.

    The control passes these parts in this order: control range, delay, servo, lag, affine force of the actuator, limits, torque-speed
    curve, gear, friction. Every number is a scalar for all environments or an array (num_envs,). See docs/reference/actuators.md.

    Attributes:
        delay: Delay of the control, s. If it is no multiple of the time step, a step uses the mean of the delayed control over the step.
            With a sampled servo (`PID.period`), the delay is rounded up to whole steps.
        delay_steps: Delay of the control, time steps; it is added to `delay`.
        lag: Time constant of a first-order lag of the control, or of the effort of a servo, s; 0 disables the lag.
        limits: Lowest and highest force of the actuator, N or N m, in addition to its `forcerange`.
        motor: DC motor with gear.
        servo: Servo that replaces the affine force and the control range of the actuator.
        friction: Dry friction on the actuator's side of MJCF's gear, N or N m. The friction at the joint is this value times the absolute
            value of the gear.
        stribeck_friction: Additional dry friction at rest, N or N m, on the same side. It decreases with the speed v of that side by the
            factor exp(-(v / stribeck_velocity)**2), the Stribeck curve.
        stribeck_velocity: Speed at which the additional friction has decreased to 1/e, m/s or rad/s; needed with `stribeck_friction`.
    """

    delay: Number = 0.0
    delay_steps: Number = 0.0
    lag: Number = 0.0
    limits: tuple[Number, Number] | None = None
    motor: DCMotor | None = None
    servo: PID | None = None
    friction: Number = 0.0
    stribeck_friction: Number = 0.0
    stribeck_velocity: Number = 0.0

    def __post_init__(self) -> None:
        for name, kind in (("motor", DCMotor), ("servo", PID)):
            given = getattr(self, name)
            if given is not None and not isinstance(given, kind):
                raise TypeError(f"{name} is {given!r}, must be a stepper.actuators.{kind.__name__}")
        check_numbers(self, "motor", "servo")

    def _row(self, num_envs: int, envs: Envs = None) -> dict[str, Any]:
        """Dictionary of the drive's numbers for the Rust library.

        Its entries "servo" and "motor" are nested dictionaries, or None if the drive has no servo or motor.

        Args:
            num_envs: Number of environments, for checks of array sizes.
            envs: Mask (num_envs,) or indices of the environments whose numbers are returned; None selects all.
        """
        low, high = (-math.inf, math.inf) if self.limits is None else self.limits
        names = ("delay", "delay_steps", "lag", "friction", "stribeck_friction", "stribeck_velocity")
        return {
            **{name: numbers(name, getattr(self, name), num_envs, envs) for name in names},
            "low": numbers("limits[0]", low, num_envs, envs),
            "high": numbers("limits[1]", high, num_envs, envs),
            "servo": None if self.servo is None else self.servo._row(num_envs, envs),
            "motor": None if self.motor is None else self.motor._row(num_envs, envs),
        }


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
        return cls.from_dict(read_file(path), str(path))

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

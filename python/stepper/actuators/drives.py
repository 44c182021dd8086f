"""Drive of an actuator and its parts: delay, lag, servo and motor between a control and the force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper.shared.tables import check_numbers, numbers

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
        """Dictionary of the servo's numbers for the Rust library. Each value is a list with one number per environment, or one for all.

        Args:
            num_envs: Number of environments, for checks of array sizes.
            envs: Mask (num_envs,) or indices of the environments whose numbers are returned; None selects all.
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
        """Dictionary of the motor's numbers for the Rust library. Values per environment are lists, with one number if all are equal.

        Args:
            num_envs: Number of environments, for checks of array sizes.
            envs: Mask (num_envs,) or indices of the environments whose numbers are returned; None selects all.
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
        return {
            **{name: numbers(name, getattr(self, name), num_envs, envs) for name in ("delay", "delay_steps", "lag", "friction")},
            "low": numbers("limits[0]", low, num_envs, envs),
            "high": numbers("limits[1]", high, num_envs, envs),
            "servo": None if self.servo is None else self.servo._row(num_envs, envs),
            "motor": None if self.motor is None else self.motor._row(num_envs, envs),
        }

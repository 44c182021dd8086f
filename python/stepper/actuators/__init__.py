"""Drives of actuators: models of delay, servo, motor and gear between the control and the force."""

from typing import Any

from stepper._hints import no_name
from stepper.actuators.drives import PID, DCMotor, Drive
from stepper.actuators.model import ActuatorModel

__all__ = ["PID", "ActuatorModel", "DCMotor", "Drive"]


def __getattr__(name: str) -> Any:
    raise no_name(__name__, name, __all__)

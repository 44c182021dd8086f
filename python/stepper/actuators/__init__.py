"""Drives of actuators: from the control to the force."""

from stepper.actuators.drives import PID, DCMotor, Drive
from stepper.actuators.model import ActuatorModel

__all__ = ["PID", "ActuatorModel", "DCMotor", "Drive"]

"""Actuators: what becomes of a control before it is a force."""

from stepper.actuators.drives import PID, DCMotor, Drive
from stepper.actuators.model import ActuatorModel

__all__ = ["PID", "ActuatorModel", "DCMotor", "Drive"]

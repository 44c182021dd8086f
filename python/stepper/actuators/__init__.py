"""Drives of actuators: models of delay, servo, motor and gear between the control and the force."""

from stepper.actuators.drives import PID, DCMotor, Drive
from stepper.actuators.model import ActuatorModel

__all__ = ["PID", "ActuatorModel", "DCMotor", "Drive"]

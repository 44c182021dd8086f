"""Drives of actuators: models of delay, servo, motor and gear between the control and the force."""

from stepper.actuators.model import PID, ActuatorModel, DCMotor, Drive

__all__ = ["PID", "ActuatorModel", "DCMotor", "Drive"]

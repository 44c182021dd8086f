"""Sensors: what they make of the truth, devices that one can buy, and readings that are added to a model."""

from stepper.sensors.model import SensorModel
from stepper.sensors.readings import Combination, RayFan, SensorSpec
from stepper.sensors.transfer import Transfer
from stepper.sensors.view import FieldOfView

__all__ = ["Combination", "FieldOfView", "RayFan", "SensorModel", "SensorSpec", "Transfer"]

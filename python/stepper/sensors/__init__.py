"""Sensors: what they make of the truth, devices that one can buy, and readings that MJCF has no word for."""

from stepper.sensors.model import SensorModel
from stepper.sensors.readings import Combination, RayFan
from stepper.sensors.transfer import Transfer
from stepper.sensors.view import FieldOfView

__all__ = ["Combination", "FieldOfView", "RayFan", "SensorModel", "Transfer"]

"""Sensors: what they make of the truth, devices that one can buy, and readings that MJCF has no word for."""

from stepper.sensors.model import SensorModel
from stepper.sensors.readings import Combination, RayFan
from stepper.sensors.transfer import Transfer

__all__ = ["Combination", "RayFan", "SensorModel", "Transfer"]

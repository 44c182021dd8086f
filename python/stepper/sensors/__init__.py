"""Sensor errors, commercial devices with data sheets, additional sensors for a model, and heights of height fields."""

from stepper.sensors import devices
from stepper.sensors.heights import HeightField
from stepper.sensors.model import SensorModel
from stepper.sensors.readings import Combination, RayFan, SensorSpec
from stepper.sensors.transfer import Transfer

__all__ = ["Combination", "HeightField", "RayFan", "SensorModel", "SensorSpec", "Transfer", "devices"]

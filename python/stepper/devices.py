"""Transfer functions of devices that one can buy, from their data sheets: `stepper.sensors.devices` under its public name."""

from stepper.sensors.devices import DEVICES, encoder, encoder_velocity, find

__all__ = ["DEVICES", "encoder", "encoder_velocity", "find"]

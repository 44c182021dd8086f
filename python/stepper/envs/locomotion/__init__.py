"""Locomotion of legged robots that packages ship, by the names that the tasks are registered under."""

from stepper.envs.locomotion.go1 import Go1Velocity

__all__ = ["Go1Velocity"]

"""Locomotion of legged robots that packages ship, by the names that the tasks are registered under."""

from stepper.envs.locomotion.g1 import G1Velocity
from stepper.envs.locomotion.go1 import Go1Velocity
from stepper.envs.locomotion.velocity import VelocityTask

__all__ = ["G1Velocity", "Go1Velocity", "VelocityTask"]

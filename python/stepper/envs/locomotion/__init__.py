"""Locomotion tasks of legged robots. The robots' model files come from the installed package mjlab."""

from stepper.envs.locomotion.g1 import G1Rough, G1Velocity
from stepper.envs.locomotion.go1 import Go1Rough, Go1Velocity
from stepper.envs.locomotion.velocity import RoughTask, VelocityTask

__all__ = ["G1Rough", "G1Velocity", "Go1Rough", "Go1Velocity", "RoughTask", "VelocityTask"]

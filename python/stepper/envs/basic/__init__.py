"""Small tasks, one file each with its scene, as examples for writing a first task."""

from stepper.envs.basic.falling_block import FallingBlock
from stepper.envs.basic.grasp import Grasp

__all__ = ["FallingBlock", "Grasp"]

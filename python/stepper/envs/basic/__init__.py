"""Small tasks of stepper, one file each with its scene: examples for a first task of your own."""

from stepper.envs.basic.falling_block import FallingBlock
from stepper.envs.basic.grasp import Grasp

__all__ = ["FallingBlock", "Grasp"]

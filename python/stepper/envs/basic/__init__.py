"""Small tasks of stepper's own, a file each, whose scenes are in them: to begin with, and to copy."""

from stepper.envs.basic.falling_block import FallingBlock
from stepper.envs.basic.grasp import Grasp

__all__ = ["FallingBlock", "Grasp"]

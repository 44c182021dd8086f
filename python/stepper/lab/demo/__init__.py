"""Demo (`stepper demo`): a thousand humanoids fall and come to rest, in stepper and in MuJoCo."""

from stepper.lab.demo.race import Plan
from stepper.lab.demo.report import demo

__all__ = ["Plan", "demo"]

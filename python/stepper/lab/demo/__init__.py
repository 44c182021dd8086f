"""The demo: a thousand humanoids fall about and lie still, beside MuJoCo."""

from stepper.lab.demo.race import Plan, demo

__all__ = ["Plan", "demo"]

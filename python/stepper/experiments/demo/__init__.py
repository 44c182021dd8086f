"""The demo: a thousand humanoids fall about and lie still, beside MuJoCo."""

from stepper.experiments.demo.race import Plan, demo

__all__ = ["Plan", "demo"]

"""Velocity tasks on rough terrain, with the observations, rewards, events and curricula of mjlab's."""

from stepper.envs.locomotion.rough.task import RoughTask

__all__ = ["RoughTask"]

"""Velocity tasks on rough terrain, with the observations, rewards, random events and curricula of mjlab's tasks."""

from stepper.envs.locomotion.rough.task import RoughTask

__all__ = ["RoughTask"]

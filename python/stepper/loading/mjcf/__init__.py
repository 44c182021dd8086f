"""Conversion of a model that MuJoCo's compiler made, a `mujoco.MjModel`, into a description for `Model.from_description`."""

from stepper.loading.mjcf.describe import describe

__all__ = ["describe"]

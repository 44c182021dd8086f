"""Scenes that have one of everything, small enough to be tried thousands of times."""

from models import mjcf

ROBOT = "everything"
SCENES = {name: mjcf(name) for name in (ROBOT, "stack", "double_pendulum")}

"""Robots dropped and left: at rest the floor carries their weight, and nothing creeps."""

import mujoco
import numpy as np
import pytest
from models import SOURCES, simulate


# Name, height of the drop and what to wait for.
ROBOTS = ["dm_control/humanoid", "dm_control/quadruped", "gymnasium/ant"]

"""Scene 11: a double pendulum and a chain of five links, without damping.

Right answer: the energy is constant; the state is that of a converged DOP853 solution. Here the whole sweep of time steps that a user may choose;
the state after one second at dt 1e-4 is held to 1e-8 in reference/test_trajectories.py.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from models import simulate
from numerics import slope, state_error

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))
from test_trajectories import converged, run, scene

DTS = [1e-4, 1e-3, 5e-3, 2e-2]
ORDERS = {"euler": 1, "midpoint": 2, "rk4": 4}

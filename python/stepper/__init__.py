"""stepper: a rigid-body contact stepper for robots.

Load a scene with `load`, step environments of it with `Stepper`, and read in `Stepper.residual` and `Stepper.status` how well that went.
"""

import importlib
from typing import Any

from stepper import _pickles as _pickles
from stepper import devices
from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__, cpu_levels
from stepper.actuators import PID, ActuatorModel, DCMotor, Drive
from stepper.experiments.compare import Comparison, compare
from stepper.identification import Episode, Identification, Parameter, identify
from stepper.loading import ModelWarning, load
from stepper.recording import Difference, Recorder, RecordingError, Replay, replay
from stepper.sensors import Combination, RayFan, SensorModel, Transfer

__all__ = [
    "PID",
    "ActuatorModel",
    "Combination",
    "Comparison",
    "DCMotor",
    "Difference",
    "Drive",
    "Episode",
    "Identification",
    "Model",
    "ModelError",
    "ModelWarning",
    "Options",
    "Parameter",
    "RayFan",
    "Recorder",
    "RecordingError",
    "Replay",
    "SensorModel",
    "State",
    "Status",
    "Stepper",
    "Transfer",
    "__version__",
    "compare",
    "cpu_levels",
    "devices",
    "identify",
    "load",
    "replay",
]


def __getattr__(name: str) -> Any:
    # Gymnasium is optional, and slow to import.
    if name == "envs":
        return importlib.import_module("stepper.envs")
    raise AttributeError(f"module 'stepper' has no attribute {name!r}")

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
from stepper.experiments.accuracy import Chart, Tuning, chart, tune
from stepper.experiments.compare import Comparison, compare
from stepper.experiments.study import Outcome, Parameter, Policy, Report, Study, report, sweep
from stepper.identification import Episode, Identification, Unknown, identify
from stepper.loading import ModelWarning, load
from stepper.recording import Difference, Recorder, RecordingError, Replay, replay
from stepper.sensors import Combination, RayFan, SensorModel, Transfer

__all__ = [
    "PID",
    "ActuatorModel",
    "Chart",
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
    "Outcome",
    "Parameter",
    "Policy",
    "RayFan",
    "Recorder",
    "RecordingError",
    "Replay",
    "Report",
    "SensorModel",
    "State",
    "Status",
    "Stepper",
    "Study",
    "Transfer",
    "Tuning",
    "Unknown",
    "__version__",
    "chart",
    "compare",
    "cpu_levels",
    "devices",
    "identify",
    "load",
    "replay",
    "report",
    "sweep",
    "tune",
]


def __getattr__(name: str) -> Any:
    # Gymnasium is optional and slow to import, and few look at what they step.
    if name in ("envs", "viewer"):
        return importlib.import_module(f"stepper.{name}")
    raise AttributeError(f"module 'stepper' has no attribute {name!r}")

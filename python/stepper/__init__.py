"""stepper: a rigid-body contact stepper for robots.

Load a scene with `load`, step environments of it with `Stepper`, and read in `Stepper.residual` and `Stepper.status` how well that went.
"""

import importlib
from typing import TYPE_CHECKING, Any

from stepper import _pickles as _pickles
from stepper import bodies, devices, quantities, states
from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__, cpu_levels
from stepper.actuators import PID, ActuatorModel, DCMotor, Drive
from stepper.loading import HeightField, ModelWarning, load
from stepper.recording import Difference, Recorder, RecordingError, Replay, replay
from stepper.sensors import Combination, FieldOfView, RayFan, SensorModel, SensorSpec, Transfer

if TYPE_CHECKING:
    from stepper.derivatives import Kink, Linearization
    from stepper.experiments.accuracy.chart import Chart, chart
    from stepper.experiments.accuracy.tune import Tuning, tune
    from stepper.experiments.compare import Comparison, compare
    from stepper.experiments.study import Outcome, Parameter, Policy, Study
    from stepper.experiments.study.ranking import Ranking, rank
    from stepper.experiments.study.report import Report, report, sweep
    from stepper.identification import Episode, FitParameter, Identification, Tracked, Tracker, identify

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
    "FieldOfView",
    "FitParameter",
    "HeightField",
    "Identification",
    "Kink",
    "Linearization",
    "Model",
    "ModelError",
    "ModelWarning",
    "Options",
    "Outcome",
    "Parameter",
    "Policy",
    "Ranking",
    "RayFan",
    "Recorder",
    "RecordingError",
    "Replay",
    "Report",
    "SensorModel",
    "SensorSpec",
    "State",
    "Status",
    "Stepper",
    "Study",
    "Tracked",
    "Tracker",
    "Transfer",
    "Tuning",
    "__version__",
    "bodies",
    "chart",
    "compare",
    "cpu_levels",
    "devices",
    "identify",
    "load",
    "quantities",
    "rank",
    "replay",
    "report",
    "states",
    "sweep",
    "tune",
]


_LATER = {
    **dict.fromkeys(("Kink", "Linearization"), "stepper.derivatives"),
    **dict.fromkeys(("Chart", "Tuning", "chart", "tune"), "stepper.experiments.accuracy"),
    **dict.fromkeys(("Comparison", "compare"), "stepper.experiments.compare"),
    **dict.fromkeys(
        ("Outcome", "Parameter", "Policy", "Ranking", "Report", "Study", "rank", "report", "sweep"), "stepper.experiments.study"
    ),
    **dict.fromkeys(("Episode", "Identification", "Tracked", "Tracker", "FitParameter", "identify"), "stepper.identification"),
}
"""Names whose modules are imported when they are asked for: a loop that steps needs none of them, and they take longer than all else."""


_SUBMODULES = ("adapters", "cli", "derivatives", "envs", "experiments", "identification", "policies", "viewer")
"""Submodules that are imported when they are first used: most are slow to import, and some need optional packages."""


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"stepper.{name}")
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module 'stepper' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_SUBMODULES})

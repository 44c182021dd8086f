"""stepper: a rigid-body contact stepper for robots.

Load a scene with `load`, step environments of it with `Stepper`, and read in `Stepper.residual` and `Stepper.status` how well that went.
"""

from stepper import devices
from stepper._actuators import PID, ActuatorModel, DCMotor, Drive
from stepper._options import Options
from stepper._readings import Combination, RayFan
from stepper._record import Recorder
from stepper._recording import RecordingError
from stepper._replay import Difference, Replay, replay
from stepper._sensors import SensorModel, Transfer
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__, cpu_levels
from stepper.loading import ModelWarning, load

__all__ = [
    "PID",
    "ActuatorModel",
    "Combination",
    "DCMotor",
    "Difference",
    "Drive",
    "Model",
    "ModelError",
    "ModelWarning",
    "Options",
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
    "cpu_levels",
    "devices",
    "load",
    "replay",
]

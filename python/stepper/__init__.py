"""stepper: a rigid-body contact stepper for robots.

Load a scene with `load`, step environments of it with `Stepper`, and read in `Stepper.residual` and `Stepper.status` how well that went.
"""

import importlib
from typing import TYPE_CHECKING, Any

from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__
from stepper.actuators import ActuatorModel, Drive
from stepper.loading import ModelWarning, load
from stepper.recording import Recorder, replay
from stepper.sensors import SensorModel, Transfer

if TYPE_CHECKING:
    from stepper import actuators, adapters, derivatives, envs, lab, policies, recording, sensors, sysid, viewer

__all__ = [
    "ActuatorModel",
    "Drive",
    "Model",
    "ModelError",
    "ModelWarning",
    "Options",
    "Recorder",
    "SensorModel",
    "State",
    "Status",
    "Stepper",
    "Transfer",
    "__version__",
    "actuators",
    "adapters",
    "derivatives",
    "envs",
    "lab",
    "load",
    "policies",
    "recording",
    "replay",
    "sensors",
    "sysid",
    "viewer",
]

_SUBMODULES = ("adapters", "derivatives", "envs", "lab", "policies", "sysid", "viewer")
"""Submodules that are imported when they are first used: most are slow to import, and some need optional packages."""


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"stepper.{name}")
    from stepper._hints import no_root_attribute  # noqa: PLC0415

    raise no_root_attribute(name, __all__)


def __dir__() -> list[str]:
    return sorted(__all__)

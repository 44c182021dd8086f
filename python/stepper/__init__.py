"""stepper: a simulator of rigid bodies in contact, for robots.

`load` reads a model. `Stepper` simulates many environments of this model. `Stepper.status` and `Stepper.residual` report how well each
step was solved.
"""

import importlib
from typing import TYPE_CHECKING, Any

from stepper._hints import Called, did_you_mean, replacement
from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__

if TYPE_CHECKING:
    from stepper import actuators, adapters, derivatives, doctor, elements, envs, lab, policies, recording, sensors, sysid, viewer
    from stepper.actuators import ActuatorModel, Drive
    from stepper.loading import ModelWarning, load
    from stepper.recording import Recorder
    from stepper.sensors import SensorModel, Transfer
    from stepper.shared.draws import add, log_uniform, normal, scale, uniform

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
    "add",
    "derivatives",
    "doctor",
    "elements",
    "envs",
    "lab",
    "load",
    "log_uniform",
    "normal",
    "policies",
    "recording",
    "scale",
    "sensors",
    "sysid",
    "uniform",
    "viewer",
]

_SUBMODULES = (
    *("actuators", "adapters", "derivatives", "doctor", "elements", "envs", "lab"),
    *("policies", "recording", "sensors", "sysid", "viewer"),
)
"""Submodules, imported at their first use: some are slow to import or need optional packages."""
_MODULE_OF = {
    **dict.fromkeys(("ActuatorModel", "Drive"), "actuators"),
    **dict.fromkeys(("ModelWarning", "load"), "loading"),
    "Recorder": "recording",
    **dict.fromkeys(("SensorModel", "Transfer"), "sensors"),
    **dict.fromkeys(("add", "log_uniform", "normal", "scale", "uniform"), "shared.draws"),
}
"""Submodule of each name that is imported at its first use."""

for _name in ("contacts", "energy", "mass_matrix", "memory", "momentum", "worst_row"):
    setattr(Stepper, _name, Called(getattr(Stepper, _name)))


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"stepper.{name}")
    if name in _MODULE_OF:
        value = getattr(importlib.import_module(f"stepper.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{replacement('engine', name) or did_you_mean(name, __all__)}")


def __dir__() -> list[str]:
    return sorted(__all__)

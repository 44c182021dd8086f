"""Points of a study: sets of parameter values, each with the name of the settings for its episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stepper._hints import did_you_mean
from stepper.lab.study.parameters import Parameter, Value, Values
from stepper.lab.study.worlds import MUJOCO_SETTINGS

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

USUAL = "stepper"
"""Name of the settings that are the options of the study itself."""
_LACKING = {"midpoint", "auto"}
"""Values of the options `integrator` and `solver` that MuJoCo does not have."""


@dataclass(frozen=True)
class Point:
    """Point of a study: values of its parameters, and settings.

    Attributes:
        values: Values of parameters by name; absent parameters keep the model's numbers.
        setting: Name of the settings.
    """

    values: Values
    setting: str = USUAL


def inapplicable(study: Study, setting: str, parameter: Parameter) -> str | None:
    """Reason why a parameter has no effect with the settings of this name; None if it has an effect."""
    given = study.setting(setting)
    if parameter.kind == "options" and parameter.leaf in given:
        return f"these settings fix {parameter.leaf}"
    if given.get("engine") == "mujoco":
        return _lacking(parameter)
    if parameter.parsed.field == "geom_restitution" and given.get("contact", study.options.contact) == "mujoco":
        return "MuJoCo's law of contact has no restitution"
    return None


def _lacking(parameter: Parameter) -> str | None:
    """Reason why the engine MuJoCo cannot apply a parameter; None if it can."""
    if parameter.kind in ("sensor", "actuator"):
        return "MuJoCo has no sensor errors and no drives"
    if parameter.kind == "options" and parameter.leaf not in MUJOCO_SETTINGS:
        return f"MuJoCo has no {parameter.leaf}"
    if parameter.kind == "options" and (words := _LACKING & {*parameter.levels(), parameter.nominal}):
        return f"MuJoCo has no {parameter.leaf} {', '.join(sorted(map(str, words)))}"
    if parameter.parsed.field in ("geom_restitution", "geom_concave", "eq_stiffness", "eq_damping"):
        return f"MuJoCo has no {parameter.parsed.field}"
    return None


def nominal_of(study: Study, setting: str) -> dict[str, Value]:
    """Nominal values by name of the parameters that have an effect with the settings of this name."""
    return {name: value for name, value in study.nominal.items() if not inapplicable(study, setting, study.parameters[name])}


def point_at(study: Study, values: Mapping[str, Value], setting: str = USUAL) -> Point:
    """Point with given values of parameters by name; the others are nominal."""
    chosen = nominal_of(study, setting)
    for name, value in values.items():
        if name not in study.parameters:
            known = ", ".join(study.parameters) or "none"
            raise ValueError(f"{study.name} has no parameter {name!r}{did_you_mean(name, study.parameters) or ','} there are: {known}")
        if reason := inapplicable(study, setting, study.parameters[name]):
            raise ValueError(f"parameter {name!r} has no effect with the settings {setting!r}: {reason}; leave it out")
        study.parameters[name].check_value(value, f"parameter {name!r}")
        chosen[name] = value
    return Point(chosen, setting)

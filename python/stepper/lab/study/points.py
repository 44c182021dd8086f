"""Points of a study: values of its parameters and settings, what of them applies, and the check of those that a user asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stepper._hints import near
from stepper.lab.study.parameters import Parameter, Theta, Value
from stepper.lab.study.worlds import MUJOCO_SETTINGS

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

USUAL = "stepper"
"""Name of the settings that a study runs with by itself."""
_LACKING = {"midpoint", "auto"}
"""Integrator and solver that MuJoCo does not have."""


@dataclass(frozen=True)
class Point:
    """Where a study is run.

    Attributes:
        theta: Values of parameters; those that are not named are as the model has them.
        setting: Name of the settings.
    """

    theta: Theta
    setting: str = USUAL


def inapplicable(study: Study, setting: str, parameter: Parameter) -> str | None:
    """Why a parameter has no part in some settings; None where it has one."""
    given = study.setting(setting)
    if parameter.kind == "options" and parameter.leaf in given:
        return f"these settings fix {parameter.leaf} themselves"
    if given.get("engine") == "mujoco":
        return _lacking(parameter)
    if parameter.parsed.field == "geom_restitution" and given.get("contact", study.options.contact) == "mujoco":
        return "restitution has no part in MuJoCo's law"
    return None


def _lacking(parameter: Parameter) -> str | None:
    """What of a parameter MuJoCo does not have."""
    if parameter.kind in ("sensor", "actuator"):
        return "MuJoCo has no errors of sensors and no drives"
    if parameter.kind == "options" and parameter.leaf not in MUJOCO_SETTINGS:
        return f"MuJoCo has no {parameter.leaf}"
    if parameter.kind == "options" and (words := _LACKING & {*parameter.levels(), parameter.nominal}):
        return f"MuJoCo has no {parameter.leaf} {', '.join(sorted(map(str, words)))}"
    if parameter.parsed.field in ("geom_restitution", "geom_concave", "eq_stiffness", "eq_damping"):
        return f"MuJoCo has no {parameter.parsed.field}"
    return None


def nominal_of(study: Study, setting: str) -> dict[str, Value]:
    """Theta of the unperturbed point with some settings: without the parameters that have no part in them."""
    return {name: value for name, value in study.nominal.items() if not inapplicable(study, setting, study.parameters[name])}


def point_at(study: Study, values: Mapping[str, Value], setting: str = USUAL) -> Point:
    """The point of values that a user asks for; what is not named is nominal.

    Raises:
        ValueError: No parameter of a name, one that has no part in the settings, or a value that is none of its.
    """
    theta = nominal_of(study, setting)
    for name, value in values.items():
        if name not in study.parameters:
            known = ", ".join(study.parameters) or "none"
            raise ValueError(f"{study.name} has no parameter {name!r}{near(name, study.parameters) or ','} there are: {known}")
        if reason := inapplicable(study, setting, study.parameters[name]):
            raise ValueError(f"parameter {name!r} has no part in {setting!r}: {reason}")
        study.parameters[name].check_value(value, f"parameter {name!r}")
        theta[name] = value
    return Point(theta, setting)

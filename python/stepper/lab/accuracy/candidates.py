"""Candidate settings for `chart` and `tune`: settings of stepper and MuJoCo, and time steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stepper._options import Options
from stepper.lab.study.batches import steps_of
from stepper.lab.study.report import no_peer
from stepper.lab.study.study import Study


@dataclass(frozen=True)
class Line:
    """Line of a chart: settings at several time steps.

    Attributes:
        engine: "stepper" or "MuJoCo".
        name: Name of the settings.
        settings: Settings other than the time step that differ from the study's, by name, such as tolerance=1e-8.
        law: Contact law: "hard" or "mujoco".
    """

    engine: str
    name: str
    settings: dict[str, Any]
    law: str

    @property
    def label(self) -> str:
        """Label of the line in the chart: name of the engine and name of the settings."""
        return f"{self.engine}: {self.name}"


_FAST = {"integrator": "euler", "stabilization": "baumgarte", "tolerance": 1e-3}
"""Settings for little processor time per step."""
_HARD: tuple[tuple[str, dict[str, Any]], ...] = (
    ("midpoint", {"integrator": "midpoint"}),
    ("midpoint, f32", {"integrator": "midpoint", "precision": "f32"}),
    ("midpoint, tolerance 1e-3", {"integrator": "midpoint", "tolerance": 1e-3}),
    ("midpoint, error 1e-4", {"integrator": "midpoint", "error": 1e-4}),
    ("euler", {"integrator": "euler"}),
    ("euler, f32", {"integrator": "euler", "precision": "f32"}),
    ("euler, baumgarte, tolerance 1e-3", _FAST),
    ("euler, baumgarte, tolerance 1e-3, f32", _FAST | {"precision": "f32"}),
    ("implicit", {"integrator": "implicit"}),
    ("rk4", {"integrator": "rk4"}),
)
"""Settings of the lines for hard contact: name, and values that differ from the study's."""
_MORE: tuple[tuple[str, dict[str, Any]], ...] = (
    ("midpoint, error 1e-3", {"integrator": "midpoint", "error": 1e-3}),
    ("midpoint, error 1e-5", {"integrator": "midpoint", "error": 1e-5}),
    ("midpoint, pgs", {"integrator": "midpoint", "solver": "pgs"}),
    ("midpoint, newton", {"integrator": "midpoint", "solver": "newton"}),
    ("midpoint, 10 iterations", {"integrator": "midpoint", "iterations": 10}),
)
"""Settings of further lines for hard contact, in which the settings of the solver vary."""
_PEER: tuple[tuple[str, dict[str, Any]], ...] = (
    ("its file's settings", {}),
    ("implicitfast, elliptic, Newton", {"integrator": "implicitfast", "cone": "elliptic", "solver": "newton"}),
    (
        "implicitfast, elliptic, impratio 10, noslip 10",
        {"integrator": "implicitfast", "cone": "elliptic", "solver": "newton", "impratio": 10.0, "noslip_iterations": 10},
    ),
)
"""Settings of the lines for the engine MuJoCo."""


def hard_lines(*, more: bool = False) -> list[Line]:
    """Lines of a chart for stepper with hard contact: settings to run at several time steps.

    With `more`, the solver's settings vary too.
    """
    return [Line("stepper", name, {"contact": "hard"} | given, "hard") for name, given in _HARD + (_MORE if more else ())]


def lines(study: Study, *, quick: bool) -> list[Line]:
    """All lines of a study's chart: hard contact, MuJoCo's contact law, and the engine MuJoCo if it can run the study."""
    model, _ = study.loaded
    try:
        integrator = Options.from_model(model).integrator if model.requested else "euler"
    except ValueError:
        integrator = "euler"  # The file selects an integrator that stepper does not have.
    law = {"contact": "mujoco", "integrator": integrator}
    found = hard_lines(more=not quick)
    found += [Line("stepper", f"MuJoCo's law, {integrator}", law, "mujoco")]
    found += [Line("stepper", f"MuJoCo's law, {integrator}, f32", law | {"precision": "f32"}, "mujoco")]
    if no_peer(study) is None:
        found += [Line("MuJoCo", name, {"engine": "mujoco"} | given, "mujoco") for name, given in _PEER]
    return found


def timesteps(study: Study, *, coarser: int = 3, finer: int = 3) -> list[float]:
    """Time steps around that of the study, s, ascending by factors of about two. Each divides the control period."""
    own = steps_of(study, study.options.timestep or float(study.loaded[0].timestep))
    counts = {max(1, round(own * 2.0**k)) for k in range(-coarser, finer + 1)}
    return sorted(study.control_period / count for count in counts)


def pareto(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the Pareto front, by ascending cost: candidates for which no other is both cheaper and more accurate."""
    front: list[int] = []
    best = math.inf
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if errors[k] < best:
            front.append(k)
            best = errors[k]
    return front

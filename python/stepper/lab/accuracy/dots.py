"""Points of a chart: errors, costs, invariants and outcomes of some settings with a given time step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

from stepper.lab.accuracy.candidates import pareto

CAUSES = {"solver": "solver", "step": "time step", "model": "model"}
"""Causes of an error, as words for tables and pictures. Keys are the attributes of `Dot` with the part of the error from a cause."""


@dataclass(frozen=True)
class Dot:
    """Point of a chart: settings with a given time step. Errors are medians over episodes, in the unit of the distance (m or rad).

    Attributes:
        engine: "stepper" or "MuJoCo".
        setting: Name of the settings.
        timestep: Time step, s.
        error: Largest distance of the run from the reference up to the horizon. It is infinite if the run is not finite, and NaN if
            it was stopped before the horizon.
        min_error: Smallest error of all episodes.
        max_error: Largest error of all episodes.
        solver: Error from the solver: distance of the run from the same run with a tight tolerance (1e-9 m/s) and precision "f64". NaN for
            MuJoCo.
        step: Error from the time step: distance of the run with a tight tolerance from the converged run with the same contact law.
        model: Error from the contact law (softness, friction cone): distance of that converged run from the reference.
        us_single_env: Microseconds of one core for a simulated second of one environment, stepped alone; NaN if not measured.
        batch: Microseconds of one core for a simulated second of one environment, stepped in a batch; NaN if not measured.
        depth: Deepest overlap of all episodes in the engine's contacts, m.
        residual: Largest residual of all episodes, m/s; NaN for MuJoCo.
        outcome: Mean of an outcome over finite episodes: the outcome with a condition of success, or otherwise the first outcome. NaN
            without outcomes.
        share: Fraction of successful episodes, where episodes that were not finite are failures; NaN without a condition of success.
        invariants: Largest errors of invariants over all episodes, by name; NaN if not measured.
        notes: Remarks: runs that were stopped, or not finite.
    """

    engine: str
    setting: str
    timestep: float
    error: float
    min_error: float
    max_error: float
    solver: float
    step: float
    model: float
    us_single_env: float
    batch: float
    depth: float
    residual: float
    outcome: float
    share: float
    invariants: dict[str, float]
    notes: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label of the chart's line to which this point belongs: name of the engine and name of the settings."""
        return f"{self.engine}: {self.setting}"

    @property
    def cause(self) -> str:
        """Largest cause of the error: "solver", "time step" or "model". An empty string if the error is 0 or one of its parts is unknown.

        For MuJoCo the error from the solver is not known separately, and is included in the error from the time step.
        """
        names = {name: word for name, word in CAUSES.items() if word != "solver" or self.engine == "stepper"}
        parts = {word: float(getattr(self, name)) for name, word in names.items()}
        cause = max(parts, key=lambda word: parts[word])
        return cause if all(map(math.isfinite, [self.error, *parts.values()])) and parts[cause] > 0.0 else ""

    @property
    def row(self) -> dict[str, object]:
        """Row of the chart's table for this point: values by name of the column."""
        return dict(self._columns())

    def _columns(self) -> Iterator[tuple[str, object]]:
        """Yields the name and the value of each column of the chart's table for this point."""
        for own in fields(self):
            if own.name in CAUSES:
                yield f"error from {CAUSES[own.name]}", getattr(self, own.name)
            elif own.name not in ("invariants", "notes"):
                yield own.name, getattr(self, own.name)
            if own.name == "model":
                yield "cause", self.cause
        yield from self.invariants.items()
        yield "notes", "; ".join(self.notes)


def front(dots: Sequence[Dot], cost: str, engine: str | None = None) -> list[Dot]:
    """Pareto front of a chart: points for which no other point is both cheaper and more accurate."""
    own = [dot for dot in dots if math.isfinite(dot.error) and math.isfinite(getattr(dot, cost)) and engine in (None, dot.engine)]
    return [own[k] for k in pareto([getattr(dot, cost) for dot in own], [dot.error for dot in own])]

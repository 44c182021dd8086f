"""Points of a chart as numbers: errors, costs, invariants and outcomes of settings at a time step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

from stepper.lab.accuracy.candidates import pareto
from stepper.lab.accuracy.distributions import Shift


@dataclass(frozen=True)
class Dot:
    """Settings at one time step: a point of a chart. Errors are medians over episodes, in the unit of the distance.

    Attributes:
        engine: "stepper", "MuJoCo" or "rapier".
        setting: In a few words.
        timestep: s.
        error: From the reference; infinite where runs are not finite, and NaN where the clock stopped them before the horizon.
        least: Of all episodes.
        most: Of all episodes.
        solver: From the same run solved to 1e-9 m/s in 64 bits; NaN of peers.
        step: Of that run from the converged one of the same law.
        model: Of that from the reference: softness, and the friction cone.
        alone: Microseconds of one core for a simulated second of one environment, stepped alone; NaN where it was not measured.
        batch: The same in a batch.
        depth: Deepest overlap of all episodes as the engine says, m.
        residual: Largest residual of all episodes, m/s; NaN of peers.
        outcome: Mean of the outcome that decides, or the first, of episodes that were finite; NaN without one.
        share: Share of successes; NaN without one. What was not finite is none.
        invariants: Largest errors of invariants of all episodes by name; NaN where there is none to be measured.
        shifts: By how much outcomes differ from those of the converged runs.
        notes: What has to be said of it: what was stopped, what was not finite.
    """

    engine: str
    setting: str
    timestep: float
    error: float
    least: float
    most: float
    solver: float
    step: float
    model: float
    alone: float
    batch: float
    depth: float
    residual: float
    outcome: float
    share: float
    invariants: dict[str, float]
    shifts: tuple[Shift, ...]
    notes: tuple[str, ...]

    @property
    def label(self) -> str:
        """Engine and settings."""
        return f"{self.engine}: {self.setting}"

    @property
    def row(self) -> dict[str, object]:
        """As a row of a table, with a column for every number."""
        return dict(self._columns())

    def _columns(self) -> Iterator[tuple[str, object]]:
        for own in fields(self):
            if own.name not in ("invariants", "shifts", "notes"):
                yield own.name, getattr(self, own.name)
        yield from self.invariants.items()
        for shift in self.shifts:
            yield from ((f"shift of {shift.name}", shift.value), (f"{shift.name}, low", shift.low), (f"{shift.name}, high", shift.high))
        yield "notes", "; ".join(self.notes)


def front(dots: Sequence[Dot], cost: str, engine: str | None = None) -> list[Dot]:
    """Points that nothing is both cheaper and more accurate than, by cost ("alone" or "batch")."""
    own = [dot for dot in dots if math.isfinite(dot.error) and math.isfinite(getattr(dot, cost)) and engine in (None, dot.engine)]
    return [own[k] for k in pareto([getattr(dot, cost) for dot in own], [dot.error for dot in own])]

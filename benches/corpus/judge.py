"""Which models step well: thresholds, and the criteria that a row misses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from corpus.row import MEASURED, Episode, Motion, Row

UNSOLVED = 1e-3
"""Largest share of the steps of both episodes that are NOT_CONVERGED."""
ENERGY = 10.0
"""How many times larger or smaller than MuJoCo's the mean kinetic energy may be."""
ENERGY_FLOOR = 1e-3
"""J: below this, energies count as this."""
HINGE_EXCESS = 0.05
"""rad: how far a hinge may go beyond its range, and beyond where it starts."""
SLIDE_EXCESS = 0.01
"""m: how far a slide may, a third of the stroke of a gripper's finger."""
AGREES = 1e-6
"""Relative error of smooth dynamics that counts as agreement.

MuJoCo takes a centre of mass within some nanometres of a body's origin as being there, which shows as 1e-9 to 1e-7; and mass matrices have
conditions of up to 1e9.
"""

LESS_ENERGY = "less energy"


@dataclass(frozen=True)
class Fault:
    """A criterion of stepping well that a model misses.

    Attributes:
        criterion: Its name.
        figures: What was measured.
    """

    criterion: str
    figures: str

    def __str__(self) -> str:
        return f"{self.criterion}: {self.figures}"


def agrees(row: Row) -> bool:
    """Whether the smooth dynamics are MuJoCo's."""
    return max(row.mass_error, row.bias_error, row.acceleration_error) <= AGREES


def faults(row: Row) -> list[Fault]:
    """What keeps a model from stepping well in stepper; empty where it steps well."""
    if row.outcome != MEASURED:
        return [Fault(row.outcome, row.note)]
    found = [fault for name, episode in episodes(row) for fault in _faults(name, episode)]
    if (share := not_converged(row)) > UNSOLVED:
        found.append(Fault("NOT_CONVERGED", f"{share:.2%} of the steps, residual {max(e.residual for _, e in episodes(row)):.2g} m/s"))
    return found


def their_faults(row: Row) -> list[Fault]:
    """What keeps a model from stepping well in MuJoCo: what it warns of."""
    return [Fault(f"MuJoCo warns, {name}", episode.warnings) for name, episode in episodes(row) if episode.warnings]


def not_converged(row: Row) -> float:
    """Share of the steps of both episodes that are NOT_CONVERGED."""
    steps = sum(episode.steps for _, episode in episodes(row))
    return sum(episode.not_converged * episode.steps for _, episode in episodes(row)) / max(steps, 1)


def infeasible(row: Row) -> float:
    """Larger share of the two episodes' steps that are INFEASIBLE."""
    return max(episode.infeasible for _, episode in episodes(row))


def tunnelled(row: Row) -> float:
    """Larger share of the two episodes' steps that are TUNNELLED."""
    return max(episode.tunnelled for _, episode in episodes(row))


def episodes(row: Row) -> list[tuple[str, Episode]]:
    """Both, with their names."""
    return [("random", row.random), ("rest", row.rest)]


def _faults(name: str, episode: Episode) -> list[Fault]:
    shares = {flag.upper(): getattr(episode, flag) for flag in ("non_finite", "contacts_full", "unresolved")}
    found = [Fault(flag, f"{share:.2%} of the steps, {name}") for flag, share in shares.items() if share]
    ratio = max(episode.ours.mean_energy, ENERGY_FLOOR) / max(episode.theirs.mean_energy, ENERGY_FLOOR)
    # Where MuJoCo warns, it has begun again from the reference pose, and its energy is no measure.
    if not episode.warnings and not 1 / ENERGY <= ratio <= ENERGY:
        figures = f"{_energies(episode.ours)} J, MuJoCo's {_energies(episode.theirs)} J, {name}"
        found.append(Fault(LESS_ENERGY if ratio < 1 else "more energy", figures))
    for kind, bound, unit in (("hinge", HINGE_EXCESS, "rad"), ("slide", SLIDE_EXCESS, "m")):
        ours, theirs = (getattr(motion, f"{kind}_excess") for motion in (episode.ours, episode.theirs))
        if ours > bound or math.isnan(ours):
            found.append(Fault(f"{kind} limit", f"{ours:.2g} {unit} beyond its range, MuJoCo's {theirs:.2g} {unit}, {name}"))
    return found


def _energies(motion: Motion) -> str:
    return f"{motion.mean_energy:.2g} (at most {motion.max_energy:.2g})"

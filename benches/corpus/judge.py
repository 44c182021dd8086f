"""Criteria, with thresholds, by which a model of the corpus counts as stepping well."""

import math
from dataclasses import dataclass

from corpus.row import MEASURED, Episode, Motion, Row

UNSOLVED = 1e-3
"""Largest allowed fraction of steps with the flag NOT_CONVERGED, over both episodes of a model ("random" and "rest") together."""
ENERGY = 10.0
"""Largest allowed ratio of the larger to the smaller of the mean kinetic energies in stepper and in MuJoCo."""
ENERGY_FLOOR = 1e-3
"""Smallest mean kinetic energy in the comparison of the engines, J. Smaller energies are replaced by this value."""
HINGE_EXCESS = 0.05
"""Largest allowed increase of a hinge's limit violation since the reference pose, rad."""
SLIDE_EXCESS = 0.01
"""Largest allowed increase of a slide's limit violation since the reference pose, m: a third of the stroke of a gripper finger."""
AGREES = 1e-6
"""Largest relative error of smooth dynamics that counts as agreement with MuJoCo.

MuJoCo rounds a centre of mass within some nanometres of the body's origin to the origin, an effect of 1e-9 to 1e-7. Mass matrices have
condition numbers of up to 1e9.
"""

LESS_ENERGY = "less energy"


@dataclass(frozen=True)
class Fault:
    """Violated criterion of a model.

    Attributes:
        criterion: Name of the criterion.
        figures: Text of the measured values that violate the criterion.
    """

    criterion: str
    figures: str

    def __str__(self) -> str:
        return f"{self.criterion}: {self.figures}"


def agrees(row: Row) -> bool:
    """Whether the smooth dynamics of a model agree with MuJoCo's."""
    return max(row.mass_error, row.bias_error, row.acceleration_error) <= AGREES


def faults(row: Row) -> list[Fault]:
    """Criteria that a model violates in stepper. The list is empty if the model steps well."""
    if row.outcome != MEASURED:
        return [Fault(row.outcome, row.note)]
    found = [fault for name, episode in episodes(row) for fault in _faults(name, episode)]
    if (share := not_converged(row)) > UNSOLVED:
        found.append(Fault("NOT_CONVERGED", f"{share:.2%} of the steps, residual {max(e.residual for _, e in episodes(row)):.2g} m/s"))
    return found


def their_faults(row: Row) -> list[Fault]:
    """Violated criteria of a model in MuJoCo: one for each episode in which MuJoCo gave warnings."""
    return [Fault(f"MuJoCo warns, {name}", episode.warnings) for name, episode in episodes(row) if episode.warnings]


def not_converged(row: Row) -> float:
    """Fraction of stepper's steps with the flag NOT_CONVERGED, over both episodes of a model ("random" and "rest") together."""
    steps = sum(episode.steps for _, episode in episodes(row))
    return sum(episode.not_converged * episode.steps for _, episode in episodes(row)) / max(steps, 1)


def worse_share(row: Row, flag: str) -> float:
    """Fraction of stepper's steps with a flag, such as "infeasible", in the episode of a model that has more of these steps."""
    return max(float(getattr(episode, flag)) for _, episode in episodes(row))


def episodes(row: Row) -> list[tuple[str, Episode]]:
    """Names and measurements of both episodes of a model: "random" controls, and "rest" with zero controls."""
    return [("random", row.random), ("rest", row.rest)]


def _faults(name: str, episode: Episode) -> list[Fault]:
    """Criteria that one episode of a model violates in stepper."""
    shares = {flag.upper(): getattr(episode, flag) for flag in ("non_finite", "contacts_full", "unresolved")}
    found = [Fault(flag, f"{share:.2%} of the steps, {name}") for flag, share in shares.items() if share]
    ratio = max(episode.ours.mean_energy, ENERGY_FLOOR) / max(episode.theirs.mean_energy, ENERGY_FLOOR)
    # Energies are compared only if MuJoCo gives no warning, because it resets the state after one.
    if not episode.warnings and not 1 / ENERGY <= ratio <= ENERGY:
        figures = f"{_energies(episode.ours)} J, MuJoCo's {_energies(episode.theirs)} J, {name}"
        found.append(Fault(LESS_ENERGY if ratio < 1 else "more energy", figures))
    for kind, bound, unit in (("hinge", HINGE_EXCESS, "rad"), ("slide", SLIDE_EXCESS, "m")):
        ours, theirs = (getattr(motion, f"{kind}_excess") for motion in (episode.ours, episode.theirs))
        if ours > bound or math.isnan(ours):
            found.append(Fault(f"{kind} limit", f"{ours:.2g} {unit} beyond its range, MuJoCo's {theirs:.2g} {unit}, {name}"))
    return found


def _energies(motion: Motion) -> str:
    """Text of the mean and the largest kinetic energy of a motion, J."""
    return f"{motion.mean_energy:.2g} (at most {motion.max_energy:.2g})"

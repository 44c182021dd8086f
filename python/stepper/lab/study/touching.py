"""Statistics of the contacts in a study's episodes, for each pair of geoms: duration, forces and used friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model
from stepper.lab.study.batches import USUAL, run_batch, world_of
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import StepperWorld, World

Array = NDArray[np.float64]
_SLIDING_SHARE = 0.999
"""Fraction of the friction cone above which a contact counts as sliding."""


@dataclass(frozen=True)
class Pair:
    """Statistics of the contacts of two geoms over all steps and episodes.

    Attributes:
        geoms: Indices of the geoms, the lower first.
        names: Names of the geoms.
        time: Fraction of the steps in which the normal force is positive.
        impulse: Impulse of the normal forces, N s per episode.
        peak: Largest total normal force, N.
        friction: Coefficient of sliding friction of the pair.
        used: Largest ratio of total tangential to total normal force.
        slides: Fraction of the normal impulse that acts while the ratio of total tangential to total normal force is at its bound,
            `friction`.
    """

    geoms: tuple[int, int]
    names: tuple[str, str]
    time: float
    impulse: float
    peak: float
    friction: float
    used: float
    slides: float


def deciding(pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs of geoms with at least a hundredth of the total impulse of all pairs, or a tenth of the largest force of any pair."""
    total, peak = sum(pair.impulse for pair in pairs), max((pair.peak for pair in pairs), default=0.0)
    return [pair for pair in pairs if pair.impulse >= 0.01 * total or pair.peak >= 0.1 * peak]


def _friction_of_pairs(model: Model, friction: Array) -> dict[tuple[int, int], float]:
    """Sliding friction of the explicit contact pairs of a model, by their geoms, the lower index first.

    Of two pairs of the same geoms the first is used.
    """
    found: dict[tuple[int, int], float] = {}
    for k in range(model.npair):
        pair = model.pair(k)
        found.setdefault((min(pair.geom1, pair.geom2), max(pair.geom1, pair.geom2)), float(friction[k, 0]))
    return found


def pair_friction(model: Model, friction: Array, first: int, second: int, explicit: Mapping[tuple[int, int], float]) -> float:
    """Sliding friction of two geoms.

    It is the friction of their explicit pair if there is one. Otherwise it is that of the geom with the higher priority. With equal
    priorities it is the larger of the two.

    Args:
        model: Model of the scene.
        friction: Friction coefficients of the geoms, (ngeom, 3): sliding (no unit), torsional (m), rolling (m).
        first: Index of a geom.
        second: Index of another geom.
        explicit: Sliding friction of explicit pairs by their geoms, the lower index first.
    """
    key = (min(first, second), max(first, second))
    if key in explicit:
        return explicit[key]
    one, other = model.geom(first), model.geom(second)
    if one.priority != other.priority:
        return float(friction[first if one.priority > other.priority else second, 0])
    return float(max(friction[first, 0], friction[second, 0]))


class _Ledger:
    """Accumulator that adds up the statistics of contacts, step by step.

    Args:
        model: Model of the scene.
        num_envs: Number of environments.
        friction: Friction coefficients of the geoms, (ngeom, 3).
        explicit: Sliding friction of explicit pairs by their geoms, the lower index first.
    """

    def __init__(self, model: Model, num_envs: int, friction: Array, explicit: Mapping[tuple[int, int], float]):
        self.model, self.num_envs, self.friction, self.explicit, self.steps = model, num_envs, friction, explicit, 0
        self.found: dict[tuple[int, int], dict[str, float]] = {}

    def record(self, now: World) -> None:
        """Adds the contacts of the last step to the statistics."""
        assert isinstance(now, StepperWorld)
        self.steps += self.num_envs
        contacts = now.sim.contacts()
        if len(contacts):
            self._add(contacts, now.timestep)

    def _add(self, contacts: NDArray[np.void], timestep: float) -> None:
        """Adds the forces of contacts, in the format of `Stepper.contacts`, to the statistics of their pairs of geoms; timestep in s."""
        pairs = np.sort(np.asarray(contacts["geom"], np.int64), axis=1)
        kinds, which = np.unique(pairs, axis=0, return_inverse=True)
        normal = np.asarray(contacts["force"][:, 0], float)
        tangent = np.einsum("ij,ijk->ik", contacts["force"][:, 1:], contacts["frame"][:, 1:])
        for number, (a, b) in enumerate(kinds.tolist()):
            own = which.ravel() == number
            pushes = own & (normal > 0)
            book = self.found.setdefault((a, b), dict.fromkeys(("time", "impulse", "peak", "used", "slides"), 0.0))
            if not pushes.any():
                continue
            # Forces are summed over the contacts of a pair, because Coulomb's law does not determine how the contacts share a load.
            envs, at = np.unique(contacts["env"][pushes], return_inverse=True)
            force = np.bincount(at, normal[pushes])
            side = np.linalg.norm([np.bincount(at, tangent[pushes, k]) for k in range(3)], axis=0)
            mu = pair_friction(self.model, self.friction, a, b, self.explicit)
            book["time"] += len(envs)
            book["impulse"] += timestep * force.sum()
            book["peak"] = max(book["peak"], float(force.max()))
            # For tiny normal forces the ratio is dominated by rounding.
            firm = force > 1e-6 * book["peak"]
            book["used"] = max(book["used"], float((side[firm] / force[firm]).max(initial=0.0)))
            book["slides"] += timestep * force[side >= _SLIDING_SHARE * mu * force].sum()

    def result(self) -> list[Pair]:
        """Statistics of all steps so far, the pair with the largest impulse first."""
        names = [name or f"#{k}" for k, name in enumerate(self.model.geom_names)]
        pairs = [
            Pair(
                geoms=key,
                names=(names[key[0]], names[key[1]]),
                time=book["time"] / self.steps,
                impulse=book["impulse"] / self.num_envs,
                peak=book["peak"],
                friction=pair_friction(self.model, self.friction, *key, self.explicit),
                used=book["used"],
                slides=book["slides"] / book["impulse"] if book["impulse"] else 0.0,
            )
            for key, book in self.found.items()
        ]
        return sorted(pairs, key=lambda pair: (-pair.impulse, pair.geoms))


def touching(study: Study, episodes: Sequence[int], **changed: Any) -> list[Pair]:
    """Runs episodes with nominal parameters, and returns statistics of all pairs of geoms that had contacts, the largest impulse first.

    Args:
        study: The study.
        episodes: Numbers of the episodes.
        **changed: Settings that differ from the study's, by name, such as timestep=0.001 or engine="mujoco".
    """
    world = world_of(study, USUAL, [study.nominal] * len(episodes), **changed)
    assert isinstance(world, StepperWorld)
    # All environments have the nominal values of the parameters. The friction of the first one is therefore that of all.
    own = world.sim.randomized
    geoms, pairs = (own[name][0] if name in own else getattr(world.model, name) for name in ("geom_friction", "pair_friction"))
    ledger = _Ledger(world.model, len(episodes), np.asarray(geoms, np.float64), _friction_of_pairs(world.model, np.asarray(pairs)))
    run_batch(study, world, episodes, ledger.record)
    return ledger.result()

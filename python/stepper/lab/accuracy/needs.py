"""Pairs of bodies that `tune` can exclude from contact, because they never came near each other, and the effect of their exclusion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from stepper._stepper import Model
from stepper.lab.accuracy.costs import saving
from stepper.lab.accuracy.traces import Distance, run
from stepper.lab.study.study import Study
from stepper.lab.study.touching import touching
from stepper.loading import describe
from stepper.shared.machine import one_core


@dataclass(frozen=True)
class UnusedPairs:
    """Pairs of bodies that may collide, but never came near enough to touch within a step.

    Attributes:
        count: Number of these pairs.
        of: Number of all pairs that may collide.
        error: Largest change of the motion in any episode without them, m or rad.
        saved: Saved fraction of a batch's processor time, median of rounds.
        min_saved: Lower bound of `saved`.
    """

    count: int
    of: int
    error: float
    saved: float
    min_saved: float


def unused_pairs(
    study: Study, episodes: Sequence[int], settings: Mapping[str, Any], distance: Distance, budget: float
) -> tuple[UnusedPairs | None, Model | None]:
    """Pairs of bodies that never came near each other in some episodes, and the model that excludes them from contact.

    Both are None if there are no such pairs, or if the model has no source (MJCF, URDF). The model is None if the exclusion changes the
    motion by more than the budget, or saves nothing.

    Args:
        study: The study.
        episodes: Numbers of the episodes.
        settings: Settings that differ from the study's, by name, such as timestep=0.001.
        distance: Measure of the change of the motion.
        budget: Largest allowed change of the motion, m or rad.
    """
    model, compiled = study.loaded
    if compiled is None:
        return None, None
    may = pairs_that_may_touch(model, compiled)
    never = may - {_bodies(model, pair.geoms) for pair in touching(study, episodes, **settings)}
    if not never:
        return None, None
    description = describe(compiled)
    known = {_ordered(own) for own in description["excludes"]}
    description["excludes"] += [list(own) for own in sorted(never - known)]
    # Exclusions do not apply to explicit contact pairs.
    description["pairs"] = [pair for pair in description["pairs"] if _bodies(model, pair["geoms"]) not in never]
    smaller = Model.from_description(description, strict=False)
    other, trace = replace(study, model=smaller), run(study, episodes, **settings)
    error = float(distance(run(other, episodes, **settings), trace).max())
    with one_core():
        saved, least = saving((study, settings), (other, settings), trace)
    return UnusedPairs(len(never), len(may), error, saved, least), smaller if error <= budget and least > 0 else None


def pairs_that_may_touch(model: Model, compiled: Any) -> set[tuple[int, int]]:
    """Pairs of bodies that may collide, the lower index first.

    The masks of the two bodies' geoms (contype, conaffinity) match. The bodies can move relative to each other, and are not parent and
    child. Bodies without joints count as parts of their parents. The world can collide with its children. Exclusions and explicit contact
    pairs of the model apply.

    Args:
        model: Model of the scene.
        compiled: `mujoco.MjModel` of the scene.
    """
    rigid = [0] * model.nbody
    for k in range(1, model.nbody):
        rigid[k] = k if model.body(k).jntnum else rigid[model.body(k).parentid]
    below = [rigid[model.body(k).parentid] for k in rigid]
    kinds = {(g.bodyid, g.contype, g.conaffinity) for g in map(model.geom, range(model.ngeom))}
    may = {
        _ordered((a, b))
        for a, ones, takes in kinds
        for b, others, gives in kinds
        if ((ones & gives) or (others & takes))
        and rigid[a] != rigid[b]
        and not (rigid[a] and rigid[b] and (below[a] == rigid[b] or below[b] == rigid[a]))
    }
    # A signature has one body in its upper 16 bits and the other in its lower.
    excluded = {_ordered((s >> 16, s & 0xFFFF)) for s in map(int, compiled.exclude_signature)}
    return (may - excluded) | {_bodies(model, (pair.geom1, pair.geom2)) for pair in map(model.pair, range(model.npair))}


def _bodies(model: Model, geoms: Sequence[int]) -> tuple[int, int]:
    """Indices of the bodies of two geoms, the lower index first."""
    return _ordered([model.geom(g).bodyid for g in geoms])


def _ordered(pair: Sequence[int]) -> tuple[int, int]:
    """Pair of indices in ascending order."""
    first, second = sorted(pair)
    return first, second

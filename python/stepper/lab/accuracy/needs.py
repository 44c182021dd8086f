"""Removable parts of a scene for `tune`: parts that the episodes do not use, and the effect of removing each of them."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from stepper._stepper import Model
from stepper.lab.accuracy.costs import saving
from stepper.lab.accuracy.traces import Distance, Trace, run
from stepper.lab.study.study import Study
from stepper.lab.study.touching import Touching, pairs_that_may_touch, touching
from stepper.loading import describe
from stepper.shared.machine import one_core

Description = dict[str, Any]
_Cut = tuple[str, str, Callable[[Description], None]]
"""Removable part of a scene: its name, the reason why it may be removed, and the function that removes it from a description."""


@dataclass(frozen=True)
class Spare:
    """Part of a scene that may be removable.

    Attributes:
        part: Name of the part, with numbers: "2 of 3 pairs of bodies".
        reason: Observation because of which the part may be removable.
        error: Largest change of the motion in any episode without the part, m or rad; NaN if it was not measured.
        saved: Saved fraction of a batch's processor time, median of rounds; NaN if it was not measured.
        min_saved: Lower bound of `saved`.
        removed: Whether the smaller model (`Tuning.smaller`) lacks the part: `error` is within the budget, and `min_saved` above 0.
    """

    part: str
    reason: str
    error: float
    saved: float
    min_saved: float
    removed: bool


@dataclass(frozen=True)
class Bench:
    """Test of how the removal of parts of the scene changes motion and processor time, on some episodes of a study.

    Attributes:
        study: The study.
        episodes: Numbers of the episodes.
        settings: Settings that differ from the study's, by name, such as timestep=0.001 or engine="mujoco".
        distance: Measure of a change of the motion: the largest distance or angle between two runs.
        trace: Run of the episodes with these settings.
    """

    study: Study
    episodes: Sequence[int]
    settings: Mapping[str, Any]
    distance: Distance
    trace: Trace

    def errors(self, smaller: Sequence[Model], progress: Callable[[float], None]) -> list[float]:
        """Largest change of the motion with each of some smaller models in place of the study's model, m or rad.

        A change is infinite if the controller or a measure of an outcome reads a removed part.
        """
        found: list[float] = []
        for model in smaller:
            try:
                trace = run(self._study_with(model), self.episodes, **self.settings)
                found.append(float(self.distance(trace, self.trace).max()))
            except KeyError:
                found.append(math.inf)
            progress(len(found) / len(smaller))
        return found

    def saved(self, smaller: Model) -> tuple[float, float]:
        """Fraction of a batch's processor time that a smaller model saves: median and lower bound."""
        with one_core():
            return saving((self.study, self.settings), (self._study_with(smaller), self.settings), self.trace)

    def spare(self, cut: _Cut, smaller: Model, error: float, budget: float) -> Spare:
        """Effect of removing a part of the scene. The saved time is measured here; the change of the motion is an argument."""
        what, why, _ = cut
        saved, least = self.saved(smaller) if math.isfinite(error) else (math.nan, math.nan)
        return Spare(what, why, error, saved, least, error <= budget and least > 0)

    def _study_with(self, smaller: Model) -> Study:
        """Copy of the study with a smaller model, with ideal sensors, and without the parameters that change sensors."""
        # The controller reads the parameters. Sensors are ideal and may be removed, so that their parameters are dropped.
        kept = {name: own for name, own in self.study.parameters.items() if own.kind != "sensor"}
        return replace(self.study, model=smaller, parameters=kept, sensors=None)


def spares(bench: Bench, budget: float, progress: Callable[[float], None]) -> tuple[list[Spare], Model | None]:
    """Removes unused parts of a scene, one by one and then together.

    Returns:
        Parts with the effects of their removal, and the smaller model; None if no part can be removed.
    """
    model, compiled = bench.study.loaded
    if compiled is None:
        why = "the model has no source from which parts can be removed; give MJCF, URDF or an MjModel"
        return [Spare("nothing", why, math.nan, math.nan, math.nan, False)], None
    seen = touching(bench.study, bench.episodes, **bench.settings)
    whole = describe(compiled)
    tries = [*_pairs(model, compiled, seen), *_sensors(model, seen)]
    models = [_smaller(whole, [cut]) for _, _, cut in tries]
    errors = bench.errors(models, lambda done: progress(0.9 * done))
    found = [bench.spare(own, smaller, error, budget) for own, smaller, error in zip(tries, models, errors, strict=True)]
    taken = [own for own, spare in zip(tries, found, strict=True) if spare.removed]
    if not taken:
        return found, None
    together = _smaller(whole, [cut for _, _, cut in taken])
    (error,) = bench.errors([together], lambda done: progress(0.9 + 0.1 * done))
    found.append(bench.spare(("all removed parts together", "", lambda _: None), together, error, budget))
    return found, together if found[-1].removed else None


def _smaller(whole: Description, cuts: Sequence[Callable[[Description], None]]) -> Model:
    """Model without some parts of the scene."""
    # Meshes and height fields stay shared, because no cut changes them.
    description = {name: value if name in ("meshes", "height_fields") else copy.deepcopy(value) for name, value in whole.items()}
    for cut in cuts:
        cut(description)
    return Model.from_description(description, strict=False)


def _pairs(model: Model, compiled: Any, seen: Touching) -> list[_Cut]:
    """Pairs of bodies that may collide but never came near enough to touch, with the function that removes them from a description.

    The function excludes the pairs, and removes their explicit contact pairs, to which exclusions do not apply.
    """
    may = pairs_that_may_touch(model, compiled)
    never = sorted(may - {_bodies(model, pair.geoms) for pair in seen.pairs})

    def remove(description: Description) -> None:
        known = {_ordered(own) for own in description["excludes"]}
        description["excludes"] += [list(own) for own in never if own not in known]
        description["pairs"] = [pair for pair in description["pairs"] if _bodies(model, pair["geoms"]) not in never]

    return [(f"{len(never)} of {len(may)} pairs of bodies", "they never came near enough to touch within a step", remove)] if never else []


def _bodies(model: Model, geoms: Sequence[int]) -> tuple[int, int]:
    """Indices of the bodies of two geoms, the lower index first."""
    return _ordered([model.geom(g).bodyid for g in geoms])


def _ordered(pair: Sequence[int]) -> tuple[int, int]:
    """Pair of indices in ascending order."""
    first, second = sorted(pair)
    return first, second


def _sensors(model: Model, seen: Touching) -> list[_Cut]:
    """Sensors that a scene does not need, with the function that removes them from a description of the scene.

    They are all sensors, if neither the controller nor an outcome reads one. Otherwise the list is empty.
    """
    if not model.sensors or seen.senses:
        return []

    def remove(description: Description) -> None:
        description["sensors"] = []

    return [(f"{len(model.sensors)} sensors", "neither the controller nor an outcome reads them", remove)]

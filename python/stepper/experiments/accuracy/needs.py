"""What a scene does not need: what nothing uses in the episodes of a study, taken out one by one, and what taking it out changes."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stepper._stepper import Model
from stepper.experiments.accuracy.costs import saving
from stepper.experiments.accuracy.traces import Distance, Trace, run
from stepper.experiments.study.study import Study
from stepper.experiments.study.touching import Touching, pair_friction, pairs_of_bodies, touching
from stepper.loading import describe
from stepper.shared.machine import one_core

Description = dict[str, Any]
_NO_FRICTION = 1e-9
"""Ratio of tangential and normal force below which a contact has no friction."""
_HOLDS = 0.9
"""Share of its cone that a contact may use for it to be one that never slides."""
_WIDER = 2.0
"""Ratio of the friction of the check to that in force: what never slides moves as before."""
_FAR = 0.01
"""Share of a joint's range that it keeps from a limit which it does not need."""


@dataclass(frozen=True)
class Spare:
    """What a scene may do without.

    Attributes:
        what: In words, with numbers.
        why: What was seen.
        error: Largest change of all episodes, in the unit of the distance; NaN where it was not taken out.
        saved: Share of the processor time of a batch; NaN where it was not taken out.
        taken: Whether it is out of the smaller model.
    """

    what: str
    why: str
    error: float
    saved: float
    taken: bool


@dataclass(frozen=True)
class Bench:
    """What a scene is looked at with.

    Attributes:
        study: The study.
        episodes: In which it is looked.
        settings: With which it is run.
        distance: That a change is measured by.
        trace: The episodes with these settings.
    """

    study: Study
    episodes: Sequence[int]
    settings: Mapping[str, Any]
    distance: Distance
    trace: Trace

    def error(self, smaller: Model) -> float:
        """Largest change that a smaller model makes; infinite where the drive or a measure reads what is gone."""
        try:
            return float(self.distance(run(self._with(smaller), self.episodes, **self.settings), self.trace).max())
        except KeyError:
            return math.inf

    def saved(self, smaller: Model) -> float:
        """Share of the time of a batch that a smaller model saves."""
        with one_core():
            return saving(self.study, self._with(smaller), self.settings, self.trace)

    def _with(self, smaller: Model) -> Study:
        # The drive reads its parameters, and nominal values are in force; sensors are ideal here, and may be gone.
        kept = {name: own for name, own in self.study.parameters.items() if own.kind != "sensor"}
        return replace(self.study, model=smaller, parameters=kept, sensors=None)


def spares(bench: Bench, budget: float, tick: Callable[[float], None]) -> tuple[list[Spare], Model | None]:
    """Takes out what the episodes do not use, one by one and then together.

    Args:
        bench: The study with its episodes.
        budget: Change that is allowed.
        tick: Called with the fraction done.

    Returns:
        What was found; and the smaller model, None where nothing could be taken out.
    """
    model, compiled = bench.study.loaded
    if compiled is None:
        return [
            Spare("nothing", "the model has no source to take anything out of; give MJCF, URDF or an MjModel", math.nan, math.nan, False)
        ], None
    seen = touching(bench.study, bench.episodes, **bench.settings)
    tries = [*_pairs(model, seen), *_frictionless(model, seen), *_limits(model, seen), *_sensors(model, seen)]
    whole = describe(compiled)
    found: list[Spare] = []
    taken: list[Callable[[Description], None]] = []

    def tried(what: str, why: str, cuts: Sequence[Callable[[Description], None]]) -> Model | None:
        smaller = _smaller(whole, cuts)
        error = bench.error(smaller)
        found.append(Spare(what, why, error, bench.saved(smaller) if math.isfinite(error) else math.nan, error <= budget))
        return smaller if error <= budget else None

    for number, (what, why, cut) in enumerate(tries):
        if tried(what, why, [cut]) is not None:
            taken.append(cut)
        tick((number + 1) / (len(tries) + 1))
    found += [Spare(what, why, bench.error(_smaller(whole, [wider])), math.nan, False) for what, why, wider in cones(model, seen, whole)]
    return found, tried("all that is taken out, together", "", taken) if taken else None


def _smaller(whole: Description, cuts: Sequence[Callable[[Description], None]]) -> Model:
    # Vertices and the like stay shared: no cut changes them.
    made = {name: value if name in ("meshes", "height_fields") else copy.deepcopy(value) for name, value in whole.items()}
    for cut in cuts:
        cut(made)
    return Model.from_description(made, strict=False)


_Cut = tuple[str, str, Callable[[Description], None]]


def _pairs(model: Model, seen: Touching) -> list[_Cut]:
    """Pairs of bodies that may collide and never came near."""
    near = {tuple(sorted(model.geom(g).bodyid for g in pair.geoms)) for pair in seen.pairs}
    may = pairs_of_bodies(model)
    never = sorted(may - near)
    if not never:
        return []

    def cut(made: Description) -> None:
        known = {tuple(own) for own in made["excludes"]}
        made["excludes"] += [list(own) for own in never if own not in known]

    return [(f"{len(never)} of {len(may)} pairs of bodies", "no contact of theirs came within reach of a step", cut)]


def _frictionless(model: Model, seen: Touching) -> list[_Cut]:
    """Friction of geoms whose contacts use none."""
    used = {g for pair in seen.pairs if pair.used > _NO_FRICTION or pair.twists > _NO_FRICTION * pair.peak for g in pair.geoms}
    touched = {g for pair in seen.pairs if pair.impulse > 0 for g in pair.geoms}
    idle = sorted(g for g in touched - used if model.geom(g).condim > 1)
    if not idle:
        return []

    def cut(made: Description) -> None:
        for g in idle:
            made["geoms"][g]["condim"] = 1

    return [(f"friction of {len(idle)} geoms", "no contact of theirs has a tangential force", cut)]


def cones(model: Model, seen: Touching, whole: Description) -> list[_Cut]:
    """Cones of contacts that never slide, which rows of friction without a bound would do for, and what makes them wider.

    A contact that stays within its cone moves as it would without one. Whether it does is asked twice: of every contact, how much of its
    cone it uses; and of the motion, whether a wider cone changes it. Rows without a cone are nothing that a step offers, so nothing is
    taken out.
    """
    pressed = {pair.geoms: pair for pair in seen.pairs if pair.impulse > 0}
    holds = {key for key, pair in pressed.items() if _NO_FRICTION < pair.cone <= _HOLDS and pair.twists <= _NO_FRICTION * pair.peak}
    # Geoms that slide nowhere: the friction of others is that of their sliding, too.
    steady = {g for key in holds for g in key} - {g for key in pressed.keys() - holds for g in key}
    explicit = {tuple(sorted(pair["geoms"])): k for k, pair in enumerate(whole["pairs"])}
    friction = np.asarray(model.geom_friction, float)
    wide = {k: _WIDER * max(pressed[key].friction for key in holds if k in key) for k in steady}
    raised = np.array([[wide.get(k, own), *rest] for k, (own, *rest) in enumerate(friction.tolist())]).reshape(friction.shape)
    # Of a pair without a steady geom, or whose friction is that of the other one, the cone stays as it is.
    widened = {key for key in holds if key in explicit or pair_friction(model, raised, *key, {}) >= _WIDER * pressed[key].friction}
    if not widened:
        return []
    worst = max((pressed[key] for key in widened), key=lambda pair: pair.cone)

    def wider(made: Description) -> None:
        for k, own in wide.items():
            made["geoms"][k]["friction"][0] = own
        for key in widened & explicit.keys():
            made["pairs"][explicit[key]]["friction"][0] *= _WIDER

    what = f"cones of {len(widened)} of {len(pressed)} pairs of geoms that touch"
    why = (
        f"none slides: a contact uses {worst.cone:.0%} of its cone at the most ({' - '.join(worst.names)}, which leaves a margin of "
        f"{1 - worst.cone:.0%}); the change is that of cones {_WIDER:g} times as wide"
    )
    return [(what, why, wider)]


def _limits(model: Model, seen: Touching) -> list[_Cut]:
    """Limits that no joint came near."""
    far = []
    for k in range(model.njnt):
        joint = model.joint(k)
        if not joint.limited or joint.nq != 1:
            continue
        low, high = joint.range
        room = _FAR * (high - low) if np.isfinite(high - low) else _FAR
        if seen.reach[0, joint.qposadr] > low + room and seen.reach[1, joint.qposadr] < high - room:
            far.append(k)
    if not far:
        return []

    def cut(made: Description) -> None:
        for k in far:
            made["joints"][k]["range"] = None

    return [(f"limits of {len(far)} joints", f"they stay {_FAR:.0%} of their range away", cut)]


def _sensors(model: Model, seen: Touching) -> list[_Cut]:
    """Sensors, where neither the drive nor an outcome reads any."""
    if not model.sensors or seen.senses:
        return []

    def cut(made: Description) -> None:
        made["sensors"] = []

    return [(f"{len(model.sensors)} sensors", "neither the drive nor an outcome reads them", cut)]

"""What touched in the episodes of a study: of every pair of geoms how near, how long, how hard, and how much of its friction it used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model
from stepper.experiments.study.batches import drive_through, world_of
from stepper.experiments.study.outcomes import Watch
from stepper.experiments.study.study import USUAL, Study
from stepper.experiments.study.worlds import StepperWorld, World

Array = NDArray[np.float64]
_STICKS = 0.999
"""Share of the friction cone beyond which a contact slides."""


@dataclass(frozen=True)
class Pair:
    """Contacts of two geoms over all steps and episodes.

    Attributes:
        geoms: Their indices, the lower first.
        names: Of the geoms.
        time: Share of the steps in which they press.
        impulse: Of normal forces, N s an episode.
        peak: Largest normal force of all contacts of the pair together, N.
        friction: Sliding friction in force: the largest ratio that their cone allows.
        used: Largest ratio of tangential and normal force, of all contacts of the pair together.
        slides: Share of the normal impulse under which that is at its bound.
        twists: Largest torque about and across the normal, N m.
        nearest: Least distance of a contact that was given a row, m.
    """

    geoms: tuple[int, int]
    names: tuple[str, str]
    time: float
    impulse: float
    peak: float
    friction: float
    used: float
    slides: float
    twists: float
    nearest: float


@dataclass(frozen=True)
class Touching:
    """What touched.

    Attributes:
        pairs: By impulse, the largest first.
        steps: Steps that were seen, of all episodes.
        limits: Share of the steps in which each joint was within a hundredth of its range of a limit, (njnt,).
        senses: Whether the drive or an outcome read a sensor.
        reach: Least and greatest position of every coordinate, (2, nq).
    """

    pairs: tuple[Pair, ...]
    steps: int
    limits: Array
    senses: bool
    reach: Array

    @property
    def deciding(self) -> tuple[Pair, ...]:
        """Pairs with a hundredth of the impulse of all, or a tenth of the greatest force."""
        total, peak = sum(pair.impulse for pair in self.pairs), max((pair.peak for pair in self.pairs), default=0.0)
        return tuple(pair for pair in self.pairs if pair.impulse >= 0.01 * total or pair.peak >= 0.1 * peak)


def pair_friction(model: Model, friction: Array, first: int, second: int) -> float:
    """Sliding friction of two geoms: of the one with the higher priority, else the larger. An explicit pair's own is not known here.

    Args:
        model: The scene.
        friction: In force, (ngeom, 3).
        first: A geom.
        second: Another one.
    """
    one, other = model.geom(first), model.geom(second)
    if one.priority != other.priority:
        return float(friction[first if one.priority > other.priority else second, 0])
    return float(max(friction[first, 0], friction[second, 0]))


class _Ledger:
    """Counts contacts, step by step."""

    def __init__(self, model: Model, num_envs: int, friction: Array):
        self.model, self.num_envs, self.friction, self.steps = model, num_envs, friction, 0
        self.found: dict[tuple[int, int], dict[str, float]] = {}
        self.limits = np.zeros(model.njnt)
        self.reach = np.array([np.full(model.nq, np.inf), np.full(model.nq, -np.inf)])
        joints = [model.joint(i) for i in range(model.njnt)]
        self._limited = [(k, j.qposadr, *j.range) for k, j in enumerate(joints) if j.limited and j.nq == 1]

    def look(self, now: World) -> None:
        """Takes in a step."""
        assert isinstance(now, StepperWorld)
        self.steps += self.num_envs
        qpos = now.qpos
        self.reach[0], self.reach[1] = np.minimum(self.reach[0], qpos.min(axis=0)), np.maximum(self.reach[1], qpos.max(axis=0))
        for joint, at, low, high in self._limited:
            near = 0.01 * (high - low) if np.isfinite(high - low) else 0.01
            self.limits[joint] += np.count_nonzero((qpos[:, at] < low + near) | (qpos[:, at] > high - near))
        contacts = now.sim.contacts()
        if len(contacts):
            self._add(contacts, now.timestep)

    def _add(self, contacts: NDArray[np.void], timestep: float) -> None:
        pairs = np.sort(np.asarray(contacts["geom"], np.int64), axis=1)
        kinds, which = np.unique(pairs, axis=0, return_inverse=True)
        normal = np.asarray(contacts["force"][:, 0], float)
        tangent = np.einsum("ij,ijk->ik", contacts["force"][:, 1:], contacts["frame"][:, 1:])
        twist = np.linalg.norm(contacts["torque"], axis=1)
        for number, (a, b) in enumerate(kinds.tolist()):
            own = which.ravel() == number
            pushes = own & (normal > 0)
            book = self.found.setdefault(
                (a, b), dict.fromkeys(("time", "impulse", "peak", "used", "slides", "twists"), 0.0) | {"nearest": np.inf}
            )
            book["nearest"] = min(book["nearest"], float(contacts["distance"][own].min()))
            if not pushes.any():
                continue
            # Of all contacts of the pair together: how they share a load, the law leaves open.
            envs, at = np.unique(contacts["env"][pushes], return_inverse=True)
            force = np.bincount(at, normal[pushes])
            side = np.linalg.norm([np.bincount(at, tangent[pushes, k]) for k in range(3)], axis=0)
            mu = pair_friction(self.model, self.friction, a, b)
            book["time"] += len(envs)
            book["impulse"] += timestep * force.sum()
            book["peak"] = max(book["peak"], float(force.max()))
            # Of contacts that hardly press, the ratio is rounding.
            firm = force > 1e-6 * book["peak"]
            book["used"] = max(book["used"], float((side[firm] / force[firm]).max(initial=0.0)))
            book["slides"] += timestep * force[side >= _STICKS * mu * force].sum()
            book["twists"] = max(book["twists"], float(twist[pushes].max()))

    def result(self, *, senses: bool) -> Touching:
        """What was counted."""
        names = [name or f"#{k}" for k, name in enumerate(self.model.geom_names)]
        pairs = [
            Pair(
                geoms=key,
                names=(names[key[0]], names[key[1]]),
                time=book["time"] / self.steps,
                impulse=book["impulse"] / self.num_envs,
                peak=book["peak"],
                friction=pair_friction(self.model, self.friction, *key),
                used=book["used"],
                slides=book["slides"] / book["impulse"] if book["impulse"] else 0.0,
                twists=book["twists"],
                nearest=book["nearest"],
            )
            for key, book in self.found.items()
        ]
        return Touching(
            tuple(sorted(pairs, key=lambda pair: (-pair.impulse, pair.geoms))),
            self.steps,
            self.limits / max(1, self.steps),
            senses,
            self.reach,
        )


def touching(study: Study, episodes: Sequence[int], **changed: Any) -> Touching:
    """Runs episodes of the nominal point, with settings as of `world_of`, and sees what touches in every step."""
    world = world_of(study, USUAL, [study.nominal] * len(episodes), **changed)
    assert isinstance(world, StepperWorld)
    # All environments are at the nominal point.
    own = world.sim.randomized.get("geom_friction")
    ledger = _Ledger(world.model, len(episodes), np.asarray(world.model.geom_friction if own is None else own[0], np.float64))
    watches: list[Watch] = []

    def look(now: World) -> None:
        # Outcomes are read as in an episode that counts, so that it is known whether they read sensors.
        if watches:
            watches[0].look(now)
        else:
            watches.append(Watch(tuple(study.all_outcomes), now))

    drive_through(study, world, episodes, look, ledger.look)
    watches[0].values(world)
    return ledger.result(senses=world.senses)

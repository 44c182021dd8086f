"""Statistics of the contacts in a study's episodes, for each pair of geoms: distance, duration, forces and used friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper._stepper import Model
from stepper.lab.study.batches import run_batch, world_of
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import StepperWorld, World

Array = NDArray[np.float64]
_SLIDING_SHARE = 0.999
"""Fraction of the friction cone above which a contact counts as sliding."""
_LEAST_FORCE = 1e-3
"""Fraction of a pair's largest normal force below which the friction ratio of a single contact is ignored."""


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
        cone: Largest used fraction of the friction cone by a single contact, |f_t| / (mu f_n), without contacts whose normal force is below
            a thousandth of the peak.
        twists: Largest torsional or rolling friction torque of a contact, N m.
        nearest: Smallest distance of the contacts, m; negative for overlap.
    """

    geoms: tuple[int, int]
    names: tuple[str, str]
    time: float
    impulse: float
    peak: float
    friction: float
    used: float
    slides: float
    cone: float
    twists: float
    nearest: float


@dataclass(frozen=True)
class Touching:
    """Statistics of contacts, solver and limits over episodes.

    Attributes:
        pairs: Pairs of geoms, the largest impulse first.
        steps: Number of steps of all episodes.
        max_contacts: Largest number of simultaneous contacts in one environment.
        sweeps: Largest number of Gauss-Seidel iterations in a step.
        newton_steps: Largest number of Newton steps in a step.
        status: All flags of `Status` that steps set.
        saturated: Fraction of the steps in which each actuator was at a bound of its force, (nu,).
        limits: Fraction of the steps in which each joint was within a hundredth of its range from a limit, (njnt,).
        senses: Whether the controller or an outcome read a sensor.
    """

    pairs: tuple[Pair, ...]
    steps: int
    max_contacts: int
    sweeps: int
    newton_steps: int
    status: Status
    saturated: Array
    limits: Array
    senses: bool

    @property
    def deciding(self) -> tuple[Pair, ...]:
        """Pairs of geoms with at least a hundredth of the total impulse of all pairs, or a tenth of the largest force of any pair."""
        total, peak = sum(pair.impulse for pair in self.pairs), max((pair.peak for pair in self.pairs), default=0.0)
        return tuple(pair for pair in self.pairs if pair.impulse >= 0.01 * total or pair.peak >= 0.1 * peak)


def explicit_friction(compiled: Any) -> dict[tuple[int, int], float]:
    """Sliding friction of the explicit contact pairs of a model, by their geoms, the lower index first."""
    if compiled is None:
        return {}
    pairs = np.sort(np.stack([compiled.pair_geom1, compiled.pair_geom2], axis=1), axis=1)
    return {(int(a), int(b)): float(mu) for (a, b), mu in zip(pairs, compiled.pair_friction[:, 0], strict=True)}


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


def pairs_of_bodies(model: Model) -> set[tuple[int, int]]:
    """Pairs of bodies that may collide, the lower index first.

    The masks of the two bodies' geoms (contype, conaffinity) match. The bodies can move relative to each other, and are not parent and
    child. Bodies without joints count as parts of their parents. The world can collide with its children. `pairs_that_may_touch` also
    applies explicit pairs and exclusions.
    """
    rigid = [0] * model.nbody
    for k in range(1, model.nbody):
        rigid[k] = k if model.body(k).jntnum else rigid[model.body(k).parentid]
    below = [rigid[model.body(k).parentid] for k in rigid]
    geoms = [model.geom(g) for g in range(model.ngeom)]
    kinds = {(g.bodyid, g.contype, g.conaffinity) for g in geoms}
    return {
        (min(a, b), max(a, b))
        for a, ones, takes in kinds
        for b, others, gives in kinds
        if ((ones & gives) or (others & takes))
        and rigid[a] != rigid[b]
        and not (rigid[a] and rigid[b] and (below[a] == rigid[b] or below[b] == rigid[a]))
    }


def pairs_that_may_touch(model: Model, compiled: Any) -> set[tuple[int, int]]:
    """Pairs of bodies that may collide, with the exclusions and explicit pairs of an `MjModel`.

    Args:
        model: Model of the scene.
        compiled: `mujoco.MjModel` of the scene. With None, the result has no explicit pairs, and exclusions have no effect.
    """
    may = pairs_of_bodies(model)
    if compiled is not None:
        # A signature has one body in its upper 16 bits and the other in its lower.
        may -= {(min(s >> 16, s & 0xFFFF), max(s >> 16, s & 0xFFFF)) for s in map(int, compiled.exclude_signature)}
        may |= {(min(a, b), max(a, b)) for pair in explicit_friction(compiled) for a, b in [[model.geom(g).bodyid for g in pair]]}
    return may


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
        self.max_contacts, self.sweeps, self.newton_steps, self.status, self.saturated = 0, 0, 0, 0, np.zeros(model.nu)
        self.found: dict[tuple[int, int], dict[str, float]] = {}
        self.limits = np.zeros(model.njnt)
        joints = [model.joint(i) for i in range(model.njnt)]
        self._limited = [(k, j.qposadr, *j.range) for k, j in enumerate(joints) if j.limited and j.nq == 1]

    def record(self, now: World) -> None:
        """Adds the contacts, limits and solver iterations of the last step to the statistics."""
        assert isinstance(now, StepperWorld)
        self.steps += self.num_envs
        qpos = now.qpos
        for joint, at, low, high in self._limited:
            near = 0.01 * (high - low) if np.isfinite(high - low) else 0.01
            self.limits[joint] += np.count_nonzero((qpos[:, at] < low + near) | (qpos[:, at] > high - near))
        iterations, newton_steps = now.sim.iterations, now.sim.newton_steps
        self.sweeps = max(self.sweeps, int((iterations - newton_steps).max()))
        self.newton_steps = max(self.newton_steps, int(newton_steps.max()))
        self.status |= int(np.bitwise_or.reduce(now.sim.status))
        self.saturated += np.count_nonzero(now.sim.actuator_saturation, axis=0)
        contacts = now.sim.contacts()
        if len(contacts):
            self.max_contacts = max(self.max_contacts, int(np.bincount(contacts["env"]).max()))
            self._add(contacts, now.timestep)

    def _add(self, contacts: NDArray[np.void], timestep: float) -> None:
        """Adds the forces of contacts, in the format of `Stepper.contacts`, to the statistics of their pairs of geoms; timestep in s."""
        pairs = np.sort(np.asarray(contacts["geom"], np.int64), axis=1)
        kinds, which = np.unique(pairs, axis=0, return_inverse=True)
        normal = np.asarray(contacts["force"][:, 0], float)
        tangent = np.einsum("ij,ijk->ik", contacts["force"][:, 1:], contacts["frame"][:, 1:])
        twist = np.linalg.norm(contacts["torque"], axis=1)
        for number, (a, b) in enumerate(kinds.tolist()):
            own = which.ravel() == number
            pushes = own & (normal > 0)
            book = self.found.setdefault(
                (a, b), dict.fromkeys(("time", "impulse", "peak", "used", "slides", "cone", "twists"), 0.0) | {"nearest": np.inf}
            )
            book["nearest"] = min(book["nearest"], float(contacts["distance"][own].min()))
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
            bears = pushes & (normal > _LEAST_FORCE * book["peak"])
            if mu > 0:
                ratio = np.linalg.norm(contacts["force"][bears, 1:], axis=1) / normal[bears]
                book["cone"] = max(book["cone"], float(ratio.max(initial=0.0)) / mu)
            book["twists"] = max(book["twists"], float(twist[pushes].max()))

    def result(self, *, senses: bool) -> Touching:
        """Statistics of all steps so far. `senses` is whether the controller or an outcome has read a sensor."""
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
                cone=book["cone"],
                twists=book["twists"],
                nearest=book["nearest"],
            )
            for key, book in self.found.items()
        ]
        return Touching(
            pairs=tuple(sorted(pairs, key=lambda pair: (-pair.impulse, pair.geoms))),
            steps=self.steps,
            max_contacts=self.max_contacts,
            sweeps=self.sweeps,
            newton_steps=self.newton_steps,
            status=Status(self.status),
            saturated=self.saturated / max(1, self.steps),
            limits=self.limits / max(1, self.steps),
            senses=senses,
        )


def touching(study: Study, episodes: Sequence[int], **changed: Any) -> Touching:
    """Runs episodes with nominal parameters, and returns statistics of the contacts in every step.

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
    # Outcomes are measured too, to record whether they read sensors.
    run_batch(study, world, episodes, ledger.record)
    return ledger.result(senses=world.senses)

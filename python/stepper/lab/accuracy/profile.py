"""CostProfile of a run (`stepper.lab.profile`): parts of the scene that it used, and the time and memory of each part.

Parts are removed one after the other, sensors first and actuators last. After each removal, steps are timed from the same states, which
come from a run of the full scene. The share of a part is the reduction of the step time by the removal of this part, as a fraction of the
whole scene's step time. All shares, with that of the remaining scene, add up to 1.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.lab.accuracy.costs import BATCH, Timed
from stepper.lab.study.batches import running, world_of
from stepper.lab.study.document import Document, Section, counted
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study
from stepper.lab.study.touching import Touching, pairs_that_may_touch, touching
from stepper.lab.study.worlds import StepperWorld
from stepper.loading import describe
from stepper.shared.arguments import check_whole
from stepper.shared.machine import cpu_name, one_core
from stepper.shared.progress import ProgressCallback, silent

Array = NDArray[np.float64]
_BATCHES = 4
"""Number of batches of states from which the steps of a scene are timed."""
_ROUNDS = 11
"""Number of rounds in which the parts of a scene are timed."""
_SHORTEST_ROUND = 4e-3
"""Shortest duration of a timed round, s of processor time."""
_USED_FRICTION = 1e-9
"""Value above which a pair of geoms counts as using friction.

The compared numbers are the used fraction of the friction cone, |f_t| / (mu f_n), and the largest torsional or rolling friction torque
divided by the largest normal force, m.
"""


@dataclass(frozen=True)
class Part:
    """Cost of a part of a scene.

    Attributes:
        name: Name of the part.
        share: Fraction of the whole scene's step time, in a batch.
        time: Processor time for a step of one environment, microseconds.
        memory: Memory of an environment, bytes.
    """

    name: str
    share: float
    time: float
    memory: int


@dataclass(frozen=True)
class Use:
    """Number of elements of one kind in a scene, and the number that a run used.

    Attributes:
        name: Kind of element.
        could: Number of elements in the scene, or an upper bound; None if there is no bound.
        did: Number of elements that the run used, or the largest observed value.
        words: Remark for the table.
    """

    name: str
    could: int | None
    did: int
    words: str = ""


@dataclass(frozen=True)
class CostProfile:
    """Result of `profile`: used parts of a scene, and their costs.

    Attributes:
        study: The study.
        uses: Kinds of elements of the scene, with the number of elements and the number that the run used.
        parts: Costs of the whole scene (first entry) and of each part. Empty if the model has no source (MJCF, URDF), because parts are
            removed from the source.
        document: The profile as a document with tables.
    """

    study: Study
    uses: tuple[Use, ...]
    parts: tuple[Part, ...]
    document: Document

    def __str__(self) -> str:
        return self.document.markdown()


def profile(source: Any, *, episodes: int = 4, progress: ProgressCallback | None = None) -> CostProfile:
    """Runs episodes of a study or model, lists the parts of the scene that they used, and measures the cost of each part.

    Args:
        source: A study or its file; or a model, as for `stepper.load`, which gets random controls for one second.
        episodes: Number of episodes, with nominal values of the parameters.
        progress: Progress callback with a text and the fraction done.

    Raises:
        ValueError: `episodes` is below 1.
    """
    check_whole("episodes", episodes, least=1)
    study, report = Study.from_model(source), progress or silent
    report("run", 0.0)
    seen = touching(study, range(episodes))
    report("run", 1.0)
    uses = tuple(_uses(study, seen))
    parts = tuple(_costs(study, range(episodes), report))
    document = Document(f"Parts and costs of {study.name}")
    document.sections += [_uses_section(uses, seen, episodes), _costs_section(study, parts)]
    return CostProfile(study, uses, parts, document)


def _uses(study: Study, seen: Touching) -> Iterator[Use]:
    """Yields rows of the table of used elements: kinds of elements of the scene, and how many of each a run used."""
    model, options = study.loaded[0], study.options
    pressed = [pair for pair in seen.pairs if pair.impulse > 0]
    rubbed = [pair for pair in pressed if pair.cone > _USED_FRICTION or pair.twists > _USED_FRICTION * pair.peak]
    slid = [pair for pair in pressed if pair.cone >= 1 - 1e-3]
    near = {tuple(sorted(model.geom(g).bodyid for g in pair.geoms)) for pair in seen.pairs}
    yield Use("pairs of bodies within reach of a step", len(pairs_that_may_touch(model, study.loaded[1])), len(near))
    yield Use("pairs of geoms that press on each other, of those within reach", len(seen.pairs), len(pressed))
    yield Use("pairs of geoms with friction, of those that press", len(pressed), len(rubbed))
    largest = max((pair.cone for pair in rubbed), default=0.0)
    yield Use(
        "pairs of geoms with a sliding contact, of those with friction",
        len(rubbed),
        len(slid),
        f"a contact uses at most {min(1.0, largest):.0%} of its friction cone",
    )
    yield Use("contacts of an environment at once", options.max_contacts, seen.max_contacts)
    limited = [k for k in range(model.njnt) if model.joint(k).limited]
    yield Use("joint limits that are reached", len(limited), int(np.count_nonzero(seen.limits)), "closer than a hundredth of the range")
    yield Use("actuators that reach a limit of their effort", model.nu, int(np.count_nonzero(seen.saturated)))
    yield Use("sensors that are read", len(model.sensors), len(model.sensors) if seen.senses else 0, "counts as all or none")
    yield Use("sweeps of the solver in a step, summed over its solves", None, seen.sweeps, f"at most {options.iterations} per solve")
    yield Use("Newton steps of the solver in a step", None, seen.newton_steps, "0 if sweeps always sufficed")
    flags = [flag for flag in Status if flag and flag in seen.status]
    yield Use("kinds of flags that steps set", len(Status), len(flags), ", ".join(flag.name or "" for flag in flags))


def _uses_section(uses: tuple[Use, ...], seen: Touching, episodes: int) -> Section:
    """Section of the document with the table of used elements of the scene."""
    words = [
        f"{counted(seen.steps, 'step')} of {counted(episodes, 'episode')} at the nominal point. `stepper tune` removes unused parts, and "
        "measures on other episodes what that changes."
    ]
    return Section(
        "Used parts of the scene", words, ("", "in the scene", "used", ""), [[use.name, use.could, use.did, use.words] for use in uses]
    )


def _costs_section(study: Study, parts: tuple[Part, ...]) -> Section:
    """Section of the document with the time and memory that each part of the scene costs."""
    if not parts:
        return Section("Costs", ["The model has no source from which parts can be removed; give MJCF, URDF or an MjModel."])
    words = [
        f"One core of {cpu_name()}, {study.precision}, batches of {BATCH}, the smallest of {_ROUNDS} rounds. Parts are removed one after "
        "the other, and steps start from the same states of the run. A share is the reduction of the step's time by the removal of that "
        "part, so that shares add up. It is negative if the rest is harder to solve without the part. Shares below a tenth may be noise "
        "of the timing on a busy machine."
    ]
    rows = [[part.name, part.share, part.time, part.memory] for part in parts]
    return Section("Costs", words, ("part", "share of the step", "us per step of an environment", "bytes per environment"), rows)


_PARTS: dict[str, dict[str, dict[str, Any] | None]] = {
    "sensors": {"sensors": None},
    "friction of contacts": {"geoms": {"condim": 1}, "pairs": {"condim": 1}},
    "contacts: to find them, and their normals": {"pairs": None, "geoms": {"contype": 0, "conaffinity": 0}},
    "limits": {"joints": {"range": None}, "tendons": {"range": None}},
    "dry friction": {"joints": {"frictionloss": 0.0}, "tendons": {"frictionloss": 0.0}},
    "equalities": {"equalities": None},
    "drag of air or water": {"medium": {"density": 0.0, "viscosity": 0.0}},
    # Keyframes contain controls.
    "actuators": {"actuators": None, "keyframes": None},
}
"""Removable parts of a scene, in the order of removal: changes of its description (`stepper.loading.describe`) by kind of element.

None removes all elements of a kind. Otherwise, the values are written into every element.
"""
_REMAINDER = "motion of the bodies"
"""Name of the part of a scene that remains when all removable parts are removed."""


_States = tuple[Array, Array, Array, Array]
"""States of a batch of environments: qpos, qvel, act and ctrl, (num_envs, ...) each."""


class _Steps(Timed):
    """Timed steps of a model from given states. Before each timed step, an untimed step gives the solver its warm start.

    Args:
        model: Model to time.
        study: Study with precision, sensors and actuators.
        states: Batches of states.
        options: Options of the step.
    """

    def __init__(self, model: Model, study: Study, states: list[_States], options: Any):
        sensors = study.sensors if model.nsensordata else None
        actuators = study.actuators if model.nu else None
        self.sim = Stepper(model, BATCH, options=options, precision=study.precision, sensors=sensors, actuators=actuators)
        self._states, self.times = states, []

    def once(self) -> float:
        """Makes one timed step from each batch of states, and returns the processor time of these steps, s."""
        total, sim = 0.0, self.sim
        for qpos, qvel, act, ctrl in self._states:
            sim.set_state(qpos=qpos, qvel=qvel, act=act if sim.model.na else None)
            given = ctrl if sim.model.nu else None
            sim.step(given, 1)
            begin = time.process_time()
            sim.step(given, 1)
            total += time.process_time() - begin
        return total


def _states(study: Study, episodes: range) -> tuple[list[_States], Any]:
    """Batches of states that occur in some episodes of a study, and the options of the stepper that ran the episodes."""
    world = world_of(study, USUAL, [study.nominal] * len(episodes), sensors=None)
    assert isinstance(world, StepperWorld)
    sim = world.sim
    rows: list[_States] = []
    for is_end in running(study, world, episodes):
        if is_end:
            rows.append((world.qpos.copy(), world.qvel.copy(), np.array(sim.act, float), np.array(sim.ctrl, float)))
    # Controls are recorded after the steps in which they act: row k of the controls acts on the state of row k - 1.
    every = [np.concatenate([row[k] for row in (rows[1:] if k == 3 else rows[:-1])]) for k in range(4)]
    chosen = np.random.default_rng(0).permutation(np.resize(np.arange(len(every[0])), max(BATCH, min(len(every[0]), _BATCHES * BATCH))))
    cut = [chosen[first : first + BATCH] for first in range(0, len(chosen) - BATCH + 1, BATCH)]
    return [(every[0][k], every[1][k], every[2][k], every[3][k]) for k in cut], sim.options


def _changed(elements: Any, values: dict[str, Any] | None) -> Any:
    """Elements of one kind in a description of a model with some values changed; none if the values are None."""
    if values is None:
        return []
    return elements | values if isinstance(elements, dict) else [one | values for one in elements]


def _costs(study: Study, episodes: range, progress: ProgressCallback) -> Iterator[Part]:
    """Yields the costs of the whole scene, of each removable part, and of the remaining scene without these parts."""
    compiled = study.loaded[1]
    if compiled is None:
        return
    states, options = _states(study, episodes)
    description = describe(compiled)
    names, cases = ["all"], [_Steps(Model.from_description(description, strict=False), study, states, options)]
    for name, changes in _PARTS.items():
        before, description = description, description | {kind: _changed(description[kind], values) for kind, values in changes.items()}
        if all(description[kind] == before[kind] for kind in changes):
            continue
        names.append(name)
        cases.append(_Steps(Model.from_description(description, strict=False), study, states, options))
    with one_core():
        for case in cases:
            case.once()
        for number in range(_ROUNDS):
            for case in cases:
                case.measure(_SHORTEST_ROUND)
            progress("costs", (number + 1) / _ROUNDS)
    steps = len(states) * BATCH
    # The shortest round counts, because other load on the machine only adds time.
    spent = [1e6 * min(case.times) / steps for case in cases]
    memory = [case.sim.memory()["per_env"] for case in cases]
    yield Part(names[0], 1.0, spent[0], memory[0])
    for k, name in enumerate([*names[1:], _REMAINDER]):
        last = k == len(names) - 1
        own, bytes_of = (spent[k], memory[k]) if last else (spent[k] - spent[k + 1], memory[k] - memory[k + 1])
        yield Part(name, own / spent[0], own, bytes_of)

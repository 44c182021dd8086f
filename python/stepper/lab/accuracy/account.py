"""What happened in a run beside what could, and what the parts of a scene cost: share of a step, bytes of an environment.

The parts are taken out one after the other, from what is read to what moves, and each step is timed from the same states of a run of the
whole. What is left is the motion of the bodies. A part's share is what the step is cheaper for without it, so that shares add up.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.lab.accuracy.costs import BATCH
from stepper.lab.study.batches import drive_through, world_of
from stepper.lab.study.document import Document, Section, counted
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study
from stepper.lab.study.touching import Touching, pairs_that_may_touch, touching
from stepper.lab.study.worlds import StepperWorld, World
from stepper.lab.timing import Timed
from stepper.loading import describe
from stepper.shared.machine import cpu_name, one_core
from stepper.shared.progress import Tick, silent

Array = NDArray[np.float64]
Description = dict[str, Any]
_BATCHES = 4
"""Batches of states that are stepped from."""
_ROUNDS = 11
_LEAST = 4e-3
"""Rounds, and processor seconds of one at the least."""
_USED = 1e-9
"""Share of its cone, or torque over the peak force in m, above which a contact uses friction."""


@dataclass(frozen=True)
class Part:
    """What a part of a scene costs.

    Attributes:
        name: In words.
        share: Of the time of a step of a batch.
        time: Microseconds of one core for a step of one environment.
        memory: Bytes of an environment.
    """

    name: str
    share: float
    time: float
    memory: int


@dataclass(frozen=True)
class Use:
    """What could happen, and what did.

    Attributes:
        name: In words.
        could: How many, or the bound; None where there is none.
        did: How many, or the largest.
        words: Further.
    """

    name: str
    could: int | None
    did: int
    words: str = ""


@dataclass(frozen=True)
class Account:
    """Costs and events of a run.

    Attributes:
        study: What was run.
        uses: What could happen, and what did.
        parts: What the scene is made of, with costs; the whole first. Empty for a model without a source, of which nothing can be taken
            out.
        document: In words.
    """

    study: Study
    uses: tuple[Use, ...]
    parts: tuple[Part, ...]
    document: Document

    def __str__(self) -> str:
        return self.document.markdown()


def account(source: Any, *, episodes: int = 4, tick: Tick | None = None) -> Account:
    """Runs episodes of a study or model, says what of the scene they used, and measures what each part of it costs.

    Args:
        source: A study or the file of one; or a model as of `stepper.load`, which gets random controls for a second.
        episodes: How many, at the nominal point.
        tick: Called with what is being done and the fraction done.

    Raises:
        ValueError: No episode.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}, must be at least 1")
    study, told = Study.from_model(source), tick or silent
    told("run", 0.0)
    seen = touching(study, range(episodes))
    told("run", 1.0)
    uses = tuple(_uses(study, seen))
    parts = tuple(_costs(study, range(episodes), told))
    document = Document(f"What {study.name} uses, and what it costs")
    document.sections += [_used(uses, seen, episodes), _spent(study, parts)]
    return Account(study, uses, parts, document)


def _uses(study: Study, seen: Touching) -> Iterator[Use]:
    model, options = study.loaded[0], study.options
    pressed = [pair for pair in seen.pairs if pair.impulse > 0]
    rubbed = [pair for pair in pressed if pair.cone > _USED or pair.twists > _USED * pair.peak]
    slid = [pair for pair in pressed if pair.cone >= 1 - 1e-3]
    near = {tuple(sorted(model.geom(g).bodyid for g in pair.geoms)) for pair in seen.pairs}
    yield Use("pairs of bodies within reach of a step", len(pairs_that_may_touch(model, study.loaded[1])), len(near))
    yield Use("pairs of geoms that press, of those within reach", len(seen.pairs), len(pressed))
    yield Use("those with friction, of those that press", len(pressed), len(rubbed))
    largest = max((pair.cone for pair in rubbed), default=0.0)
    yield Use("those of which a contact slides", len(rubbed), len(slid), f"a contact uses {min(1.0, largest):.0%} of its cone at the most")
    yield Use("contacts of an environment at once", options.max_contacts, seen.most)
    limited = [k for k in range(model.njnt) if model.joint(k).limited]
    yield Use("limits of joints that are reached", len(limited), int(np.count_nonzero(seen.limits)), "to a hundredth of the range")
    yield Use("actuators at a bound of their effort", model.nu, int(np.count_nonzero(seen.saturated)))
    yield Use("sensors that are read", len(model.sensors), len(model.sensors) if seen.senses else 0, "all or none")
    yield Use("sweeps of the solver in a step, over all its solves", None, seen.sweeps, f"{options.iterations} of each solve at the most")
    yield Use("Newton steps of the solver in a step", None, seen.newton_steps, "0: its second tier was never needed")
    flags = [flag for flag in Status if flag and flag in seen.status]
    yield Use("kinds of flags that steps set", len(Status), len(flags), ", ".join(flag.name or "" for flag in flags))


def _used(uses: tuple[Use, ...], seen: Touching, episodes: int) -> Section:
    words = [
        f"{counted(seen.steps, 'step')} of {counted(episodes, 'episode')} at the nominal point. `stepper tune` takes out what is not "
        "used, and proves on other episodes what that changes."
    ]
    return Section(
        "What happened beside what could", words, ("", "could", "did", ""), [[use.name, use.could, use.did, use.words] for use in uses]
    )


def _spent(study: Study, parts: tuple[Part, ...]) -> Section:
    if not parts:
        return Section("Costs", ["The model has no source to take anything out of; give MJCF, URDF or an MjModel."])
    words = [
        f"One core of {cpu_name()}, {study.precision}, batches of {BATCH}, the least of {_ROUNDS} rounds. Steps from the same states of "
        "the run, the parts taken out one after the other: a share is what the step is cheaper for without that part too, so that shares "
        "add up. It is negative where the rest is harder to solve without the part; less than a tenth is within what timing scatters on a "
        "busy machine."
    ]
    rows = [[part.name, part.share, part.time, part.memory] for part in parts]
    return Section("Costs", words, ("part", "share of the step", "us of a step of an environment", "bytes of an environment"), rows)


# What is taken out, in this order, from what is read to what moves.


def _no_sensors(made: Description) -> None:
    made["sensors"] = []


def _no_friction(made: Description) -> None:
    for one in (*made["geoms"], *made["pairs"]):
        one["condim"] = 1


def _no_contacts(made: Description) -> None:
    made["pairs"] = []
    for geom in made["geoms"]:
        geom["contype"] = geom["conaffinity"] = 0


def _no_limits(made: Description) -> None:
    for one in (*made["joints"], *made["tendons"]):
        one["range"] = None


def _no_dry_friction(made: Description) -> None:
    for one in (*made["joints"], *made["tendons"]):
        one["frictionloss"] = 0.0


def _no_equalities(made: Description) -> None:
    made["equalities"] = []


def _no_medium(made: Description) -> None:
    made["medium"] |= {"density": 0.0, "viscosity": 0.0}


def _no_actuators(made: Description) -> None:
    made["actuators"], made["keyframes"] = [], []


_PARTS: tuple[tuple[str, Callable[[Description], None]], ...] = (
    ("sensors", _no_sensors),
    ("friction of contacts", _no_friction),
    ("contacts: to find them, and their normals", _no_contacts),
    ("limits", _no_limits),
    ("dry friction", _no_dry_friction),
    ("equalities", _no_equalities),
    ("drag of air or water", _no_medium),
    ("actuators", _no_actuators),
)
_REST = "motion of the bodies"


_States = tuple[Array, Array, Array, Array]
"""qpos, qvel, act and ctrl of a batch."""


class _Steps(Timed):
    """Steps of a model from states of a run: one that warms the solver, and one that counts."""

    def __init__(self, model: Model, study: Study, states: list[_States], options: Any):
        sensors = study.sensors if model.nsensordata else None
        actuators = study.actuators if model.nu else None
        self.sim = Stepper(model, BATCH, options=options, precision=study.precision, sensors=sensors, actuators=actuators)
        self._states, self.times = states, []

    def once(self) -> float:
        """Processor seconds of the steps that count."""
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
    """Batches of states from all of some episodes, and the options in force."""
    world = world_of(study, USUAL, [study.nominal] * len(episodes), sensors=None)
    assert isinstance(world, StepperWorld)
    sim = world.sim
    rows: list[_States] = []

    def look(_: World) -> None:
        rows.append((world.qpos.copy(), world.qvel.copy(), np.array(sim.act, float), np.array(sim.ctrl, float)))

    drive_through(study, world, episodes, look)
    # Controls come into force with the step after the state.
    every = [np.concatenate([row[k] for row in (rows[1:] if k == 3 else rows[:-1])]) for k in range(4)]
    chosen = np.random.default_rng(0).permutation(np.resize(np.arange(len(every[0])), max(BATCH, min(len(every[0]), _BATCHES * BATCH))))
    cut = [chosen[first : first + BATCH] for first in range(0, len(chosen) - BATCH + 1, BATCH)]
    return [(every[0][k], every[1][k], every[2][k], every[3][k]) for k in cut], sim.options


def _costs(study: Study, episodes: range, tick: Tick) -> Iterator[Part]:
    """The whole, every part that the scene has, and the rest."""
    compiled = study.loaded[1]
    if compiled is None:
        return
    states, options = _states(study, episodes)
    made = {name: value if name in ("meshes", "height_fields") else copy.deepcopy(value) for name, value in describe(compiled).items()}
    names, cases = ["all"], [_Steps(Model.from_description(made, strict=False), study, states, options)]
    for name, cut in _PARTS:
        before = copy.deepcopy({key: value for key, value in made.items() if key not in ("meshes", "height_fields")})
        cut(made)
        if all(made[key] == value for key, value in before.items()):
            continue
        names.append(name)
        cases.append(_Steps(Model.from_description(made, strict=False), study, states, options))
    with one_core():
        for case in cases:
            case.once()
        for number in range(_ROUNDS):
            for case in cases:
                case.measure(_LEAST)
            tick("costs", (number + 1) / _ROUNDS)
    steps = len(states) * BATCH
    # The least of the rounds: what else runs on the machine only adds, and more than the parts differ by.
    spent = [1e6 * min(case.times) / steps for case in cases]
    room = [case.sim.memory()["per_env"] for case in cases]
    yield Part(names[0], 1.0, spent[0], room[0])
    for k, name in enumerate([*names[1:], _REST]):
        last = k == len(names) - 1
        own, bytes_of = (spent[k], room[k]) if last else (spent[k] - spent[k + 1], room[k] - room[k + 1])
        yield Part(name, own / spent[0], own, bytes_of)

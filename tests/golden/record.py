"""What a golden trajectory is, and the bytes of all that can be read while it runs."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import stepper

LABELS = {
    "max_penetration": "depth", "max_limit_violation": "limit_overshoot", "sensordata": "observation", "sensordata_ideal": "sensor_truth",
}  # fmt: skip
"""Labels of attributes in the digests, where these are not the names of the attributes."""
READINGS = (
    "qpos", "qvel", "act", "ctrl", "time", "status", "residual", "iterations", "max_penetration", "max_limit_violation", "sensordata",
    "sensordata_ideal", "sensor_faults", "actuator_saturation", "xpos", "xquat",
)  # fmt: skip
"""Attributes of a stepper that are read after every call of `step`, in addition to its contacts."""
CONTACT = ("env", "geom", "body", "pos", "normal", "distance", "force", "torque", "frame")
"""What is read of a contact."""


class Random:
    """Numbers that are the same on every machine: multiples of 2^-53, and one product and one sum of them."""

    def __init__(self, seed: int):
        self.generator = np.random.default_rng(seed)

    def uniform(self, low, high, shape=()) -> np.ndarray:
        """Numbers from low to high."""
        return low + (high - low) * self.generator.random(shape)


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A model, how it is stepped, and what is done to it.

    Attributes:
        model: Makes the model.
        num_envs: Number of environments; None is a single one.
        precision: "f64" or "f32".
        options: Fields of `stepper.Options`.
        settings: Further arguments of `stepper.Stepper`.
        calls: Calls of `step`.
        nstep: Steps of each.
        offset: Largest difference of a coordinate from the model's reference at the start.
        speed: Largest velocity of a degree of freedom at the start, in m/s or rad/s.
        control: Largest control.
        prepare: What is done to the stepper once, before the start.
        act: What is done to the stepper before a call, whose number it gets. It may return the controls of the call; None is random ones.
    """

    model: Callable[[], stepper.Model]
    num_envs: int | None = 5
    precision: str = "f64"
    options: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    calls: int = 80
    nstep: int = 2
    offset: float = 0.05
    speed: float = 1.0
    control: float = 1.0
    prepare: Callable[[stepper.Stepper, Random], None] | None = None
    act: Callable[[stepper.Stepper, Random, int], np.ndarray | None] | None = None


@dataclass(frozen=True)
class Record:
    """What a trajectory was.

    Attributes:
        model: Digest of the compiled model.
        readings: What was read, each with when and what it is, in order.
        contacts: Contacts of the steps that were read, together.
        flags: Flags of `stepper.Status` that any environment had.
        final: Configuration and velocity of the first environment at the end, (nq + nv,), to nine digits.
    """

    model: str
    readings: list[tuple[str, bytes]]
    contacts: int
    flags: stepper.Status
    final: tuple[float, ...] = ()

    @property
    def bits(self) -> str:
        """Digest of the readings."""
        digest = hashlib.sha256()
        for label, data in self.readings:
            digest.update(f"{label} {len(data)}\n".encode())
            digest.update(data)
        return digest.hexdigest()

    def entry(self) -> dict[str, Any]:
        """Entry of golden.json."""
        numbers = {"model": self.model, "bits": self.bits, "contacts": self.contacts, "flags": self.flags.name or "OK"}
        return numbers | {"final": list(self.final)}


def record(trajectory: Trajectory) -> Record:
    """Runs a trajectory and reads everything."""
    random = Random(17)
    model = trajectory.model()
    options = stepper.Options(**trajectory.options)
    sim = stepper.Stepper(model, trajectory.num_envs, options=options, precision=trajectory.precision, **trajectory.settings)
    envs = () if trajectory.num_envs is None else (trajectory.num_envs,)
    if trajectory.prepare is not None:
        trajectory.prepare(sim, random)
    offset, speed = random.uniform(-trajectory.offset, trajectory.offset, (*envs, model.nq)), trajectory.speed
    sim.set_state(model.qpos0 + offset, random.uniform(-speed, speed, (*envs, model.nv)))
    readings, contacts, flags = [], 0, 0
    for call in range(trajectory.calls):
        ctrl = None if trajectory.act is None else trajectory.act(sim, random, call)
        if ctrl is None:
            ctrl = random.uniform(-trajectory.control, trajectory.control, (*envs, model.nu))
        sim.step(ctrl, nstep=trajectory.nstep)
        readings += [(f"call {call}: {LABELS.get(name, name)}", np.ascontiguousarray(getattr(sim, name)).tobytes()) for name in READINGS]
        met = sim.contacts()
        readings += [(f"call {call}: contacts {name}", np.ascontiguousarray(met[name]).tobytes()) for name in CONTACT]
        contacts += len(met)
        flags |= int(np.bitwise_or.reduce(np.ravel(sim.status)))
    labels = ("mass matrix", "bias force", "smooth acceleration", "energy", "momentum")
    for env in range(trajectory.num_envs or 1):
        evaluated = zip(labels, sim._in_64_bits(env), strict=True)
        readings += [(f"end, environment {env}: {name}", value.tobytes()) for name, value in evaluated]
    final = np.concatenate([np.atleast_2d(sim.qpos)[0], np.atleast_2d(sim.qvel)[0]]).astype(float)
    return Record(model.digest, readings, contacts, stepper.Status(flags), tuple(float(f"{x:.9g}") for x in final))

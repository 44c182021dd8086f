"""A scene: a model, where its environments begin, what they are told to do, and in which phases that is timed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from many_contacts.assets import Assets

Array: TypeAlias = NDArray[np.float64]

LEAST = (2.5, 4.0)
"""Ratio to MuJoCo's time that every scene should reach at least, in f64 and f32."""
MEAN = (5.0, 9.0)
"""The same for the geometric mean over scenes."""


@dataclass(frozen=True)
class Phase:
    """A stretch of an episode.

    Attributes:
        name: What happens in it.
        steps: Its length, steps.
        timed: Whether it is a row of the table; other phases only lead to the next one.
        held: Names of a body that is held and of the body that holds it ("world" for the floor); what moves between them is slip.
    """

    name: str
    steps: int
    timed: bool = True
    held: tuple[str, str] | None = None


@dataclass(frozen=True)
class Script:
    """What happens in every environment of a batch, the same in every engine.

    Attributes:
        qpos: Configurations at the beginning, (num_envs, nq).
        control: Controls, (blocks, num_envs, nu); the last block stays in force.
        hold: Steps that a block is held.
        qvel: Velocities at the beginning, (num_envs, nv); None is at rest.
        push: Force (N) and torque (N m) on every body all the time, world axes, (nbody, 6); None is none.
        mocap: Poses of the mocap bodies, (blocks, num_envs, nmocap, 7); None leaves them where the model has them.
        ended: Function of configurations (num_envs, nq) that says which environments begin anew, (num_envs,) bool; None is none ever.
        anew: Configurations for that, (draws, num_envs, nq): the k-th time an environment takes draw k modulo `draws`.
    """

    qpos: Array
    control: Array
    hold: int = 1
    qvel: Array | None = None
    push: Array | None = None
    mocap: Array | None = None
    ended: Callable[[Array], NDArray[np.bool_]] | None = None
    anew: Array | None = None


@dataclass(frozen=True)
class Scene:
    """A scene of the benchmark.

    Attributes:
        name: Of the scene.
        about: What it is and where its numbers come from, for the page.
        spec: Builds the model.
        script: Writes what happens, given the compiled model, the number of environments and random numbers.
        phases: Of an episode, in their order.
        lead: Steps, with the first controls, that bring environments to where the episode begins; one engine makes them for all.
        group: Scenes of one group count once in the mean over scenes; "" is the scene's own.
        target: Ratios that are wanted in f64 and f32.
    """

    name: str
    about: str
    spec: Callable[[Assets], Any]
    script: Callable[[mujoco.MjModel, int, np.random.Generator], Script]
    phases: tuple[Phase, ...]
    lead: int = 0
    group: str = ""
    target: tuple[float, float] = LEAST

    @property
    def steps(self) -> int:
        """Length of an episode, steps."""
        return sum(phase.steps for phase in self.phases)

    def row(self, phase: Phase) -> str:
        """Name of the row of a phase."""
        alone = sum(p.timed for p in self.phases) == 1
        return self.name if alone else f"{self.name}: {phase.name}"


def still(qpos: Array, num_envs: int) -> Array:
    """One configuration (nq,) for all environments, (num_envs, nq)."""
    return np.tile(np.asarray(qpos, np.float64), (num_envs, 1))


def uncontrolled(num_envs: int, nu: int = 0) -> Array:
    """Controls of 0 throughout, (1, num_envs, nu)."""
    return np.zeros((1, num_envs, nu))


def turned(rng: np.random.Generator, count: int) -> Array:
    """Quaternions of random orientations, (count, 4)."""
    quat = rng.normal(size=(count, 4))
    return np.asarray(quat / np.linalg.norm(quat, axis=1, keepdims=True), np.float64)

"""Definition of a benchmark scene: a model, initial states and controls of an episode (a `Script`), and the timed phases of the episode."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from many_contacts.assets import Assets

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Phase:
    """Phase of an episode: a number of steps with a name.

    Attributes:
        name: Name of the phase.
        steps: Length in steps.
        timed: Whether the phase is measured, and shown in the tables of results.
        held: Names of a held body and of the body that holds it ("world" for the floor). Their relative displacement is the slip.
    """

    name: str
    steps: int
    timed: bool = True
    held: tuple[str, str] | None = None


@dataclass(frozen=True)
class Script:
    """Initial states and inputs of an episode, the same for all engines.

    Attributes:
        qpos: Initial configurations, (num_envs, nq).
        control: Controls, (blocks, num_envs, nu). The last block lasts until the end.
        hold: Number of steps per block.
        qvel: Initial velocities, (num_envs, nv). With None all environments start at rest.
        push: Constant force (N) and torque (N m) on each body in world axes, (nbody, 6). With None there are no such forces.
        mocap: Poses of the mocap bodies, (blocks, num_envs, nmocap, 7). With None they keep the poses of the model.
        ended: Function from configurations (num_envs, nq) to a mask (num_envs,) of environments to reset. With None nothing is reset.
        reset_qpos: Configurations after a reset, (draws, num_envs, nq). The k-th reset of an environment uses draw k modulo `draws`.
    """

    qpos: Array
    control: Array
    hold: int = 1
    qvel: Array | None = None
    push: Array | None = None
    mocap: Array | None = None
    ended: Callable[[Array], NDArray[np.bool_]] | None = None
    reset_qpos: Array | None = None


@dataclass(frozen=True)
class Scene:
    """Scene of the benchmark.

    Attributes:
        name: Name of the scene.
        about: Description of the scene and source of its parameters, for the page.
        spec: Function that builds the model, an `MjSpec`, from the cache of downloaded packages.
        script: Function that makes the `Script` (initial states and controls). Its arguments are the compiled model, the number of
            environments and a random number generator.
        phases: Phases of an episode, in order.
        lead: Number of steps before the episode begins, with the first controls of the script. The episode starts
            in all engines from the states after these steps.
        group: Name of a group of similar scenes, which count as one scene in mean speedups. Empty if the scene counts alone.
    """

    name: str
    about: str
    spec: Callable[[Assets], Any]
    script: Callable[[mujoco.MjModel, int, np.random.Generator], Script]
    phases: tuple[Phase, ...]
    lead: int = 0
    group: str = ""

    @property
    def steps(self) -> int:
        """Number of steps in an episode."""
        return sum(phase.steps for phase in self.phases)

    def row(self, phase: Phase) -> str:
        """Name of a phase in the tables of results: the scene's name, followed by the phase's name if several phases are measured."""
        alone = sum(p.timed for p in self.phases) == 1
        return self.name if alone else f"{self.name}: {phase.name}"


def still(qpos: Array, num_envs: int) -> Array:
    """Copies of a configuration (nq,) for all environments, (num_envs, nq)."""
    return np.tile(np.asarray(qpos, np.float64), (num_envs, 1))


def uncontrolled(num_envs: int, nu: int = 0) -> Array:
    """Zero controls for a whole episode, in the format of `Script.control` with a single block of steps: (1, num_envs, nu)."""
    return np.zeros((1, num_envs, nu))


def turned(rng: np.random.Generator, count: int) -> Array:
    """Quaternions of random orientations, (count, 4)."""
    quat = rng.normal(size=(count, 4))
    return np.asarray(quat / np.linalg.norm(quat, axis=1, keepdims=True), np.float64)

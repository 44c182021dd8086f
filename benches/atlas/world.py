"""Interface of a scene in an engine: states, forces, contacts, derived quantities and costs.

States have MuJoCo's layout in every engine: quaternions are (w, x, y, z), and a free joint has a linear velocity in world axes and an
angular velocity in body axes. Energy, momentum and body poses are computed from the states by MuJoCo's kinematics, in the same way for all
engines.
"""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from atlas.mjcf import SURFACE

Array = NDArray[np.float64]
AT_ONCE = 1000
"""Largest number of steps in one call of an engine."""
NOT_FINITE = "a step was not finite"
"""Note of a run in which the engine reported a state that is not finite."""


class CannotRunError(Exception):
    """Error of an engine that does not support a scene; the message has the reason."""


class DivergedError(Exception):
    """Error of a run whose state is not finite, or that the engine has reset."""


class TooSlowError(Exception):
    """Error of a run that took more processor time than `World.limit`."""


@dataclass(frozen=True)
class Touch:
    """Contact point with a force: two geoms, normal (3,) from the first to the second, and normal force in N."""

    geoms: tuple[int, int]
    normal: Array
    force: float


class World(ABC):
    """Batch of environments of a scene in an engine.

    Attributes:
        model: MuJoCo's model of the scene, for names, masses and derived quantities.
        dt: Time step, s.
        num_envs: Number of environments.
        cpu: Processor time spent in steps so far, s.
        seconds: Simulated time so far, s.
        flags: Status flags of the engine, each with a count: environments that report it after a call of the engine (of 1 to 1000
            steps), summed over all calls.
        limit: Processor time after which a world raises `TooSlowError`, s.
    """

    limit = float("inf")

    def __init__(self, mjcf: str, dt: float, num_envs: int) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf)
        self.dt = dt
        self.num_envs = num_envs
        self.cpu = 0.0
        self.seconds = 0.0
        self.flags: Counter[str] = Counter()
        self._yard = mujoco.MjData(self.model)

    @property
    def surfaces(self) -> NDArray[np.bool_]:
        """Mask (ngeom,) of the mesh geoms that collide by their triangles."""
        m = self.model
        return np.array([m.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH and m.geom(g).name == SURFACE for g in range(m.ngeom)])

    @property
    @abstractmethod
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), a copy."""

    @property
    @abstractmethod
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), a copy."""

    @abstractmethod
    def set(self, qpos: ArrayLike | None = None, qvel: ArrayLike | None = None) -> None:
        """Set positions and velocities, (num_envs, n), or (n,) for all environments; None keeps them."""

    @abstractmethod
    def push(self, body: str, force: ArrayLike, torque: ArrayLike = (0, 0, 0)) -> None:
        """Apply a lasting force (N) and torque (N m) at a body's centre of mass, in world axes, (num_envs, 3) or (3,) for all."""

    @abstractmethod
    def touches(self, env: int = 0) -> list[Touch]:
        """Contacts of the last step that exert a force, in one environment."""

    @abstractmethod
    def _advance(self, ctrl: Array | None, nstep: int) -> None:
        """Make `nstep` steps with controls (num_envs, nu). The caller adds the processor time of this method to `cpu`."""

    @abstractmethod
    def _check(self) -> None:
        """Collect the status flags of the last steps. Raises `DivergedError` if a state is not finite."""

    def step(self, nstep: int = 1, ctrl: ArrayLike | None = None) -> None:
        """Step all environments with constant controls.

        Args:
            nstep: Number of time steps.
            ctrl: Controls, (num_envs, nu), or (nu,) for all environments. None gives no controls to the engine.
        """
        given = None if ctrl is None else np.broadcast_to(np.asarray(ctrl, float), (self.num_envs, self.model.nu))
        while nstep > 0:
            some = min(nstep, AT_ONCE)
            begin = time.process_time()
            self._advance(given, some)
            self.cpu += time.process_time() - begin
            self.seconds += some * self.dt
            nstep -= some
            self._check()
            if self.cpu > self.limit:
                raise TooSlowError(f"stopped after {self.limit:g} s of processor time and {self.seconds:g} simulated seconds")

    def run(self, seconds: float, ctrl: ArrayLike | None = None) -> None:
        """Step all environments for a time in s, which is rounded to a whole number of steps, at least one."""
        self.step(max(1, round(seconds / self.dt)), ctrl)

    def worst(self, error: Callable[[], float], count: int, seconds: float) -> float:
        """Largest of zero and the errors after each of `count` runs of a time in s."""
        errors = [0.0]
        for _ in range(count):
            self.run(seconds)
            errors.append(float(error()))
        return max(errors)

    def mean(self, error: Callable[[], float], seconds: float, every: float) -> float:
        """Mean of the errors after each of the runs of `every` s, or of a time step if that is longer, that make up a time in s."""
        every = max(every, self.dt)
        errors = []
        for _ in range(round(seconds / every)):
            self.run(every)
            errors.append(float(error()))
        return float(np.mean(errors))

    def body(self, name: str) -> int:
        """Index of a body."""
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name))

    def geom(self, name: str) -> int:
        """Index of a geom."""
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, name))

    def at(self, env: int = 0) -> mujoco.MjData:
        """MuJoCo's data with kinematics, energy and momentum at the current state of an environment. The next call overwrites the data."""
        d, m = self._yard, self.model
        d.qpos[:], d.qvel[:] = self.qpos[env], self.qvel[env]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_crb(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_energyPos(m, d)
        mujoco.mj_energyVel(m, d)
        mujoco.mj_subtreeVel(m, d)
        return d

    def energy(self) -> Array:
        """Total energy of each environment, (num_envs,), J."""
        return np.array([self.at(env).energy.sum() for env in range(self.num_envs)])

    def kinetic(self) -> Array:
        """Kinetic energy of each environment, (num_envs,), J."""
        return np.array([self.at(env).energy[1] for env in range(self.num_envs)])

    def momentum(self, env: int = 0) -> tuple[Array, Array]:
        """Linear momentum (3,), kg m/s, and angular momentum about the common centre of mass (3,), kg m^2/s."""
        d = self.at(env)
        return d.subtree_linvel[0] * self.model.body_subtreemass[0], d.subtree_angmom[0].copy()

    def normal_force(self, between: tuple[str, str] | None = None, axis: ArrayLike = (0, 0, 1), env: int = 0) -> float:
        """Component along an axis of the sum of the normal forces in the last step, N.

        Args:
            between: Names of two bodies. The sum is over their contacts, and the forces are those on the second body. With None, the
                sum is over all contacts, and each adds the absolute value of its component.
            axis: Unit vector in world axes, (3,).
            env: Index of the environment.
        """
        total = 0.0
        for touch in self.touches(env):
            a, b = (int(self.model.geom_bodyid[g]) for g in touch.geoms)
            if between is None:
                total += touch.force * abs(float(touch.normal @ np.asarray(axis, float)))
            elif {a, b} == {self.body(n) for n in between}:
                sign = 1 if b == self.body(between[1]) else -1
                total += sign * touch.force * float(touch.normal @ np.asarray(axis, float))
        return total

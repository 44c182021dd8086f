"""One engine's way through the same episodes: what it did in every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.shared.machine import require
from stepper.shared.progress import Tick

Array = NDArray[np.float64]

Drive = Array | Callable[[Array, Array], Any]
"""Controls (steps, nu) or (steps, num_envs, nu), or a policy: configurations (num_envs, nq) and velocities (num_envs, nv) to controls."""


@dataclass(frozen=True)
class Touching:
    """Contacts that push in one environment.

    Attributes:
        geoms: (n, 2)
        force: Normal forces, (n,) in N.
        depth: How far they overlap, (n,) in m.
    """

    geoms: NDArray[np.int64]
    force: Array
    depth: Array


class Engine(Protocol):
    """What steps some environments of a model."""

    name: str

    def state(self) -> tuple[Array, Array]:
        """Configurations (num_envs, nq) and velocities (num_envs, nv)."""

    def step(self, ctrl: Array) -> None:
        """One time step with controls (num_envs, nu)."""

    def touching(self, env: int) -> Touching:
        """Contacts of the last step that push."""

    def energy(self, env: int) -> float:
        """Potential and kinetic energy, J."""

    def overshoot(self) -> Array:
        """Farthest that a joint is beyond its range, (num_envs,) in rad or m."""


class Ours:
    """stepper with one law of contact."""

    def __init__(self, name: str, model: Model, options: Options, qpos: Array, qvel: Array) -> None:
        self.name = name
        self._sim = Stepper(model, num_envs=len(qpos), options=options)
        self._sim.set_state(qpos=qpos, qvel=qvel)

    def state(self) -> tuple[Array, Array]:
        """See `Engine.state`."""
        return np.array(self._sim.qpos), np.array(self._sim.qvel)

    def step(self, ctrl: Array) -> None:
        """See `Engine.step`."""
        self._sim.step(ctrl)

    def touching(self, env: int) -> Touching:
        """See `Engine.touching`."""
        found = self._sim.contacts(env)
        found = found[found["force"][:, 0] > 0.0]
        return Touching(np.array(found["geom"], np.int64), np.array(found["force"][:, 0]), np.maximum(-found["distance"], 0.0))

    def energy(self, env: int) -> float:
        """See `Engine.energy`."""
        return float(sum(np.atleast_1d(part)[env] for part in self._sim.energy()))

    def overshoot(self) -> Array:
        """See `Engine.overshoot`."""
        return np.array(self._sim.max_limit_violation)


class Theirs:
    """MuJoCo with the settings of its own model."""

    name = "MuJoCo"

    def __init__(self, compiled: Any, timestep: float, qpos: Array, qvel: Array) -> None:
        self._mujoco = require("mujoco", "to compare with it")
        self._model = compiled.__copy__()
        self._model.opt.timestep = timestep
        self._model.opt.enableflags |= self._mujoco.mjtEnableBit.mjENBL_ENERGY
        self._data = [self._mujoco.MjData(self._model) for _ in qpos]
        self._now = self._mujoco.MjData(self._model)
        for data, q, v in zip(self._data, qpos, qvel, strict=True):
            data.qpos[:], data.qvel[:] = q, v

    def state(self) -> tuple[Array, Array]:
        """See `Engine.state`."""
        return np.array([d.qpos for d in self._data]), np.array([d.qvel for d in self._data])

    def step(self, ctrl: Array) -> None:
        """See `Engine.step`."""
        for data, row in zip(self._data, ctrl, strict=True):
            data.ctrl[:] = row
            self._mujoco.mj_step(self._model, data)

    def touching(self, env: int) -> Touching:
        """See `Engine.touching`."""
        data, wrench = self._data[env], np.zeros(6)
        geoms, force, depth = [], [], []
        for i, contact in enumerate(data.contact):
            self._mujoco.mj_contactForce(self._model, data, i, wrench)
            if wrench[0] > 0.0:
                geoms.append([int(g) for g in contact.geom])
                force.append(float(wrench[0]))
                depth.append(max(float(contact.includemargin - contact.dist), 0.0))
        return Touching(np.array(geoms, np.int64).reshape(-1, 2), np.array(force), np.array(depth))

    def energy(self, env: int) -> float:
        """See `Engine.energy`."""
        # What a step leaves is the energy of the state before it.
        data, now = self._data[env], self._now
        now.qpos[:], now.qvel[:] = data.qpos, data.qvel
        self._mujoco.mj_fwdPosition(self._model, now)
        self._mujoco.mj_fwdVelocity(self._model, now)
        self._mujoco.mj_energyPos(self._model, now)
        self._mujoco.mj_energyVel(self._model, now)
        return float(now.energy.sum())

    def overshoot(self) -> Array:
        """See `Engine.overshoot`."""
        m = self._model
        one = (m.jnt_limited != 0) & np.isin(m.jnt_type, [self._mujoco.mjtJoint.mjJNT_HINGE, self._mujoco.mjtJoint.mjJNT_SLIDE])
        q = np.array([d.qpos[m.jnt_qposadr[one]] for d in self._data])
        low, high = m.jnt_range[one].T
        out: Array = np.max(np.maximum(low - q, q - high), axis=1, initial=0.0)
        return out


@dataclass(frozen=True)
class Course:
    """What one engine did, for every step and environment.

    Attributes:
        name: Of the engine.
        timestep: s.
        qpos: Configurations after every step, (steps, num_envs, nq).
        depth: Deepest overlap, (steps, num_envs) in m.
        overshoot: Farthest beyond a limit, (steps, num_envs) in rad or m.
        energy: Potential and kinetic energy after every step, (steps, num_envs) in J.
        force: Largest normal force of a contact, (steps, num_envs) in N.
        impulse: Sum of normal impulses, (steps, num_envs) in N s.
        slip: Way that touching surfaces slide on one another, (steps, num_envs) in m; NaN where nobody could measure it.
        pairs: Number of pairs of geoms that touch, (steps, num_envs).
        begins: Number of pairs that touch and did not in the step before, (steps, num_envs).
        reward: (steps, num_envs)
    """

    name: str
    timestep: float
    qpos: Array
    depth: Array
    overshoot: Array
    energy: Array
    force: Array
    impulse: Array
    slip: Array
    pairs: Array
    begins: Array
    reward: Array


class Slip:
    """Measures how touching surfaces slide, in the states of any engine: by MuJoCo's contact points and velocities at the state."""

    def __init__(self, compiled: Any) -> None:
        self._mujoco = require("mujoco", "to measure how surfaces slide")
        self._model = compiled
        self._data = self._mujoco.MjData(compiled)

    def speed(self, qpos: Array, qvel: Array, pairs: set[tuple[int, int]]) -> float:
        """Sum over the pairs of geoms that push of the largest speed at which their surfaces slide, m/s."""
        mujoco, data, most = self._mujoco, self._data, dict.fromkeys(pairs, 0.0)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_fwdVelocity(self._model, data)
        velocity = np.zeros(6)
        for contact in data.contact:
            geoms = (int(contact.geom[0]), int(contact.geom[1]))
            if geoms not in most:
                continue
            relative = np.zeros(3)
            for sign, geom in zip((-1.0, 1.0), geoms, strict=True):
                mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, velocity, 0)
                relative += sign * (velocity[3:] + np.cross(velocity[:3], contact.pos - data.geom_xpos[geom]))
            normal = contact.frame[:3]
            most[geoms] = max(most[geoms], float(np.linalg.norm(relative - normal * (normal @ relative))))
        return sum(most.values())


def run(
    engine: Engine, drive: Drive, steps: int, timestep: float, *, slip: Slip | None, reward: Callable[..., Any] | None, tick: Tick
) -> Course:
    """Steps an engine and keeps what it did."""
    qpos, qvel = engine.state()
    n = len(qpos)
    rows: dict[str, list[Any]] = {
        key: [] for key in ("qpos", "depth", "overshoot", "energy", "force", "impulse", "slip", "pairs", "begins", "reward")
    }
    before: list[set[tuple[int, int]]] = [set() for _ in range(n)]
    for k in range(steps):
        ctrl = np.asarray(drive(qpos, qvel) if callable(drive) else drive[min(k, len(drive) - 1)], float)
        ctrl = np.broadcast_to(ctrl, (n, ctrl.shape[-1]))
        engine.step(ctrl)
        last, (qpos, qvel) = (qpos, qvel), engine.state()
        touching = [engine.touching(env) for env in range(n)]
        now = [{(int(a), int(b)) for a, b in t.geoms} for t in touching]
        rows["qpos"].append(qpos)
        rows["depth"].append([np.max(t.depth, initial=0.0) for t in touching])
        rows["overshoot"].append(engine.overshoot())
        rows["energy"].append([engine.energy(env) for env in range(n)])
        rows["force"].append([np.max(t.force, initial=0.0) for t in touching])
        rows["impulse"].append([timestep * t.force.sum() for t in touching])
        rows["slip"].append([timestep * slip.speed(q, v, pairs) if slip else np.nan for q, v, pairs in zip(qpos, qvel, now, strict=True)])
        rows["pairs"].append([len(pairs) for pairs in now])
        rows["begins"].append([len(pairs - old) for pairs, old in zip(now, before, strict=True)])
        rows["reward"].append(np.zeros(n) if reward is None else np.broadcast_to(reward(last, ctrl, (qpos, qvel)), n))
        before = now
        tick(engine.name, (k + 1) / steps)
    return Course(engine.name, timestep, **{key: np.array(value, float) for key, value in rows.items()})

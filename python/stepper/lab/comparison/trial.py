"""Run of one engine for a comparison, recorded step by step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.worlds import World
from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, silent

Array = NDArray[np.float64]

ControlSource = Array | Callable[[Array, Array], Any]
"""Recorded controls (steps, nu) or (steps, num_envs, nu), or a function of qpos (num_envs, nq) and qvel (num_envs, nv) that returns
controls. Controllers of studies are functions of a `World` instead (`stepper.lab.study.controllers.Controller`)."""


@dataclass(frozen=True)
class Course:
    """Recorded run of one engine, with values after every step in every environment.

    Attributes:
        name: Name of the engine.
        timestep: Time step, s.
        qpos: Positions after every step, (steps, num_envs, nq), m and rad.
        depth: Deepest overlap, (steps, num_envs), m.
        overshoot: Largest violation of a limit, (steps, num_envs), rad or m.
        energy: Potential and kinetic energy after every step, (steps, num_envs), J.
        force: Largest normal force of a contact, (steps, num_envs), N.
        impulse: Sum of normal impulses, (steps, num_envs), N s.
        slip: Sliding distance in the step, summed over touching pairs of geoms, (steps, num_envs), m; NaN if it was not measured.
        pairs: Number of pairs of geoms that touch, (steps, num_envs).
        begins: Number of pairs that touch and did not touch in the previous step, (steps, num_envs).
        reward: Reward of every step, (steps, num_envs).
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
    """Measurement of the sliding speed of touching surfaces, m/s, with MuJoCo's contact points and velocities for a state of any engine.

    Args:
        compiled: `mujoco.MjModel` of the scene.
    """

    def __init__(self, compiled: Any) -> None:
        self._mujoco = require("mujoco", "to measure how surfaces slide")
        self._model = compiled
        self._data = self._mujoco.MjData(compiled)

    def speed(self, qpos: Array, qvel: Array, pairs: set[tuple[int, int]]) -> float:
        """Sliding speed of the scene, m/s: the largest sliding speed of the surfaces of each pair of touching geoms, summed over the pairs.

        Args:
            qpos: Positions, (nq,), m and rad.
            qvel: Velocities, (nv,), m/s and rad/s.
            pairs: Pairs of geoms that exert forces on each other.
        """
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
    name: str,
    world: World,
    controller: ControlSource,
    steps: int,
    *,
    slip: Slip | None = None,
    reward: Callable[..., Any] | None = None,
    progress: ProgressCallback = silent,
) -> Course:
    """Steps the environments of an engine, and records every step.

    Args:
        name: Name of the engine.
        world: Environments, in their initial states.
        controller: Controls (rows, num_envs, nu), one row per step; after the end, the last row is kept. Or a function of qpos and qvel
            that returns controls.
        steps: Number of steps.
        slip: Measurement of sliding; None does not measure it.
        reward: Function of (qpos, qvel) before the step, controls, and (qpos, qvel) after it, that returns (num_envs,).
        progress: Progress callback, called after every step with the name and the fraction of the steps.
    """
    qpos, qvel = np.array(world.qpos), np.array(world.qvel)
    n = world.num_envs
    rows: dict[str, list[Any]] = {
        key: [] for key in ("qpos", "depth", "overshoot", "energy", "force", "impulse", "slip", "pairs", "begins", "reward")
    }
    before: list[set[tuple[int, int]]] = [set() for _ in range(n)]
    for k in range(steps):
        ctrl = np.asarray(controller(qpos, qvel) if callable(controller) else controller[min(k, len(controller) - 1)], float)
        ctrl = np.broadcast_to(ctrl, (n, ctrl.shape[-1]))
        world.step(ctrl, 1)
        last, (qpos, qvel) = (qpos, qvel), (np.array(world.qpos), np.array(world.qvel))
        contacts = world.contacts()
        pushing = [contacts[(contacts["env"] == env) & (contacts["force"][:, 0] > 0.0)] for env in range(n)]
        now = [{(int(a), int(b)) for a, b in own["geom"]} for own in pushing]
        rows["qpos"].append(qpos)
        rows["depth"].append([np.max(-own["distance"], initial=0.0) for own in pushing])
        rows["overshoot"].append(np.array(world.max_limit_violation))
        rows["energy"].append(np.sum(world.energy(), axis=0))
        rows["force"].append([np.max(own["force"][:, 0], initial=0.0) for own in pushing])
        rows["impulse"].append([world.timestep * own["force"][:, 0].sum() for own in pushing])
        rows["slip"].append(
            [world.timestep * slip.speed(q, v, pairs) if slip else np.nan for q, v, pairs in zip(qpos, qvel, now, strict=True)]
        )
        rows["pairs"].append([len(pairs) for pairs in now])
        rows["begins"].append([len(pairs - old) for pairs, old in zip(now, before, strict=True)])
        rows["reward"].append(np.zeros(n) if reward is None else np.broadcast_to(reward(last, ctrl, (qpos, qvel)), n))
        before = now
        progress(name, (k + 1) / steps)
    return Course(name, world.timestep, **{key: np.array(value, float) for key, value in rows.items()})

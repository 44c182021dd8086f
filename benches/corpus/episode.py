"""Episodes of both engines with the same controls from the reference pose: flags, residuals and motion."""

import dataclasses
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray

from corpus.dynamics import Array, control_bounds, kept_controls
from corpus.row import Episode, Motion

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
RANDOM_STEPS = 500
REST_SECONDS = 2.0
NUDGE = 1e-2
"""Standard deviation of the initial velocities of the episode "rest", rad/s and m/s. Unstable equilibria fall over."""
_SHARES = {field.name for field in dataclasses.fields(Episode)}
"""Names of the fields of `Episode`. A field with the name of a status flag has the fraction of the steps with this flag."""
PATIENCE = 60.0
"""Largest processor time of an episode, s. Models with very small time steps make fewer steps."""


def random_episode(m: Any, model: stepper.Model, rng: np.random.Generator) -> Episode:
    """Episode of `RANDOM_STEPS` steps, with new random controls for each step."""
    low, high = control_bounds(m)
    return _run(m, model, np.zeros(m.nv), lambda: rng.uniform(low, high), RANDOM_STEPS)


def rest_episode(m: Any, model: stepper.Model, rng: np.random.Generator) -> Episode:
    """Episode of `REST_SECONDS` with all controls 0 and small random initial velocities."""
    zero, qvel = np.zeros(m.nu), rng.normal(scale=NUDGE, size=m.nv)
    return _run(m, model, qvel, lambda: zero, max(1, round(REST_SECONDS / m.opt.timestep)))


def _run(m: Any, model: stepper.Model, qvel: Array, control: Callable[[], Array], steps: int) -> Episode:
    """Episode of stepper and MuJoCo from the reference pose."""
    sim, data = stepper.Stepper(model), mujoco.MjData(m)
    sim.set_state(qvel=qvel)
    data.qvel[:] = qvel
    limits, kept = Limits(m), kept_controls(m, model)
    ours, theirs = _Track(limits), _Track(limits)
    flags: Counter[stepper.Status] = Counter()
    residual, begin, made = 0.0, time.process_time(), 0
    while made < steps and time.process_time() - begin < PATIENCE:
        ctrl = control()
        sim.step(ctrl[kept])
        flags.update(stepper.Status(int(sim.status)))
        residual = float(np.maximum(residual, sim.residual))  # np.maximum keeps NaN, unlike max.
        ours.add(sim.energy()[1], sim.qpos)
        data.ctrl[:] = ctrl
        mujoco.mj_step(m, data)
        mujoco.mj_energyVel(m, data)
        theirs.add(float(data.energy[1]), data.qpos)
        made += 1
    # Flags of overlap and limits are not counted: both are measured for both engines below.
    shares = {name: flags[flag] / made for flag in stepper.Status if (name := str(flag.name).lower()) in _SHARES}
    return Episode(steps=made, residual=residual, ours=ours.motion(), theirs=theirs.motion(), warnings=_warnings(data), **shares)


def _warnings(data: Any) -> str:
    """Names and counts of MuJoCo's warnings in `MjData`."""
    counts = {kind.name.removeprefix("mjWARN_"): int(data.warning[int(kind)].number) for kind in _kinds_of_warnings()}
    return " ".join(f"{name}:{count}" for name, count in counts.items() if count)


def _kinds_of_warnings() -> list[Any]:
    """Members of MuJoCo's enumeration of warnings."""
    kinds = mujoco.mjtWarning
    return [getattr(kinds, name) for name in dir(kinds) if name.startswith("mjWARN_")]


class Limits:
    """Limits of the hinges and slides of a model, to measure their violation."""

    def __init__(self, m: Any) -> None:
        off = int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        on = m.jnt_limited.astype(bool) & np.isin(m.jnt_type, (HINGE, SLIDE)) & (not int(m.opt.disableflags) & off)
        self.adr: NDArray[np.intp] = np.asarray(m.jnt_qposadr[on], np.intp)
        self.hinge: NDArray[np.bool_] = m.jnt_type[on] == HINGE
        self.low, self.high = m.jnt_range[on].T
        self.outside = np.zeros(len(self.adr))
        """Violation of the range of each limited joint in the reference pose, m or rad."""
        self.outside = self.excess(m.qpos0)

    def excess(self, qpos: Array) -> Array:
        """Violation of the range of each limited joint at `qpos` (nq,), less that in the reference pose, at least 0, m or rad."""
        q = qpos[self.adr]
        beyond: Array = np.maximum(np.maximum(self.low - q, q - self.high), 0.0)
        return np.maximum(beyond - self.outside, 0.0)

    def worst(self, excess: Array) -> tuple[float, float]:
        """Largest value of `excess` over the hinges, rad, and over the slides, m."""
        return float(excess[self.hinge].max(initial=0.0)), float(excess[~self.hinge].max(initial=0.0))


class _Track:
    """Record of the motion of one engine in an episode, for its summary."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.energies: list[float] = []
        self.excess = np.zeros(len(limits.adr))

    def add(self, energy: float, qpos: Array) -> None:
        """Add the kinetic energy and the positions after a step to the record."""
        self.energies.append(energy)
        self.excess = np.maximum(self.excess, self.limits.excess(qpos))

    def motion(self) -> Motion:
        """Summary of the motion over all steps of the episode."""
        return Motion(float(np.mean(self.energies)), float(np.max(self.energies)), *self.limits.worst(self.excess))

"""Comparison of smooth dynamics at random states: mass matrix, bias force, and acceleration without constraints."""

import math
from typing import Any

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[np.float64]
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
STATES = 5
SPEED = 2.0
"""Standard deviation of each velocity, rad/s and m/s."""


def kept_actuators(m: Any, model: stepper.Model) -> list[int]:
    """Indices in MuJoCo of the actuators that stepper supports."""
    left_out = {name for kind, name, _ in model.omitted if kind == "actuator"}
    names = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, a) or f"#{a}" for a in range(m.nactuator)]
    return [a for a, name in enumerate(names) if name not in left_out]


def kept_controls(m: Any, model: stepper.Model) -> NDArray[np.intp]:
    """Indices in MuJoCo of stepper's controls, in stepper's order."""
    return _indices((m.actuator_ctrladr[a], m.actuator_ctrlnum[a]) for a in kept_actuators(m, model))


def kept_activations(m: Any, model: stepper.Model) -> NDArray[np.intp]:
    """Indices in MuJoCo of stepper's activations, in stepper's order."""
    return _indices((m.actuator_actadr[a], max(m.actuator_actnum[a], 0)) for a in kept_actuators(m, model))


def _indices(pieces: Any) -> NDArray[np.intp]:
    """Indices of all entries of some index ranges, each given as a pair (start, count)."""
    return np.array([i for start, count in pieces for i in range(start, start + count)], np.intp)


def control_bounds(m: Any) -> tuple[Array, Array]:
    """Lower and upper bounds of the controls; -1 and 1 for controls without bounds."""
    limited = m.actuator_ctrllimited.astype(bool)
    low, high = m.actuator_ctrlrange.T
    return np.where(limited, low, -1.0), np.where(limited, high, 1.0)


def agreement(m: Any, model: stepper.Model, rng: np.random.Generator) -> tuple[float, float, float]:
    """Relative errors of mass matrix, bias force and acceleration without constraints: the largest over `STATES` states.

    The error of an entry (i, j) of the mass matrix M is relative to sqrt(M_ii M_jj). Forces c have the norm |c|^2 = c . M^-1 c and
    accelerations a have |a|^2 = a . M a, so that slides and hinges are comparable. Errors are relative to the norm of MuJoCo's value, or
    to the norm of the acceleration qvel / 1 s if that is larger. Otherwise bias forces that consist only of rounding errors would count.
    """
    sim, data = stepper.Stepper(model), mujoco.MjData(m)
    controls, activations = kept_controls(m, model), kept_activations(m, model)
    worst = np.zeros(3)
    for _ in range(STATES):
        qpos, qvel = _random_state(m, rng)
        act, ctrl = rng.uniform(-1, 1, m.na), rng.uniform(*control_bounds(m))
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = qpos, qvel, act, ctrl
        mujoco.mj_forward(m, data)
        sim.step(ctrl[controls])  # Applies the controls; the state is set again below.
        sim.set_state(qpos, qvel, act=act[activations])
        mass = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, data, mass)
        size = np.sqrt(np.outer(np.diag(mass), np.diag(mass)))
        floor = float(qvel @ mass @ qvel)
        errors = [
            float(np.abs((sim.mass_matrix() - mass) / size).max()),
            _relative(np.linalg.inv(mass), sim.qfrc_bias, data.qfrc_bias, floor),
            _relative(mass, sim.qacc_smooth, data.qacc_smooth, floor),
        ]
        worst = np.maximum(worst, errors)
    return float(worst[0]), float(worst[1]), float(worst[2])


def _relative(metric: Array, found: Array, expected: Array, floor: float) -> float:
    """Relative error |found - expected| / |expected| in the norm |x|^2 = x . metric x.

    The square of the denominator counts as at least `floor`.
    """
    difference = found - expected
    return math.sqrt(max(float(difference @ metric @ difference), 0.0) / max(float(expected @ metric @ expected), floor))


def _random_state(m: Any, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random state: joints within their range or +-pi, positions within 1 m, uniform orientations, normal velocities."""
    qpos = np.zeros(m.nq)
    for j in range(m.njnt):
        at, kind = m.jnt_qposadr[j], m.jnt_type[j]
        if kind == FREE:
            qpos[at : at + 3] = rng.uniform(-1, 1, 3)
            at += 3
        if kind in (FREE, BALL):
            q = rng.normal(size=4)
            qpos[at : at + 4] = q / np.linalg.norm(q)
        else:
            qpos[at] = rng.uniform(*(m.jnt_range[j] if m.jnt_limited[j] else (-np.pi, np.pi)))
    return qpos, rng.normal(scale=SPEED, size=m.nv)

"""Measures of error, orders of convergence, trajectories by a method that shares nothing with the engine, and derivatives side by side."""

from collections.abc import Mapping
from functools import cache

import mujoco
import numpy as np
import stepper
from models import BALL, FREE, simulate, stepper_model
from scipy.integrate import solve_ivp

# Noise of a central difference: rounding of numbers of order 1 to 10 over the step of 1e-6.
NOISE = 1e-8


def relative_error(found, expected) -> float:
    """Largest difference over the largest expected entry; the difference itself where nothing is expected."""
    found, expected = np.asarray(found), np.asarray(expected)
    if expected.size == 0:
        return 0.0
    scale = np.abs(expected).max()
    return float(np.abs(found - expected).max() / (scale if scale > 0 else 1.0))


def slope(steps, errors) -> float:
    """The order p of error = C h^p by least squares over all points."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def state_error(model: mujoco.MjModel, found, expected) -> float:
    """Largest difference of two states (qpos, qvel), orientations by their rotation vector."""
    dq = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, dq, 1.0, np.ascontiguousarray(expected[0]), np.ascontiguousarray(found[0]))
    return float(max(np.abs(dq).max(), np.abs(np.subtract(found[1], expected[1])).max()))


def acceleration_of_short_steps(source: str, state: tuple[np.ndarray, np.ndarray], integrator: str) -> np.ndarray:
    """Change of the velocity in a step over its length h, extrapolated to h = 0: forces within the step make it differ by order h."""
    found = []
    for h in (8e-6, 4e-6, 2e-6):
        sim = simulate(source, integrator=integrator, timestep=h)
        sim.set_state(*state)
        sim.step()
        found.append((sim.qvel - state[1]) / h)
    # Neville's scheme over three step sizes leaves terms of order h^3, and the rounding of v over h.
    twice = [2 * found[1] - found[0], 2 * found[2] - found[1]]
    return (4 * twice[1] - twice[0]) / 3


def _rate(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> np.ndarray:
    """d/dt (qpos, qvel), from MuJoCo's smooth acceleration and dq/dt = q (0, omega) / 2."""
    nq = model.nq
    data.qpos[:], data.qvel[:] = state[:nq], state[nq:]
    mujoco.mj_forward(model, data)
    rate = np.zeros_like(state)
    rate[nq:] = data.qacc_smooth
    for j in range(model.njnt):
        q, v, kind = model.jnt_qposadr[j], model.jnt_dofadr[j], model.jnt_type[j]
        if kind == FREE:
            rate[q : q + 3] = state[nq + v : nq + v + 3]
            q, v = q + 3, v + 3
        if kind in {FREE, BALL}:
            mujoco.mju_mulQuat(rate[q : q + 4], state[q : q + 4], np.concatenate([[0.0], 0.5 * state[nq + v : nq + v + 3]]))
        else:
            rate[q] = state[nq + v]
    return rate


def reference(model: mujoco.MjModel, qpos, qvel, seconds: float, ctrl=None) -> tuple[np.ndarray, np.ndarray]:
    """The state after smooth motion by DOP853 on MuJoCo's accelerations, converged to about 1e-12."""
    data = mujoco.MjData(model)
    if ctrl is not None:
        data.ctrl[:] = ctrl
    start = np.concatenate([qpos, qvel])
    end = solve_ivp(lambda _, y: _rate(model, data, y), (0.0, seconds), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return end[: model.nq], end[model.nq :]


def joined(blocks: Mapping[str, np.ndarray]) -> np.ndarray:
    """Derivatives by the state and the controls, or what is known of these columns."""
    return np.concatenate([blocks[name] for name in ("qpos", "qvel", "act", "ctrl")], axis=-1)


@cache
def touching(robot: str, **options) -> tuple[stepper.Stepper, np.ndarray]:
    """Eight robots that fell onto the floor under random controls, and controls."""
    model, rng = stepper_model(robot, strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 8, options=stepper.Options(**options))
    for _ in range(10):
        sim.step(rng.uniform(-0.3, 0.3, (8, model.nu)), nstep=20)
    assert sum(c["force"][0] > 0 for c in sim.contacts()) >= 4
    return sim, rng.uniform(-0.3, 0.3, (8, model.nu))

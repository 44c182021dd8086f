"""Effect of encoder noise on the score of dm_control's cart-pole: one controller, with ideal and with noisy encoders.

The controller is a linear-quadratic regulator for the linearised cart-pole. It computes velocities as differences of measured positions.
The score is that of dm_control's task "balance", at most 1000.

    python examples/noisy_joints.py       # mean score of 32 episodes for each seed
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper
from dm_control.utils import rewards
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

Array = NDArray[np.float64]

EPISODES, STEPS = 32, 1000
IDEAL = None
NOISY = stepper.SensorModel({"angle": stepper.Transfer(noise_std=0.01)})
"""Sensor model with 0.01 rad of white noise on the encoder of the pole."""
STATE_COST, CONTROL_COST = (1.0, 10.0, 0.1, 0.1), 0.1


def cartpole() -> stepper.Model:
    """dm_control's cart-pole with an encoder on each joint."""
    spec = importlib.util.find_spec("dm_control")
    assert spec is not None and spec.submodule_search_locations is not None
    scene = mujoco.MjSpec.from_file(str(Path(spec.submodule_search_locations[0]) / "suite/cartpole.xml"))
    for name, joint in (("place", "slider"), ("angle", "hinge_1")):
        scene.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
    return stepper.load(scene.compile())


def regulator(model: stepper.Model) -> Array:
    """Gain K (4,) of the linear-quadratic regulator u = -K x at the upright pole, with x = (position, angle, their rates)."""
    sim = stepper.Stepper(model)

    def after(state: Array, ctrl: float) -> Array:
        sim.reset(qpos=state[:2], qvel=state[2:])
        sim.step([ctrl])
        return np.concatenate([sim.qpos, sim.qvel])

    eps = 1e-6
    # Central differences, column by column.
    A = np.array([after(eps * e, 0.0) - after(-eps * e, 0.0) for e in np.eye(4)]).T / (2 * eps)
    B = ((after(np.zeros(4), eps) - after(np.zeros(4), -eps)) / (2 * eps))[:, None]
    Q, R = np.diag(STATE_COST), np.array([[CONTROL_COST]])
    P = solve_discrete_are(A, B, Q, R)
    return np.asarray(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)[0])


def reward(qpos: Array, qvel: Array, ctrl: Array) -> Array:
    """Reward of dm_control's `cartpole.Balance`, from true states: for an upright, slow pole near the centre and small controls."""
    upright = (1 + np.cos(qpos[:, 1])) / 2
    centred = (1 + rewards.tolerance(qpos[:, 0], margin=2)) / 2
    gentle = (4 + rewards.tolerance(ctrl, margin=1, value_at_margin=0, sigmoid="quadratic")) / 5
    slow = (1 + rewards.tolerance(qvel[:, 1], margin=5)) / 2
    return np.asarray(upright * centred * gentle * slow)


def scores(sensors: stepper.SensorModel | None, seed: int = 0, episodes: int = EPISODES) -> Array:
    """Scores of the regulator in some episodes, (episodes,). The initial states depend on the seed, not on the sensors.

    Args:
        sensors: Sensor model. With None sensors are ideal.
        seed: Seed of the initial states and the sensor noise.
        episodes: Number of episodes.
    """
    model = cartpole()
    gain = regulator(model)
    sim = stepper.Stepper(model, episodes, sensors=sensors, seed=seed)
    rng = np.random.default_rng(seed)
    # Initial states have the distribution of dm_control's task.
    qpos = np.stack([rng.uniform(-0.1, 0.1, episodes), rng.uniform(-0.034, 0.034, episodes)], axis=1)
    sim.reset(qpos=qpos, qvel=0.01 * rng.normal(size=(episodes, 2)), seed=seed)
    total, before = np.zeros(episodes), sim.sensordata
    for _ in range(STEPS):
        position = sim.sensordata
        state = np.hstack([position, (position - before) / sim.timestep])
        ctrl = np.clip(-state @ gain, -1.0, 1.0)
        sim.step(ctrl[:, None])
        total += reward(sim.qpos, sim.qvel, ctrl)
        before = position
    return total


def table(seeds: range = range(5)) -> list[dict[str, Any]]:
    """Mean scores for each seed, with ideal and with noisy encoders."""
    return [{"seed": seed, "ideal": scores(IDEAL, seed).mean(), "noisy": scores(NOISY, seed).mean()} for seed in seeds]


def main() -> None:
    """Print a table of the regulator's mean scores with ideal and with noisy encoders."""
    print(f"mean score of {EPISODES} episodes of {STEPS} steps, by encoder noise\n seed   ideal   0.01 rad")
    for row in table():
        print(f"{row['seed']:5} {row['ideal']:7.1f} {row['noisy']:10.1f}")


if __name__ == "__main__":
    main()

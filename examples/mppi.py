"""Model-predictive path integral control (MPPI) of dm_control's walker and quadruped, with bit-exact predictions.

    python examples/mppi.py                       # the walker walks for four seconds
    python examples/mppi.py quadruped --seconds 2

A control lasts 25 ms (walker) or 40 ms (quadruped). For each control a planner copies the state of the plant and simulates many control
sequences in a batch. The plan is their mean, weighted by their returns (Williams et al. 2017, https://arxiv.org/abs/1707.02342). The plant
then reaches exactly the states that the plan predicts. A copied state is complete, and an environment has the same bits alone, in a batch,
and on any number of threads. The example counts the predictions that are exact.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.envs.suite import SUITE

Array = NDArray[Any]


@dataclass(frozen=True)
class Robot:
    """Robot with the parameters of its planner.

    Attributes:
        task: Name of the task in dm_control's suite that has the model.
        nstep: Simulation steps per control.
        horizon: Number of controls in a plan.
        noise: Standard deviation of the sampled controls about the plan, as a fraction of half the control range.
        temperature: Temperature of the weights exp(return / temperature), as a fraction of the standard deviation of the returns.
        reward: Function from qpos and qvel, (T, num_envs, ...), to rewards (T, num_envs).
        start: Initial values of some coordinates of qpos by index. The other coordinates start at the reference configuration.
    """

    task: str
    nstep: int
    horizon: int
    noise: float
    temperature: float
    reward: Callable[[Array, Array], Array]
    start: dict[int, float]


def _walker(qpos: Array, qvel: Array) -> Array:
    """Reward for a high, upright torso at 1 m/s; qpos begins with its height, x and pitch."""
    high = np.clip((qpos[..., 0] + 1.3) / 1.2, 0.0, 1.0)
    speed: Array = np.clip(1.0 - np.abs(qvel[..., 1] - 1.0), -1.0, 1.0)
    reward: Array = 3.0 * high + np.cos(qpos[..., 2]) + 2.0 * speed
    return reward


def _quadruped(qpos: Array, qvel: Array) -> Array:
    """Reward for an upright trunk at 0.5 m/s along x."""
    upright = 1.0 - 2.0 * np.square(qpos[..., 4:6]).sum(axis=-1)
    speed: Array = np.clip(1.0 - 2.0 * np.abs(qvel[..., 0] - 0.5), -1.0, 1.0)
    reward: Array = 2.0 * upright + speed - 0.2 * np.square(qvel[..., 1]) - 0.05 * np.square(qvel[..., 5])
    return reward


ROBOTS = {
    "walker": Robot("walker-walk", nstep=10, horizon=20, noise=0.5, temperature=0.2, reward=_walker, start={}),
    "quadruped": Robot("quadruped-walk", nstep=8, horizon=15, noise=0.4, temperature=0.2, reward=_quadruped, start={2: 0.57}),
}
"""Robots, with the parameters of their planners, by name."""


def model_of(robot: Robot) -> stepper.Model:
    """Model of the robot, from dm_control."""
    kind, arguments = SUITE[robot.task]
    return kind(**arguments).model()


@dataclass(frozen=True)
class Plan:
    """Plan with its predicted states.

    Attributes:
        controls: Controls, (horizon, nu).
        qpos: Predicted configurations after each control, (horizon, nq).
        qvel: Predicted velocities after each control, (horizon, nv).
    """

    controls: Array
    qpos: Array
    qvel: Array


class Planner:
    """MPPI planner of one robot. Each plan starts from the previous one.

    Args:
        robot: Robot and planner parameters.
        model: Model of the robot.
        samples: Number of sampled control sequences per plan.
        seed: Seed of the samples.
        settings: Arguments of the planner's `Stepper` objects: options, precision, threads.
    """

    def __init__(self, robot: Robot, model: stepper.Model, *, samples: int = 128, seed: int = 0, **settings: Any):
        self._robot, self._random = robot, np.random.default_rng(seed)
        self._many = stepper.Stepper(model, samples, **settings)
        self._one = stepper.Stepper(model, 1, **settings)
        low, high = model.actuator_ctrlrange.T
        self._low, self._high = low, high
        self._controls = np.tile((low + high) / 2.0, (robot.horizon, 1))

    def plan(self, state: stepper.State) -> Plan:
        """Returns the plan from the state of one environment: the weighted mean of the sampled control sequences."""
        robot, model = self._robot, self._many.model
        # The previous plan, shifted by one control; its last control is repeated.
        self._controls = np.vstack([self._controls[1:], self._controls[-1:]])
        noise = self._random.normal(size=(robot.horizon, self._many.num_envs or 1, model.nu))
        noise[:, 0] = 0.0
        # Noise correlated in time: a robot hardly follows white noise.
        for k in range(1, robot.horizon):
            noise[k] = 0.7 * noise[k - 1] + 0.7 * noise[k]
        tried = np.clip(self._controls[:, None] + robot.noise * (self._high - self._low) / 2.0 * noise, self._low, self._high)
        found = self._many.rollout(tried, robot.nstep, initial=state, fields=["qpos", "qvel"])
        returns = robot.reward(found["qpos"], found["qvel"]).mean(axis=0)
        returns = np.where(found["residual"].max(axis=0) < np.inf, returns, -np.inf)
        weights = np.exp((returns - returns.max()) / (robot.temperature * np.std(returns) + 1e-9))
        self._controls = np.einsum("n,tnu->tu", weights / weights.sum(), tried)
        # The mean is none of the sampled sequences, so its states need another rollout.
        alone = self._one.rollout(self._controls[:, None], robot.nstep, initial=state, fields=["qpos", "qvel"])
        return Plan(self._controls, alone["qpos"][:, 0], alone["qvel"][:, 0])


@dataclass(frozen=True)
class Outcome:
    """Result of a run.

    Attributes:
        reward: Mean reward of the plant.
        distance: Distance travelled in x, m.
        promised: Number of predicted states: after the first control of each plan, and after all later controls of the last plan.
        kept: Number of predictions that agree with the plant in all bits of qpos and qvel.
        planning: Mean time of a plan, s.
    """

    reward: float
    distance: float
    promised: int
    kept: int
    planning: float


def run(name: str, *, seconds: float = 4.0, samples: int = 128, seed: int = 0, **settings: Any) -> Outcome:
    """Control a robot, and compare its states with the predictions of the plans.

    Args:
        name: Name in `ROBOTS`.
        seconds: Simulated time, s.
        samples: Number of sampled control sequences per plan.
        seed: Seed of the samples.
        settings: Arguments of `Stepper` for plant and planner: options, precision. `threads` is for the planner alone.
    """
    robot = ROBOTS[name]
    model = model_of(robot)
    planner = Planner(robot, model, samples=samples, seed=seed, **settings)
    plant = stepper.Stepper(model, 1, **{key: value for key, value in settings.items() if key != "threads"})
    qpos = np.array(model.qpos0)
    for coordinate, value in robot.start.items():
        qpos[coordinate] = value
    plant.reset(qpos=qpos)
    along = 1 if name == "walker" else 0
    begin, rewards, kept, spent = plant.qpos[0, along], [], 0, 0.0
    steps = round(seconds / (robot.nstep * plant.timestep))
    for _ in range(steps):
        since = time.perf_counter()
        plan = planner.plan(plant.get_state(0))
        spent += time.perf_counter() - since
        plant.step(plan.controls[0], robot.nstep)
        kept += int(_equals_prediction(plant, plan, 0))
        rewards.append(float(robot.reward(plant.qpos, plant.qvel)[0]))
    # The plant follows the last plan to its end, in open loop.
    distance = float(plant.qpos[0, along] - begin)
    for k in range(1, robot.horizon):
        plant.step(plan.controls[k], robot.nstep)
        kept += int(_equals_prediction(plant, plan, k))
    return Outcome(float(np.mean(rewards)), distance, steps + robot.horizon - 1, kept, spent / steps)


def _equals_prediction(plant: stepper.Stepper, plan: Plan, k: int) -> bool:
    """Whether the present state of the plant equals the prediction of a plan after its control `k`, bit for bit."""
    return np.array_equal(plant.qpos[0], plan.qpos[k]) and np.array_equal(plant.qvel[0], plan.qvel[k])


def main() -> None:
    """Control a robot with the planner, and print its reward, its distance and the number of exact predictions."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", nargs="?", default="walker", choices=ROBOTS)
    parser.add_argument("--seconds", type=float, default=4.0, help="simulated time, s [4]")
    parser.add_argument("--samples", type=int, default=128, help="number of sampled control sequences per plan [128]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--precision", choices=("f64", "f32"), default="f64")
    parser.add_argument("--contact", choices=("hard", "mujoco"), default="hard")
    parser.add_argument("--threads", type=int, default=1, help="number of threads of the planner; 0 uses all cores [1]")
    given = parser.parse_args()
    options = stepper.Options() if given.contact == "hard" else stepper.Options.from_model(model_of(ROBOTS[given.robot]))
    settings = {"precision": given.precision, "threads": given.threads, "options": options}
    found = run(given.robot, seconds=given.seconds, samples=given.samples, seed=given.seed, **settings)
    print(f"{given.robot}: {found.distance:.2f} m in {given.seconds:g} s, mean reward {found.reward:.2f}")
    print(f"{found.kept} of {found.promised} predictions were exact to the bit; {1e3 * found.planning:.0f} ms per plan")


if __name__ == "__main__":
    main()

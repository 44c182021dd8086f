"""Model-predictive path integral control (MPPI) of dm_control's walker and quadruped: plans whose predictions come true to the bit.

    python examples/mppi.py                       # the walker walks for four seconds
    python examples/mppi.py quadruped --seconds 2

Every 25 or 40 ms a planner takes over the plant's state, tries many sequences of controls side by side, and holds the mean of the good ones
(Williams et al. 2017, https://arxiv.org/abs/1707.02342). Where it says the plan leads is where the plant goes: states are everything that
survives a step, and environments have the same bits alone, in a batch, and on any number of threads. The example counts that.
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
    """What is planned for.

    Attributes:
        task: Of dm_control's suite, whose model it is.
        nstep: Steps that each control is held.
        horizon: Controls of a plan.
        noise: Standard deviation of what is tried beside a plan, of the controls' half range.
        temperature: Spread of the returns over which plans are averaged, of the standard deviation of their returns.
        reward: Of configurations and velocities (T, num_envs, ...), (T, num_envs).
        start: Where it begins, a change of the reference configuration.
    """

    task: str
    nstep: int
    horizon: int
    noise: float
    temperature: float
    reward: Callable[[Array, Array], Array]
    start: dict[int, float]


def _walker(qpos: Array, qvel: Array) -> Array:
    """High, upright, at 1 m/s: height of the torso, its pitch and its speed are the first coordinates."""
    high = np.clip((qpos[..., 0] + 1.3) / 1.2, 0.0, 1.0)
    speed: Array = np.clip(1.0 - np.abs(qvel[..., 1] - 1.0), -1.0, 1.0)
    reward: Array = 3.0 * high + np.cos(qpos[..., 2]) + 2.0 * speed
    return reward


def _quadruped(qpos: Array, qvel: Array) -> Array:
    """Upright, at 0.5 m/s along x."""
    upright = 1.0 - 2.0 * np.square(qpos[..., 4:6]).sum(axis=-1)
    speed: Array = np.clip(1.0 - 2.0 * np.abs(qvel[..., 0] - 0.5), -1.0, 1.0)
    reward: Array = 2.0 * upright + speed - 0.2 * np.square(qvel[..., 1]) - 0.05 * np.square(qvel[..., 5])
    return reward


ROBOTS = {
    "walker": Robot("walker-walk", nstep=10, horizon=20, noise=0.5, temperature=0.2, reward=_walker, start={}),
    "quadruped": Robot("quadruped-walk", nstep=8, horizon=15, noise=0.4, temperature=0.2, reward=_quadruped, start={2: 0.57}),
}
"""Robots by name."""


def model_of(robot: Robot) -> stepper.Model:
    """The robot's model, of dm_control's file."""
    kind, arguments = SUITE[robot.task]
    return kind(**arguments).model()


@dataclass(frozen=True)
class Plan:
    """What a planner says.

    Attributes:
        controls: (horizon, nu).
        qpos: Where it leads after every control, (horizon, nq).
        qvel: And how fast, (horizon, nv).
    """

    controls: Array
    qpos: Array
    qvel: Array


class Planner:
    """Plans of one robot, each from the last one's.

    Args:
        robot: The robot.
        model: Its model.
        samples: Sequences that are tried side by side.
        seed: Of what is tried.
        settings: Of both steppers: options, precision, threads.
    """

    def __init__(self, robot: Robot, model: stepper.Model, *, samples: int = 128, seed: int = 0, **settings: Any):
        self._robot, self._random = robot, np.random.default_rng(seed)
        self._many = stepper.Stepper(model, samples, **settings)
        self._one = stepper.Stepper(model, 1, **settings)
        low, high = model.actuator_ctrlrange.T
        self._low, self._high = low, high
        self._controls = np.tile((low + high) / 2.0, (robot.horizon, 1))

    def plan(self, state: stepper.State) -> Plan:
        """The best mean of sequences from a state of one environment."""
        robot, model = self._robot, self._many.model
        # What was planned goes on where it had come to; its end is held.
        self._controls = np.vstack([self._controls[1:], self._controls[-1:]])
        noise = self._random.normal(size=(robot.horizon, self._many.num_envs or 1, model.nu))
        noise[:, 0] = 0.0
        # Neighbours in time are alike, as a robot does not follow what trembles.
        for k in range(1, robot.horizon):
            noise[k] = 0.7 * noise[k - 1] + 0.7 * noise[k]
        tried = np.clip(self._controls[:, None] + robot.noise * (self._high - self._low) / 2.0 * noise, self._low, self._high)
        found = self._many.rollout(tried, robot.nstep, initial=state, fields=["qpos", "qvel"])
        returns = robot.reward(found["qpos"], found["qvel"]).mean(axis=0)
        returns = np.where(found["residual"].max(axis=0) < np.inf, returns, -np.inf)
        weights = np.exp((returns - returns.max()) / (robot.temperature * np.std(returns) + 1e-9))
        self._controls = np.einsum("n,tnu->tu", weights / weights.sum(), tried)
        # A mean of sequences is none that was tried: where it leads is asked for.
        alone = self._one.rollout(self._controls[:, None], robot.nstep, initial=state, fields=["qpos", "qvel"])
        return Plan(self._controls, alone["qpos"][:, 0], alone["qvel"][:, 0])


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes:
        reward: Mean reward of the plant.
        distance: How far it came in x, m.
        promised: Predictions that were made: of the state after the first control of every plan, and after each of the last plan's.
        kept: Those that came true, all bits of qpos and qvel alike.
        planning: Mean time of a plan, s.
    """

    reward: float
    distance: float
    promised: int
    kept: int
    planning: float


def run(name: str, *, seconds: float = 4.0, samples: int = 128, seed: int = 0, **settings: Any) -> Outcome:
    """Controls a robot, and looks whether it does what plans say.

    Args:
        name: One of `ROBOTS`.
        seconds: Simulated time.
        samples: Sequences that are tried side by side.
        seed: Of what is tried.
        settings: Of plant and planner: options, precision; and the planner's threads.
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
        kept += int(_is(plant, plan, 0))
        rewards.append(float(robot.reward(plant.qpos, plant.qvel)[0]))
    # The last plan is carried out to its end, with nobody who corrects it.
    distance = float(plant.qpos[0, along] - begin)
    for k in range(1, robot.horizon):
        plant.step(plan.controls[k], robot.nstep)
        kept += int(_is(plant, plan, k))
    return Outcome(float(np.mean(rewards)), distance, steps + robot.horizon - 1, kept, spent / steps)


def _is(plant: stepper.Stepper, plan: Plan, k: int) -> bool:
    """Whether the plant is where a plan said that control `k` leads."""
    return np.array_equal(plant.qpos[0], plan.qpos[k]) and np.array_equal(plant.qvel[0], plan.qvel[k])


def main() -> None:
    """Controls a robot and prints what became of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", nargs="?", default="walker", choices=ROBOTS)
    parser.add_argument("--seconds", type=float, default=4.0, help="simulated time [4]")
    parser.add_argument("--samples", type=int, default=128, help="sequences of controls that are tried side by side [128]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--precision", choices=("f64", "f32"), default="f64")
    parser.add_argument("--contact", choices=("hard", "mujoco"), default="hard")
    parser.add_argument("--threads", type=int, default=1, help="of the planner; 0 is all [1]")
    given = parser.parse_args()
    options = stepper.Options() if given.contact == "hard" else stepper.Options.from_model(model_of(ROBOTS[given.robot]))
    settings = {"precision": given.precision, "threads": given.threads, "options": options}
    found = run(given.robot, seconds=given.seconds, samples=given.samples, seed=given.seed, **settings)
    print(f"{given.robot}: {found.distance:.2f} m in {given.seconds:g} s, mean reward {found.reward:.2f}")
    print(f"{found.kept} of {found.promised} predictions came true to the bit; {1e3 * found.planning:.0f} ms a plan")


if __name__ == "__main__":
    main()

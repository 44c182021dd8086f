"""Trains the quadruped Go1 to climb stairs, beginning with a policy that walks on plain ground.

    python examples/train_stairs.py --out out/train/stairs
    python benches/climbing.py out/train/stairs/stage3/policy.npz

The script has three stages:

1. The new policy imitates the policy of `stepper/Go1Velocity-v0`, which walks on plain ground, in the states that the two policies reach
   (DAgger: Ross et al. 2011, https://arxiv.org/abs/1011.0686). The critic is then trained alone.
2. PPO on stairs that become higher as the robot climbs them. Most commands are to walk straight ahead, without noise and pushes.
3. PPO on the same stairs with the noise and pushes of `stepper/Go1Rough-v0`, and with more of its commands.

The same command continues a stopped run in stage 2 or 3. The stages take about 3, 30 and 15 minutes on two free cores, and up to 6 GB of
memory. The script needs the extras `train` and `mjcf`, and `pip install --no-deps mjlab`, whose model of the robot it reads.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
import torch
from stepper.envs import Rng
from stepper.envs.commands import VelocityCommand
from stepper.envs.locomotion import Go1Rough
from stepper.envs.quantities import base_angvel, base_linvel, gravity, joint_pos, joint_vel
from stepper.envs.task import Array, TaskView
from stepper.envs.terrain import Flat, PyramidSlope, PyramidStairs, RandomRough, Terrain
from stepper.policies import Policy, load
from stepper.policies.ppo import Run, train
from stepper.policies.ppo_settings import Settings

TEACHER = Path(__file__).parent / "policies/go1_velocity.npz"
WEIGHTS: Mapping[str, float] = {
    "track_linear_velocity": 5.0,
    "track_angular_velocity": 0.75,
    "air_time": 0.3,
    "action_rate": -0.01,
    "foot_clearance": -0.3,
    "foot_swing_height": -0.05,
    "pose": 0.3,
}
"""Weights of the reward. Those of mjlab reward the pose more and the commanded velocity less: the robot would rather stand."""
STAIRS = Terrain(
    sub_terrains={
        "flat": Flat(proportion=0.05),
        "stairs": PyramidStairs(proportion=0.25),
        "stairs_inv": PyramidStairs(proportion=0.5, inverted=True),
        "slope_inv": PyramidSlope(proportion=0.1, slope_range=(0.0, 0.7), inverted=True),
        "rough": RandomRough(proportion=0.1, height_range=(0.02, 0.1)),
    },
    num_rows=20,
    border_width=4.0,
)
"""Terrain of the training. From row to row, the steps of its stairs are about 1 cm higher, up to 0.2 m."""
SPEEDS = (0.5, 1.0)
"""Lowest and highest commanded velocity straight ahead, m/s."""
EDGE = 4.3
"""Distance from the middle of a tile in x or y, m, at which an episode ends. A tile ends at 4 m; the robot is then half a length beyond."""

NOISE = 0.12
"""Standard deviation of the actions in the imitation and at the beginning of PPO, as a fraction of the largest action."""
CRITIC_UPDATES = 25
"""Number of updates that train the critic alone."""
PASSES, MINIBATCH = 4, 4096
"""Number of passes over the teacher's actions after each round of the imitation, and number of actions per gradient step."""


@dataclass(frozen=True, kw_only=True)
class StraightCommand(VelocityCommand):
    """Velocity that is kept for the whole episode: straight ahead at a heading in most episodes, and as in `Go1Rough` in the others.

    Attributes:
        straight: Fraction of the episodes with a command straight ahead.
    """

    every: tuple[float, float] | None = None
    straight: float = 0.85

    def draw(self, rng: Rng, steps: Array) -> Array:
        """Numbers of commands, (n, 5), as in `VelocityCommand`."""
        drawn, numbers = super().draw(rng, steps), rng.uniform(0.0, 1.0, 3)
        straight = numbers[:, 0] < self.straight
        low, high = SPEEDS
        drawn[straight, 0] = (low + (high - low) * numbers[:, 1])[straight]
        drawn[straight, 1:3] = 0.0
        drawn[straight, 3] = np.pi * (2.0 * numbers[straight, 2] - 1.0)
        return drawn


@dataclass(frozen=True, kw_only=True)
class Go1Stairs(Go1Rough):
    """`Go1Rough` on `STAIRS`, with commands straight ahead in most episodes. An episode is truncated at the edge of its tile.

    Attributes:
        terrain: Terrain of all environments.
        episode_seconds: Time limit of an episode, s.
        straight: Fraction of the episodes with a command straight ahead. The others have commands as in `Go1Rough`.
    """

    terrain: Terrain | None = STAIRS
    episode_seconds: float = 12.0
    straight: float = 0.85

    @property
    def commands(self) -> Mapping[str, VelocityCommand]:
        """The command "twist", which is kept for the whole episode."""
        ranges = {name: getattr(self.twist, name) for name in ("x", "y", "yaw", "standing", "turning", "forward")}
        return {"twist": StraightCommand(straight=self.straight, **ranges)}

    def truncated(self, now: TaskView) -> Array:
        """Whether the robot has left its tile, (num_envs,)."""
        away = now.qpos[:, :2] - now.episode_state["terrain_origin"][:, :2]
        return np.asarray(super().truncated(now) | (np.abs(away).max(axis=1) > EDGE))


ENVIRONMENT = "stepper/Go1Stairs-v0"
"""Id of the environment of the task on stairs."""
if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(
        ENVIRONMENT,
        entry_point="stepper.envs:StepperEnv",
        vector_entry_point="stepper.envs:StepperVectorEnv",
        max_episode_steps=600,
        kwargs={"task": Go1Stairs},
    )


def teacher_actions(teacher: Policy, now: TaskView) -> Array:
    """Actions of the task on stairs, (num_envs, nu), that the policy of `Go1Velocity` chooses in the states of all environments (`now`).

    The function builds the observations of `Go1Velocity`. Both tasks have the same actions, within other bounds.
    """
    parts = (base_linvel(now), base_angvel(now), gravity(now), joint_pos(now), joint_vel(now), now.action, now.command())
    actions: Array = teacher(np.hstack(parts))
    return actions


def imitate(run: Run, teacher: Policy, *, rounds: int, steps: int) -> None:
    """Stage 1: trains the actor of a run to act like the teacher.

    In the first round the teacher acts. In each later round it acts half as often as in the round before, and otherwise the actor does.
    The teacher also gives its action for states in which the actor acts. After every round, the actor learns all these actions so far.

    Args:
        run: Run, whose actor and observation moments change.
        teacher: Policy of `Go1Velocity`.
        rounds: Number of rounds.
        steps: Number of actions per round, in each environment.
    """
    batch, rng = run.envs.unwrapped, np.random.default_rng(run.settings.seed)
    optimizer = torch.optim.Adam(run.net.actor.parameters(), lr=1e-3)
    seen, shown = [], []
    for k in range(rounds):
        error = 0.0
        for _ in range(steps):
            wanted = teacher_actions(teacher, batch.now) / run.half
            with torch.no_grad():
                own = run.net.actor(run.normal(run.observation["policy"])).numpy()
            seen.append(run.observation["policy"].astype(np.float32))
            shown.append(wanted.astype(np.float32))
            teacher_acts = rng.random((len(own), 1)) < 0.5**k
            action = np.where(teacher_acts, wanted, own) + NOISE * rng.standard_normal(own.shape)
            observation, *_, info = run.envs.step(run.half * np.clip(action, -1.0, 1.0))
            run.observation = run.groups(observation)
            error += info["tracking_error"].mean() / steps
        if k == 0:
            run.observed["policy"].update(np.concatenate(seen))
        states, actions = run.normal(np.concatenate(seen)), torch.from_numpy(np.concatenate(shown))
        for _ in range(PASSES):
            for part in torch.randperm(len(states)).split(MINIBATCH):
                loss = (run.net.actor(states[part]) - actions[part]).square().mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
        rms = float(loss.detach()) ** 0.5
        print(f"imitation {k + 1} of {rounds}: velocity error {error:.3f} m/s, rms error of actions {rms:.3f} of the largest", flush=True)


def train_critic(run: Run, updates: int) -> None:
    """Trains the critic of a run, while the weights of the actor stay. PPO with an untrained critic would spoil the actor.

    The running moments of the observations are updated, so that the actions change a little.
    """
    frozen = [*run.net.actor.parameters(), run.net.log_std]
    for parameter in frozen:
        parameter.requires_grad_(False)
    for _ in range(updates):
        run.update(run.collect())
        for group in run.optimizer.param_groups:  # The update adapts the learning rate to changes of the actor.
            group["lr"] = run.settings.learning_rate
    for parameter in frozen:
        parameter.requires_grad_(True)


def settings(seed: int, steps: Sequence[int]) -> tuple[Settings, Settings]:
    """Settings of stages 2 and 3, with this seed and these numbers of steps."""
    task = Settings.of_task("stepper/Go1Rough-v0", seed=seed, hidden=(128, 128), entropy=0.002, learning_rate=3e-4, initial_std=NOISE)
    stairs = dataclasses.replace(task, env=ENVIRONMENT)
    plain, noisy = {"noise": 0.0, "push": 0.0}, {"straight": 0.6, "max_init_level": STAIRS.num_rows - 1}
    second, third = (
        dataclasses.replace(stairs, steps=count, values={"rewards": dict(WEIGHTS), **values})
        for count, values in zip(steps, (plain, noisy), strict=True)
    )
    return second, third


def main() -> None:
    """Runs the stages of which the folder has no checkpoint yet, or continues the last one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/train/stairs"), help="folder for stage2/ and stage3/ [out/train/stairs]")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers [1]")
    text = "numbers of environment steps of stages 2 and 3, including those that train the critic [20000000 10000000]"
    parser.add_argument("--steps", type=int, nargs=2, default=(20_000_000, 10_000_000), metavar="N", help=text)
    given = parser.parse_args()
    second, third = settings(given.seed, given.steps)
    folders = given.out / "stage2", given.out / "stage3"
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(second.threads)
    if not (folders[0] / "checkpoint.pt").exists():
        run = Run(second)
        imitate(run, load(TEACHER), rounds=6, steps=100)
        print("training the critic", flush=True)
        train_critic(run, updates=CRITIC_UPDATES)
        run.save(folders[0] / "checkpoint.pt")
    climber = train(second, folders[0])
    if not (folders[1] / "checkpoint.pt").exists():
        run = Run(third)
        run.net.load_state_dict(climber.net.state_dict())
        run.observed, run.returned = climber.observed, climber.returned
        run.save(folders[1] / "checkpoint.pt")
    train(third, folders[1])


if __name__ == "__main__":
    main()

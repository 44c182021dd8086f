"""Gymnasium's MuJoCo tasks, version 5, by their registered names."""

from stepper.envs.task import Task
from stepper.envs.tasks.arms import Pusher, Reacher
from stepper.envs.tasks.humanoid import Humanoid, HumanoidStandup
from stepper.envs.tasks.pendulums import InvertedDoublePendulum, InvertedPendulum
from stepper.envs.tasks.running import Ant, HalfCheetah, Hopper, Swimmer, Walker2d

TASKS: dict[str, type[Task]] = {
    task.__name__: task
    for task in (
        *(Ant, HalfCheetah, Hopper, Humanoid, HumanoidStandup, InvertedDoublePendulum, InvertedPendulum, Pusher, Reacher, Swimmer),
        Walker2d,
    )
}
"""Gymnasium's MuJoCo tasks: class by name, such as "HalfCheetah"."""

__all__ = [
    "TASKS",
    "Ant",
    "HalfCheetah",
    "Hopper",
    "Humanoid",
    "HumanoidStandup",
    "InvertedDoublePendulum",
    "InvertedPendulum",
    "Pusher",
    "Reacher",
    "Swimmer",
    "Walker2d",
]

"""Gymnasium's MuJoCo tasks, version 5, one file each, by their registered names."""

from stepper.envs.task import Task
from stepper.envs.tasks.ant import Ant
from stepper.envs.tasks.half_cheetah import HalfCheetah
from stepper.envs.tasks.hopper import Hopper
from stepper.envs.tasks.humanoid import Humanoid
from stepper.envs.tasks.humanoid_standup import HumanoidStandup
from stepper.envs.tasks.inverted_double_pendulum import InvertedDoublePendulum
from stepper.envs.tasks.inverted_pendulum import InvertedPendulum
from stepper.envs.tasks.pusher import Pusher
from stepper.envs.tasks.reacher import Reacher
from stepper.envs.tasks.swimmer import Swimmer
from stepper.envs.tasks.walker2d import Walker2d

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

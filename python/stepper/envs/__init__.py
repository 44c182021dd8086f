"""Gymnasium environments, single and vectorised. Importing this package registers their ids, such as "stepper/HalfCheetah-v5".

    import gymnasium
    import stepper.envs

    envs = gymnasium.make_vec("stepper/HalfCheetah-v5", num_envs=1024)

docs/reference/environments.md lists the tasks, and shows how to write one. The package needs Gymnasium; `import stepper` does not.
"""

from stepper.shared.machine import require

require("gymnasium", "for stepper.envs")

from stepper.envs import commands, quantities, terrain  # noqa: E402
from stepper.envs.actions import Servo  # noqa: E402
from stepper.envs.contacts import contact_forces  # noqa: E402
from stepper.envs.events import at_reset, at_start, every, push  # noqa: E402
from stepper.envs.observations import Group, Observation  # noqa: E402
from stepper.envs.registration import register_tasks  # noqa: E402
from stepper.envs.rewards import Reward  # noqa: E402
from stepper.envs.single import StepperEnv  # noqa: E402
from stepper.envs.task import MujocoTask, Reset, Task, TaskView, all_within, square_sum, within  # noqa: E402
from stepper.envs.tasks import TASKS  # noqa: E402
from stepper.envs.vector import StepperVectorEnv  # noqa: E402
from stepper.shared.draws import add, log_uniform, normal, scale, uniform  # noqa: E402
from stepper.shared.streams import Rng, seeds  # noqa: E402
from stepper.shared.view import BatchView, per_moment  # noqa: E402

__all__ = [
    "TASKS",
    "BatchView",
    "Group",
    "MujocoTask",
    "Observation",
    "Reset",
    "Reward",
    "Rng",
    "Servo",
    "StepperEnv",
    "StepperVectorEnv",
    "Task",
    "TaskView",
    "add",
    "all_within",
    "at_reset",
    "at_start",
    "commands",
    "contact_forces",
    "every",
    "log_uniform",
    "normal",
    "per_moment",
    "push",
    "quantities",
    "scale",
    "seeds",
    "square_sum",
    "terrain",
    "uniform",
    "within",
]

register_tasks()

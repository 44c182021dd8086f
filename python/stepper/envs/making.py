"""Conversion of the arguments `task` and `autoreset_mode` of environments to a `Task` and an `AutoresetMode`."""

from __future__ import annotations

import inspect
import re
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode

from stepper._hints import WrongArgumentError, did_you_mean_or_all, replacements, unknown_keyword
from stepper.envs.members import no_dataclass, signatures
from stepper.envs.task import Task
from stepper.envs.tasks import TASKS
from stepper.shared.functions import in_words

SETTINGS = (
    *("contact", "options", "precision", "dtype", "max_episode_steps", "rewards", "groups"),
    *("render_mode", "width", "height", "camera_id", "camera_name", "default_camera_config"),
)
"""Arguments of single and vector environments that belong to the environment, not to the task."""
VECTOR_SETTINGS = ("num_envs", "autoreset_mode", "threads", "episode_statistics", "model")
"""Arguments that only vector environments have."""


def make_task(task: Task | type[Task] | str, arguments: dict[str, Any], *, vector: bool) -> Task:
    """Task from the arguments of an environment. If `task` is a class or a name, the function calls the class with `arguments`.

    Args:
        task: Task, class of tasks, or name in `stepper.envs.TASKS`.
        arguments: Arguments of the task's constructor; must be empty if `task` is a task.
        vector: Whether the task is for a vector environment; it selects the arguments that error messages list.
    """
    if isinstance(task, Task):
        known = inspect.signature(type(task)).parameters
        for name in arguments:
            if name not in known:
                raise TypeError(_unknown(type(task), name, [], vector=vector))
        if arguments:
            call = f"{type(task).__name__}({', '.join(f'{name}=...' for name in arguments)})"
            raise TypeError(f"{type(task).__name__} exists already: give {sorted(arguments)} to its constructor, as {call}")
        return task
    if not isinstance(task, str) and not (isinstance(task, type) and issubclass(task, Task)):
        raise TypeError(f"the task is {in_words(task)}, must be a stepper.envs.Task, the class of one, or the name of one")
    if isinstance(task, str) and task not in TASKS:
        raise ValueError(f"there is no task {task!r}{_near_task(task)}; or give a stepper.envs.Task")
    kind = TASKS[task] if isinstance(task, str) else task
    known = inspect.signature(kind).parameters
    if not any(p.kind == inspect.Parameter.VAR_KEYWORD for p in known.values()):
        for name in arguments:
            if name not in known:
                raise WrongArgumentError(_unknown(kind, name, [*known], vector=vector))
    for name, value in arguments.items():
        default = known[name].default if name in known else None
        if isinstance(value, str) and isinstance(default, int | float):
            wanted = "True or False" if isinstance(default, bool) else "a number"
            raise ValueError(f"{name} of {kind.__name__} is {value!r}, must be {wanted}, as the default {default}")
    return kind(**arguments)


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """Gymnasium's `AutoresetMode` from the argument `mode`: an `AutoresetMode`, or its name or value as text, in upper or lower case."""
    text = (mode.name if isinstance(mode, AutoresetMode) else str(mode)).lower()
    found = next((each for each in AutoresetMode if text in (each.name.lower(), each.value.lower())), None)
    if found is None:
        raise ValueError(f"autoreset_mode is {mode!r}, must be {', '.join(repr(each.name) for each in AutoresetMode)}, or a member of "
                         "gymnasium.vector.AutoresetMode")  # fmt: skip
    return found


def _unknown(kind: type[Task], name: str, task_arguments: list[str], *, vector: bool) -> str:
    """Error message for an argument that neither an environment nor its task has."""
    call = "StepperVectorEnv" if vector else "StepperEnv"
    if remedy := no_dataclass(kind, name):
        return f"{call}() takes no {name!r}{remedy}"
    method = replacements("Task").get(name) or next((each for each in signatures(Task) if each.startswith(f"{name}(")), "")
    if method and name not in (*SETTINGS, *VECTOR_SETTINGS):
        return f"{call}() takes no {name!r}: write a subclass of {kind.__name__} with a method {method}, and give that as the task"
    return unknown_keyword(call, name, [*SETTINGS, *task_arguments, *(VECTOR_SETTINGS if vector else ())])


def _near_task(name: str) -> str:
    """Hint for an unknown name of a task: similar names, the call that makes Gymnasium's environment of this name, or what takes a file."""
    if (short := re.sub(r"-v\d+$", "", name)) in TASKS:
        return f"; did you mean {short!r}?"
    if name.endswith((".xml", ".urdf", ".mjcf")):
        return f": write a subclass of stepper.envs.Task, whose method model(self) returns stepper.load({name!r})"
    if name in gymnasium.registry:
        return f"; {name!r} is a name of Gymnasium: gymnasium.make_vec({name!r}, num_envs=...) makes its environments"
    return did_you_mean_or_all(name, sorted(TASKS))

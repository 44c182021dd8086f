"""Conversion of the arguments `task` and `autoreset_mode` of environments to a `Task` and an `AutoresetMode`."""

from __future__ import annotations

import inspect
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv

from stepper._hints import WrongArgumentError, did_you_mean_or_all, unknown_keyword
from stepper._other_names import NEW_KEYWORDS
from stepper.envs.task import Task
from stepper.envs.tasks import TASKS

SETTINGS = (
    *("contact", "options", "precision", "dtype", "max_episode_steps"),
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

    Raises:
        TypeError: `task` has another type, its constructor does not have one of the arguments, or arguments are given with a task.
        ValueError: The name is unknown, or the value of a number or bool is a text.
    """
    if isinstance(task, Task):
        if not vector and (of_vectors := [name for name in arguments if name in VECTOR_SETTINGS]):
            raise TypeError(_unknown(type(task), of_vectors[0], [], vector=vector))
        if arguments:
            raise TypeError(f"{type(task).__name__} exists already: give {sorted(arguments)} to its constructor, not to the environment")
        return task
    if not isinstance(task, str) and not (isinstance(task, type) and issubclass(task, Task)):
        raise TypeError(f"the task is {_in_words(task)}, must be a stepper.envs.Task, the class of one, or the name of one{_remedy(task)}")
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
    """Gymnasium's `AutoresetMode` from the argument `mode`: an `AutoresetMode`, or its name or value as text, in upper or lower case.

    Raises:
        ValueError: The mode is unknown.
    """
    text = (mode.name if isinstance(mode, AutoresetMode) else str(mode)).lower()
    found = next((each for each in AutoresetMode if text in (each.name.lower(), each.value.lower())), None)
    if found is None:
        raise ValueError(f"autoreset_mode is {mode!r}, must be {', '.join(repr(each.name) for each in AutoresetMode)}, or a member of "
                         "gymnasium.vector.AutoresetMode")  # fmt: skip
    return found


def _unknown(kind: type[Task], name: str, of_task: list[str], *, vector: bool) -> str:
    """Error message for an argument that neither an environment nor its task has.

    Args:
        kind: Class of the task.
        name: The unknown argument.
        of_task: Names of the arguments of the task's constructor.
        vector: Whether the environment is a vector environment.
    """
    call = f"an environment of {kind.__name__}"
    if name == "seed":
        return f"{call}() takes no 'seed': give it to reset(seed=...), which begins episodes under it"
    if name == "env_kwargs":
        return f"{call}() takes no 'env_kwargs': give its arguments themselves, as contact=\"hard\""
    if vector:
        return unknown_keyword(call, name, [*VECTOR_SETTINGS, *SETTINGS, *of_task])
    if name in VECTOR_SETTINGS:
        remedy = "make them with gymnasium.make_vec, without vectorization_mode"
        return f"{call}() takes no {name!r}, an argument of vector environments: {remedy}"
    if (present := NEW_KEYWORDS.get(name)) in VECTOR_SETTINGS:
        return f"{call}() takes no {name!r}: use {present} of gymnasium.make_vec, an argument of vector environments"
    return unknown_keyword(call, name, [*SETTINGS, *of_task])


def _in_words(value: Any) -> str:
    """Description, for an error message, of a value that the user gave as a task although it is no task."""
    if value is None or isinstance(value, bool | int | float | list | tuple | dict):
        return f"{value!r} ({type(value).__name__})"
    if isinstance(value, type):
        return f"the class {value.__module__}.{value.__qualname__}"
    return f"an object of type {type(value).__module__}.{type(value).__qualname__}"


def _remedy(value: Any) -> str:
    """Advice at the end of an error message, if the user gave an environment or a function as a task; "" for other values."""
    if isinstance(value, gymnasium.Env | VectorEnv):
        name = value.spec.id if value.spec is not None else None
        return f": give the name of the environment{f', {name!r}' if name else ''} and num_envs, which make a batch of it"
    if (callable(value) and not isinstance(value, type)) or (isinstance(value, list | tuple) and value and callable(value[0])):
        return ": give the name or the task that the function makes, and num_envs, which make a batch of it"
    return ""


def _near_task(name: str) -> str:
    """Hint for an unknown name of a task: similar names, or the call that makes Gymnasium's environment of this name."""
    if name in gymnasium.registry:
        return f"; {name!r} is a name of Gymnasium: gymnasium.make_vec({name!r}, num_envs=...) makes its environments"
    return did_you_mean_or_all(name, sorted(TASKS))

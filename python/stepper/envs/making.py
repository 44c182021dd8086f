"""Conversion of the arguments `task` and `autoreset_mode` of environments to a `Task` and an `AutoresetMode`."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from gymnasium.vector import AutoresetMode

from stepper._hints import WrongArgumentError, did_you_mean_or_all, unknown_keyword
from stepper.envs.task import Task
from stepper.envs.tasks import TASKS
from stepper.shared.arguments import in_words


def make_task(task: Task | type[Task] | str, arguments: Mapping[str, Any], environment: type) -> Task:
    """Task from the arguments of an environment. If `task` is a class or a name, the function calls the class with `arguments`.

    Args:
        task: Task, class of tasks, or name in `stepper.envs.TASKS`.
        arguments: Arguments of the task's constructor; must be empty if `task` is a task.
        environment: Class of the environment, whose arguments error messages list too.
    """
    if not isinstance(task, Task | str) and not (isinstance(task, type) and issubclass(task, Task)):
        raise TypeError(f"the task is {in_words(task)}, must be a stepper.envs.Task, the class of one, or the name of one")
    if isinstance(task, str) and task not in TASKS:
        raise ValueError(f"there is no task {task!r}{did_you_mean_or_all(task, sorted(TASKS))}; or give a stepper.envs.Task")
    kind = TASKS[task] if isinstance(task, str) else task if isinstance(task, type) else type(task)
    known = inspect.signature(kind).parameters
    if not any(parameter.kind == inspect.Parameter.VAR_KEYWORD for parameter in known.values()):
        for name in arguments:
            if name not in known:
                settings = [name for name in inspect.signature(environment).parameters if name not in ("task", "arguments")]
                raise WrongArgumentError(unknown_keyword(environment.__name__, name, [*settings, *known]))
    for name, value in arguments.items():
        default = known[name].default if name in known else None
        if isinstance(value, str) and isinstance(default, int | float):
            wanted = "True or False" if isinstance(default, bool) else "a number"
            raise ValueError(f"{name} of {kind.__name__} is {value!r}, must be {wanted}, as the default {default}")
    if not isinstance(task, Task):
        return kind(**arguments)
    if arguments:
        call = f"{kind.__name__}({', '.join(f'{name}=...' for name in arguments)})"
        raise TypeError(f"{kind.__name__} exists already: give {sorted(arguments)} to its constructor, as {call}")
    return task


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """Gymnasium's `AutoresetMode` from the argument `mode`: an `AutoresetMode`, or its name or value as text, in upper or lower case."""
    text = (mode.name if isinstance(mode, AutoresetMode) else str(mode)).lower()
    found = next((each for each in AutoresetMode if text in (each.name.lower(), each.value.lower())), None)
    if found is None:
        raise ValueError(f"autoreset_mode is {mode!r}, must be {', '.join(repr(each.name) for each in AutoresetMode)}, or a member of "
                         "gymnasium.vector.AutoresetMode")  # fmt: skip
    return found

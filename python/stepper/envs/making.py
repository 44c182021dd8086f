"""Conversion of the arguments `task` and `autoreset_mode` of environments to a `Task` and an `AutoresetMode`."""

from __future__ import annotations

import inspect
import re
from pathlib import PurePath
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv

from stepper._hints import WrongArgumentError, did_you_mean_or_all, unknown_keyword
from stepper._other_names import IGNORED_BY_ENVIRONMENTS, NEW_KEYWORDS, RENAMED
from stepper._stepper import Model, Stepper
from stepper.envs.members import no_dataclass
from stepper.envs.task import Task
from stepper.envs.tasks import TASKS

SETTINGS = (
    *("contact", "options", "precision", "dtype", "max_episode_steps", "rewards", "groups"),
    *("render_mode", "width", "height", "camera_id", "camera_name", "default_camera_config"),
)
"""Arguments of single and vector environments that belong to the environment, not to the task."""
VECTOR_SETTINGS = ("num_envs", "autoreset_mode", "threads", "episode_statistics", "model")
"""Arguments that only vector environments have."""

_FILES = ("xml_file", "xml", "xml_path", "model_path", "model_file", "model_xml", "mjcf", "urdf", "file", "path", "fullpath")
"""Arguments of other libraries that name the file of a model."""
_REMEDIES = {
    "seed": "give it to reset(seed=...), which begins episodes under it",
    "env_kwargs": 'give its arguments themselves, as contact="hard"',
    "device": "leave it out, environments run on the CPU",
    "wrappers": "wrap the environment that you get, with gymnasium.wrappers or gymnasium.wrappers.vector",
}
"""Remedies in error messages for arguments that environments do not take, by name."""
_FRAME_SKIPS = ("decimation", "action_repeat", "n_substeps", "nsubsteps", "n_frames", "n_sub_steps")
"""Names of other libraries for the argument `frame_skip` of a task."""


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
        known = inspect.signature(type(task)).parameters
        for name in arguments:
            if name not in known:
                raise TypeError(_unknown(type(task), name, [], vector=vector))
        if arguments:
            call = f"{type(task).__name__}({', '.join(f'{name}=...' for name in arguments)})"
            raise TypeError(f"{type(task).__name__} exists already: give {sorted(arguments)} to its constructor, as {call}")
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


def _unknown(kind: type[Task], name: str, task_arguments: list[str], *, vector: bool) -> str:
    """Error message for an argument that neither an environment nor its task has."""
    call = "StepperVectorEnv" if vector else "StepperEnv"
    if remedy := _remedy_of(kind, name, task_arguments) or no_dataclass(kind, name):
        return f"{call}() takes no {name!r}{remedy}"
    if vector:
        return unknown_keyword(call, name, [*VECTOR_SETTINGS, *SETTINGS, *task_arguments])
    if name in VECTOR_SETTINGS:
        remedy = "make them with gymnasium.make_vec, without vectorization_mode"
        return f"{call}() takes no {name!r}, an argument of vector environments: {remedy}"
    if (present := NEW_KEYWORDS.get(name)) in VECTOR_SETTINGS:
        return f"{call}() takes no {name!r}: use {present} of gymnasium.make_vec, an argument of vector environments"
    return unknown_keyword(call, name, [*SETTINGS, *task_arguments])


def _remedy_of(kind: type[Task], name: str, task_arguments: list[str]) -> str:
    """End of an error message for an argument that belongs elsewhere, such as into a method of the task; "" for other arguments."""
    settings = (*SETTINGS, *VECTOR_SETTINGS)
    if name in VECTOR_SETTINGS or NEW_KEYWORDS.get(name, "").partition("=")[0] in settings:
        return ""
    field = "xml_file" if name in _FILES else "frame_skip" if name in _FRAME_SKIPS else ""
    if remedy := _remedy_of_field(kind, field, task_arguments):
        return f": {remedy}"
    if name in _REMEDIES:
        return f": {_REMEDIES[name]}"
    method = "model" if name in _FILES else RENAMED["Task"].get(name, name)
    if inspect.isfunction(function := vars(Task).get(method)) and not method.startswith("_"):
        arguments = ", ".join(inspect.signature(function).parameters)
        return f": write a subclass of {kind.__name__} with a method {method}({arguments}), and give that as the task"
    advice = IGNORED_BY_ENVIRONMENTS.get(name)
    return f": {advice}" if advice else ""


def _remedy_of_field(kind: type[Task], field: str, task_arguments: list[str]) -> str:
    """Advice on how to set the field "xml_file" or "frame_skip" of a task; "" for other fields, and for a task without a file."""
    if field in task_arguments:
        return f"use {field}"
    if field in inspect.signature(kind).parameters:
        return f"give {field} to the constructor of the task, as {kind.__name__}({field}=...)"
    return f"set frame_skip in the class {kind.__name__}, or in a subclass" if field == "frame_skip" else ""


def _in_words(value: Any) -> str:
    """Description, for an error message, of a value that the user gave as a task although it is no task."""
    if value is None or isinstance(value, bool | int | float | list | tuple | dict):
        return f"{value!r} ({type(value).__name__})"
    if isinstance(value, type):
        return f"the class {value.__module__}.{value.__qualname__}"
    return f"an object of type {type(value).__module__}.{type(value).__qualname__}"


def _remedy(value: Any) -> str:
    """Advice at the end of an error message, if the user gave an environment, a function or a model as a task; "" for other values."""
    if isinstance(value, Model | Stepper):
        return ": a class of tasks defines the observations and rewards of a model, which its method model(self) returns"
    if isinstance(value, gymnasium.Env | VectorEnv):
        name = value.spec.id if value.spec is not None else None
        return f": give the name of the environment{f', {name!r}' if name else ''} and num_envs, which make a batch of it"
    if (callable(value) and not isinstance(value, type)) or (isinstance(value, list | tuple) and value and callable(value[0])):
        return ": give the name or the task that the function makes, and num_envs, which make a batch of it"
    return ""


def _near_task(name: str) -> str:
    """Hint for an unknown name of a task: similar names, the call that makes Gymnasium's environment of this name, or what takes a file."""
    if (short := re.sub(r"-v\d+$", "", name)) in TASKS:
        return f"; did you mean {short!r}?"
    if name.endswith((".xml", ".urdf", ".mjcf")):
        stem = PurePath(name).stem.replace("_", "")
        if own := next((task for task in TASKS if task.lower() == stem.lower()), None):
            return f": give the task and its file, as StepperEnv({own!r}, xml_file={name!r})"
        return f": write a subclass of stepper.envs.Task, whose method model(self) returns stepper.load({name!r})"
    if name in gymnasium.registry:
        return f"; {name!r} is a name of Gymnasium: gymnasium.make_vec({name!r}, num_envs=...) makes its environments"
    return did_you_mean_or_all(name, sorted(TASKS))

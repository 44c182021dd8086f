"""Errors for absent attributes of tasks, of `now` and of environments, with hints."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection
from typing import Any

from stepper._hints import did_you_mean, hint_of, no_attribute
from stepper._other_names import NEW_NAMES, RENAMED
from stepper._stepper import Stepper
from stepper.envs.hooks import IN_PLACE


def missing_from_task(task: object, name: str, names_of_moment: Collection[str]) -> AttributeError:
    """Error for an attribute that a task does not have, with a hint: the attribute of `now`, or the method of `Task` to use."""
    if name in names_of_moment or inspect.isdatadescriptor(getattr(Stepper, name, None)):
        hint = f"; now has it, as now.{name}, in methods that take now"
    elif name in RENAMED["Task"]:
        hint = f"; did you mean {RENAMED['Task'][name]}?"
    else:
        hint = did_you_mean(name, dir(task))
    return AttributeError(f"the task {type(task).__name__} has no attribute {name!r}{hint}")


def missing_from_now(name: str, moment: type, names_of_moment: Collection[str]) -> AttributeError:
    """Error for an attribute that a `TaskView` does not have, with a hint: the quantity to use, or similar names."""
    hint = hint_of(moment, name) or re.sub(r"(?<![\w.])sim\.", "now.sim.", hint_of(Stepper, name))
    hint = hint or did_you_mean(name, {*dir(Stepper), *dir(moment), *names_of_moment})
    return AttributeError(f"now, a stepper.envs.TaskView, has no attribute {name!r}{hint}")


def missing_from_environment(owner: type, env: Any, name: str) -> AttributeError:
    """Error for an attribute that an environment does not have, with a hint: its task, stepper, model or view that has the attribute."""
    if "_batch" in vars(env) and name[0] != "_" and name not in NEW_NAMES[owner.__name__]:
        for place, thing in (("task", env.task), ("sim", env.sim), ("sim.model", env.sim.model), ("now", env.now)):
            if name in vars(type(thing)) or name in dir(thing):
                found = f"{place}.{name}"
                if place == "task" and name not in IN_PLACE and _takes_now(getattr(env.task, name)):
                    found += "(env.unwrapped.now)"
                return AttributeError(f"a stepper.envs.{owner.__name__} has no attribute {name!r}; use env.unwrapped.{found}")
    return no_attribute(owner, name)


def _takes_now(value: Any) -> bool:
    """Whether a value is a method whose only argument is `now`."""
    return inspect.ismethod(value) and list(inspect.signature(value).parameters) == ["now"]


def check_assignment(env: Any, name: str, value: Any) -> None:
    """Raises AttributeError if an argument or the frame_skip of the task is assigned to an environment, which would change nothing."""
    if "_batch" not in vars(env) or hasattr(type(env), name):
        return
    task, text = type(env.task).__name__, f"{name} of a {type(env).__name__} cannot be assigned"
    if name in getattr(env.task, "__dataclass_fields__", ()):
        remedy = f"with the argument {name}={value!r} or of the task {task}({name}={value!r})"
        raise AttributeError(f"{text}, it is an argument of the task: make another environment, {remedy}")
    if name == "frame_skip":
        raise AttributeError(f"{text}: set it in the class {task} of the task, or in a subclass")

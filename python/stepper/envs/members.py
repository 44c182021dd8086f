"""Checks of the definition of a task: members that environments ignore, arguments without a dataclass, and missing methods."""

from __future__ import annotations

import difflib
import inspect
import sys
import warnings
from abc import ABCMeta
from collections.abc import Iterable
from dataclasses import fields
from types import MethodType
from typing import TYPE_CHECKING, Any

from stepper._hints import WrongArgumentError, replacements, unknown_keyword

_DATACLASS = "write @dataclass(frozen=True, kw_only=True) above class"
_SKELETON = {
    "frame_skip": "frame_skip: int = 1",
    "model": 'def model(self): return stepper.load("robot.xml")',
    "observations": 'def observations(self): return stepper.envs.Observation("qpos"), stepper.envs.Observation("qvel")',
    "reward": "def reward(self, now): return now.qpos[:, 0]",
}
"""Members that every task needs, as lines of code."""
_TYPO = 0.85
"""Similarity, as of `difflib`, above which the name of a method counts as a misspelt one: a wrong letter in names of seven letters."""


class TaskType(ABCMeta):
    """Metaclass of tasks. Its call checks the definition of the class and the arguments before it makes a task."""

    if not TYPE_CHECKING:  # Type checkers read the arguments from the class.

        def __call__(cls, *given: Any, **named: Any) -> Any:
            """Makes a task, after checks of the class and the arguments."""
            _check_complete(cls)
            _check_defaults(cls)
            _check_arguments(cls, given, named)
            return super().__call__(*given, **named)

        @property
        def __signature__(cls) -> inspect.Signature:
            if _has_no_constructor(cls):
                return inspect.Signature()
            return inspect.signature(MethodType(cls.__init__, cls))


def check_members(task: type, base: type) -> None:
    """Warns of members of a class of tasks that environments ignore.

    They are methods with another library's name for a method of `Task` that the class does not define, misspelt methods, and values such as
    `decimation` (sections "Task", "parts" and "ignored" of `_guesses.toml`). Members that a base class already has are accepted, and all
    members of stepper's own tasks.
    """
    if task.__module__.startswith("stepper."):
        return
    for name in _new_names(task):
        advice = replacements("ignored").get(name)
        if inspect.isfunction(vars(task).get(name)):
            method = replacements("Task").get(name) or _method(base, name)
            renamed = method and method.partition("(")[0] not in vars(task)
            advice = f"define {method} instead of {name}" if renamed else replacements("parts").get(name) or advice
        if advice:
            _warn(task, f"{task.__name__} defines {name}, which environments ignore: {advice}")


def check_environment(env: type, base: type) -> None:
    """Warns of methods of a class of environments that belong into a task, of which `base` is the base class."""
    for name in _new_names(env):
        method = replacements("Task").get(name) or _method(base, name)
        # Environments have a method `reset`, and hindsight experience replay calls their `compute_reward`.
        if method and name not in ("reset", "compute_reward") and inspect.isfunction(vars(env).get(name)):
            remedy = f"define {method} in a subclass of stepper.envs.Task, and give that to {env.__mro__[1].__name__}"
            _warn(env, f"{env.__name__} defines {name}, which environments ignore: {remedy}")


def _warn(kind: type, text: str) -> None:
    """Issues a UserWarning at the line that defines a class: the innermost call in the module of the class."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__") != kind.__module__:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, UserWarning, stacklevel=level)


def _annotations(kind: type) -> dict[str, Any]:
    """Annotations in the body of a class, by name; empty if one of them has a name that is not defined yet."""
    try:
        return inspect.get_annotations(kind)
    except NameError:
        return {}


def _new_names(kind: type) -> list[str]:
    """Names of the members and annotated fields in the body of a class that no base class has."""
    inherited = {name for base in kind.__mro__[1:] for name in (*_annotations(base), *vars(base))}
    return [name for name in dict.fromkeys([*_annotations(kind), *vars(kind)]) if name not in inherited]


def signatures(base: type) -> list[str]:
    """Public methods in the body of a class, with the names of their arguments, such as "reward(self, now)"."""
    methods = {name: member for name, member in vars(base).items() if inspect.isfunction(member) and name[0] != "_"}
    return [f"{name}({', '.join(inspect.signature(member).parameters)})" for name, member in methods.items()]


def _method(base: type, name: str) -> str:
    """Method of the class `Task`, with its arguments, that has another name, or a similar one; "" if there is none."""
    methods = {text.partition("(")[0]: text for text in signatures(base)}
    similar = [name] if name in methods else difflib.get_close_matches(name, methods, 1, _TYPO)
    return methods[similar[0]] if similar else ""


def _check_complete(task: type) -> None:
    """Raises TypeError with a skeleton if a class of tasks lacks members that every task defines."""
    missing = set(getattr(task, "__abstractmethods__", ()))
    if not any({"reward", "rewards"} & vars(kind).keys() for kind in task.__mro__ if not _is_abstract(kind)):
        missing.add("reward")
    if missing:
        missing |= set() if hasattr(task, "frame_skip") else {"frame_skip"}
        lines = "".join(f"\n    {_SKELETON.get(name, f'def {name}(self, ...): ...')}" for name in sorted(missing))
        raise TypeError(f"{task.__name__} does not define {', '.join(sorted(missing))}. In the class of your task, write{lines}")


def _check_arguments(task: type, given: tuple[Any, ...], named: Iterable[str]) -> None:
    """Raises WrongArgumentError for an unknown argument of a class of tasks, or a positional one where arguments have names."""
    known = inspect.signature(task).parameters
    kinds = {parameter.kind for parameter in known.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        for name in named:
            if name not in known:
                remedy = no_dataclass(task, name)
                raise WrongArgumentError(
                    f"{task.__name__}() takes no {name!r}{remedy}" if remedy else unknown_keyword(task.__name__, name, known)
                )
    if given and kinds <= {inspect.Parameter.KEYWORD_ONLY}:
        remedy = f"give it by name, as {task.__name__}({next(iter(known))}=...)" if known else f"{_DATACLASS} {task.__name__}"
        raise WrongArgumentError(f"{task.__name__}() takes no argument without a name, but {given[0]!r} is given: {remedy}")


def no_dataclass(task: type, name: str) -> str:
    """End of an error message about an argument of a class of tasks without `@dataclass`, whose fields are no arguments; "" for others."""
    if "__dataclass_fields__" in vars(task) or not (name in _annotations(task) or _has_no_constructor(task)):
        return ""
    return f", because {task.__name__} is no dataclass: {_DATACLASS} {task.__name__}, with the field {name}"


def _check_defaults(task: type) -> None:
    """Raises TypeError if a class gives a field of a dataclass another default in a way that Python's dataclasses ignore."""
    for kind, *bases in (task.__mro__[k:] for k in range(len(task.__mro__))):
        owner: Any = next((base for base in bases if "__dataclass_fields__" in vars(base)), None)
        if owner is None or _has_own_constructor(task):
            return
        typed = _annotations(kind) if "__dataclass_fields__" in vars(kind) else {}
        for field in fields(owner):
            if field.init and field.name in vars(kind) and field.name not in typed:
                raise TypeError(
                    f"{kind.__name__} changes {field.name} of the dataclass {owner.__name__} without effect: {_DATACLASS} {kind.__name__}, "
                    f"and the field with its type, {field.name}: {field.type} = {vars(kind)[field.name]!r}"
                )


def _has_own_constructor(task: type) -> bool:
    """Whether the constructor of a class of tasks is written by hand, and not made by `dataclass`."""
    kind = next(kind for kind in task.__mro__ if "__init__" in vars(kind))
    return "__dataclass_fields__" not in vars(kind)


def _has_no_constructor(task: type) -> bool:
    """Whether a class of tasks defines no constructor, nor do its bases except `Task` and `MujocoTask`."""
    return not any(name in vars(kind) for kind in task.__mro__ if not _is_abstract(kind) for name in ("__init__", "__new__"))


def _is_abstract(kind: type) -> bool:
    """Whether a class is `Task` or `MujocoTask`, or `object`."""
    return kind is object or kind.__module__ == "stepper.envs.task"

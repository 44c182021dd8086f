"""Checks of the definition of a task: members that environments ignore, arguments without a dataclass, and missing methods."""

from __future__ import annotations

import inspect
import sys
import warnings
from abc import ABCMeta
from dataclasses import fields
from types import CodeType, MethodType
from typing import TYPE_CHECKING, Any

from stepper._hints import WrongArgumentError, unknown_keyword
from stepper._other_names import IGNORED_BY_ENVIRONMENTS, PARTS_OF_OTHER_TASKS, RENAMED

_DATACLASS = "@dataclass(frozen=True, kw_only=True)"
_NO_ARGUMENTS = "the constructor of Task takes no arguments: load the model in the method model(self), and define frame_skip in the class"
_SKELETON = {
    "frame_skip": "frame_skip: int = 1",
    "model": 'def model(self): return stepper.load("robot.xml")',
    "observations": 'def observations(self): return stepper.envs.Observation("qpos"), stepper.envs.Observation("qvel")',
    "reward": "def reward(self, now): return now.qpos[:, 0]",
}
"""Members that every task needs, as lines of code."""


class TaskType(ABCMeta):
    """Metaclass of tasks. Its call checks the definition of the class and the arguments before it makes a task."""

    if not TYPE_CHECKING:  # Type checkers read the arguments from the class.

        def __call__(cls, *given: Any, **named: Any) -> Any:
            """Makes a task, after checks of the class and the arguments."""
            _check_complete(cls)
            _check_defaults(cls)
            _check_arguments(cls, given, named)
            try:
                return super().__call__(*given, **named)
            except TypeError as error:
                if str(error).startswith("object.__init__()"):
                    error.add_note(_NO_ARGUMENTS)
                raise

        @property
        def __signature__(cls) -> inspect.Signature:
            if _has_no_constructor(cls):
                return inspect.Signature()
            return inspect.signature(MethodType(cls.__init__, cls))


def no_dataclass(task: type, name: str) -> str:
    """End of an error message about an argument that is a field of a class of tasks without `@dataclass`; "" for other arguments."""
    for kind in _undecorated(task):
        if name in _annotations(kind):
            own, field = (task, f", with the field {name}") if _is_abstract(kind) else (kind, "")
            return f", because {own.__name__} is no dataclass: write {_dataclass_advice(own)}{field}"
    return ""


def check_members(task: type, base: type) -> None:
    """Warns of members of a class of tasks that environments ignore.

    They are methods with another library's name for a method of `Task`, methods whose name is one edit away from a method of `Task`, and
    values such as `decimation`. Members that a base class already has or that the class itself uses are accepted, and all members of
    stepper's own tasks.
    """
    if task.__module__.startswith("stepper."):
        return
    inherited = {name for kind in task.__mro__[1:] for name in _names_of(kind)}
    for name in _names_of(task):
        if name not in inherited and (advice := _advice(name, vars(task).get(name), base)) and not _uses(task, name):
            _warn(task, f"{task.__name__} defines {name}, which environments ignore: {advice}")


def check_environment(env: type, base: type) -> None:
    """Warns of methods of a class of environments that belong into a task."""
    inherited = {name for kind in env.__mro__[1:] for name in _names_of(kind)}
    for name, member in vars(env).items():
        method = name if name in _methods_of(base) else RENAMED["Task"].get(name)
        # Environments have a method `reset`, and hindsight experience replay calls their `compute_reward`.
        if method and name not in ("reset", "compute_reward") and inspect.isfunction(member) and name not in inherited:
            remedy = f"define {_signature(base, method)} in a subclass of stepper.envs.Task, and give that to {env.__mro__[1].__name__}"
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


def _uses(task: type, name: str) -> bool:
    """Whether the code of a class of tasks, or of its bases, refers to a member by name, outside the member itself."""
    for kind in task.__mro__:
        if not kind.__module__.startswith("stepper."):
            for key, member in vars(kind).items():
                function = getattr(member, "fget", None) or inspect.unwrap(getattr(member, "__func__", member))
                if key != name and inspect.isfunction(function) and _refers(function.__code__, name):
                    return True
    return False


def _refers(code: CodeType, name: str) -> bool:
    """Whether a function, or a function in it, refers to an attribute or global by name."""
    return name in code.co_names or any(_refers(part, name) for part in code.co_consts if isinstance(part, CodeType))


def _names_of(kind: type) -> list[str]:
    """Names of the members and annotated fields in the body of a class."""
    return [*dict.fromkeys([*_annotations(kind), *vars(kind)])]


def _methods_of(base: type) -> list[str]:
    """Names of the public methods in the body of a class."""
    return [name for name, member in vars(base).items() if inspect.isfunction(member) and name[0] != "_"]


def _signature(base: type, method: str) -> str:
    """Call of a method with the names of its arguments, such as "reward(self, now)"."""
    return f"{method}({', '.join(inspect.signature(vars(base)[method]).parameters)})"


def _advice(name: str, value: Any, base: type) -> str:
    """Advice on a member of a task that environments ignore, or "" if the member may be the task's own."""
    if inspect.isfunction(value):
        method = (
            RENAMED["Task"].get(name)
            or RENAMED["Task"].get(name.lstrip("_"))
            or next((each for each in _methods_of(base) if _one_edit_apart(name, each)), None)
        )
        if method is not None:
            return f"define {_signature(base, method)} instead of {name}"
    if inspect.isfunction(value) or isinstance(value, dict | type):
        return PARTS_OF_OTHER_TASKS.get(name.lstrip("_")) or IGNORED_BY_ENVIRONMENTS.get(name, "")
    return IGNORED_BY_ENVIRONMENTS.get(name, "")


def _one_edit_apart(one: str, other: str) -> bool:
    """Whether two names differ by one letter that is added, removed or replaced, or by an exchange of two adjacent letters."""
    start = next((k for k, (x, y) in enumerate(zip(one, other, strict=False)) if x != y), min(len(one), len(other)))
    a, b = one[start:], other[start:]
    return a != b and (a[1:] == b[1:] or a[1:] == b or a == b[1:] or (a[:2] == b[1::-1] and a[2:] == b[2:]))


def _check_complete(task: type) -> None:
    """Raises TypeError with a skeleton if a class of tasks lacks methods that every task defines."""
    missing = sorted(getattr(task, "__abstractmethods__", ()))
    if not any({"reward", "rewards"} & vars(kind).keys() for kind in task.__mro__ if not _is_abstract(kind)):
        missing.append("reward")
    if missing:
        names = [*missing, *([] if hasattr(task, "frame_skip") else ["frame_skip"])]
        lines = [f"\n    {_SKELETON[name]}" for name in _SKELETON if name in names]
        if not set(missing) <= _SKELETON.keys():
            lines = [f"\n    def {name}{inspect.signature(getattr(task, name))}: ..." for name in missing]
        what = "a task that you write" if _is_abstract(task) else task.__name__
        raise TypeError(f"{task.__name__} does not define {', '.join(missing)}. In the class of {what}, write{''.join(lines)}")


def _check_arguments(task: type, given: tuple[Any, ...], named: dict[str, Any]) -> None:
    """Raises WrongArgumentError for an unknown argument of a class of tasks, or a positional one where arguments have names."""
    known, call = inspect.signature(task).parameters, f"{task.__name__}()"
    kinds = {parameter.kind for parameter in known.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        for name in named:
            if name not in known:
                remedy = no_dataclass(task, name) or (
                    f": write {_dataclass_advice(task)}, with the field {name}" if _has_no_constructor(task) else ""
                )
                raise WrongArgumentError(f"{call} takes no {name!r}{remedy}" if remedy else unknown_keyword(task.__name__, name, known))
    if given and kinds <= {inspect.Parameter.KEYWORD_ONLY}:
        remedy = (
            f"give it by name, as {task.__name__}({next(iter(known))}=...)"
            if known
            else f"write {_dataclass_advice(task)}, with a field for it"
        )
        raise WrongArgumentError(f"{call} takes no argument without a name, but {given[0]!r} is given: {remedy}")


def _check_defaults(task: type) -> None:
    """Raises TypeError if a class gives a field of a dataclass another default in a way that Python's dataclasses ignore."""
    for kind, *bases in (task.__mro__[k:] for k in range(len(task.__mro__))):
        owner: Any = next((base for base in bases if "__dataclass_fields__" in vars(base)), None)
        if owner is None or _has_own_constructor(task):
            return
        typed = _annotations(kind) if "__dataclass_fields__" in vars(kind) else {}
        for field in fields(owner):
            if field.init and field.name in vars(kind) and field.name not in typed:
                text = f"{field.name}: {field.type} = {vars(kind)[field.name]!r}"
                raise TypeError(
                    f"{kind.__name__} changes {field.name} of the dataclass {owner.__name__} without effect: write "
                    f"{_dataclass_advice(kind)}, and the field with its type, {text}"
                )


def _has_own_constructor(task: type) -> bool:
    """Whether the constructor of a class of tasks is written by hand, and not made by `dataclass`."""
    kind = next(kind for kind in task.__mro__ if "__init__" in vars(kind))
    return "__dataclass_fields__" not in vars(kind)


def _undecorated(task: type) -> list[type]:
    """Classes from `task` up to the first that has a constructor, such as a dataclass: their fields are no arguments."""
    kinds: list[type] = []
    for kind in task.__mro__:
        if "__init__" in vars(kind) and not _is_abstract(kind):
            break
        kinds.append(kind)
    return kinds


def _has_no_constructor(task: type) -> bool:
    """Whether a class of tasks defines no constructor, nor do its bases except `Task` and `MujocoTask`."""
    return not any(name in vars(kind) for kind in task.__mro__ if not _is_abstract(kind) for name in ("__init__", "__new__"))


def _is_abstract(kind: type) -> bool:
    """Whether a class is `Task` or `MujocoTask`, or `object`."""
    return kind is object or kind.__module__ == "stepper.envs.task"


def _dataclass_advice(kind: type) -> str:
    """Advice to make a class a dataclass."""
    return f"{_DATACLASS} above class {kind.__name__}"

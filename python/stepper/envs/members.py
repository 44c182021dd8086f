"""Checks of the definition of a task: members that environments ignore, arguments without a dataclass, and missing methods."""

from __future__ import annotations

import difflib
import dis
import inspect
import re
from abc import ABCMeta
from collections.abc import Iterable, Iterator
from dataclasses import fields
from functools import cached_property
from types import CodeType, MethodType
from typing import TYPE_CHECKING, Any

from stepper._hints import WrongArgumentError, unknown_keyword
from stepper._other_names import IGNORED_BY_ENVIRONMENTS, RENAMED

_SIMILAR = 0.85
"""Ratio of `difflib` from which the name of a method counts as a misspelled method of `Task`."""
_DATACLASS = "@dataclass(frozen=True, kw_only=True)"
_NO_ARGUMENTS = "the constructor of Task takes no arguments: load the model in the method model(self), and define frame_skip in the class"
_SKELETON = {
    "frame_skip": "frame_skip: int = 1",
    "model": 'def model(self): return stepper.load("robot.xml")',
    "observations": 'def observations(self): return stepper.envs.Observation("qpos"), stepper.envs.Observation("qvel")',
    "reward": "def reward(self, now): return now.qpos[:, 0], {}",
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
            if _takes_nothing(cls):
                return inspect.Signature()
            return inspect.signature(MethodType(cls.__init__, cls))


def no_dataclass(task: type, name: str) -> str:
    """End of an error message about an argument that is a field of a class of tasks without `@dataclass`; "" for other arguments.

    Args:
        task: The class.
        name: Name of the argument.
    """
    for kind in _undecorated(task):
        if name in _annotations(kind):
            own, field = (task, f", with the field {name}") if _is_abstract(kind) else (kind, "")
            return f", because {own.__name__} is no dataclass: write {_above(own)}{field}"
    return ""


def check_members(task: type, base: type, members: Iterable[str] | None = None) -> None:
    """Raises TypeError if a class of tasks defines a member that environments ignore.

    Such a member has another library's name for a method of `Task`, or is misspelled. Members that the class itself uses are accepted, and
    all members of stepper's own tasks.

    Args:
        task: The class.
        base: The class `Task`.
        members: Names of attributes of an instance that its constructor set; None checks the body of the class.
    """
    if task.__module__.startswith("stepper."):
        return
    others = task.__mro__[1:] if members is None else task.__mro__
    known = {name for kind in others for name in _names_of(kind)}
    names = [name for name in (_names_of(task) if members is None else members) if name not in known]
    suspects = {name: text for name in names if (text := _instead(name, vars(task).get(name), base))}
    while suspects and (used := suspects.keys() & set(_read_in(task, suspects))):
        suspects = {name: text for name, text in suspects.items() if name not in used}
    if suspects:
        remedies = "; ".join(suspects.values())
        raise TypeError(f"{task.__name__} defines {', '.join(suspects)}, which environments ignore: {remedies}")


def check_environment(env: type, base: type) -> None:
    """Raises TypeError if a class of environments defines a method that belongs into a task, and that the class itself does not use.

    Args:
        env: The class.
        base: The class `Task`.
    """
    inherited = {name for kind in env.__mro__[1:] for name in _names_of(kind)}
    for name, member in vars(env).items():
        is_method = name[0] != "_" and inspect.isfunction(vars(base).get(name))
        method = name if is_method else RENAMED["Task"].get(name, "") if _OF_TASKS.match(name) else ""
        if method and inspect.isfunction(member) and name not in inherited and name not in set(_read_in(env, [name])):
            arguments = ", ".join(inspect.signature(vars(base)[method]).parameters)
            raise TypeError(
                f"{env.__name__} defines {name}, which environments ignore: define {method}({arguments}) in a subclass of "
                f"stepper.envs.Task, and give that to {env.__mro__[1].__name__}"
            )


_OF_TASKS = re.compile("_|reset_|compute_")
"""Beginning of names of other libraries for methods that a class of environments defines, and no user of it calls."""


def _annotations(kind: type) -> dict[str, Any]:
    """Annotations in the body of a class, by name; empty if one of them has a name that is not defined yet."""
    try:
        return inspect.get_annotations(kind)
    except NameError:
        return {}


def _names_of(kind: type) -> list[str]:
    """Names of the members and annotated fields in the body of a class."""
    return [*dict.fromkeys([*_annotations(kind), *vars(kind)])]


def _instead(name: str, value: Any, base: type) -> str:
    """Advice on a member of a task that environments ignore, or "" if the member may be the task's own.

    Args:
        name: Name of the member.
        value: Its value in the body of the class, or None.
        base: The class `Task`.
    """
    if _codes(value) or inspect.isclass(value):
        methods = [method for method, function in vars(base).items() if inspect.isfunction(function) and method[0] != "_"]
        new = RENAMED["Task"].get(name)
        if new is None and name[0] != "_":
            new = next(iter(difflib.get_close_matches(name, methods, n=1, cutoff=_SIMILAR)), None)
        if new is not None:
            return f"define {new}({', '.join(inspect.signature(vars(base)[new]).parameters)}) instead of {name}"
    return IGNORED_BY_ENVIRONMENTS.get(name, "")


def _codes(value: Any) -> list[CodeType]:
    """Code of a function, method, property or decorated function, with that of the functions in it; empty for other values."""
    if isinstance(value, property):
        value = value.fget
    elif isinstance(value, cached_property):
        value = value.func
    code = getattr(inspect.unwrap(getattr(value, "__func__", value)), "__code__", None)
    codes = [code] if isinstance(code, CodeType) else []
    for code in codes:
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return codes


def _read_in(task: type, without: Iterable[str]) -> Iterator[str]:
    """Names that the members of a class and of its bases outside stepper use, except the members `without`.

    They are attributes that code reads, texts in code, and texts and functions in tables, such as a dictionary of terms of a reward.
    """
    members = [member for kind in task.__mro__ if not kind.__module__.startswith("stepper.") for member in vars(kind).items()]
    for name, member in members:
        if name in without:
            continue
        for code in _codes(member):
            yield from (step.argval for step in dis.get_instructions(code) if step.opname in _READS and isinstance(step.argval, str))
        if not name.startswith("__") and isinstance(member, tuple | list | set | frozenset | dict):
            for item in [*member, *(member.values() if isinstance(member, dict) else ())]:
                yield item if isinstance(item, str) else getattr(item, "__name__", "")


_READS = {name for name in dis.opname if name.startswith("LOAD_") and any(part in name for part in ("ATTR", "METHOD", "CONST"))}
"""Instructions of Python that read an attribute or a constant."""


def _check_complete(task: type) -> None:
    """Raises TypeError with a skeleton if a class of tasks lacks methods that every task defines."""
    if missing := sorted(getattr(task, "__abstractmethods__", ())):
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
                remedy = no_dataclass(task, name) or (f": write {_above(task)}, with the field {name}" if _takes_nothing(task) else "")
                raise WrongArgumentError(f"{call} takes no {name!r}{remedy}" if remedy else unknown_keyword(task.__name__, name, known))
    if given and kinds <= {inspect.Parameter.KEYWORD_ONLY}:
        remedy = f"give it by name, as {task.__name__}({next(iter(known))}=...)" if known else f"write {_above(task)}, with a field for it"
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
                    f"{kind.__name__} changes {field.name} of the dataclass {owner.__name__} without effect: write {_above(kind)}, and the "
                    f"field with its type, {text}"
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


def _takes_nothing(task: type) -> bool:
    """Whether a class of tasks defines no constructor, nor do its bases except `Task` and `MujocoTask`."""
    return not any(name in vars(kind) for kind in task.__mro__ if not _is_abstract(kind) for name in ("__init__", "__new__"))


def _is_abstract(kind: type) -> bool:
    """Whether a class is `Task` or `MujocoTask`, or `object`."""
    return kind is object or kind.__module__ == "stepper.envs.task"


def _above(kind: type) -> str:
    """Advice to make a class a dataclass."""
    return f"{_DATACLASS} above class {kind.__name__}"

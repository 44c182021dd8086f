"""Error messages for unknown names, and for assignments to read-only attributes of the compiled library.

`_guesses.toml` has the names that users of other simulators try, with the name or call to use instead; `difflib` finds similar names.
"""

from __future__ import annotations

import difflib
import functools
import tomllib
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

from stepper import _stepper
from stepper._stepper import Model, Stepper

_PREFIXES = {"Joint": ("jnt", "dof"), "Equality": ("eq",), "Keyframe": ("key",)}
"""Prefixes of MuJoCo's names of the arrays of a kind of element, where they are not its name."""
_LISTED = 12
"""Largest number of names that an error message lists."""


class WrongArgumentError(TypeError):
    """Wrong argument of a call: an unknown keyword, or a value of a wrong type. The command line prints the message without a traceback."""


@functools.cache
def _guesses() -> dict[str, dict[str, str]]:
    """Replacement of each name, by section of `_guesses.toml`."""
    sections = tomllib.loads(Path(__file__).with_name("_guesses.toml").read_text("utf-8"))
    return {
        section: {name: text.replace("NAME", name) for text, names in rows.items() for name in names.split()}
        for section, rows in sections.items()
    }


def replacement(section: str, name: str) -> str:
    """End of an error message with the replacement of an unknown name: "; use ...", or "" if `_guesses.toml` does not have the name."""
    text = _guesses().get(section, {}).get(name, "")
    return f"; {text[2:]}" if text.startswith(": ") else f"; use {text}" if text else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """End of an error message with up to three known names that are similar to an unknown one: "; did you mean ...?", or ""."""
    similar = difflib.get_close_matches(name, [other for other in known if not other.startswith("_")])
    return f"; did you mean {' or '.join(similar)}?" if similar and not name.startswith("__") else ""


def did_you_mean_or_all(name: str, known: Collection[str]) -> str:
    """End of an error message with the known names that are similar to an unknown one, or all known names if none is similar."""
    return did_you_mean(name, known) or f"; there are: {', '.join(known)}"


def no_attribute(owner: type, name: str, more: Iterable[str] = ()) -> AttributeError:
    """Error for an attribute that a class does not have, with a hint: its replacement, the class that has it, or similar names.

    Args:
        owner: The class.
        name: The unknown name.
        more: Names of further attributes, which only the instances have.
    """
    other, place = {Model: (Stepper, "sim"), Stepper: (Model, "sim.model")}.get(owner, (owner, ""))
    sections = (owner.__name__, *(("Stepper",) if owner.__name__ == "TaskView" else ()), "engine")
    hint = next(filter(None, (replacement(section, name) for section in sections)), "")
    if not hint and name[0] != "_" and hasattr(other, name) and other is not owner:
        hint = f"; use {place}.{name}"
    known = {*dir(owner), *more, *(f"{place}.{each}" for each in dir(other) if place and each[0] != "_")}
    return AttributeError(f"a {_public_name(owner)} has no attribute {name!r}{hint or did_you_mean(name, known)}")


def not_assigned(owner: type, name: str) -> AttributeError:
    """Error for an assignment to a read-only attribute of a stepper, a model, or an element of a model, such as a body."""
    there = getattr(owner, name, None)
    if there is None:
        return no_attribute(owner, name)
    prefixes = (*_PREFIXES.get(owner.__name__, ()), owner.__name__.lower())
    field = next((each for each in (name, *(f"{prefix}_{name}" for prefix in prefixes)) if each in _fields()), None)
    if callable(there):
        reason = "it is a method"
    elif owner is Stepper:
        reason = "the methods set_state, reset, step and randomize change a stepper, and its constructor sets the rest"
    elif name == "sensors":
        reason = "model.with_sensors(...) makes a model with more sensors"
    elif field is None:
        reason = "it is defined in the model's file: change the file, and load it again"
    else:
        reason = f"model.replace({field}=...) makes a model with other values"
        reason += f", sim.randomize({field}=...) sets values per environment" if _fields()[field] else ""
    return AttributeError(f"{name} of a {_public_name(owner)} cannot be assigned: {reason}")


@functools.cache
def _fields() -> dict[str, bool]:
    """Fields that `Model.replace` takes, and whether `Stepper.randomize` takes them."""
    return {name: per_environment for name, *_, per_environment in _stepper.fields()}


def _public_name(owner: type) -> str:
    """Name of a class as users write it: "stepper.lab.Study", or "stepper.Model's body" for a body of a model."""
    folder = owner.__module__.split(".")[1]
    if folder == "_stepper" and owner not in (Model, Stepper, _stepper.State):
        return f"stepper.Model's {owner.__name__.lower()}"
    return f"stepper.{owner.__name__}" if folder.startswith("_") else f"stepper.{folder}.{owner.__name__}"


def raise_error_of_property(instance: Any, name: str) -> None:
    """Raises the AttributeError that hides behind a call of `__getattr__`: that of a property, or a plain one for a special name.

    Python calls `__getattr__` also after a property of the class raised an AttributeError. The function evaluates the property again, so
    that the original error shows. It returns if the class has no such attribute.
    """
    if name.startswith("__") or hasattr(type(instance), name):
        object.__getattribute__(instance, name)


class Called:
    """Descriptor of a method of a stepper that takes no argument, such as `energy`. Operations on `sim.energy` raise errors with the call.

    Args:
        method: The method of the class.
    """

    def __init__(self, method: Callable[..., Any]):
        self._method = method

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self._method if instance is None else _Uncalled(self._method.__get__(instance))


class _Uncalled:
    """Method of a stepper that can be called, and raises an error with the call in place of any other operation.

    Args:
        method: Method of an instance.
    """

    def __init__(self, method: Callable[..., Any]):
        self.__doc__, self.__name__, self.__wrapped__ = method.__doc__, method.__name__, method

    def __call__(self, *args: Any, **keywords: Any) -> Any:
        return self.__wrapped__(*args, **keywords)

    def __repr__(self) -> str:
        return f"<method {self.__name__} of a stepper.Stepper; sim.{self.__name__}() calls it>"

    def __getattr__(self, name: str) -> Any:
        remedy = "" if name.startswith("__") else f": write sim.{self.__name__}().{name}"
        raise AttributeError(f"sim.{self.__name__} is a method without an attribute {name!r}{remedy}")

    def _refuse(self, *_: Any) -> Any:
        raise TypeError(f"sim.{self.__name__} is a method: write sim.{self.__name__}()")

    __add__ = __array__ = __bool__ = __eq__ = __float__ = __format__ = __ge__ = __getitem__ = __gt__ = __iter__ = __le__ = __len__ = _refuse
    __lt__ = __mul__ = __ne__ = __neg__ = __radd__ = __rmul__ = __rsub__ = __rtruediv__ = __sub__ = __truediv__ = _refuse
    __hash__ = None  # type: ignore[assignment]


def unknown_keyword(call: str, name: str, known: Collection[str]) -> str:
    """Error message for an unknown keyword argument of a call, such as "Stepper.reset", with similar keywords, or all of them."""
    return f"{call}() takes no {name!r}{did_you_mean_or_all(name, known) if known else '; it has no arguments'}"


def unknown_field(where: str, name: str, known: Iterable[str], listed: str) -> str:
    """Error message for an unknown field of a model, with a hint: the call that sets it, similar names, or where all fields are listed.

    Args:
        where: Function or argument to which the user gave the name, such as "Stepper.randomize" or "wrt".
        name: The unknown name.
        known: Names of the fields that the function accepts.
        listed: Command or page that lists these fields, such as "help(stepper.Stepper.randomize)".
    """
    if name in _fields():
        hint = f"; all environments of a stepper share this one: make a stepper.Stepper of model.replace({name}=...)"
    else:
        hint = replacement("fields", name) or did_you_mean(name, known) or f"; {listed} lists the fields"
    return f"{where}: there is no field {name!r}{hint}"


def unknown(kind: str, name: str, names: list[str]) -> str:
    """Error message for a name that no element of the model has.

    Args:
        kind: Kind of element, such as "joint".
        name: The unknown name.
        names: Names of all elements of this kind. Elements without a name are "".
    """
    known = [other for other in names if other]
    if not known:
        return f"no {kind} {name!r}: " + (f"none of the {len(names)} has a name, give an index" if names else f"this model has no {kind}")
    listed = ", ".join(known[:_LISTED]) + (f" and {len(known) - _LISTED} more" if len(known) > _LISTED else "")
    guess = did_you_mean(name, known)
    return f"no {kind} {name!r}{guess} There are: {listed}" if guess else f"no {kind} {name!r}, there are: {listed}"

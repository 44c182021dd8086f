"""Error messages for unknown names and for assignments to read-only attributes.

`replacement` looks an unknown name up in `_guesses.toml`, which has the names that users of other simulators try. Similar names that exist
follow from `difflib`.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import sys
import tomllib
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from stepper import _stepper
from stepper._stepper import Model, Stepper

C = TypeVar("C", bound=Callable[..., Any])
_PREFIXES = {"jnt": "joint", "dof": "joint", "ten": "tendon", "key": "keyframe", "eq": "equality"}
"""Kind of element of MuJoCo's names of arrays, by prefix, where the two differ."""
_IN_FILE = "it is defined in the model's file: change the file, and load it again"
_RESULT = "each step computes it from the state, which sim.set_state(...) sets"
_OTHER_SECTIONS = {"StepperVectorEnv": "StepperEnv", **dict.fromkeys(("Stepper", "Model", "State", "stepper"), "engine")}
"""Second section of `_guesses.toml` for a class or module."""
_COMPOUNDS = ("actuator_kp", "actuator_kv")
"""Parameters that selectors alone take (`stepper.shared.fields.COMPOUNDS`)."""
_VARIABLE = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
_LISTED = 12
"""Largest number of names that an error message lists."""


@functools.cache
def replacements(section: str) -> dict[str, str]:
    """Replacement of each name in a section of `_guesses.toml`, empty for an unknown section.

    Args:
        section: Class, module or call, such as "Stepper", "stepper.viewer" or "Stepper.reset()".
    """
    return {name: text.replace("NAME", name) for text, names in _guesses().get(section, {}).items() for name in names.split()}


@functools.cache
def _guesses() -> dict[str, dict[str, str]]:
    return tomllib.loads(Path(__file__).with_name("_guesses.toml").read_text("utf-8"))


def replacement(place: str, name: str) -> str:
    """End of an error message with the replacement of an unknown name: "; use ...", or "" if `_guesses.toml` does not have the name.

    Args:
        place: Class, module or call, such as "Stepper", "stepper.viewer" or "Stepper.reset()".
        name: The unknown name.
    """
    text = replacements(place).get(name) or replacements(_OTHER_SECTIONS.get(place, "")).get(name, "")
    return f"; {text[2:]}" if text.startswith(": ") else f"; use {text}" if text else ""


def hint_of(owner: type, name: str) -> str:
    """End of an error message about a missing attribute: its replacement, or the class that has it. "" if neither is known."""
    if (hint := replacement(owner.__name__, name)) or name.startswith("_"):
        return hint
    if owner is Stepper:
        return _hint_of_stepper(name)
    if owner in (Model, _stepper.State) and hasattr(Stepper, name):
        initial = f", and model.{name}0 is its value after a reset" if hasattr(Model, f"{name}0") else ""
        return f"; a stepper.Stepper has it, as sim.{name}{initial}"
    if owner is Model:
        return _attribute_of_element(name)
    return _array_of_elements(owner.__name__.lower(), name) if owner.__module__ == _stepper.__name__ else ""


def _hint_of_stepper(name: str) -> str:
    """Hint for an attribute that a stepper does not have: the attribute without "get_", or that of the model, or ""."""
    if name.startswith("get_") and hasattr(Stepper, name[4:]):
        return f"; use sim.{name[4:]}"
    if name in _randomized():
        return f"; sim.model.{name} has the model's values, and sim.randomized['{name}'] those that sim.randomize({name}=...) sets"
    return f"; use sim.model.{name}" if hasattr(Model, name) else _attribute_of_element(name)


def _attribute_of_element(name: str) -> str:
    """Hint for MuJoCo's name of an array, such as model.joint(name).axis for "jnt_axis"; "" if no element has the attribute."""
    prefix, _, attribute = name.partition("_")
    kind = _PREFIXES.get(prefix, prefix)
    known = attribute and hasattr(getattr(_stepper, kind.capitalize(), None), attribute)
    return f"; use model.{kind}(name).{attribute}" if known else ""


def _array_of_elements(kind: str, name: str) -> str:
    """Hint for an attribute that an element of a model, such as a "body", does not have: the array that has it, or ""."""
    for array in (f"{prefix}_{name}" for prefix in _prefixes(kind)):
        if hasattr(Model, array):
            return f"; use model.{array}, in which its id is the index"
    for array in (f"{kind}_{name}", name):
        if hasattr(Stepper, array):
            return f"; use sim.read('{array}', name) of a stepper.Stepper"
    return ""


def _prefixes(kind: str) -> list[str]:
    """Prefixes of MuJoCo's names of the arrays of a kind of element, such as "jnt" and "dof" of joints."""
    return [kind, *(prefix for prefix, other in _PREFIXES.items() if other == kind)]


@functools.cache
def _randomized() -> frozenset[str]:
    """Fields that `Stepper.randomize` takes."""
    return frozenset(name for name, *_, per_environment in _stepper.fields() if per_environment)


def no_attribute(owner: type, name: str, more: Iterable[str] = ()) -> AttributeError:
    """Error for an attribute that a class does not have, with a hint: its replacement, the class that has it, or similar names."""
    own = {*dir(owner), *more}
    other, instance = {Model: (Stepper, "sim"), Stepper: (Model, "sim.model")}.get(owner, (owner, ""))
    hint = hint_of(owner, name)
    if not hint and not name.startswith("__"):
        similar = difflib.get_close_matches(name, [each for each in own.union(dir(other)) if each[0] != "_"])
        listed = " or ".join(each if each in own else f"{instance}.{each}" for each in similar)
        hint = f"; did you mean {listed}?" if listed else ""
    return AttributeError(f"a {_public_name(owner)} has no attribute {name!r}{hint}")


def not_assigned(owner: type, name: str) -> AttributeError:
    """Error for an assignment to a read-only attribute of a stepper, a model, or an element of a model, such as a body."""
    there = getattr(owner, name, None)
    if there is None:
        return no_attribute(owner, name)
    if callable(there):
        reason = "it is a method"
    elif owner is Stepper:
        reason = replacements("assigned").get(name, _RESULT)
    elif name == "sensors":
        reason = "model.with_sensors(...) makes a model with more sensors"
    else:
        arrays = (name, *(f"{prefix}_{name}" for prefix in _prefixes(owner.__name__.lower())))
        reason = next((_field_setter(array) for array in arrays if isinstance(getattr(Model, array, None), property)), _IN_FILE)
    return AttributeError(f"{name} of a {_public_name(owner)} cannot be assigned: {reason}")


def _field_setter(field: str) -> str:
    """Calls that set a field of the model."""
    per_environment = f", sim.randomize({field}=...) sets values per environment" if field in _randomized() else ""
    return f"model.replace({field}=...) makes a model with other values{per_environment}"


def raise_error_of_property(instance: Any, name: str) -> None:
    """Raises the AttributeError that hides behind a call of `__getattr__`: that of a property, or a plain one for a special name.

    Python calls `__getattr__` also after a property of the class raised an AttributeError. The function evaluates the property again, so
    that the original error shows. It returns if the class has no such attribute.
    """
    if name.startswith("__") or hasattr(type(instance), name):
        object.__getattribute__(instance, name)


def _public_name(owner: type) -> str:
    """Name of a class as users write it: "stepper.lab.Study", or "stepper.Model's body" for a body of a model.

    Public classes of stepper.shared are names of stepper.envs.
    """
    folder = owner.__module__.split(".")[1].replace("shared", "envs")
    if folder == "_stepper" and owner not in (Model, Stepper, _stepper.State):
        return f"stepper.Model's {owner.__name__.lower()}"
    return f"stepper.{owner.__name__}" if folder.startswith("_") else f"stepper.{folder}.{owner.__name__}"


def no_name(module: str, name: str, known: Iterable[str]) -> AttributeError:
    """Error for a name that a module does not have, with a hint: its replacement, the loaded submodule that has it, or similar names."""
    hint = "" if name.startswith("_") else replacement(module, name)
    if not hint and name[:1] != "_":
        loaded = [each for each in sys.modules if each.startswith(f"{module}.") and name in getattr(sys.modules[each], "__all__", ())]
        owner = next((one for one in (Stepper, Model) if module == "stepper" and hasattr(one, name)), None)
        hint = f"; use {loaded[0]}.{name}" if loaded else f"; a {_public_name(owner)} has it" if owner else ""
    listed = did_you_mean(name, known) if module == "stepper" or name.startswith("__") else did_you_mean_or_all(name, list(known))
    return AttributeError(f"module {module!r} has no attribute {name!r}{hint or listed}")


class Hints:
    """Base class whose instances raise an AttributeError with a hint for a missing attribute, and for an assignment to one.

    A class annotates its public attributes that users may assign; results are properties.
    """

    if not TYPE_CHECKING:  # Type checkers read the attributes from the class.

        def __getattr__(self, name: str) -> Any:
            raise_error_of_property(self, name)
            raise no_attribute(type(self), name, vars(self))

        def __setattr__(self, name: str, value: Any) -> None:
            if not name.startswith("_") and name not in _annotated(type(self)):
                if hasattr(type(self), name):
                    raise AttributeError(f"{name} of a {_public_name(type(self))} cannot be assigned")
                raise no_attribute(type(self), name)
            object.__setattr__(self, name, value)


@functools.cache
def _annotated(kind: type) -> frozenset[str]:
    """Names that a class and its bases annotate."""
    return frozenset(name for base in kind.__mro__ for name in inspect.get_annotations(base))


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


class WrongArgumentError(TypeError):
    """Wrong argument of a call: an unknown keyword, or a value of a wrong type. The command line prints the message without a traceback."""


def unknown_keyword(call: str, name: str, known: Collection[str]) -> str:
    """Error message for an unknown keyword argument, with a hint: its replacement, similar names, or all keywords."""
    present = replacements("keywords").get(name, "")
    hint = replacement(f"{call}()", name)[1:] or (f" use {present}" if present.partition("=")[0] in known else "")
    hint = hint or ("" if known else " it has no arguments")
    return f"{call}() takes no {name!r}{f':{hint}' if hint else did_you_mean_or_all(name, known)}"


def _lacking(call: str, signature: inspect.Signature, args: int, keywords: Collection[str]) -> str:
    """Error message for required arguments that a call lacks, with a hint; "" if it lacks none."""
    positional = [name for name, one in signature.parameters.items() if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    required = [name for name, one in signature.parameters.items() if one.default is one.empty and one.kind not in _VARIABLE]
    missing = [name for name in required if name not in positional[:args] and name not in keywords]
    arguments = f"argument{'s' * (len(missing) > 1)} {' and '.join(missing)}"
    return f"{call}() lacks the {arguments}{replacement(f'{call}()', missing[0])}" if missing else ""


def hint_keywords(call: str) -> Callable[[C], C]:
    """Decorator of a class or a function, which raises TypeError with a hint for an unknown keyword, and for a missing argument."""

    def with_hints(target: C) -> C:
        signature = inspect.signature(target)
        known = [name for name in signature.parameters if not name.startswith("_") and name != "self"]
        original: Callable[..., Any] = target.__init__ if isinstance(target, type) else target  # type: ignore[misc]

        @functools.wraps(original)
        def checked(*args: Any, **keywords: Any) -> Any:
            for name in keywords:
                if name not in signature.parameters:
                    raise TypeError(unknown_keyword(call, name, known))
            try:
                return original(*args, **keywords)
            except TypeError:
                if lacking := _lacking(call, signature, len(args) - isinstance(target, type), keywords):
                    raise TypeError(lacking) from None
                raise

        if not isinstance(target, type):
            return checked  # type: ignore[return-value]
        target.__init__ = checked  # type: ignore[misc]
        # Private fields exist for dataclasses.replace, and are left out of the public signature.
        target.__signature__ = signature.replace(parameters=[signature.parameters[name] for name in known])  # type: ignore[attr-defined]
        return target

    return with_hints


def unknown_field(where: str, name: str, known: Iterable[str], listed: str) -> str:
    """Error message for an unknown field of a model, with a hint: the call that sets it, similar names, or where all fields are listed.

    Args:
        where: Function or argument to which the user gave the name, such as "Stepper.randomize" or "wrt".
        name: The unknown name.
        known: Names of the fields that the function accepts.
        listed: Command or page that lists these fields, such as "help(stepper.Stepper.randomize)".
    """
    known = list(known)
    field = replacements("fields").get(name, "")
    advice = replacements("assigned").get(name, "")
    if field in known:
        hint = f"; did you mean {field}?"
    elif (field or name) in _COMPOUNDS:
        hint = f"; use {{'{field or name}[name]': ...}} as the first argument"
    elif isinstance(getattr(Model, field or name, None), property):
        hint = f"; all environments of a stepper share this one: make a stepper.Stepper of model.replace({field or name}=...)"
    elif field:
        hint = f"; use {field}"
    elif advice or _attribute_of_element(name):
        hint = f"; {advice or _IN_FILE}"
    else:
        of_stepper = hint_of(Model, name) if hasattr(Stepper, name) else ""
        hint = of_stepper or did_you_mean(name, known) or hint_of(Model, name) or f"; {listed} lists the fields"
    return f"{where}: there is no field {name!r}{hint}"


def unknown_quantity(name: str, known: Collection[str]) -> str:
    """Error message for an unknown quantity of `Stepper.read`, with a hint: its place, similar names, or all quantities."""
    hint = f"; use sim.{name}" if hasattr(Stepper, name) else hint_of(Stepper, name)
    return f"there is no quantity {name!r}{hint or did_you_mean_or_all(name, sorted(known))}"


def unknown(kind: str, name: str, names: list[str]) -> str:
    """Error message for a name that no element of the model has."""
    known = [other for other in names if other]
    if not known:
        return f"no {kind} {name!r}: " + (f"none of the {len(names)} has a name, give an index" if names else f"this model has no {kind}")
    listed = ", ".join(known[:_LISTED]) + (f" and {len(known) - _LISTED} more" if len(known) > _LISTED else "")
    guess = did_you_mean(name, known)
    return f"no {kind} {name!r}{guess} There are: {listed}" if guess else f"no {kind} {name!r}, there are: {listed}"


def did_you_mean(name: str, known: Iterable[str], *, text: str | None = None) -> str:
    """End of an error message with up to three known names that are similar to an unknown one: "; did you mean ...?".

    The result is "" if no name is similar. `text` is the user's text that contains the unknown name, such as "body_mas[arm]". With `text`,
    the message suggests one corrected text instead: the most similar name replaces the unknown one, as in "body_mass[arm]".
    """
    if name.startswith("__"):
        return ""
    similar = difflib.get_close_matches(name, [other for other in known if not other.startswith("_")], n=3 if text is None else 1)
    if text not in (None, name):
        similar = [repr(text.replace(name, other, 1)) for other in similar]
    return f"; did you mean {' or '.join(similar)}?" if similar else ""


def did_you_mean_or_all(name: str, known: Collection[str]) -> str:
    """End of an error message with the known names that are similar to an unknown one, or all known names if none is similar."""
    return did_you_mean(name, known) or f"; there are: {', '.join(known)}"

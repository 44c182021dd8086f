"""Error messages with hints for common mistakes: writes to a copy, assignments to read-only attributes, and unknown names."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stepper import _stepper
from stepper._other_names import EARLIER_SELECTORS, FAMILIES, KINDS, NEW_KEYWORDS, NEW_KEYWORDS_OF, NEW_NAMES, PARTS, ROOT_NAMES
from stepper._stepper import Model, Stepper

C = TypeVar("C", bound=Callable[..., Any])
_RESULT = "each step computes it from the state, which sim.set_state(...) sets"
_OF_MODEL = {"sensors": "model.with_sensors(...) makes a model with more sensors"}
"""Advice for errors on assignments to attributes of a model, by attribute, where the general advice would be wrong."""
_IN_FILE = "it is defined in the model's file: change the file, and load it again"
_STATE = ("qpos", "qvel", "act", "time")
_REMEDIES = {
    **{name: f"sim.set_state({name}=...) sets it" for name in _STATE},
    "ctrl": "sim.step(ctrl) sets new controls, which later steps keep",
    **dict.fromkeys(
        ("xpos", "site_xpos", "geom_xpos", "subtree_com"), "sim.set_state(qpos=...) moves bodies, sim.mocap_pos moves mocap bodies"
    ),
    **dict.fromkeys(
        ("xquat", "site_xquat", "geom_xquat"), "sim.set_state(qpos=...) turns bodies, sim.mocap_quat turns mocap bodies"
    ),
    **dict.fromkeys(("body_linvel", "body_angvel"), "sim.set_state(qvel=...) sets velocities of joints, which move bodies"),
    "qfrc_bias": "it follows from qpos and qvel, which sim.set_state sets",
    **dict.fromkeys(("actuator_force", "qfrc_actuator"), "it follows from the controls, which sim.step(ctrl) sets"),
    "qfrc_constraint": "sim.qfrc_applied sets forces on joints",
    "body_contact_force": "sim.xfrc_applied sets forces on bodies",
    **dict.fromkeys(
        ("jnt_pos", "jnt_axis", "site_pos", "site_quat", "actuator_actrange", "tendon_jntid", "tendon_coef",
         "key_qpos", "key_qvel", "key_act", "key_ctrl"),
        _IN_FILE,
    ),
    "timestep": "stepper.Options(timestep=...) sets it, and model.replace(timestep=...) sets the default of the model",
    "tolerance": "stepper.Options(tolerance=...) sets it",
    "eq_active": "sim.eq_active[...] = ... switches equalities of each environment, model.replace(eq_active0=...) their initial state",
    "model": "make another stepper of another model, or change parameters of environments with sim.randomize(...)",
    "randomized": "sim.randomize(...) sets it",
    **dict.fromkeys(("options", "num_envs", "precision", "threads", "sensors", "actuators"), "it is an argument of stepper.Stepper(...)"),
    "seed": "sim.reset(seed=...) sets another",
    **dict.fromkeys(
        (
            "status", "residual", "iterations", "newton_steps", "max_penetration", "max_limit_violation", "max_equality_violation",
            "sensordata", "sensordata_ideal", "sensor_faults", "actuator_saturation", "qacc", "qacc_smooth",
        ),
        _RESULT,
    ),
}  # fmt: skip
_CALL = re.compile(r"[\w.]+(\([^()]*\)(\.\w+)?)?")
"""Pattern of a hint that is only a name or a call, without prose."""
_INSTANCES: dict[type, str] = {Stepper: "sim", Model: "model"}
"""Names of instances in messages."""
_READ = {"body": r"x\w+|c(inert|vel|frc_ext)|subtree_com", "joint": r"q\w+", "actuator": "ctrl"}
"""Pattern of quantities that `Stepper.read` has for a kind of element, and whose names do not begin with this kind."""
_LISTED = 12
"""Largest number of names that an error message lists."""
_OF_ENVIRONMENTS = "it differs between environments: sim.randomize({}=...) sets it"

_SHARED = "; all environments of a stepper share this one: make a stepper.Stepper of model.replace({}=...)"
_OF_SELECTORS = ("Stepper.randomize", "Model.replace")
"""Calls that take values by selector as their first argument."""

_OPERATORS = ("add", "sub", "mul", "matmul", "truediv", "floordiv", "mod", "pow", "lshift", "rshift", "and", "or", "xor")
_WRITING = ("__setitem__", *(f"__i{name}__" for name in _OPERATORS), "fill", "sort", "put")


class ReadOnly(np.ndarray[Any, Any]):
    """Read-only copy of an array of a stepper or a model. Writing to it raises an error with the call that sets the values.

    Results of arithmetic and of `copy()` are plain writable arrays.
    """

    message = ""
    """Error message for attempts to write to the array. The function `kind` makes a subclass with the message for an attribute."""
    # The result of arithmetic with another array has the type of the other array.
    __array_priority__ = -1.0

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return array[()] if return_scalar else array

    def __repr__(self) -> str:
        return repr(self.view(np.ndarray))

    def copy(self, order: Any = "C") -> Any:
        """Writable copy as a plain NumPy array."""
        return np.array(self, order=order)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.view(np.ndarray).__reduce_ex__(protocol)


def _guarded(write: Callable[..., Any]) -> Callable[..., Any]:
    """Wrapper of an array method that changes the array, such as `fill`.

    If the array is read-only, the wrapped method raises ValueError with the error message of the array.
    """

    @functools.wraps(write)
    def guarded(self: ReadOnly, *given: Any) -> Any:
        if not self.flags.writeable:
            raise ValueError(self.message)
        return write(self, *given)

    return guarded


for _name in _WRITING:
    setattr(ReadOnly, _name, _guarded(getattr(np.ndarray, _name)))


def kind(field: str, remedy: str = "") -> type[ReadOnly]:
    """Subclass of the read-only array type `ReadOnly` for one attribute. Attempts to write raise an error that names the attribute.

    Args:
        field: Name of the attribute, such as "qpos".
        remedy: Advice at the end of the message: the call that sets the values. "" uses the advice of `remedy_of(field)`.
    """
    message = (
        f"{field} is a read-only copy, and writing to it would change nothing: {remedy or remedy_of(field)}. Its copy() can be written to"
    )
    return type("ReadOnly", (ReadOnly,), {"message": message, "__module__": __name__})


def remedy_of(field: str) -> str:
    """End of the error message for writing to a read-only array of a stepper or a model: the call that sets the values of `field`."""
    if field in _REMEDIES:
        return _REMEDIES[field]
    per_environment = f", sim.randomize({field}=...) sets values per environment" if field in _randomized() else ""
    return f"model.replace({field}=...) makes a model with other values{per_environment}"


def kind_of_environments(field: str) -> type[ReadOnly]:
    """Subclass of the read-only array type `ReadOnly` for one field in `Stepper.randomized`.

    Writing to such an array raises an error whose message names the call `Stepper.randomize`.
    """
    return kind(field, _OF_ENVIRONMENTS.format(field))


class Contacts(np.ndarray[Any, Any]):
    """Contacts of `Stepper.contacts`, one per row. Errors for unknown fields list the fields.

    A single field is a plain array.
    """

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str) and key not in (self.dtype.names or ()):
            raise ValueError(f"contacts have no field {key!r}; there are: {', '.join(self.dtype.names or ())}")
        found = super().__getitem__(key)
        return found.view(np.ndarray) if isinstance(key, str) else found

    def __getattr__(self, name: str) -> Any:
        names = self.dtype.names or ()
        hint = f"; use contacts[{name!r}]" if name in names else f"; its fields are {', '.join(names)}, as contacts['force']"
        raise AttributeError(f"contacts are an array without the attribute {name!r}{hint}")


def not_assigned(owner: type, name: str) -> AttributeError:
    """Error for an assignment to a read-only attribute of a stepper, a model, or an element of a model, such as a body."""
    there = getattr(owner, name, None)
    if there is None:
        return no_attribute(owner, name)
    # The fields of `Model.replace` are properties. The other attributes of a model are computed from its file.
    if isinstance(there, property) or (owner is Stepper and name in _REMEDIES):
        reason = remedy_of(name)
    elif callable(there):
        reason = "it is a method"
    elif owner.__name__.lower() in KINDS:
        arrays = (f"{prefix}_{name}" for prefix in KINDS[owner.__name__.lower()])
        reason = next((remedy_of(array) for array in arrays if hasattr(Model, array)), _IN_FILE)
    elif owner is Model:
        reason = _OF_MODEL.get(name, _IN_FILE)
    else:
        reason = _RESULT
    return AttributeError(f"{name} of a {_public_name(owner)} cannot be assigned: {reason}")


def no_attribute(owner: type, name: str, more: Iterable[str] = ()) -> AttributeError:
    """Error for an attribute that a class does not have, with a hint.

    The hint is the current name of the attribute, the class that has the attribute, or similar names. `more` are the names of further
    attributes, which only the instances have.
    """
    hint = "" if name.startswith("__") else hint_of(owner, name) or _similar_attribute(owner, name, more)
    return AttributeError(f"a {_public_name(owner)} has no attribute {name!r}{hint}")


def raise_error_of_property(instance: Any, name: str) -> None:
    """Raises the AttributeError that hides behind a call of `__getattr__`: that of a property, or a plain one for a special name.

    Python calls `__getattr__` also after a property of the class raised an AttributeError. The function evaluates the property again, so
    that the original error shows. It returns if the class has no such attribute.
    """
    if name.startswith("__") or hasattr(type(instance), name):
        object.__getattribute__(instance, name)


def _similar_attribute(owner: type, name: str, more: Iterable[str] = ()) -> str:
    """End of an error message with attributes of similar names, of a class or, for a model and a stepper, of the other one.

    Args:
        owner: The class.
        name: The unknown name.
        more: Names of further attributes, which only the instances have.
    """
    own = {*dir(owner), *more}
    other, instance = {Model: (Stepper, "sim"), Stepper: (Model, "sim.model")}.get(owner, (owner, ""))
    best = difflib.get_close_matches(name, own.union(dir(other)), n=1, cutoff=0.8)
    return f"; did you mean {instance}.{best[0]}?" if best and best[0] not in own else did_you_mean(name, own)


def _public_name(owner: type) -> str:
    """Name of a class as users write it: "stepper.lab.Study", or "stepper.Model's body" for a body of a model.

    Public classes of stepper.shared are names of stepper.envs.
    """
    folder = owner.__module__.split(".")[1].replace("shared", "envs")
    if owner.__name__.lower() in KINDS and folder == "_stepper":
        return f"stepper.Model's {owner.__name__.lower()}"
    return f"stepper.{owner.__name__}" if folder.startswith("_") else f"stepper.{folder}.{owner.__name__}"


def hint_of(owner: type, name: str) -> str:
    """End of an error message about a missing attribute: its current name, or the class that has it. "" if neither is known."""
    if owner in _INSTANCES:
        return "" if name.startswith("_") else _hint_of_model(name) if owner is Model else _hint_of_stepper(name)
    if text := _other_name(owner.__name__, name) or present_keyword(f"stepper.{owner.__name__}", name):
        return _replacement(text)
    if owner is _stepper.State and hasattr(Stepper, name):
        return f"; after sim.set_state(state), sim.{name} has it"
    return _hint_of_element(owner.__name__.lower(), name) if owner.__module__ == _stepper.__name__ else ""


def _replacement(text: str) -> str:
    """End of an error message: "; did you mean ...?" for a name or call, otherwise "; use ..." or the sentence after an initial ": "."""
    if _CALL.fullmatch(text):
        return f"; did you mean {text}?"
    return f"; {text[2:]}" if text.startswith(": ") else f"; use {text}"


def _other_name(place: str, name: str) -> str:
    """Replacement for `name` in the tables: of the class or module `place`, by the whole name or by the pattern of its family."""
    if text := NEW_NAMES.get(place, {}).get(name):
        return text
    for pattern, text in FAMILIES.get(place, {}).items():
        if found := re.fullmatch(pattern, name):
            return found.expand(text)
    return ""


def _hint_of_model(name: str) -> str:
    """End of an error message about an attribute that a model does not have; "" if no place is known."""
    text = NEW_NAMES["Model"].get(name, "")
    if not text and hasattr(Stepper, name):
        start = f", and model.{name}0 is its value after a reset" if hasattr(Model, f"{name}0") else ""
        return f"; a stepper.Stepper of the model has it, as sim.{name}{start}"
    text = text or _attribute_of_element(name) or _other_name("Model", name) or _from_other_class(Stepper, "sim", name, Model)
    return _replacement(text.replace("sim.model.", "model.")) if text else ""


def _hint_of_stepper(name: str) -> str:
    """End of an error message about an attribute that a stepper does not have; "" if no place is known."""
    if name.startswith(("get_", "set_")) and name not in NEW_NAMES["Stepper"]:
        methods = [method for method in dir(Stepper) if method.startswith(name[:4])]
        if difflib.get_close_matches(name, methods, n=1, cutoff=0.85):  # A misspelt method, such as get_stat.
            return ""
    rest = name.removeprefix("get_")
    if rest != name and name not in NEW_NAMES["Stepper"]:  # Getters of mujoco-py and others.
        hint = f"; use sim.{rest}" if hasattr(Stepper, rest) else _hint_of_stepper(rest)
        if hint:
            return hint
    text = _other_name("Stepper", name)
    if not text and name in _randomized():
        return (
            f"; sim.randomize({name}=...) sets it per environment, then sim.randomized['{name}'] has it; "
            f"the value of the model is sim.model.{name}"
        )
    if not text and hasattr(Model, name):
        return f"; its model has it, as sim.model.{name}"
    text = text or _attribute_of_element(name) or _from_other_class(Model, "sim.model", name, Stepper)
    return _replacement(re.sub(r"(?<![\w.])model\.", "sim.model.", text)) if text else ""


def _from_other_class(owner: type, instance: str, name: str, other: type) -> str:
    """Replacement for an attribute from the tables of another class, or "".

    Args:
        owner: The other class.
        instance: Name of its instances, such as "sim.model". It precedes a replacement that only they have.
        name: Name of the attribute.
        other: Class of the object that lacks the attribute.
    """
    text = _other_name(owner.__name__, name)
    first = re.match(r"\w*", text)
    return f"{instance}.{text}" if first and first[0] and hasattr(owner, first[0]) and not hasattr(other, first[0]) else text


def _attribute_of_element(name: str) -> str:
    """Attribute of an element for MuJoCo's name of an array, such as "model.joint(name).axis" for "jnt_axis"; "" if there is none."""
    prefix, _, field = name.partition("_")
    for kind, prefixes in KINDS.items():
        if prefix not in (*prefixes, kind) or field in ("", "name"):
            continue
        for whole in (f"{first}_{field}" for first in prefixes):
            if hasattr(Model, whole):
                return f"model.{whole}"
        if hasattr(getattr(_stepper, kind.capitalize()), field):
            return f"model.{kind}(name).{field}"
    return ""


def _hint_of_element(kind: str, name: str) -> str:
    """End of an error message about an attribute that an element of a model, such as a body, does not have; "" if no place is known."""
    arrays = [f"{prefix}_{name}" for prefix in KINDS.get(kind, ())]
    for whole in arrays:
        if hasattr(Model, whole):
            return f"; use model.{whole}, in which its id is the index"
    for whole in (*arrays, name):
        if hasattr(Stepper, whole) and (whole != name or re.fullmatch(_READ.get(kind, ""), name)):
            return f"; use sim.read('{whole}', name) of a stepper.Stepper"
    for whole in (*arrays, name):
        if text := _from_other_class(Model, "model", whole, Stepper) or _from_other_class(Stepper, "sim", whole, Model):
            return _replacement(text)
    return ""


@functools.cache
def _randomized() -> frozenset[str]:
    """Fields that `Stepper.randomize` takes."""
    return frozenset(name for name, *_, per_environment in _stepper.fields() if per_environment)


def no_root_attribute(name: str, known: Iterable[str]) -> Exception:
    """Error for a name that the package `stepper` does not have, with a hint: the submodule or call to use instead, or similar names.

    `known` are the names that the package has.
    """
    hint = ""
    if name in ROOT_NAMES:
        hint = f"; use {ROOT_NAMES[name]}"
    elif module := _module_of("stepper", name):
        hint = f"; use {module}.{name}"
    elif text := _other_name("stepper", name):
        hint = _replacement(text)
    elif owner := next((owner for owner in _INSTANCES if hasattr(owner, name) and not name.startswith("_")), None):
        hint = f"; use {_INSTANCES[owner]}.{name} of a stepper.{owner.__name__}"
    return _absent("stepper", name, hint, known)


def no_name(module: str, name: str, known: Iterable[str]) -> Exception:
    """Error for a name that a submodule does not have, with a hint: the current name, similar names, or all names.

    Args:
        module: Name of the submodule, such as "stepper.envs".
        name: The absent name.
        known: Names that the submodule has.
    """
    if name.startswith("_"):
        return _absent(module, name, "", known)
    new = NEW_NAMES.get(module, {}).get(name)
    if not new and (place := _module_of(module, name)):
        new = f"{place}.{name}"
    new = new or _other_name(module, name)
    return _absent(module, name, _replacement(new) if new else did_you_mean_or_all(name, list(known)), known)


_INTERNAL_PACKAGES = ("cli", "loading", "shared")
_PUBLIC = re.compile(r"^(?:class|def) ([A-Za-z]\w*)", re.MULTILINE)


def _module_of(package: str, name: str) -> str:
    """Module of a package that has a public name, such as "stepper.lab" for `Study`, or ""."""
    return _modules(package).get(name, "")


@functools.cache
def _modules(package: str) -> dict[str, str]:
    """Module of each public name of the subpackages of a package, and of the modules of `stepper.adapters`.

    The function reads source files, because imports are slow and need optional libraries.
    """
    folder = Path(str(sys.modules[package].__file__)).parent
    found: dict[str, str] = {}
    for file in folder.glob("*/__init__.py"):
        if file.parent.name not in _INTERNAL_PACKAGES and (
            listed := re.search(r"^__all__ = \[(.*?)\]", file.read_text("utf-8"), re.M | re.S)
        ):
            found |= dict.fromkeys(re.findall(r'"(\w+)"', listed[1]), f"{package}.{file.parent.name}")
    if package == "stepper.adapters":
        for file in folder.glob("[a-z]*.py"):
            found |= dict.fromkeys(_PUBLIC.findall(file.read_text("utf-8")), f"{package}.{file.stem}")
    return found


def _absent(module: str, name: str, hint: str, known: Iterable[str]) -> Exception:
    """Error for an absent name of a module: AttributeError, or ImportError if `from module import name` failed and there is a hint.

    Python replaces an AttributeError raised in that statement by an ImportError without the hint, so the hint needs an ImportError. If
    `name` is a submodule, the error stays an AttributeError: Python then imports the submodule. The function recognises the import
    statement by the name of the frame three calls above.

    Args:
        module: Name of the module, such as "stepper".
        name: The absent name.
        hint: End of the message, such as "; use stepper.lab". With "", the message lists similar names from `known`.
        known: Names that the module has.
    """
    hint = hint or did_you_mean(name, known)
    imported = sys._getframe(3).f_code.co_name == "_handle_fromlist"
    if hint and imported and importlib.util.find_spec(f"{module}.{name}") is None:
        return ImportError(f"cannot import name {name!r} from {module!r}{hint}", name=name)
    return AttributeError(f"module {module!r} has no attribute {name!r}{hint}")


class Hinting(type):
    """Metaclass whose classes raise an AttributeError with a hint for a missing class attribute, such as `Options.of`.

    The hint is the current name of the attribute, or similar names.
    """

    if not TYPE_CHECKING:  # Type checkers read the attributes from the stub.

        def __getattr__(cls, name: str) -> Any:
            raise no_attribute(cls, name)


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


def present_keyword(call: str, name: str) -> str:
    """Current name of a keyword argument, from its name in an earlier version or another library; "" if `name` is no such name.

    Args:
        call: Name of the call, such as "Stepper.reset".
        name: Name in an earlier version or another library.
    """
    return NEW_KEYWORDS_OF.get(call, {}).get(name, "")


class WrongArgumentError(TypeError):
    """Wrong argument of a call: an unknown keyword, or a value of a wrong type. The command line prints the message without a traceback."""


def unknown_keyword(call: str, name: str, known: Collection[str]) -> str:
    """Error message for an unknown keyword argument, with a hint: its current name, similar names, or all keywords.

    Args:
        call: Name of the call, such as "Stepper.reset".
        name: The unknown keyword.
        known: Keywords that the call takes.
    """
    if present := present_keyword(call, name):
        return f"{call}() takes no {name!r}: use {present}"
    present = NEW_KEYWORDS.get(name, "")
    if present.partition("=")[0] in known:
        return f"{call}() takes no {name!r}: use {present}"
    hint = did_you_mean(name, known)
    if not hint and call in PARTS:
        part, text, default = PARTS[call]
        fields = inspect.signature(getattr(sys.modules["stepper"], part)).parameters
        new = present_keyword(f"stepper.{part}", name) or (name if name in fields else default)
        keyword = new if "=" in new else f"{new}=..."
        hint = f": use {text.replace('FIELD', keyword) if new.partition('=')[0] in fields else new}"
    return f"{call}() takes no {name!r}{(hint or did_you_mean_or_all(name, known)) if known else ': it has no arguments'}"


def hint_keywords(call: str) -> Callable[[C], C]:
    """Decorator of a class or a function: wrong arguments of a call raise TypeError with a hint.

    Wrong are unknown keywords, too many arguments, missing arguments, and an argument that is given twice.
    An assignment to a field of a frozen dataclass raises an error that names `dataclasses.replace`.

    Args:
        call: Name of the class or function in the message.
    """

    def with_hints(target: C) -> C:
        signature = inspect.signature(target)
        parameters = signature.parameters.values()
        known = [parameter.name for parameter in parameters]
        bound = sum(name in ("self", "cls") for name in known)
        # Private fields exist for dataclasses.replace, and are left out of the public signature.
        public = signature.replace(parameters=[parameter for parameter in parameters if not parameter.name.startswith("_")])
        plain = signature.replace(
            parameters=[public.parameters[name].replace(annotation=inspect.Parameter.empty) for name in list(public.parameters)[bound:]],
            return_annotation=inspect.Signature.empty,
        )
        in_order = list(plain.parameters)
        required = [
            name
            for name, parameter in plain.parameters.items()
            if parameter.default is parameter.empty and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        ]
        fewest = len(required)
        most = sum(parameter.kind is parameter.POSITIONAL_OR_KEYWORD for parameter in parameters) - bound

        def check(given: tuple[Any, ...], named: dict[str, Any]) -> None:
            if other := next((name for name in named if name not in known), None):
                raise TypeError(unknown_keyword(call, other, list(plain.parameters)))
            if len(given) > most:
                raise TypeError(
                    f"{call}() takes {most or 'no'} argument{'' if most == 1 else 's'} without a keyword, not {len(given)}: {call}{plain}"
                )
            for name, value in zip(plain.parameters, given, strict=False):
                if name in named:
                    remedy = present_keyword(call, name)
                    raise TypeError(f"{call}() takes one {name}, not {value!r} and {named[name]!r}" + (f": use {remedy}" if remedy else ""))
            if missing := [name for name in required if name not in named and name not in in_order[: len(given)]]:
                raise TypeError(f"{call}() lacks the argument {missing[0]}: {call}{plain}")

        if isinstance(target, type):
            _check_calls(target, check)
            target.__signature__ = public  # type: ignore[attr-defined]
            return target

        @functools.wraps(target)
        def checked(*given: Any, **named: Any) -> Any:
            if named or not fewest <= len(given) - bound <= most:
                check(given[bound:], named)
            return target(*given, **named)

        return checked  # type: ignore[return-value]

    return with_hints


def _check_calls(kind: type, check: Callable[[tuple[Any, ...], dict[str, Any]], None]) -> None:
    """Calls `check` with the positional arguments and the keyword arguments of each call of a class, before its `__init__`.

    If the class is a frozen dataclass, an assignment to a field raises an error that names `dataclasses.replace`.
    """
    make: Callable[..., None] = kind.__init__  # type: ignore[misc]

    @functools.wraps(make)
    def init(self: Any, *given: Any, **named: Any) -> None:
        check(given, named)
        make(self, *given, **named)

    def assign(self: Any, name: str, _value: Any) -> None:
        known = [field.name for field in dataclasses.fields(self)]
        if name not in known:
            raise no_attribute(type(self), name, known)
        changed = f"dataclasses.replace(old, {name}=...) makes a changed copy"
        raise dataclasses.FrozenInstanceError(f"{name} of a {_public_name(type(self))} cannot be assigned: {changed}")

    kind.__init__ = init  # type: ignore[misc]
    if dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        kind.__setattr__ = assign  # type: ignore[method-assign]


def unknown_field(where: str, name: str, known: Iterable[str], listed: str) -> str:
    """Error message for an unknown field of a model, with a hint: the call that sets it, similar names, or where all fields are listed.

    Args:
        where: Function or argument to which the user gave the name, such as "Stepper.randomize" or "wrt".
        name: The unknown name.
        known: Names of the fields that the function accepts.
        listed: Command or page that lists these fields, such as "help(stepper.Stepper.randomize)".
    """
    form = EARLIER_SELECTORS.get(name) or next((form for form in EARLIER_SELECTORS.values() if form.startswith(f"{name}[")), "")
    view = _attribute_of_element(name)
    field = form.partition("[")[0] or view.removeprefix("model.")
    if name in (other := NEW_NAMES.get(where, {})):
        hint = _replacement(other[name])
    elif isinstance(getattr(Model, name, None), property):
        hint = _SHARED.format(name)
    elif (result := next((own for own in (name, _other_name("Stepper", name)) if own in _REMEDIES), "")) or "(" in view:
        hint = f"; {_REMEDIES.get(result, _IN_FILE)}"
    elif field in known:
        hint = f"; did you mean {field}?"
    elif isinstance(getattr(Model, field, None), property):
        hint = _SHARED.format(field)
    elif form and where in _OF_SELECTORS:
        hint = f"; use {{'{form.format('name')}': ...}} as the first argument"
    elif form:
        hint = f"; did you mean {field}?"
    else:
        hint = _hint_of_model(name) or did_you_mean(name, known) or f"; {listed} lists the fields"
    return f"{where}: there is no field {name!r}{hint}"


def unknown_quantity(name: str, known: Collection[str]) -> str:
    """Error message for an unknown quantity of `Stepper.read`, with a hint: its place, similar names, or all quantities.

    Args:
        name: The unknown name.
        known: Names of the quantities.
    """
    hint = f"; use sim.{name}" if hasattr(Stepper, name) else _hint_of_stepper(name)
    return f"there is no quantity {name!r}{hint or did_you_mean_or_all(name, sorted(known))}"


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


def did_you_mean(name: str, known: Iterable[str], *, text: str | None = None) -> str:
    """End of an error message with up to three known names that are similar to an unknown one: "; did you mean ...?".

    The result is "" if no name is similar. `text` is the user's text that contains the unknown name, such as "body_mas[arm]". With `text`,
    the message suggests one corrected text instead: the most similar name replaces the unknown one, as in "body_mass[arm]".
    """
    if name.startswith("__"):
        return ""
    found = difflib.get_close_matches(name, [other for other in known if not other.startswith("_")], n=3 if text is None else 1)
    if text not in (None, name):
        found = [repr(text.replace(name, other, 1)) for other in found]
    return f"; did you mean {' or '.join(found)}?" if found else ""


def did_you_mean_or_all(name: str, known: Collection[str]) -> str:
    """End of an error message with the known names that are similar to an unknown one, or all known names if none is similar."""
    return did_you_mean(name, known) or f"; there are: {', '.join(known)}"

"""Hints for mistakes: writes to a copy, assignments to read-only attributes, and unknown names."""

from __future__ import annotations

import difflib
import functools
import inspect
import re
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stepper._other_names import EARLIER_SELECTORS, NEW_KEYWORDS, NEW_KEYWORDS_OF, NEW_NAMES, ROOT_NAMES
from stepper._stepper import Model, Stepper

T = TypeVar("T")
_NOTHING = "nothing sets it: it says how things are"
_STATE = ("qpos", "qvel", "act", "time")
_REMEDIES = {
    **{name: f"sim.set_state({name}=...) sets it" for name in _STATE},
    "ctrl": "sim.step(ctrl) takes new controls, and holds them until others are given",
    **dict.fromkeys(
        ("xpos", "site_xpos", "geom_xpos", "subtree_com"), "sim.set_state(qpos=...) moves bodies, sim.mocap_pos those that the user poses"
    ),
    **dict.fromkeys(
        ("xquat", "site_xquat", "geom_xquat"), "sim.set_state(qpos=...) turns bodies, sim.mocap_quat those that the user poses"
    ),
    **dict.fromkeys(("body_linvel", "body_angvel"), "sim.set_state(qvel=...) sets velocities of joints, which move bodies"),
    "qfrc_bias": "it follows from qpos and qvel, which sim.set_state sets",
    **dict.fromkeys(("actuator_force", "qfrc_actuator"), "sim.step(ctrl) takes the controls that it follows from"),
    "qfrc_constraint": "sim.qfrc_applied has forces on joints that one can set",
    "body_contact_force": "sim.xfrc_applied has forces on bodies that one can set",
    **dict.fromkeys(
        ("jnt_pos", "jnt_axis", "site_pos", "site_quat", "actuator_actrange", "tendon_jntid", "tendon_coef",
         "key_qpos", "key_qvel", "key_act", "key_ctrl"),
        "the file of the model says it: change that, and load it again",
    ),
    "timestep": "stepper.Options(timestep=...) chooses it, and model.replace(timestep=...) a model's own",
    "tolerance": "stepper.Options(tolerance=...) chooses it",
    "eq_active": "sim.eq_active[...] = ... switches equalities of each environment, model.replace(eq_active0=...) their initial state",
    "model": "make another stepper of another model, or change parameters of environments with sim.randomize(...)",
    "randomized": "sim.randomize(...) sets it",
    **dict.fromkeys(("options", "num_envs", "precision", "threads", "sensors", "actuators"), "it is chosen when a stepper.Stepper is made"),
    "seed": "sim.reset(seed=...) takes another",
    **dict.fromkeys(
        (
            "status", "residual", "iterations", "newton_steps", "max_penetration", "max_limit_violation", "max_equality_violation",
            "sensordata", "sensordata_ideal", "sensor_faults", "actuator_saturation", "qacc", "qacc_smooth",
        ),
        _NOTHING,
    ),
}  # fmt: skip
_CALL = re.compile(r"[\w.]+(\([^()]*\)(\.\w+)?)?")
"""A name or a call, without words."""
_LISTED = 12
"""Names that a message lists."""
_OF_ENVIRONMENTS = "environments have it of their own: sim.randomize({}=...) sets it"

_OPERATORS = ("add", "sub", "mul", "matmul", "truediv", "floordiv", "mod", "pow", "lshift", "rshift", "and", "or", "xor")
_WRITING = ("__setitem__", *(f"__i{name}__" for name in _OPERATORS), "fill", "sort", "put")


class ReadOnly(np.ndarray[Any, Any]):
    """A copy of numbers that a stepper or a model has. Writing to it is an error that names the call which sets them.

    What is computed from it is a plain array; so is its `copy()`, to which one can write.
    """

    message = ""
    # With any other array, the other's kind is that of the result.
    __array_priority__ = -1.0

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return array[()] if return_scalar else array

    def __repr__(self) -> str:
        return repr(self.view(np.ndarray))

    def copy(self, order: Any = "C") -> Any:
        """A separate plain array."""
        return np.array(self, order=order)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.view(np.ndarray).__reduce_ex__(protocol)


def _guarded(write: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(write)
    def guarded(self: ReadOnly, *given: Any) -> Any:
        if not self.flags.writeable:
            raise ValueError(self.message)
        return write(self, *given)

    return guarded


for _name in _WRITING:
    setattr(ReadOnly, _name, _guarded(getattr(np.ndarray, _name)))


def kind(field: str, remedy: str = "") -> type[ReadOnly]:
    """The kind of array that a field is read as."""
    message = (
        f"{field} is a read-only copy, and writing to it would change nothing: {remedy or remedy_of(field)}. Its copy() can be written to"
    )
    return type("ReadOnly", (ReadOnly,), {"message": message, "__module__": __name__})


def remedy_of(field: str) -> str:
    """Call that sets an array of a stepper or a field of a model."""
    return (
        _REMEDIES.get(field)
        or f"model.replace({field}=...) makes a model with other numbers, sim.randomize(...) gives environments their own"
    )


def kind_of_environments(field: str) -> type[ReadOnly]:
    """The kind of array that `Stepper.randomized` has of a field."""
    return kind(field, _OF_ENVIRONMENTS.format(field))


def not_assigned(owner: type, name: str) -> AttributeError:
    """Message for an assignment to a read-only attribute."""
    there = getattr(owner, name, None)
    if there is None:
        return no_attribute(owner, name)
    # Fields that `replace` takes are properties; what else a model has follows from them.
    known = name in _REMEDIES or isinstance(there, property)
    return AttributeError(f"{name} of a stepper.{owner.__name__} cannot be assigned: {remedy_of(name) if known else _NOTHING}")


def no_attribute(owner: type, name: str) -> AttributeError:
    """Error for an attribute that a class does not have: its new name, where it is instead, or similar names."""
    hint = _place_of(owner, name) or near(name, dir(owner))
    return AttributeError(f"a {_public_name(owner)} has no attribute {name!r}{hint}")


def _public_name(owner: type) -> str:
    """Name of a class as users write it: "stepper.lab.Study"."""
    folder = owner.__module__.split(".")[1]
    return f"stepper.{owner.__name__}" if folder.startswith("_") else f"stepper.{folder}.{owner.__name__}"


def _place_of(owner: type, name: str) -> str:
    """Hint at an attribute that has a new name or belongs to another class, as the end of a message; empty if there is none."""
    other = NEW_NAMES.get(owner.__name__, {}).get(name)
    if other is not None:
        return f"; did you mean {other}?" if _CALL.fullmatch(other) else f"; use {other}"
    if name.startswith("_"):
        return ""
    if owner is Model and hasattr(Stepper, name):
        start = f", and model.{name}0 is its value after a reset" if hasattr(Model, f"{name}0") else ""
        return f"; a stepper.Stepper of the model has it, as sim.{name}{start}"
    if owner is Stepper and hasattr(Model, name):
        return f"; its model has it, as sim.model.{name}"
    return ""


def no_root_attribute(name: str, known: Iterable[str]) -> AttributeError:
    """Error for a name that `stepper` does not have: its present place, or similar names."""
    hint = f"; use {ROOT_NAMES[name]}" if name in ROOT_NAMES else near(name, known)
    return AttributeError(f"module 'stepper' has no attribute {name!r}{hint}")


def no_name(module: str, name: str, known: Iterable[str]) -> AttributeError:
    """Error for a name that a submodule does not have: its present name, or similar names."""
    new = NEW_NAMES.get(module, {}).get(name)
    return AttributeError(f"module {module!r} has no attribute {name!r}{f'; did you mean {new}?' if new else near(name, known)}")


class Hinting(type):
    """Metaclass of classes whose missing attributes are named in an error with a hint, as `Options.of`."""

    if not TYPE_CHECKING:  # Type checkers read the attributes from the stub.

        def __getattr__(cls, name: str) -> Any:
            raise no_attribute(cls, name)


def present_keyword(call: str, name: str) -> str:
    """New name of a keyword that a call no longer has; empty if there is none."""
    return NEW_KEYWORDS_OF.get(call, {}).get(name, "")


def unknown_keyword(call: str, name: str, known: Collection[str]) -> str:
    """Error message for a keyword that a call does not take: its present name, similar ones, or all keywords."""
    if present := present_keyword(call, name):
        return f"{call}() takes no {name!r}: use {present}"
    present = NEW_KEYWORDS.get(name, "")
    if present.partition("=")[0] in known:
        return f"{call}() takes no {name!r}: use {present}"
    return f"{call}() takes no {name!r}{near_or_all(name, known) if known else ': it has no arguments'}"


def hint_keywords(call: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a dataclass whose constructor, as `call`, names the present keyword in the error of an unknown one."""

    def with_hints(kind: type[T]) -> type[T]:
        make: Callable[..., None] = kind.__init__
        signature = inspect.signature(kind)
        parameters = list(signature.parameters)
        known = [name for name in parameters if not name.startswith("_")]

        @functools.wraps(make)
        def init(self: T, *given: Any, **named: Any) -> None:
            if other := next((name for name in named if name not in parameters), None):
                raise TypeError(unknown_keyword(call, other, known))
            make(self, *given, **named)

        kind.__init__ = init  # type: ignore[method-assign,assignment]
        # Private fields are carried by dataclasses.replace, and are no part of the signature.
        kind.__signature__ = signature.replace(parameters=[signature.parameters[name] for name in known])  # type: ignore[attr-defined]
        return kind

    return with_hints


def unknown_field(where: str, name: str, known: Iterable[str], listed: str) -> str:
    """Error message for an unknown field: the call that sets it, fields of similar names, or where all fields are listed.

    Args:
        where: Call or argument that was given the name: "Stepper.randomize", "wrt".
        name: The name.
        known: Names that the call takes.
        listed: What lists these names: "help(stepper.Stepper.randomize)".
    """
    hint = near(name, known) or f"; {listed} lists the fields"
    if name in (other := NEW_NAMES.get(where, {})):
        hint = f"; did you mean {other[name]}?"
    if isinstance(getattr(Model, name, None), property):
        hint = f"; all environments of a stepper share this one: make a stepper.Stepper of model.replace({name}=...)"
    elif name in _REMEDIES:
        hint = f"; {_REMEDIES[name]}"
    elif name in EARLIER_SELECTORS:
        hint = f"; did you mean {EARLIER_SELECTORS[name].partition('[')[0]}?"
    return f"{where}: there is no field {name!r}{hint}"


def unknown(kind: str, name: str, names: list[str]) -> str:
    """Message for a name that no element of a kind has.

    Args:
        kind: "joint", for example.
        name: The name that was given.
        names: Those that there are; empty where an element has none.
    """
    known = [other for other in names if other]
    if not known:
        return f"no {kind} {name!r}: " + (f"none of the {len(names)} has a name, give an index" if names else f"this model has no {kind}")
    listed = ", ".join(known[:_LISTED]) + (f" and {len(known) - _LISTED} more" if len(known) > _LISTED else "")
    guess = near(name, known)
    return f"no {kind} {name!r}{guess} There are: {listed}" if guess else f"no {kind} {name!r}, there are: {listed}"


def near(name: str, known: Iterable[str]) -> str:
    """The names most like one that nothing has, as the end of a message; empty when none is."""
    found = difflib.get_close_matches(name, [other for other in known if not other.startswith("_")], n=3)
    return f"; did you mean {' or '.join(found)}?" if found else ""


def near_or_all(name: str, known: Collection[str]) -> str:
    """Similar names, or all names if none is similar, as the end of a message."""
    return near(name, known) or f"; there are: {', '.join(known)}"

"""Checks of arguments. Every error names the argument, its value and the accepted values."""

from __future__ import annotations

import ast
import inspect
import math
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path, PureWindowsPath
from typing import Any, TypeVar

import numpy as np

from stepper._hints import WrongArgumentError

MAX_FILE_NAME = 200
"""Largest length of a name that becomes the name of a file, bytes. File systems allow 255, of which endings need some."""


def check_number(name: str, value: Any, *, least: float = -math.inf, above: float = -math.inf, most: float = math.inf) -> None:
    """Raises an error unless a value is a finite number in a range."""
    if not _is_number(value):
        raise TypeError(f"{name} is {value!r}, must be a number")
    if not (least <= value <= most and value > above and math.isfinite(value)):
        raise ValueError(f"{name} is {value!r}, must be {_range('a finite number', least, above, most)}")


def check_fraction(name: str, value: Any, meaning: str = "") -> None:
    """Raises an error unless a value is a number between 0 and 1, both excluded; `name` is the name of the argument."""
    if not _is_number(value):
        raise TypeError(f"{name} is {value!r}, must be a number between 0 and 1{meaning}")
    if not 0 < value < 1:
        raise ValueError(f"{name} is {value!r}, must be between 0 and 1{meaning}")


def check_whole(name: str, value: Any, *, least: float = -math.inf, most: float = math.inf) -> None:
    """Raises an error unless a value is a whole number from `least` to `most`; `name` is the name of the argument.

    Arrays of integers without axes count as whole numbers.
    """
    message = f"{name} is {value!r}, must be {_range('a whole number', least, -math.inf, most)}"
    if isinstance(value, bool | np.bool_):
        raise TypeError(message)
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(message) from None
    if not least <= number <= most:
        raise ValueError(message)


def check_flag(name: str, value: Any) -> None:
    """Raises TypeError unless a value is True or False; `name` is the name of the argument."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} is {value!r}, must be True or False")


def check_pair(name: str, value: Any, *, meaning: str) -> None:
    """Raises an error unless a value is a sequence of two numbers.

    Args:
        name: Name of the argument, for the message.
        value: The value.
        meaning: Meaning of the two numbers, such as "(low, high)", for the message.
    """
    fits = isinstance(value, tuple | list | np.ndarray) and len(value) == 2 and all(_is_number(number) for number in value)
    if not fits:
        raise TypeError(f"{name} is {value!r}, must be two numbers, {meaning}")


def check_range(name: str, value: Any, *, above: float = -math.inf) -> None:
    """Raises an error unless a value is two finite numbers above a bound, the lower one first; `name` is the name of the argument."""
    check_pair(name, value, meaning="the lower one first")
    for number in value:
        check_number(name, number, above=above)
    if value[0] > value[1]:
        raise ValueError(f"{name} is {value!r}, must have the lower number first")


def check_fields(owner: Any) -> None:
    """Raises TypeError if a field that is annotated as int, float, bool or two numbers has another type, except an array."""
    for field in fields(owner):
        value, name = getattr(owner, field.name), f"{field.name} of {type(owner).__name__}"
        kind = field.type if isinstance(field.type, str) else getattr(field.type, "__name__", str(field.type))
        if isinstance(value, np.ndarray):
            continue
        if kind == "bool" and not isinstance(value, bool | np.bool_ | Integral):
            raise TypeError(f"{name} is {value!r}, must be True or False")
        if kind == "int":
            check_whole(name, value)
        if kind == "float" and (not _is_number(value) or math.isnan(value)):
            raise TypeError(f"{name} is {value!r}, must be a number")
        if kind == "tuple[float, float]":
            check_pair(name, value, meaning="the lower one first")


def check_mapping(name: str, value: Any, example: str) -> None:
    """Raises TypeError unless a value is a mapping; `name` is the name of the argument, and `example` a valid value."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} is {value!r}, must be a dict such as {example}")


def check_kind(name: str, value: Any, kind: type, remedy: str) -> None:
    """Raises TypeError unless a value is of a class of stepper.

    Args:
        name: Name of the argument, for the message.
        value: The value.
        kind: The class.
        remedy: Last part of the message: an expression that makes an object of the class.
    """
    if not isinstance(value, kind):
        folders = kind.__module__.split(".")[1:-1]
        public = ".".join(["stepper", *folders[:1], kind.__name__])
        raise TypeError(f"{name} is {value!r} ({type(value).__name__}), must be a {public}: {remedy}")


def path_of(name: str, value: Any) -> Path:
    """Path from a text or a path object; `name` is the name of the argument."""
    if not isinstance(value, str | os.PathLike):
        raise TypeError(f"{name} is {value!r} ({type(value).__name__}), must be a path, as a str or pathlib.Path")
    return Path(value)


def check_file_name(name: str, value: Any, what: str) -> None:
    """Raises an error unless a text can be the name of a file or folder on every system, in the folder that the program chooses."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is {value!r}, must be a text, the name of {what}")
    if (size := len(value.encode(errors="replace"))) > MAX_FILE_NAME:
        raise ValueError(f"{name} has {size} bytes, must have at most {MAX_FILE_NAME}, because it names {what}: choose a shorter one")
    path = PureWindowsPath(value)
    if path.name != value or path.drive or not value.strip(".") or value != value.strip() or not value.isprintable():
        raise ValueError(f"{name} is {value!r}, but it names {what}: choose one without folders, a drive, line breaks and outer spaces")


def _is_number(value: Any) -> bool:
    """Whether a value is one real number: of Python, of NumPy, or in an array without axes."""
    if isinstance(value, np.ndarray):
        return value.ndim == 0 and value.dtype.kind in "iuf"
    return isinstance(value, Real) and not isinstance(value, bool)


def _range(kind: str, least: float, above: float, most: float) -> str:
    """Description of accepted numbers for a message, such as "a finite number from 0 to 1"."""
    if least > -math.inf and most < math.inf:
        return f"{kind} from {least:g} to {most:g}"
    if above > -math.inf and most < math.inf:
        return f"{kind} above {above:g} and at most {most:g}"
    if above > -math.inf:
        return f"{kind} above {above:g}"
    if least > -math.inf:
        return f"{kind} of at least {least:g}"
    return f"{kind} of at most {most:g}" if most < math.inf else kind


def check_takes(function: Callable[..., Any], arguments: Sequence[str], what: str, *, is_method: bool = False) -> None:
    """Checks that a function can be called with some positional arguments. Functions without a known signature pass.

    Args:
        function: The function, or the bound method.
        arguments: Names of the arguments, for the message.
        what: Description of the function, which begins the message: "controller".
        is_method: Whether the function is a method, so that the definition in the message begins with `self`.

    Raises:
        TypeError: The function takes another number of arguments. The message has its name and signature, and the required arguments.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*arguments)
    except TypeError:
        name = getattr(function, "__name__", "") or type(function).__name__
        own = signature.replace(return_annotation=inspect.Signature.empty)
        needed = ", ".join(arguments)
        if name == "<lambda>":
            remedy = f"lambda {needed}: ..." if needed else "lambda: ..."
        elif inspect.isfunction(function) or is_method:
            remedy = f"def {name}({', '.join((['self'] if is_method else []) + list(arguments))})"
        else:
            remedy = f"def __call__({', '.join(['self', *arguments])})"
        count = len(arguments)
        takes = f"{count} argument{'' if count == 1 else 's'}, {needed}" if count else "no arguments"
        raise WrongArgumentError(f"{what} is {name}{own}, must take {takes}: write {remedy}") from None


def in_words(value: Any) -> str:
    """Description of a value in an error message: its type, with the shape of an array and the types in a tuple."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, tuple):
        return f"a tuple ({', '.join(type(part).__name__ for part in value)})"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if callable(value):
        return "a function"
    return f"a value of type {type(value).__name__}"


T = TypeVar("T")
_WORDS = {"true": True, "false": False, "none": None}
"""Values of the words true, false and none in upper or lower case, in addition to Python's literals."""


def literal(text: str) -> object:
    """Value that a text has in Python's syntax: a number, bool, None, tuple, list, dict or string. Any other text is returned unchanged.

    The words true, false and none may be in upper or lower case.
    """
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        value: object = ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text
    return value if isinstance(value, bool | int | float | str | tuple | list | dict | None) else text


def argument_values(texts: Sequence[str], option: str) -> dict[str, object]:
    """Arguments by name from texts NAME=VALUE. A name with a point belongs to a dictionary: rewards.upright=2 gives {"rewards": {...}}."""
    found: dict[str, object] = {}
    for name, value in name_values(texts, option, literal).items():
        group, point, key = name.partition(".")
        inner = found.setdefault(group, {}) if point else None
        if inner is None:
            found[group] = value
        elif isinstance(inner, dict):
            inner[key] = value
        else:
            raise ValueError(f"{option} gives {group!r} and {name!r}: give one of them")
    return found


def name_values(texts: Sequence[str], option: str, convert: Callable[[str], T]) -> dict[str, T]:
    """Dictionary of values by name from texts NAME=VALUE of a command-line option."""
    found: dict[str, T] = {}
    for text in texts:
        name, sign, value = text.rpartition("=")
        if not (name and sign and value):
            raise ValueError(f"{option} is {text!r}, must be NAME=VALUE; repeat the option for more")
        made = convert(value)
        if found.setdefault(name, made) != made:
            raise ValueError(f"{option} gives {name!r} twice, as {found[name]} and as {made}: give it once")
    return found

"""Tables of sensor and actuator models by name or pattern, read from dictionaries or files in TOML or JSON."""

from __future__ import annotations

import fnmatch
import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper._stepper import selected
from stepper.shared.arguments import check_mapping, path_of
from stepper.shared.files import existing, explained, read_text

T = TypeVar("T")


def read_file(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Contents of a TOML (.toml) or JSON (.json) file, as a dictionary.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The ending is another one, or the text is not valid TOML or JSON.
    """
    path = path_of("path", path)
    existing(path, "JSON" if path.suffix == ".json" else "TOML")
    if path.suffix not in (".toml", ".json"):
        raise ValueError(f"{path}: the ending is {path.suffix!r}, must be .toml or .json")
    text = read_text(path, "TOML" if path.suffix == ".toml" else "JSON")
    with explained(path, f"correct the {path.suffix.removeprefix('.').upper()}"):
        data: dict[str, Any] = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    if not isinstance(data, dict):
        raise ValueError(f"{path} holds a {type(data).__name__}, must hold tables by name")
    return data


def named_tables(data: Mapping[str, Any], name: str, place: str) -> dict[str, Any]:
    """Value of the key `name` in a dictionary read from a file: a table (dictionary), which is empty if the key is absent.

    The only other key may be "default". `place` names the file in error messages.
    """
    check_mapping(place, data, f"{{{name!r}: {{...}}, 'default': {{...}}}}")
    if unknown := set(data) - {name, "default"}:
        raise ValueError(f"{place}: unknown tables {sorted(map(str, unknown))}; the known ones are {name!r} and 'default'")
    tables = data.get(name, {})
    if not isinstance(tables, Mapping):
        raise ValueError(f"{place}: {name} is {tables!r}, must be a table by name")
    return dict(tables)


def by_name(given: Any, default: Any, kind: type[T], what: str, example: str) -> dict[str, T]:
    """Copy of a mapping of names to objects of the class `kind`, after a check of all values.

    Args:
        given: The mapping; None means an empty one.
        default: Default object, which is checked but not returned; None if there is none.
        kind: Class of the objects.
        what: Kind of object, for the message.
        example: Expression that makes an object, for the message.
    """
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"{what}s is {_short(given)}, must be a mapping of names to stepper.{kind.__name__}, as {{'*': {example}}}")
    named = dict(given or {})
    for name, part in [*named.items(), ("default", default)]:
        if not isinstance(part, kind) and not (name == "default" and part is None):
            raise TypeError(f"the {what} of {name!r} is {_short(part)}, must be a stepper.{kind.__name__}, as {example}")
    return named


def _short(value: object) -> str:
    """A value for a message; of a long one, its class."""
    return text if len(text := repr(value)) <= 60 else f"a {type(value).__name__}"


def fitting(named: Mapping[str, T], default: T | None, name: str) -> T | None:
    """Value for a name from a mapping of names and patterns (with * or ?) to values.

    The order of precedence is: the value of the exact name, the value of the first pattern that matches, the default.
    """
    patterns = [value for pattern, value in named.items() if fnmatch.fnmatchcase(name, pattern)]
    return named.get(name) or (patterns[0] if patterns else default)


def check_names(named: Mapping[str, T], names: Sequence[str], kind: str) -> None:
    """Raises ValueError if a name or pattern in `named` matches none of the elements of a model."""
    for name in named:
        if name not in names and not fnmatch.filter(names, name):
            raise ValueError(f"no {kind} fits {name!r}, there are: {', '.join(names) or 'none'}")


def _check_numeric(name: str, value: Any) -> None:
    """Raises TypeError if a value is neither a number nor an array of numbers; `name` is its name for the message."""
    try:
        fits = np.asarray(value).dtype.kind in "iuf"
    except ValueError:
        fits = False
    if not fits:
        raise TypeError(f"{name} is {value!r}, must be a number or an array of numbers")


def check_numbers(part: Any, *others: str) -> None:
    """Checks that the fields of a dataclass are numbers or arrays of numbers, except those named in `others`.

    A field with the name `limits` must be a pair (low, high) of numbers or arrays.

    Raises:
        TypeError: A field is not a number.
        ValueError: The field `limits` is not a pair (low, high).
    """
    for field in fields(part):
        value = getattr(part, field.name)
        if field.name in others or (value is None and field.default is None):
            continue
        if field.name != "limits":
            _check_numeric(field.name, value)
        elif isinstance(value, tuple | list) and len(value) == 2:
            _check_numeric("limits[0]", value[0])
            _check_numeric("limits[1]", value[1])
        else:
            raise ValueError(f"limits is {value!r}, must be (low, high)")


def numbers(name: str, value: ArrayLike, num_envs: int, envs: np.ndarray[Any, Any] | None = None) -> list[float]:
    """List of a parameter's values for the Rust library: one value for all environments, or one per environment.

    Args:
        name: Name of the parameter, for the error message.
        value: A number, or an array (num_envs,).
        num_envs: Number of environments.
        envs: Mask (num_envs,) or indices of the environments whose values are returned; None selects all environments.
    """
    array = array_of(name, value)
    if array.shape not in ((), (1,), (num_envs,)):
        raise ValueError(f"{name} has shape {array.shape}, must be () or ({num_envs},)")
    chosen: list[float] = (array.ravel() if envs is None or array.size == 1 else array[selected(envs, num_envs)]).tolist()
    return chosen

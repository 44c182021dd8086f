"""What sensors and actuators have in common: tables by name or pattern, from TOML or JSON."""

from __future__ import annotations

import fnmatch
import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

T = TypeVar("T")


def read_file(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The contents of a TOML (.toml) or JSON (.json) file.

    Raises:
        ValueError: Another ending, or text that is neither.
    """
    file = Path(path)
    if file.suffix not in (".toml", ".json"):
        raise ValueError(f"{file}: the ending is {file.suffix!r}, must be .toml or .json")
    text = file.read_text(encoding="utf-8")
    try:
        data: dict[str, Any] = tomllib.loads(text) if file.suffix == ".toml" else json.loads(text)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    return data


def fitting(named: Mapping[str, T], default: T | None, name: str) -> T | None:
    """What is said of a name: by itself, by the first pattern that fits, or by default."""
    patterns = [value for pattern, value in named.items() if fnmatch.fnmatchcase(name, pattern)]
    return named.get(name) or (patterns[0] if patterns else default)


def check_names(named: Mapping[str, T], names: Sequence[str], kind: str) -> None:
    """Raises ValueError if a name or pattern fits nothing."""
    for name in named:
        if name not in names and not fnmatch.filter(names, name):
            raise ValueError(f"no {kind} fits {name!r}, there are: {', '.join(names) or 'none'}")


def check_number(name: str, value: Any) -> None:
    """Raises TypeError if a value is neither a number nor an array of numbers."""
    if np.asarray(value).dtype.kind not in "iuf":
        raise TypeError(f"{name} is {value!r}, must be a number or an array of numbers")


def numbers(name: str, value: ArrayLike, num_envs: int) -> list[float]:
    """One number for all environments, or one for each."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (1,), (num_envs,)):
        raise ValueError(f"{name} has shape {array.shape}, must be () or ({num_envs},)")
    return array.ravel().tolist()

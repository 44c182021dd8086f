"""Options NAME=VALUE of command lines."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from typing import TypeVar

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

"""Checks of functions that users give, and descriptions of what they return."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stepper._hints import WrongArgumentError


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

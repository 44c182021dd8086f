"""Checks of functions that users give."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

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

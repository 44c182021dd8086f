"""Ids of Gymnasium environments, also of environments that modules outside stepper register."""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Iterable
from pathlib import PurePath


def import_env(env: str) -> str:
    """Imports the module that registers an environment, if a module precedes the id of the environment.

    The text "push_task:me/Push-v0" imports the module push_task, which may be in the working folder, and gives the id "me/Push-v0".

    Args:
        env: Id of the environment, with or without a module and a colon before it.

    Returns:
        The id without the module, for `gymnasium.make`.
    """
    if not isinstance(env, str):
        raise TypeError(f"env is {env!r}, must be the id of an environment, as 'stepper/HalfCheetah-v5'")
    module, _, name = env.rpartition(":")
    file = module or name
    if file.endswith(".py"):
        stem = PurePath(file).stem
        raise ValueError(
            f"{file!r} is a file, must be the id of an environment: write {stem}:{name if module else 'me/Name-v0'}, with the id that the "
            f"file registers, and run in its folder"
        )
    if not module:
        return env
    sys.path.append("")
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.partition(".")[0] and error.name != module:
            raise
        raise ValueError(f"there is no module {module!r}, which {env!r} names: run in the folder of {module}.py, or install it") from error
    finally:
        sys.path.remove("")
    return name


def unknown_id(error: Exception, env: str, known: Iterable[str]) -> str:
    """Message of Gymnasium's error for an unknown id, with a similar id of stepper's environments if Gymnasium names none.

    Args:
        error: Gymnasium's error.
        env: The unknown id, possibly without namespace or version, such as "HalfCheetah".
        known: Ids in Gymnasium's registry.
    """
    ours = {name.rpartition("/")[2].rpartition("-v")[0].lower(): name for name in known if name.startswith("stepper/")}
    part, text = env.rpartition("/")[2], str(error).rstrip(".?")
    found = difflib.get_close_matches((part.rpartition("-v")[0] or part).lower(), ours, n=1)
    return f"{text}; did you mean {ours[found[0]]}?" if found and "id you mean" not in text else text

"""Names of environments, as the command line and functions of others take them."""

from __future__ import annotations

import importlib
import sys


def known(env: str) -> str:
    """Name of an environment for `gymnasium.make`.

    A module before a colon is imported: "push_task:me/Push-v0" imports push_task and gives "me/Push-v0". Modules in the working folder
    are found too.

    Raises:
        ValueError: There is no such module.
    """
    module, _, name = env.rpartition(":")
    if not module:
        return env
    sys.path.append("")
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.partition(".")[0] and error.name != module:
            raise
        raise ValueError(f"there is no module {module!r}, which {env!r} names: call where {module}.py is, or install it") from error
    finally:
        sys.path.remove("")
    return name

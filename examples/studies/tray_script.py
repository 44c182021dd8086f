"""Push on the object of tray.toml."""

from typing import Any

import numpy as np

CONTROL = 0.008
"""Control period of tray.toml, s."""


def force(now: Any, time: Any) -> Any:
    """Mean force of the push over the control period that begins at `time` (s), N.

    The push ends at the time at which the gripper reacts.
    """
    return now.parameters["push"] * np.clip((now.parameters["reaction"] - time) / CONTROL, 0.0, 1.0)


def push(now: Any) -> None:
    """Push the object until the gripper reacts."""
    now.xfrc_applied[:, now.model.body("object").id, 0] = force(now, now.time)

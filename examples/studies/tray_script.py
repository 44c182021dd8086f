"""What pushes the object of tray.toml."""

from typing import Any

import numpy as np

CONTROL = 0.008
"""s that a push is held, as in tray.toml."""


def push(now: Any) -> None:
    """Pushes until the gripper reacts; in the control in which it does, for the share of the time that is left."""
    left = np.clip((now.theta["reaction"] - now.time) / CONTROL, 0.0, 1.0)
    now.xfrc_applied[:, now.model.body("object").id, 0] = now.theta["push"] * left

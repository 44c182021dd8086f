"""What pushes the object of tray.toml, and where that is at any time."""

from typing import Any

import numpy as np

CONTROL, MASS, GRAVITY = 0.008, 0.3, 9.81
"""s that a push is held, as in tray.toml, kg and m/s^2."""


def force(now: Any, time: Any) -> Any:
    """Of the push at a time, N."""
    return now.theta["push"] * np.clip((now.theta["reaction"] - time) / CONTROL, 0.0, 1.0)


def push(now: Any) -> None:
    """Pushes until the gripper reacts; in the control in which it does, for the share of the time that is left."""
    now.xfrc_applied[:, now.model.body("object").id, 0] = force(now, now.time)


def exact(now: Any, time: Any) -> Any:
    """Configurations and velocities at times of controls. In each of them the force less the friction is constant, until the object stands.

    The millionths of a metre a second with which it begins are gone in 1e-7 s, and have no part in it.
    """
    rubs = now.theta["friction"] * GRAVITY
    mass = MASS * now.theta["mass"]
    x, v = np.zeros(now.num_envs), np.zeros(now.num_envs)
    qpos, qvel = np.tile(now.qpos, (len(time), 1, 1)), np.tile(0.0 * now.qvel, (len(time), 1, 1))
    qvel[0] = now.qvel
    for k in range(1, len(time)):
        span = time[k] - time[k - 1]
        a = force(now, float(time[k - 1])) / mass - rubs
        # What stands stays where it is unless the push is above the friction, and what is slowed down stops within the control or after it.
        moves = np.where(a < 0, np.minimum(span, v / np.maximum(-a, 1e-300)), span)
        x, v = x + v * moves + 0.5 * a * moves**2, v + a * moves
        qpos[k, :, 0], qvel[k, :, 0] = now.qpos[:, 0] + x, v
    return qpos, qvel

"""Push on the object of tray.toml, and the exact motion of the object."""

from typing import Any

import numpy as np

CONTROL, MASS, GRAVITY = 0.008, 0.3, 9.81
"""Control period of tray.toml, s; mass of the object, kg; gravity, m/s^2."""


def force(now: Any, time: Any) -> Any:
    """Mean force of the push over the control period that begins at `time` (s), N.

    The push ends at the time at which the gripper reacts.
    """
    return now.parameters["push"] * np.clip((now.parameters["reaction"] - time) / CONTROL, 0.0, 1.0)


def push(now: Any) -> None:
    """Push the object until the gripper reacts."""
    now.xfrc_applied[:, now.model.body("object").id, 0] = force(now, now.time)


def exact(now: Any, time: Any) -> Any:
    """Exact qpos and qvel at the times of the controls, in closed form.

    Within a control period, force and friction are constant until the object stops. The initial velocity of about 1e-6 m/s is neglected,
    because friction stops the object within 1e-7 s.
    """
    rubs = now.parameters["friction"] * GRAVITY
    mass = MASS * now.parameters["mass"]
    x, v = np.zeros(now.num_envs), np.zeros(now.num_envs)
    qpos, qvel = np.tile(now.qpos, (len(time), 1, 1)), np.tile(0.0 * now.qvel, (len(time), 1, 1))
    qvel[0] = now.qvel
    for k in range(1, len(time)):
        span = time[k] - time[k - 1]
        a = force(now, float(time[k - 1])) / mass - rubs
        # An object at rest moves only if the push exceeds the friction. A decelerating object stops after the time v / -a or moves during
        # the whole control period, whichever is shorter.
        moves = np.where(a < 0, np.minimum(span, v / np.maximum(-a, 1e-300)), span)
        x, v = x + v * moves + 0.5 * a * moves**2, v + a * moves
        qpos[k, :, 0], qvel[k, :, 0] = now.qpos[:, 0] + x, v
    return qpos, qvel

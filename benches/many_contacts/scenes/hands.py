"""Scenes with the Shadow hand of gymnasium-robotics, a block or a pen, and random actions of HandManipulateBlock and HandManipulatePen.

The models are those of gymnasium-robotics 1.4.2. An action is a random target in the range of each actuator, for 20 steps of 2 ms
(`shadow_dexterous_hand/hand_env.py`). The object starts above the palm; a block has a random orientation. An object
that has fallen off the hand (below 4 cm, as in `manipulate.py`) is put above the palm again.
"""

import functools
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from many_contacts.assets import Assets
from many_contacts.scene import Array, Phase, Scene, Script, still, turned

HOLD, STEPS = 20, 300
PALM = 0.04
"""Height below which the object counts as fallen off, m."""
DRAWS = 6
"""Number of random configurations of each environment, for its resets."""
PHASES = (Phase("drops", 100, timed=False), Phase("turns", STEPS))


def spec(name: str, assets: Assets) -> Any:
    """Model specification (`MjSpec`) of the Shadow hand with an object, whose `name` is "block" or "pen"."""
    return assets.spec("gymnasium-robotics", f"gymnasium_robotics/envs/assets/hand/manipulate_{name}.xml")


def script(name: str, model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) for the Shadow hand with a block or a pen.

    The servo targets are in the middle of their ranges while the object drops onto the hand, and random afterwards.
    """
    place = int(model.joint("object:joint").qposadr[0])
    starts = np.tile(still(model.qpos0, num_envs), (DRAWS + 1, 1, 1))
    starts[..., place : place + 3] += rng.normal(scale=0.005, size=(DRAWS + 1, num_envs, 3))
    if name == "block":
        starts[..., place + 3 : place + 7] = turned(rng, (DRAWS + 1) * num_envs).reshape(DRAWS + 1, num_envs, 4)
    low, high = model.actuator_ctrlrange.T
    control = rng.uniform(low, high, (sum(p.steps for p in PHASES) // HOLD, num_envs, model.nu))
    control[: PHASES[0].steps // HOLD] = (low + high) / 2

    def fell(qpos: Array) -> NDArray[np.bool_]:
        return np.asarray(qpos[:, place + 2] < PALM)

    return Script(starts[0], control, hold=HOLD, ended=fell, reset_qpos=starts[1:])


SCENES = tuple(
    Scene(
        f"hand with {name}",
        f"gymnasium-robotics' Shadow hand with a {name}, random targets held for 40 ms, 2 ms",
        functools.partial(spec, name),
        functools.partial(script, name),
        PHASES,
        group="Shadow hand",
    )
    for name in ("block", "pen")
)

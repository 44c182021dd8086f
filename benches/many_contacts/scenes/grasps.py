"""Scenes in which two fingers lift a box of 0.05 to 2 kg, with the same grip force."""

import functools
from typing import Any

import numpy as np
from atlas.mjcf import FLOOR, box, free

from many_contacts.assets import Assets
from many_contacts.kinematics import eased
from many_contacts.scene import Phase, Scene, Script, still
from many_contacts.scenes.heaps import parsed

MASSES = (0.05, 0.3, 2.0)
"""Masses of the box in the scenes, kg."""
HALF, OPEN, GRIP = 0.02, 0.03, 20.0
"""Half size of the box, m; half the distance between the open fingers, m; force of each finger, N."""
LIFT, HOLD = 0.15, 5
"""Height of the lift, m, and number of steps per target."""
HELD = ("box", "left")
PHASES = (Phase("grips", 150, timed=False), Phase("lifts", 250, held=HELD))


def gripper(mass: float, _: Assets) -> Any:
    """Model specification (`MjSpec`) of a hand with two fingers, and a box on the floor; all friction coefficients are 1.

    The hand has 1 kg and a vertical slide. Each finger has a horizontal slide. `mass` is the mass of the box, kg.
    """
    pad = f'type="box" size="0.01 0.005 0.02" pos="0 {{}} {HALF}" mass="0.05"'
    finger = '<body name="{0}"><joint name="{0}" type="slide" axis="0 1 0" damping="5" armature="0.05"/><geom name="{0}" {1}/></body>'
    fingers = "".join(finger.format(name, pad.format(side * (OPEN + 0.005))) for name, side in (("left", 1), ("right", -1)))
    hand = f'<body name="hand"><joint name="lift" type="slide" axis="0 0 1"/><geom {box((0.03, 0.06, 0.01), 1.0)} pos="0 0 0.12"/>'
    servo = '<position name="lift" joint="lift" kp="5000" kv="500"/>'
    servo += "".join(f'<position name="{n}" joint="{n}" kp="1000" forcerange="-{GRIP} {GRIP}"/>' for n in ("left", "right"))
    text = f"""<mujoco><option impratio="10" cone="elliptic"/><default><geom friction="1 0.005 0.0001" condim="4"/></default>
      <worldbody>{FLOOR}{hand}{fingers}</body>{free("box", box((HALF,) * 3, mass), (0, 0, HALF))}</worldbody>
      <actuator>{servo}</actuator></mujoco>"""
    return parsed(text, 0.002)


def lift(model: Any, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which fingers close around a box, and the hand rises within 0.5 s.

    The box is displaced by up to 4 mm and rotated by up to 5 degrees, at random.
    """
    qpos = still(model.qpos0, num_envs)
    qpos[:, -6] = rng.uniform(-0.004, 0.004, num_envs)
    half = rng.uniform(-0.09, 0.09, num_envs) / 2
    qpos[:, -4:] = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
    closed = np.tile([0.0, -OPEN, OPEN], (num_envs, 1))
    up = closed + np.array([LIFT, 0.0, 0.0])
    grips, lifts = (phase.steps // HOLD for phase in PHASES)
    return Script(qpos, np.concatenate([np.repeat(closed[None], grips, axis=0), eased(closed, up, lifts)]), hold=HOLD)


SCENES = tuple(
    Scene(
        f"lift {mass:g} kg",
        f"two fingers press a cube of 4 cm and {mass:g} kg with {GRIP:g} N each and lift it, torsional friction, 2 ms",
        functools.partial(gripper, mass),
        lift,
        PHASES,
        group="two-finger lift",
    )
    for mass in MASSES
)

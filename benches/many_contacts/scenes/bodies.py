"""Scenes with lying humanoids, and with a robot that stands on flat feet."""

import functools
from typing import Any

import mujoco
import numpy as np

from many_contacts.assets import Assets
from many_contacts.scene import Phase, Scene, Script, still, turned, uncontrolled
from many_contacts.scenes import unitree

FALL, SETTLE, LIE = 800, 40, 200
"""Numbers of steps.

In the first steps the humanoids fall. In the next ones they settle on the floor in each engine, and in the last ones they lie there.
"""
STIFFER = 20.0
"""Factor on mjlab's servo gains. With mjlab's gains the robot would fall without a policy."""
SOLE = (0.093, 0.026, 0.01)
"""Half sizes of a sole that covers the seven capsules of a foot, m."""


def humanoid(file: str, assets: Assets) -> Any:
    """Model specification (`MjSpec`) of a humanoid of dm_control's suite. `file` is the name of its MJCF file, without ".xml"."""
    return assets.spec("dm-control", f"dm_control/suite/{file}.xml")


def limp(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) for humanoids that fall without controls.

    The humanoids start at a height of 1 m with random orientations and random joint angles within 0.35 rad.
    """
    qpos = still(model.qpos0, num_envs)
    qpos[:, 2] = 1.0
    qpos[:, 3:7] = turned(rng, num_envs)
    low, high = np.where(model.jnt_limited[1:, None], model.jnt_range[1:], (-np.pi, np.pi)).T
    qpos[:, 7:] = np.clip(rng.uniform(-0.35, 0.35, (num_envs, model.nq - 7)), low, high)
    return Script(qpos, uncontrolled(num_envs, model.nu))


def on_soles(assets: Assets) -> Any:
    """Model specification (`MjSpec`) of mjlab's G1, with a box instead of the seven capsules of each foot, and stiffer servos."""
    s = unitree.spec(unitree.G1, assets)
    for geom in list(s.geoms):
        if "_foot" in (geom.name or ""):
            s.delete(geom)
    for side in ("left", "right"):
        foot = s.body(f"{side}_ankle_roll_link")
        sole = foot.add_geom(name=f"{side}_sole", type=mujoco.mjtGeom.mjGEOM_BOX, size=SOLE, pos=[0.039, 0, -0.025])
        sole.condim, sole.priority, sole.friction[0] = 3, 1, 0.6
    for act in s.actuators:
        act.gainprm[0] *= STIFFER
        act.biasprm[1] *= STIFFER
        act.biasprm[2] *= STIFFER**0.5
    return s


def stand(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which each robot holds a random pose near mjlab's home pose."""
    home = unitree.home(unitree.G1, model)
    joints = model.jnt_qposadr[model.actuator_trnid[:, 0]]
    control = home[joints] + rng.normal(scale=0.01, size=(1, num_envs, model.nu))
    return Script(still(home, num_envs), control)


def _lying(name: str, file: str) -> Scene:
    """Scene with humanoids that lie on the floor."""
    about = f"{name}, lying on the floor without control"
    phases = (Phase("settles", SETTLE, timed=False), Phase("lies", LIE))
    return Scene(f"{file} lies", about, functools.partial(humanoid, file), limp, phases, lead=FALL, group="humanoids that lie")


SCENES = (
    Scene(
        "g1 stands",
        "Unitree's G1 standing on flat soles, with servos twenty times as stiff as mjlab's, 5 ms",
        on_soles,
        stand,
        (Phase("settles", 40, timed=False), Phase("stands", 200, held=("left_ankle_roll_link", "world"))),
        lead=400,
    ),
    _lying("dm_control's humanoid", "humanoid"),
    _lying("dm_control's CMU humanoid", "humanoid_CMU"),
)

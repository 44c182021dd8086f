"""Tasks of Unitree's quadruped Go1: follow a commanded velocity, on plain or rough ground."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model
from stepper.envs.locomotion import rewards as terms
from stepper.envs.locomotion.mjlab import Servo, scene
from stepper.envs.locomotion.velocity import RoughTask, VelocityTask
from stepper.envs.rewards import Reward
from stepper.envs.task import Camera, TaskView, Terms
from stepper.envs.terrain import Terrain

_FILE = "asset_zoo/robots/unitree_go1/xmls/go1.xml"
_HEIGHT = 0.278
"""Initial height of the trunk, m."""
_ROUGH_HEIGHT = 0.2945
"""Initial height of the trunk on rough terrain, m. The feet touch the ground; in mjlab they start 0.0165 m below its surface."""
_STANCE = {"hip": 0.1, "thigh": 0.9, "calf": -1.8}
"""Initial joint angles, rad, by kind of joint; positive hip angles point outwards."""
_ROTOR = 0.000111842
"""Inertia of a motor's rotor, kg m^2, from Unitree's description of the robot."""
_GEAR = {"hip": 6.0, "thigh": 6.0, "calf": 9.0}
"""Gear ratios by kind of joint."""
_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Largest torques at the joint, N m, by kind of joint."""
_GREY, _LIGHT = "0.25 0.25 0.28 1", "0.75 0.75 0.78 1"
"""Colours (rgba) of geoms that can touch the ground, and of other geoms."""
_FOOT, _CLEARANCE = 0.023, 0.01
"""Radius of a foot, and clearance between foot and ground above which the foot counts as in the air, m."""
_MIN_AIR_TIME, _MAX_AIR_TIME = 0.1, 0.3
"""Shortest and longest time in the air, s, for the reward of a landing foot: min(time in the air, longest) - shortest."""
_LEGS = ("FR", "FL", "RR", "RL")


class _Go1:
    """The robot Go1, for tasks on any ground."""

    FEET: ClassVar[Mapping[str, tuple[str, ...]]] = {leg: (f"{leg}_foot_collision",) for leg in _LEGS}
    THIGHS: ClassVar[tuple[str, ...]] = tuple(f"{leg}_thigh_collision{k}" for leg in _LEGS for k in (1, 2, 3))
    SHANKS: ClassVar[tuple[str, ...]] = tuple(f"{leg}_calf_collision{k}" for leg in _LEGS for k in (1, 2))
    TRUNK: ClassVar[tuple[str, ...]] = ("trunk_collision", "head_collision")
    STANDING: ClassVar[Mapping[str, float]] = {"calf": 0.1, "": 0.05}
    WALKING: ClassVar[Mapping[str, float]] = {"calf": 0.6, "": 0.3}
    RUNNING: ClassVar[Mapping[str, float]] = WALKING
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {"calf": (35.55, 20.06, 0.2), "": (23.7, 30.1, 0.2)}
    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 2.0, "azimuth": 120.0, "elevation": -20.0}
    ground: Terrain | None

    def model(self) -> Model:
        """Model of the robot Go1 with servos on its ground. Feet, trunk and head can touch a plane; on terrain also shanks and thighs."""
        return _scene(self.ground)


@dataclass(frozen=True, kw_only=True)
class Go1Velocity(_Go1, VelocityTask):
    """Velocity task of a quadruped with 12 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    In addition to the terms of `VelocityTask`, the reward has the term "stride" for the time that a landing foot was in the air.
    """

    lowest = 0.15

    def rewards(self) -> Mapping[str, Reward]:
        """Terms of `VelocityTask` with other weights, and the term "stride", which is 0 while the command is to stand."""
        weights = {terms.joint_torques: -1e-4, terms.set_point_rate: -0.05, terms.stride: 3.0}
        return {**super().rewards(), **{function.__name__: Reward(function, w, per_second=False) for function, w in weights.items()}}

    def episode_state(self, num_envs: int) -> Terms:
        """Episode state of `VelocityTask`, the air time of each foot, s, and the value of the reward term "stride"."""
        return super().episode_state(num_envs) | {"air": np.zeros((num_envs, 4)), "stride": np.zeros(num_envs)}

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action as in `VelocityTask`, detects landings of feet, and computes the reward term "stride"."""
        super().advance(now)
        air = now.episode_state["air"]
        stands = terms.foot_heights(now) < _FOOT + _CLEARANCE
        landed = stands & (air > 0.0)
        now.episode_state["stride"][:] = np.where(landed, np.minimum(air, _MAX_AIR_TIME) - _MIN_AIR_TIME, 0.0).sum(axis=1)
        air[:] = np.where(stands, 0.0, air + now.dt)


@dataclass(frozen=True, kw_only=True)
class Go1Rough(_Go1, RoughTask):
    """Rough-terrain task of a quadruped with 12 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    There are no self-collisions.
    """

    friction: tuple[float, float] = (0.3, 1.5)

    def rewards(self) -> Mapping[str, Reward]:
        """Terms of `RoughTask`, with costs of collisions of shanks and trunk."""
        collisions = {
            f"{part}_collision": Reward(terms.collision, -0.1, part=name) for part, name in (("shank", "SHANKS"), ("trunk", "TRUNK"))
        }
        return {**super().rewards(), **collisions}


def _geom(name: str, *, on_terrain: bool) -> dict[str, str]:
    """MJCF attributes of the geom `name` of Go1. On terrain, all geoms except those of the hips collide with the ground."""
    is_foot = name.endswith("foot_collision")
    collides = is_foot or ("hip" not in name if on_terrain else name in _Go1.TRUNK)
    touch = {"priority": "1", "friction": "0.8 0.005 0.0005", "condim": "3"} if is_foot else {}
    return {"contype": str(int(collides)), "rgba": _GREY if collides else _LIGHT, **touch}


def _servo(name: str) -> Servo:
    """Servo of a joint of Go1 by name, such as "FR_hip_joint"."""
    leg, kind, _ = name.split("_")
    side = -1.0 if kind == "hip" and leg.endswith("L") else 1.0
    return Servo(_ROTOR * _GEAR[kind] ** 2, _TORQUE[kind], _STANCE[kind] * side)


@cache_model
def _scene(terrain: Terrain | None) -> Model:
    geom = functools.partial(_geom, on_terrain=terrain is not None)
    return scene(_FILE, "Go1", _HEIGHT if terrain is None else _ROUGH_HEIGHT, terrain=terrain, geom=geom, servo=_servo)

"""Tasks of Unitree's quadruped Go1: follow a commanded velocity, on plain or rough ground."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, cache_per_model
from stepper.envs.locomotion.mjlab import PLAIN_REACH, ROUGH_REACH, Ground, Servo, plain_ground, scene, tiled_ground
from stepper.envs.locomotion.rough import RoughTask
from stepper.envs.locomotion.velocity import VelocityTask, command
from stepper.envs.task import Camera, Moment, Terms, square_sum
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
_STANDING_COMMAND = 0.1
"""Norm of the command (m/s, rad/s) below which it counts as a command to stand."""


@dataclass(frozen=True, kw_only=True)
class Go1Velocity(VelocityTask):
    """Velocity task of a quadruped with 12 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    Only feet, trunk and head collide with the ground. In addition to the terms of `VelocityTask`, the reward has the
    term "stride" for the time that a landing foot was in the air.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {**VelocityTask.WEIGHTS, "torque": 1e-4, "change": 0.05, "stride": 3.0}
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {"calf": (35.55, 20.06, 0.2), "": (23.7, 30.1, 0.2)}
    lowest = 0.15
    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 2.0, "azimuth": 120.0, "elevation": -20.0}

    def robot(self) -> Model:
        """Model of the robot with servos, on a plane or, with `roughness`, on bumpy ground."""
        return _scene(self.roughness)

    def episode_state(self, num_envs: int) -> Terms:
        """Episode state of `VelocityTask`, the air time of each foot, s, and the value of the reward term "stride"."""
        return super().episode_state(num_envs) | {"air": np.zeros((num_envs, 4)), "stride": np.zeros(num_envs)}

    def terms(self, now: Moment) -> Terms:
        """Terms of `VelocityTask`, and the term "stride", which is 0 while the command is to stand."""
        return super().terms(now) | {"stride": now.episode_state["stride"] * (square_sum(command(now)) > _STANDING_COMMAND**2)}

    def advance(self, now: Moment) -> None:
        """Steps the simulation by one action as in `VelocityTask`, detects landings of feet, and computes the reward term "stride"."""
        super().advance(now)
        air, feet = now.episode_state["air"], now.sim.site_xpos[:, _feet(now.sim.model)]
        stands = feet[..., 2] - self.ground(feet[..., :2]) < _FOOT + _CLEARANCE
        landed = stands & (air > 0.0)
        now.episode_state["stride"][:] = np.where(landed, np.minimum(air, _MAX_AIR_TIME) - _MIN_AIR_TIME, 0.0).sum(axis=1)
        air[:] = np.where(stands, 0.0, air + now.dt)


_LEGS = ("FR", "FL", "RR", "RL")


@dataclass(frozen=True, kw_only=True)
class Go1Rough(RoughTask):
    """Rough-terrain task of a quadruped with 12 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    Feet, shanks, thighs, trunk and head can touch the terrain. There are no self-collisions.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {**RoughTask.WEIGHTS, "shank_collision": -0.1, "trunk_collision": -0.1}
    FEET: ClassVar[Mapping[str, tuple[str, ...]]] = {leg: (f"{leg}_foot_collision",) for leg in _LEGS}
    THIGHS: ClassVar[tuple[str, ...]] = tuple(f"{leg}_thigh_collision{k}" for leg in _LEGS for k in (1, 2, 3))
    SHANKS: ClassVar[tuple[str, ...]] = tuple(f"{leg}_calf_collision{k}" for leg in _LEGS for k in (1, 2))
    TRUNK: ClassVar[tuple[str, ...]] = ("trunk_collision", "head_collision")
    STANDING: ClassVar[Mapping[str, float]] = {"calf": 0.1, "": 0.05}
    WALKING: ClassVar[Mapping[str, float]] = {"calf": 0.6, "": 0.3}
    RUNNING: ClassVar[Mapping[str, float]] = WALKING
    camera: ClassVar[Camera] = Go1Velocity.camera

    friction: tuple[float, float] = (0.3, 1.5)

    def model(self) -> Model:
        """Model of the robot Go1 with servos on the generated terrain."""
        return _rough_scene(self.terrain)


@cache_per_model
def _feet(model: Model) -> list[int]:
    """Indices of the sites in the centres of the feet."""
    return [k for k, name in enumerate(model.site_names) if name in ("FR", "FL", "RR", "RL")]


def _geom(name: str) -> dict[str, str]:
    """MJCF attributes of a geom of Go1, by the geom's name, for plain ground: only feet, trunk and head collide."""
    return _geom_attributes(name, name in ("trunk_collision", "head_collision"))


def _geom_attributes(name: str, collides: bool) -> dict[str, str]:
    """MJCF attributes of the geom `name` of Go1. The geom collides with the ground if `collides` is true or the geom is a foot."""
    is_foot = name.endswith("foot_collision")
    collides = collides or is_foot
    touch = {"priority": "1", "friction": "0.8 0.005 0.0005", "condim": "3"} if is_foot else {}
    return {"contype": str(int(collides)), "rgba": _GREY if collides else _LIGHT, **touch}


def _servo(name: str) -> Servo:
    """Servo of a joint of Go1 by name, such as "FR_hip_joint"."""
    leg, kind, _ = name.split("_")
    side = -1.0 if kind == "hip" and leg.endswith("L") else 1.0
    return Servo(_ROTOR * _GEAR[kind] ** 2, _TORQUE[kind], _STANCE[kind] * side)


@cache_model
def _scene(roughness: float) -> Model:
    return _model_on(plain_ground(roughness), _geom, _HEIGHT, PLAIN_REACH)


@cache_model
def _rough_scene(terrain: Terrain) -> Model:
    return _model_on(tiled_ground(terrain), lambda name: _geom_attributes(name, "hip" not in name), _ROUGH_HEIGHT, ROUGH_REACH)


def _model_on(ground: Ground, geom: Callable[[str], Mapping[str, str]], height: float, reach: float) -> Model:
    """Model of the robot Go1 with servos, on a ground.

    Args:
        ground: Ground of the scene.
        geom: Function from the name of a geom of the robot to its MJCF attributes.
        height: Initial height of the trunk, m.
        reach: Largest distance of a servo's set point from the joint angle of the stance, as a fraction of the position error (set point
            minus joint angle) at which the torque is largest.
    """
    return scene(_FILE, "Go1", height, reach=reach, ground=ground, geom=geom, servo=_servo)

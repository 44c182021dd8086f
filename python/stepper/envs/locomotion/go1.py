"""Unitree's Go1 follows a commanded velocity, with random parameters, pushes and latency."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar
from xml.etree.ElementTree import Element

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import once_per_model, read_once
from stepper.envs.locomotion.mjlab import Ground, Looks, Servo, plain_ground, scene, tiled_ground
from stepper.envs.locomotion.rough import RoughTask
from stepper.envs.locomotion.velocity import VelocityTask, command
from stepper.envs.streams import Rng
from stepper.envs.task import Array, Camera, Moment, Terms, square_sum

_FILE = "asset_zoo/robots/unitree_go1/xmls/go1.xml"
_HEIGHT = 0.278
"""Height of the trunk at the beginning, m."""
_STANDING = 0.2945
"""Likewise on rough terrain, with the feet on the ground. It is 0.0165 m higher than in mjlab, whose feet begin in the ground."""
_STANCE = {"hip": 0.1, "thigh": 0.9, "calf": -1.8}
"""Angles at the beginning, rad; hips point outwards."""
_ROTOR = 0.000111842
"""Inertia of a motor's rotor, kg m^2, from Unitree's description of the robot."""
_GEAR = {"hip": 6.0, "thigh": 6.0, "calf": 9.0}
_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Largest torques, N m."""
_GREY, _LIGHT = "0.25 0.25 0.28 1", "0.75 0.75 0.78 1"
"""Colours of what touches the ground, and of the rest."""
_FOOT, _CLEAR = 0.023, 0.01
"""Radius of a foot, and its height above which it is in the air, m."""
_SHORTEST, _LONGEST = 0.1, 0.3
"""Times in the air, s: a foot that lands gains by what is beyond the first, up to the second."""
_STANDS = 0.1
"""Length of a command below which it is one to stand."""


@dataclass(frozen=True, kw_only=True)
class Go1Velocity(VelocityTask):
    """Quadruped with 12 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    Only feet, trunk and head collide with the ground. In addition to the terms of `VelocityTask`, the reward has a term for the time that
    a landing foot was in the air.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {**VelocityTask.WEIGHTS, "torque": 1e-4, "change": 0.05, "stride": 3.0}
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {"calf": (35.55, 20.06, 0.2), "": (23.7, 30.1, 0.2)}
    lowest = 0.15
    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 2.0, "azimuth": 120.0, "elevation": -20.0}

    def robot(self) -> Model:
        """The robot on a plane, or on rough ground, with servos."""
        return _scene(self.roughness)

    def episode_state(self, num_envs: int) -> Terms:
        """Episode state of `VelocityTask`, with the air time of each foot, s, and the reward of landed feet."""
        return super().episode_state(num_envs) | {"air": np.zeros((num_envs, 4)), "stride": np.zeros(num_envs)}

    def terms(self, now: Moment) -> Terms:
        """Terms of `VelocityTask`, with a term for strides while the command is to move."""
        return super().terms(now) | {"stride": now.episode_state["stride"] * (square_sum(command(now)) > _STANDS**2)}

    def on_reset(self, sim: Stepper, episode_state: Terms, mask: Array, rng: Rng) -> None:
        """Draws commands, pushes, latency and parameters, and clears the air times of the feet."""
        super().on_reset(sim, episode_state, mask, rng)
        episode_state["air"][mask] = 0.0
        episode_state["stride"][mask] = 0.0

    def advance(self, now: Moment) -> None:
        """Makes the steps of an action, the first ones with the previous action (latency), and detects landings of feet."""
        super().advance(now)
        air, feet = now.episode_state["air"], now.sim.site_xpos[:, _feet(now.sim.model)]
        stands = feet[..., 2] - self.ground(feet[..., :2]) < _FOOT + _CLEAR
        landed = stands & (air > 0.0)
        now.episode_state["stride"][:] = np.where(landed, np.minimum(air, _LONGEST) - _SHORTEST, 0.0).sum(axis=1)
        air[:] = np.where(stands, 0.0, air + now.dt)


_LEGS = ("FR", "FL", "RR", "RL")


@dataclass(frozen=True, kw_only=True)
class Go1Rough(RoughTask):
    """Quadruped with 12 joints on rough terrain. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    Feet, shanks, thighs, trunk and head touch the terrain, and the robot does not touch itself.
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
        """The robot on the terrain, with servos."""
        return _rough_scene()


@once_per_model
def _feet(model: Model) -> list[int]:
    """Sites in the middle of the feet."""
    return [k for k, name in enumerate(model.site_names) if name in ("FR", "FL", "RR", "RL")]


def _geom(name: str) -> dict[str, str]:
    return _touching(name, name in ("trunk_collision", "head_collision"))


def _touching(name: str, touches: bool) -> dict[str, str]:
    """Attributes of a geom that touches the ground, or not; feet do."""
    is_foot = name.endswith("foot_collision")
    touches = touches or is_foot
    touch = {"priority": "1", "friction": "0.8 0.005 0.0005", "condim": "3"} if is_foot else {}
    return {"contype": str(int(touches)), "rgba": _GREY if touches else _LIGHT, **touch}


def _servo(name: str) -> Servo:
    leg, kind, _ = name.split("_")
    side = -1.0 if kind == "hip" and leg.endswith("L") else 1.0
    return Servo(_ROTOR * _GEAR[kind] ** 2, _TORQUE[kind], _STANCE[kind] * side)


@read_once
def _scene(roughness: float) -> Model:
    return _on(plain_ground(roughness), _geom, _HEIGHT)


@read_once
def _rough_scene() -> Model:
    return _on(tiled_ground(Go1Rough.TERRAIN), lambda name: _touching(name, "hip" not in name), _STANDING)


def _on(ground: Ground, geom: Callable[[str], Mapping[str, str]], height: float) -> Model:
    """The robot on a ground."""
    squares = {"type": "2d", "builtin": "checker", "width": "64", "height": "64", "rgb1": ".30 .35 .40", "rgb2": ".36 .41 .46"}
    texture = Element("texture", {"name": "squares", **squares})
    material = Element("material", name="floor", texture="squares", texrepeat="2 2", texuniform="true")
    looks = Looks({"material": "floor"}, {}, (texture, material))
    return scene(_FILE, "Go1", height, ground=ground, geom=geom, servo=_servo, looks=looks)

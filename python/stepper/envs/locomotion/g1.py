"""Tasks of Unitree's humanoid G1: follow a commanded velocity, on plain or rough ground."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from stepper._stepper import Model
from stepper.envs.assets import cache_model
from stepper.envs.locomotion import rewards as terms
from stepper.envs.locomotion.mjlab import Servo, scene
from stepper.envs.locomotion.velocity import RoughTask, VelocityTask
from stepper.envs.rewards import Reward
from stepper.envs.task import Camera
from stepper.envs.terrain import Terrain

_FILE = "asset_zoo/robots/unitree_g1/xmls/g1.xml"
_HEIGHT = 0.77
"""Initial height of the pelvis, m. It is 0.01 m more than mjlab's, so that feet do not penetrate the ground with noisy angles."""
_STANCE = {
    "hip_pitch": -0.312, "knee": 0.669, "ankle_pitch": -0.363, "elbow": 0.6, "shoulder_pitch": 0.2,
    "left_shoulder_roll": 0.2, "right_shoulder_roll": -0.2,
}  # fmt: skip
"""Initial joint angles, rad, by a part of the joint's name: bent knees, as in mjlab. Other joints are 0."""


@dataclass(frozen=True)
class _Motor:
    """Motor with a two-stage planetary gear, with numbers of Unitree's description of the robot.

    Attributes:
        rotors: Inertias of the rotor, the first gear stage and the second gear stage, each about its axis, kg m^2.
        gears: Ratios of the two stages.
        torque: Largest torque at the joint, N m, of all its motors together.
        count: Number of such motors that drive the joint together.
    """

    rotors: tuple[float, float, float]
    gears: tuple[float, float]
    torque: float
    count: int = 1

    @property
    def inertia(self) -> float:
        """Inertia of rotors and gears reflected to the joint, kg m^2."""
        first, second = self.gears
        return self.count * (self.rotors[0] * (first * second) ** 2 + self.rotors[1] * second**2 + self.rotors[2])


_SMALL = ((1.39e-5, 1.7e-6, 1.69e-5), (1.0 + 46.0 / 18.0, 1.0 + 56.0 / 16.0), 25.0)
_MOTORS = {
    r"elbow|shoulder|wrist_roll": _Motor(*_SMALL),
    r"hip_pitch|hip_yaw|waist_yaw": _Motor((4.89e-5, 9.8e-6, 5.33e-5), (4.5, 1.0 + 48.0 / 22.0), 88.0),
    r"hip_roll|knee": _Motor((4.89e-5, 1.09e-5, 7.38e-5), (4.5, 5.0), 139.0),
    r"wrist_pitch|wrist_yaw": _Motor((6.8e-6, 0.0, 0.0), (5.0, 5.0), 5.0),
    # Joints driven by a linkage of two motors. As in mjlab, the ratio of the linkage is 1.
    r"waist_pitch|waist_roll|ankle": _Motor(*_SMALL[:2], 2.0 * _SMALL[2], count=2),
}
"""Motor of each joint, by a regular expression for the joint's name."""


_FEET = {"left": "left_foot", "right": "right_foot"}
_ARMS = {"wrist": 0.3, "shoulder_yaw": 0.1, "shoulder|elbow": 0.15}
_RUNNING_ARMS = {"shoulder_pitch": 0.5, "shoulder_roll": 0.2, "shoulder_yaw": 0.15, "elbow": 0.35, "wrist": 0.3}


class _G1:
    """The robot G1, for tasks on any ground. Only feet collide with the ground."""

    FEET: ClassVar[Mapping[str, tuple[str, ...]]] = {
        site: tuple(f"{side}_foot{k}_collision" for k in range(1, 8)) for side, site in _FEET.items()
    }
    STANDING: ClassVar[Mapping[str, float]] = {"": 0.05}
    WALKING: ClassVar[Mapping[str, float]] = {
        **{"hip_pitch": 0.3, "hip": 0.15, "knee": 0.35, "ankle_pitch": 0.25, "ankle_roll": 0.1},
        **{"waist_yaw": 0.2, "waist_roll": 0.08, "waist_pitch": 0.1, **_ARMS},
    }
    RUNNING: ClassVar[Mapping[str, float]] = {
        **{"hip_pitch": 0.5, "hip": 0.2, "knee": 0.6, "ankle_pitch": 0.35, "ankle_roll": 0.15},
        **{"waist_yaw": 0.3, "waist_roll": 0.08, "waist_pitch": 0.2, **_RUNNING_ARMS},
    }
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {
        **dict.fromkeys(("hip_roll", "knee"), (139.0, 20.0, 0.5)),
        **dict.fromkeys(("hip_pitch", "hip_yaw", "waist_yaw"), (88.0, 32.0, 0.5)),
        **dict.fromkeys(("wrist_pitch", "wrist_yaw"), (5.0, 22.0, 0.05)),
        **dict.fromkeys(("waist", "ankle"), (50.0, 37.0, 0.2)),
        "": (25.0, 37.0, 0.2),
    }
    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 3.0, "azimuth": 120.0, "elevation": -15.0}
    ground: Terrain | None

    def model(self) -> Model:
        """Model of the robot G1 with servos on its ground."""
        return _scene(self.ground)


@dataclass(frozen=True, kw_only=True)
class G1Velocity(_G1, VelocityTask):
    """Velocity task of a humanoid with 29 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`)."""

    lowest = 0.45

    mass_scale: tuple[float, float] = (0.9, 1.1)


@dataclass(frozen=True, kw_only=True)
class G1Rough(_G1, RoughTask):
    """Rough-terrain task of a humanoid with 29 joints. It needs the robot's file of mjlab (`pip install --no-deps mjlab`).

    The reward leaves out mjlab's terms of angular momentum and self-collisions.
    """

    steepest = math.cos(math.radians(70.0))

    def rewards(self) -> Mapping[str, Reward]:
        """Terms of `RoughTask`, with a cost of the rates of turn about x and y."""
        return {**super().rewards(), "body_ang_vel": Reward(terms.body_ang_vel, -0.05)}


def _named(name: str, table: Mapping[str, float]) -> float:
    """Value of the first key of `table` that is a part of a joint's name; 0 if there is none."""
    return next((value for part, value in table.items() if part in name), 0.0)


def _geom(name: str) -> dict[str, str]:
    """MJCF attributes of a geom of G1 by name: only geoms of the feet have contacts."""
    is_foot = re.fullmatch(r"(left|right)_foot\d_collision", name) is not None
    touch = {"priority": "1", "friction": "0.6 0.005 0.0005", "condim": "3"} if is_foot else {}
    return {"contype": str(int(is_foot)), "rgba": "0.75 0.75 0.78 1", **touch}


def _servo(name: str) -> Servo:
    motor = next(motor for pattern, motor in _MOTORS.items() if re.search(pattern, name))
    return Servo(motor.inertia, motor.torque, _named(name, _STANCE))


@cache_model
def _scene(terrain: Terrain | None) -> Model:
    return scene(_FILE, "G1", _HEIGHT, terrain=terrain, geom=_geom, servo=_servo, light={"diffuse": "0.8 0.8 0.8"})

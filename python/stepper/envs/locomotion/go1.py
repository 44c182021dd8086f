"""Unitree's Go1 follows a commanded velocity, as locomotion people train it: randomised, pushed, with latency."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import load_quietly, read_once
from stepper.envs.locomotion import terrain
from stepper.envs.locomotion.velocity import VelocityTask, command
from stepper.envs.streams import Draws
from stepper.envs.task import Array, Camera, Moment, Terms, square_sum
from stepper.shared.machine import package_file

_FILE = "asset_zoo/robots/unitree_go1/xmls/go1.xml"
_HEIGHT = 0.278
"""Of the trunk at the beginning, m."""
_STANCE = {"hip": 0.1, "thigh": 0.9, "calf": -1.8}
"""Angles at the beginning, rad; hips point outwards."""
_ROTOR = 0.000111842
"""Inertia of a motor's rotor, kg m^2, from Unitree's description of the robot."""
_GEAR = {"hip": 6.0, "thigh": 6.0, "calf": 9.0}
_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Largest torques, N m."""
_FREQUENCY, _DAMPING_RATIO = 2.0 * np.pi * 10.0, 2.0
"""Of the servos with the inertia of the rotors alone, rad/s: from these mjlab takes their gains."""
_REACH = 0.5
"""A servo's set point is at most this many times what gives its largest torque away from the stance."""
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
    """A quadruped of 12 joints, mjlab's, whose package has to be installed (`pip install --no-deps mjlab`): only the file is read.

    Feet, trunk and head touch the ground, and no other part. Beside the terms of all such tasks, a foot that lands gains by its time in the
    air.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {
        "linear": 1.0,
        "angular": 0.5,
        "bounce": 0.5,
        "roll": 0.02,
        "tilt": 2.0,
        "pose": 0.1,
        "torque": 1e-4,
        "change": 0.05,
        "stride": 3.0,
    }
    lowest = 0.15
    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 2.0, "azimuth": 120.0, "elevation": -20.0}

    def model(self) -> Model:
        """The robot on a plane, or on rough ground, with servos."""
        return _scene(self.roughness)

    def memory(self, num_envs: int) -> Terms:
        """As of other robots, and how long each foot is in the air, and what those that landed gained."""
        return super().memory(num_envs) | {"air": np.zeros((num_envs, 4)), "stride": np.zeros(num_envs)}

    def terms(self, now: Moment) -> Terms:
        """As of other robots, and strides where the command is to move."""
        return super().terms(now) | {"stride": now.memory["stride"] * (square_sum(command(now)) > _STANDS**2)}

    def prepare(self, sim: Stepper, memory: Terms, mask: Array, draws: Draws) -> None:
        """Commands, pushes, latency and parameters; feet have not been in the air."""
        super().prepare(sim, memory, mask, draws)
        memory["air"][mask] = 0.0
        memory["stride"][mask] = 0.0

    def advance(self, now: Moment) -> None:
        """Makes the steps: those within the latency with the action before. Looks which feet landed."""
        super().advance(now)
        air, feet = now.memory["air"], now.sim.site_xpos[:, _feet(now.sim.model)]
        stands = feet[..., 2] - self.ground(feet[..., :2]) < _FOOT + _CLEAR
        landed = stands & (air > 0.0)
        now.memory["stride"][:] = np.where(landed, np.minimum(air, _LONGEST) - _SHORTEST, 0.0).sum(axis=1)
        air[:] = np.where(stands, 0.0, air + now.dt)


@functools.lru_cache(maxsize=8)
def _feet(model: Model) -> list[int]:
    """Sites in the middle of the feet."""
    return [k for k, name in enumerate(model.site_names) if name in ("FR", "FL", "RR", "RL")]


@read_once
def _scene(roughness: float) -> Model:
    """The robot of mjlab on the ground, without what it only looks like, with servos, rotors and stance as mjlab's own code says them."""
    file = Path(package_file("mjlab", _FILE, "for its Go1, whose file it has"))
    tree = ElementTree.fromstring(file.read_text("utf-8"))
    make = type(tree)
    for asset in tree.findall("asset"):
        tree.remove(asset)
    for parent in tree.iter():
        for child in list(parent):
            name = child.get("name", "")
            if child.tag in ("light", "camera") or child.get("class") == "visual":
                parent.remove(child)
            elif child.tag == "geom" and name:
                touches = name.endswith("foot_collision") or name in ("trunk_collision", "head_collision")
                # In group 0 renderers draw it: what the file has for them to draw is left out.
                child.attrib |= {"contype": str(int(touches)), "conaffinity": "0", "group": "0", "rgba": _GREY if touches else _LIGHT}
                if name.endswith("foot_collision"):
                    child.attrib |= {"priority": "1", "friction": "0.8 0.005 0.0005", "condim": "3"}
    tree.insert(0, make("option", timestep="0.005", integrator="implicitfast"))
    world = tree.find("worldbody")
    if world is None:
        raise ValueError(f"{file} has no worldbody: this version of mjlab is not known")
    world.insert(0, make("geom", name="floor", type="plane", size="0 0 0.05", contype="0", conaffinity="1", material="floor"))
    world.insert(0, make("light", directional="true", castshadow="false", pos="0 0 5", dir="0.3 0.2 -1"))
    looks = make("asset")
    looks.append(
        make("texture", name="squares", type="2d", builtin="checker", width="64", height="64", rgb1=".30 .35 .40", rgb2=".36 .41 .46")
    )
    looks.append(make("material", name="floor", texture="squares", texrepeat="2 2", texuniform="true"))
    tree.append(looks)
    if roughness:
        field, geom = terrain.elements(roughness, {"contype": "0", "conaffinity": "1", "material": "floor"})
        looks.append(field)
        world.insert(1, geom)
    actuators, angles = make("actuator"), []
    tree.append(actuators)
    for joint in tree.iter("joint"):
        name = joint.get("name", "")
        leg, kind, _ = name.split("_")
        inertia = _ROTOR * _GEAR[kind] ** 2
        stiffness = inertia * _FREQUENCY**2
        stance = _STANCE[kind] * (-1.0 if kind == "hip" and leg.endswith("L") else 1.0)
        reach = _REACH * _TORQUE[kind] / stiffness
        joint.set("armature", repr(inertia))
        servo = {"kp": stiffness, "kv": 2.0 * _DAMPING_RATIO * inertia * _FREQUENCY}
        bounds = {"ctrlrange": (stance - reach, stance + reach), "forcerange": (-_TORQUE[kind], _TORQUE[kind])}
        attributes = {key: repr(float(value)) for key, value in servo.items()}
        attributes |= {key: f"{float(low)!r} {float(high)!r}" for key, (low, high) in bounds.items()}
        actuators.append(make("position", {"name": name, "joint": name, **attributes}))
        angles.append(stance)
    keyframes = make("keyframe")
    qpos = " ".join(map(repr, (0.0, 0.0, _HEIGHT, 1.0, 0.0, 0.0, 0.0, *angles)))
    keyframes.append(make("key", name="stance", qpos=qpos, ctrl=" ".join(map(repr, angles))))
    tree.append(keyframes)
    return load_quietly(tree)

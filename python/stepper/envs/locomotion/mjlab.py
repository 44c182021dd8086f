"""Robots of mjlab. Only the robot's file of the installed package is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import load_quietly, without
from stepper.envs.locomotion import terrain
from stepper.envs.terrain import Terrain
from stepper.shared.machine import package_file

_FREQUENCY, _DAMPING_RATIO = 2.0 * np.pi * 10.0, 2.0
"""Natural frequency of the servos with the inertia of the rotors alone, rad/s: from these mjlab takes their gains."""
_REACH = 0.5
"""A servo's set point is at most this many times what gives its largest torque away from the stance."""


Ground: TypeAlias = Callable[[dict[str, str]], tuple[list[Element], list[Element]]]
"""Ground of a scene: assets and geoms, from the attributes of the geoms."""


@dataclass(frozen=True)
class Servo:
    """Motor and gear of a joint.

    Attributes:
        inertia: Inertia of the motor's rotors, reflected to the joint, kg m^2.
        torque: Largest torque, N m.
        stance: Initial angle, rad.
    """

    inertia: float
    torque: float
    stance: float


@dataclass(frozen=True)
class Looks:
    """Elements that only renderers read.

    Attributes:
        ground: Attributes of the ground's geoms.
        light: Attributes of the light.
        assets: Textures and materials.
    """

    ground: Mapping[str, str]
    light: Mapping[str, str]
    assets: Sequence[Element] = ()


def plain_ground(roughness: float) -> Ground:
    """Plane with bumps up to a height, m; 0 is flat ground."""

    def ground(attributes: dict[str, str]) -> tuple[list[Element], list[Element]]:
        floor = Element("geom", {"name": "floor", "type": "plane", "size": "0 0 0.05", **attributes})
        if not roughness:
            return [], [floor]
        field, surface = terrain.elements(roughness, attributes)
        return [field], [surface, floor]

    return ground


def tiled_ground(tiles: Terrain) -> Ground:
    """The height field of a generated terrain, the geom "terrain"."""

    def ground(attributes: dict[str, str]) -> tuple[list[Element], list[Element]]:
        field, surface = tiles.elements(**attributes)
        return [field], [surface]

    return ground


def scene(
    file: str,
    robot: str,
    height: float,
    *,
    ground: Ground,
    geom: Callable[[str], Mapping[str, str]],
    servo: Callable[[str], Servo],
    looks: Looks,
) -> Model:
    """Scene with a robot on the ground, without visual elements, with servos, rotors and a keyframe "stance".

    Args:
        file: File of the robot in mjlab's package.
        robot: Name of the robot in errors.
        height: Initial height of the base, m.
        ground: The ground, from the attributes of its geoms.
        geom: Attributes of a geom of the robot, by its name.
        servo: The servo of a joint, by its name.
        looks: Visual elements.
    """
    path = Path(package_file("mjlab", file, f"for its {robot}, whose file it has"))
    tree = ElementTree.fromstring(path.read_text("utf-8"))
    _strip(tree, geom)
    world = tree.find("worldbody")
    if world is None:
        raise ValueError(f"{path} has no worldbody: this version of mjlab is not known")
    tree.insert(0, Element("option", timestep="0.005", integrator="implicitfast"))
    fields, surfaces = ground({"contype": "0", "conaffinity": "1", **looks.ground})
    world[:0] = surfaces
    world.insert(0, Element("light", {"directional": "true", "castshadow": "false", "pos": "0 0 5", "dir": "0.3 0.2 -1", **looks.light}))
    assets = Element("asset")
    assets.extend(looks.assets)
    assets.extend(fields)
    tree.append(assets)
    _add_servos(tree, servo, height)
    return load_quietly(tree)


def _strip(tree: Element, geom: Callable[[str], Mapping[str, str]]) -> None:
    """Takes out what is drawn, and pairs that do not touch anyway; gives the other geoms their attributes."""
    for asset in tree.findall("asset"):
        tree.remove(asset)
    without(tree, lambda element: element.tag in ("light", "camera", "exclude") or element.get("class") == "visual")
    for element in tree.iter("geom"):
        if name := element.get("name", ""):
            # In group 0 renderers draw it: what the file has for them to draw is left out.
            element.attrib |= {"conaffinity": "0", "group": "0", **geom(name)}


def _add_servos(tree: Element, servo: Callable[[str], Servo], height: float) -> None:
    """Position actuators with the gains that mjlab takes, and the keyframe."""
    actuators, keyframes, angles = Element("actuator"), Element("keyframe"), []
    tree.extend([actuators, keyframes])
    for joint in tree.iter("joint"):
        name = joint.get("name", "")
        own = servo(name)
        stiffness = own.inertia * _FREQUENCY**2
        reach = _REACH * own.torque / stiffness
        joint.set("armature", repr(own.inertia))
        gains = {"kp": stiffness, "kv": 2.0 * _DAMPING_RATIO * own.inertia * _FREQUENCY}
        bounds = {"ctrlrange": (own.stance - reach, own.stance + reach), "forcerange": (-own.torque, own.torque)}
        attributes = {key: repr(float(value)) for key, value in gains.items()}
        attributes |= {key: f"{float(low)!r} {float(high)!r}" for key, (low, high) in bounds.items()}
        actuators.append(Element("position", {"name": name, "joint": name, **attributes}))
        angles.append(own.stance)
    qpos = " ".join(map(repr, (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0, *angles)))
    keyframes.append(Element("key", name="stance", qpos=qpos, ctrl=" ".join(map(repr, angles))))

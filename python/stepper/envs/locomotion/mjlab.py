"""Scenes with robots of mjlab. The package mjlab must be installed, but only the robot's model file is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import load_quietly, remove_elements
from stepper.envs.terrain import Terrain
from stepper.shared.machine import package_file

_FREQUENCY, _DAMPING_RATIO = 2.0 * np.pi * 10.0, 2.0
"""Natural frequency (rad/s) and damping ratio of a servo that moves only the reflected rotor inertia. mjlab's gains follow from them."""
_REACH = 1.0
"""Largest distance of a servo's set point from the joint angle of the stance. mjlab does not bound set points.

The unit is the distance between set point and joint angle at which the servo has its largest torque.
"""


@dataclass(frozen=True)
class Servo:
    """Position servo of a joint.

    Attributes:
        inertia: Inertia of the motor's rotors, reflected to the joint, kg m^2.
        torque: Largest torque, N m.
        stance: Initial angle, rad.
    """

    inertia: float
    torque: float
    stance: float


_SQUARES = {
    "name": "squares",
    "type": "2d",
    "builtin": "checker",
    "width": "64",
    "height": "64",
    "rgb1": ".22 .27 .32",
    "rgb2": ".44 .49 .54",
}
"""MJCF attributes of the texture of the ground. The contrast is large enough for films of 64 colours."""
_GROUND = {"name": "floor", "texture": "squares", "texrepeat": "2 2", "texuniform": "true"}
"""MJCF attributes of the material of the ground: squares of 0.5 m."""


def _ground(terrain: Terrain | None) -> tuple[list[Element], list[Element]]:
    """Asset and geom elements of the ground: a plane "floor", or a generated terrain in a geom "terrain"."""
    attributes = {"contype": "0", "conaffinity": "1", "material": "floor"}
    if terrain is None:
        return [], [Element("geom", {"name": "floor", "type": "plane", "size": "0 0 0.05", **attributes})]
    field, surface = terrain.elements(**attributes)
    return [field], [surface]


def scene(
    file: str,
    robot: str,
    height: float,
    *,
    terrain: Terrain | None,
    geom: Callable[[str], Mapping[str, str]],
    servo: Callable[[str], Servo],
    light: Mapping[str, str] | None = None,
) -> Model:
    """Model of a robot on the ground, without visual elements, with servos, reflected rotor inertias and a keyframe "stance".

    Args:
        file: File of the robot in mjlab's package.
        robot: Name of the robot in error messages.
        height: Initial height of the base, m.
        terrain: Terrain, which becomes the geom "terrain"; None is a plane.
        geom: Function from the name of a geom of the robot to its MJCF attributes.
        servo: Function from the name of a joint to its servo.
        light: Further MJCF attributes of the light; None adds none.
    """
    path = Path(package_file("mjlab", file, f"for its {robot}, whose file it has"))
    tree = ElementTree.fromstring(path.read_text("utf-8"))
    _strip(tree, geom)
    world = tree.find("worldbody")
    if world is None:
        raise ValueError(f"{path} has no worldbody: this version of mjlab is not supported")
    tree.insert(0, Element("option", timestep="0.005", integrator="implicitfast"))
    fields, surfaces = _ground(terrain)
    world[:0] = surfaces
    world.insert(0, Element("light", {"directional": "true", "castshadow": "false", "pos": "0 0 5", "dir": "0.3 0.2 -1", **(light or {})}))
    assets = Element("asset")
    assets.extend([Element("texture", _SQUARES), Element("material", _GROUND)])
    assets.extend(fields)
    tree.append(assets)
    _add_servos(tree, servo, height)
    return load_quietly(tree)


def _strip(tree: Element, geom: Callable[[str], Mapping[str, str]]) -> None:
    """Removes elements of a robot's MJCF tree that physics does not need, and sets the attributes of its geoms; the tree changes in place.

    Assets, lights, cameras, exclusions and elements of class "visual" are removed. Each named geom gets the attributes `geom(name)`.
    """
    for asset in tree.findall("asset"):
        tree.remove(asset)
    remove_elements(tree, lambda element: element.tag in ("light", "camera", "exclude") or element.get("class") == "visual")
    for element in tree.iter("geom"):
        if name := element.get("name", ""):
            # Renderers draw group 0. The collision geoms move there, because the visual geoms are removed.
            element.attrib |= {"conaffinity": "0", "group": "0", **geom(name)}


def _add_servos(tree: Element, servo: Callable[[str], Servo], height: float) -> None:
    """Adds position actuators with mjlab's gains to a robot's MJCF tree, and a keyframe "stance" with the base at `height`, m."""
    actuators, keyframes, angles = Element("actuator"), Element("keyframe"), []
    tree.extend([actuators, keyframes])
    for joint in tree.iter("joint"):
        name = joint.get("name", "")
        motor = servo(name)
        stiffness = motor.inertia * _FREQUENCY**2
        largest = _REACH * motor.torque / stiffness
        joint.set("armature", repr(motor.inertia))
        gains = {"kp": stiffness, "kv": 2.0 * _DAMPING_RATIO * motor.inertia * _FREQUENCY}
        bounds = {"ctrlrange": (motor.stance - largest, motor.stance + largest), "forcerange": (-motor.torque, motor.torque)}
        attributes = {key: repr(float(value)) for key, value in gains.items()}
        attributes |= {key: f"{float(low)!r} {float(high)!r}" for key, (low, high) in bounds.items()}
        actuators.append(Element("position", {"name": name, "joint": name, **attributes}))
        angles.append(motor.stance)
    qpos = " ".join(map(repr, (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0, *angles)))
    keyframes.append(Element("key", name="stance", qpos=qpos, ctrl=" ".join(map(repr, angles))))

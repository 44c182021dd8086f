"""Elements of a URDF: simulated ones, and others with the reasons why they are left out.

MuJoCo's parser reads some elements and silently drops the others. `READ` lists the elements and attributes that it reads. `LEFT_OUT` has a
reason for common elements that are not simulated. Any other element gets a separate line in the report.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from xml.etree import ElementTree

from stepper._stepper import ModelError
from stepper.loading.urdf_xml import parse, prefixed

Element = ElementTree.Element
Omission = dict[str, Any]

_ORIGIN = {"origin": {"xyz", "rpy"}}
_SHAPES = {
    "geometry": set[str](),
    "geometry/box": {"size"},
    "geometry/cylinder": {"radius", "length"},
    "geometry/capsule": {"radius", "length"},
    "geometry/sphere": {"radius"},
    "geometry/mesh": {"filename", "scale"},
}


def _under(path: str, children: dict[str, set[str]]) -> dict[str, set[str]]:
    return {f"{path}/{name}": attributes for name, attributes in children.items()}


READ: dict[str, set[str]] = {
    "robot": {"name", "version"},
    "robot/link": {"name"},
    "robot/link/inertial": set(),
    **_under("robot/link/inertial", _ORIGIN | {"mass": {"value"}, "inertia": {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}}),
    "robot/link/collision": {"name"},
    **_under("robot/link/collision", _ORIGIN | _SHAPES),
    "robot/joint": {"name", "type"},
    **_under("robot/joint", _ORIGIN | {"parent": {"link"}, "child": {"link"}, "axis": {"xyz"}}),
    "robot/joint/dynamics": {"damping", "friction"},
    "robot/joint/limit": {"lower", "upper", "effort", "velocity"},
    "robot/joint/mimic": {"joint", "multiplier", "offset"},
}
"""Attributes of every element that is simulated; the speed limit is kept in the model and not enforced."""

_OTHERS = "contact settings of another simulator are not read; set them with model.replace(geom_friction=...) and similar fields"
_ACTUATORS = 'stepper.load(..., actuators="position") adds actuators'

LEFT_OUT: dict[str, str] = {
    "robot/link/visual": "is drawn and does not collide",
    "robot/material": "is drawn",
    "robot/link/collision/material": "is drawn",
    "robot/joint/safety_controller": "belongs to the controller, and its soft limits are not enforced: clip the controls yourself",
    "robot/joint/calibration": "reference positions of encoders are not simulated",
    "robot/joint/joint_properties": "is not a URDF element and not read; use <dynamics damping= friction=>",
    "robot/transmission": "motors and gears are not read",
    "robot/ros2_control": "hardware interfaces are not read",
    "robot/sensor": "is not read; model.with_sensors(...) adds sensors",
    "robot/gazebo": "settings of Gazebo are not read",
    "robot/link/contact": _OTHERS,
    "robot/link/surface": _OTHERS,
    "robot/link/collision/surface": _OTHERS,
    "robot/link/collision_checking": "belongs to a motion planner",
    "robot/link/self_filter": "belongs to a perception program",
    "robot/deformable": "deformable bodies are not simulated",
}
"""Reason for every element that is left out with all that it contains."""

_UNKNOWN = "is not supported, and not read"
_DRIVES = ("URDF transmission", "URDF ros2_control")
"""Omissions for which the actuators of `load` are a substitute."""
_HIDDEN = frozenset({"robot/mujoco"})
"""Elements that MuJoCo's compiler reads and checks by itself."""
_FREE = ("continuous", "revolute", "prismatic")


@dataclass(frozen=True)
class Urdf:
    """URDF with its elements, for reading.

    Attributes:
        text: The file.
        place: Name of the URDF in messages.
    """

    text: str
    place: str

    @cached_property
    def root(self) -> Element | None:
        """Element `robot`; None if the text is not well-formed XML, which MuJoCo's parser may accept."""
        return parse(self.text)

    @cached_property
    def joints(self) -> dict[str, Element]:
        """Joints by name."""
        return {} if self.root is None else {joint.get("name", ""): joint for joint in self.root.findall("joint")}

    def number(self, joint: str, path: str, attribute: str) -> float | None:
        """Number of an attribute of a joint; None if it is absent.

        Raises:
            ModelError: It is not a number.
        """
        element = self.joints[joint].find(path)
        given = None if element is None else element.get(attribute)
        if given is None:
            return None
        try:
            value = float(given)
        except ValueError:
            value = math.nan
        if math.isnan(value):
            raise ModelError(f'{self.place}: joint "{joint}": {path} {attribute} is "{given}"; give a number')
        return value

    def speed_limit(self, joint: str) -> float | None:
        """Speed limit of a joint, rad/s or m/s; None without one. 0 counts as no limit, because exporters write it as a default."""
        return _bound(self.number(joint, "limit", "velocity"))

    def effort_limit(self, joint: str) -> float | None:
        """Largest force or torque of a joint's actuator, N or N m; None without a limit. 0 counts as no limit, and the sign is ignored."""
        return _bound(abs(self.number(joint, "limit", "effort") or 0.0))


def _bound(given: float | None) -> float | None:
    return given if given is not None and 0.0 < given < math.inf else None


def refuse_xacro(urdf: Urdf) -> None:
    """Raises a ModelError for a xacro template of a URDF, whose elements would be dropped silently."""
    elements = re.sub(r"<!--.*?-->", "", urdf.text, flags=re.DOTALL)
    if "<xacro:" in elements or re.search(r"=\s*[\"'][^\"']*\$[{(]", elements):
        raise ModelError(f"{urdf.place}: it is a template with xacro elements, not a URDF; expand it: xacro FILE > robot.urdf")


def omissions(urdf: Urdf, actuators: str | None = None) -> list[Omission]:
    """Elements of a URDF that the model lacks, as the Rust crate's `Omission`; `actuators` is the argument of `load`."""
    if urdf.root is None:
        reason = "the XML is not well-formed, so that unsupported elements cannot be listed; correct the file"
        return [_omission("URDF", urdf.place, reason)]
    found = [*_left_out(urdf.root, "robot", ""), *_masses(urdf.root), *_limits(urdf)]
    if actuators is None:
        found = [o | {"reason": f"{o['reason']}; {_ACTUATORS}"} if o["kind"] in _DRIVES else o for o in found]
    unique = {(o["kind"], o["name"], o["reason"]): o for o in found}
    return list(unique.values())


def _omission(kind: str, name: str, reason: str) -> Omission:
    return {"kind": kind, "name": name, "reason": reason, "changes_motion": False}


def _left_out(element: Element, path: str, owner: str) -> Iterator[Omission]:
    """Attributes and descendants of an element that are not simulated; `owner` is the name of the link or joint around it."""
    for attribute in element.attrib:
        if attribute not in READ[path]:
            yield _omission(f"URDF {element.tag} attribute {prefixed(attribute)}", owner or element.get("name", ""), _UNKNOWN)
    for child in element:
        # Comments and processing instructions have no name.
        if not isinstance(child.tag, str) or (inner := f"{path}/{child.tag}") in _HIDDEN:
            continue
        name = owner or child.get("name") or child.get("reference") or f"<{prefixed(child.tag)}>"
        if inner in READ:
            yield from _left_out(child, inner, name if inner in ("robot/link", "robot/joint") else owner)
        else:
            yield _omission(f"URDF {prefixed(child.tag)}", name, LEFT_OUT.get(inner, _UNKNOWN))


def _masses(robot: Element) -> Iterator[Omission]:
    """Inertias of links that are welded to the world."""
    joints = robot.findall("joint")
    ends = [(_end(joint, "parent"), _end(joint, "child"), joint.get("type")) for joint in joints]
    moved = {child for _, child, _ in ends}
    welded = {link.get("name", "") for link in robot.findall("link")} - moved
    while more := {child for parent, child, kind in ends if kind == "fixed" and parent in welded} - welded:
        welded |= more
    for link in robot.findall("link"):
        mass = link.find("inertial/mass")
        if link.get("name") in welded and mass is not None:
            reason = (
                "the link is welded to the world, so that its inertia has no effect; for a mobile robot add "
                '<link name="world"/> and a joint of type floating between them'
            )
            yield _omission("URDF inertial", f"{link.get('name')} ({mass.get('value', '?')} kg)", reason)


def _end(joint: Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _limits(urdf: Urdf) -> Iterator[Omission]:
    """Limits that are ignored or have no effect."""
    for name, joint in urdf.joints.items():
        kind, limit = joint.get("type"), joint.find("limit")
        low, high = (urdf.number(name, "limit", end) for end in ("lower", "upper"))
        if kind in ("revolute", "prismatic") and (low or 0.0) >= (high or 0.0):
            yield _omission("URDF range", name, f"from {low or 0:g} to {high or 0:g} is empty, so the joint has no limits")
        if kind == "continuous" and not (low is None and high is None):
            yield _omission("URDF range", name, "a continuous joint has no limits; make it revolute")
        if kind not in _FREE or limit is None:
            continue
        if limit.get("effort") is not None and urdf.effort_limit(name) is None:
            yield _omission("URDF effort limit", name, f"is {limit.get('effort')}, which counts as none: actuator forces are unbounded")
        if limit.get("velocity") is not None and urdf.speed_limit(name) is None:
            yield _omission("URDF velocity limit", name, f"is {limit.get('velocity')}, which counts as none")

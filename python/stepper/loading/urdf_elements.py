"""Elements of a URDF, and a list of those that are left out, with reasons.

MuJoCo's parser silently drops the elements that it does not read. `READ` lists the elements and attributes that are simulated. `LEFT_OUT`
has a reason for common elements that are not simulated. Other elements are listed as not supported.
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

_PREFIX = re.compile(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]")
_DECLARED = re.compile(r"xmlns:([\w.-]+)\s*=")


def parse(text: str) -> ElementTree.Element | None:
    """Element `robot` of a URDF; None if the text is not well-formed.

    Blank lines before the XML declaration, and prefixes without a declared namespace (`drake:acceleration`), are accepted.
    """
    text = text.lstrip()
    unbound = {prefix for prefix in _PREFIX.findall(text) if not prefix.lower().startswith("xml")} - set(_DECLARED.findall(text))
    declarations = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in sorted(unbound))
    try:
        return ElementTree.fromstring(re.sub(r"<robot\b", f"<robot{declarations}", text))
    except ElementTree.ParseError:
        return None


def prefixed(name: str) -> str:
    """Name of an element or attribute with its prefix, as in the file: "drake:acceleration" for "{drake}acceleration"."""
    namespace, _, local = name.rpartition("}")
    prefix = namespace.removeprefix("{")
    return f"{prefix}:{local}" if prefix and "/" not in prefix else local


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
    """Copy of the dictionary `children` with `path/` before each key."""
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
"""Elements of a URDF that stepper simulates, as paths, and their attributes.

The velocity limit is stored in the model, but not enforced.
"""

_CONTACT_SETTINGS = "contact settings of another simulator are not read; set them with model.replace(geom_friction=...) and similar fields"
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
    "robot/link/contact": _CONTACT_SETTINGS,
    "robot/link/surface": _CONTACT_SETTINGS,
    "robot/link/collision/surface": _CONTACT_SETTINGS,
    "robot/link/collision_checking": "belongs to a motion planner",
    "robot/link/self_filter": "belongs to a perception program",
    "robot/deformable": "deformable bodies are not simulated",
}
"""Reason why stepper leaves out a URDF element, by the element's path. Everything inside the element is left out, too."""

_UNKNOWN = "is not supported, and not read"
_DRIVES = ("URDF transmission", "URDF ros2_control")
"""Kinds of URDF elements that stepper leaves out and for which the argument `actuators` of `load` is a substitute.

If the argument is None, the reason for leaving such an element out suggests the argument.
"""
_MUJOCO_ELEMENTS = frozenset({"robot/mujoco"})
"""Elements that MuJoCo's compiler reads and checks, and that are therefore never listed."""
_MOVABLE = ("continuous", "revolute", "prismatic")


@dataclass(frozen=True)
class Urdf:
    """Parsed URDF.

    Attributes:
        text: Contents of the URDF.
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
        """Joint elements by name; empty if the XML is not well-formed."""
        return {} if self.root is None else {joint.get("name", ""): joint for joint in self.root.findall("joint")}

    def number(self, joint: str, path: str, attribute: str) -> float | None:
        """Value of an attribute of a joint's child element `path`; None if it is absent."""
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
        """Speed limit of a joint, rad/s or m/s; None without a limit. 0 counts as no limit, because exporters write it as a default."""
        return _bound(self.number(joint, "limit", "velocity"))

    def effort_limit(self, joint: str) -> float | None:
        """Largest force or torque of a joint's actuator, N or N m; None without a limit. 0 counts as no limit, and the sign is ignored."""
        return _bound(abs(self.number(joint, "limit", "effort") or 0.0))


def _bound(given: float | None) -> float | None:
    """Limit of a joint if it is positive and finite; otherwise None, which means no limit."""
    return given if given is not None and 0.0 < given < math.inf else None


def refuse_xacro(urdf: Urdf) -> None:
    """Raises a ModelError for a xacro template, because MuJoCo's parser would silently drop its xacro elements."""
    elements = re.sub(r"<!--.*?-->", "", urdf.text, flags=re.DOTALL)
    if "<xacro:" in elements or re.search(r"=\s*[\"'][^\"']*\$[{(]", elements):
        raise ModelError(f"{urdf.place}: the file is a xacro template, not a URDF; expand it: xacro FILE > robot.urdf")


def omissions(urdf: Urdf, actuators: str | None = None, *, free_base: bool = False) -> list[Omission]:
    """Elements and attributes of a URDF that stepper does not simulate, in the format of `Model.omitted`.

    Args:
        urdf: The URDF.
        actuators: Argument `actuators` of `load`. If it is None, the reasons for leaving out transmissions and ros2_control elements
            suggest setting it.
        free_base: Argument `free_base` of `load`. Without it, the inertia of links that are welded to the world has no effect.
    """
    if urdf.root is None:
        reason = "the XML is not well-formed, so that unsupported elements cannot be listed; correct the file"
        return [_omission("URDF", urdf.place, reason)]
    found = [*_left_out(urdf.root, "robot", ""), *([] if free_base else _masses(urdf.root)), *_limits(urdf)]
    if actuators is None:
        found = [o | {"reason": f"{o['reason']}; {_ACTUATORS}"} if o["kind"] in _DRIVES else o for o in found]
    unique = {(o["kind"], o["name"], o["reason"]): o for o in found}
    return list(unique.values())


def _omission(kind: str, name: str, reason: str) -> Omission:
    """Entry for `Model.omitted` about an element whose absence does not change the motion."""
    return {"kind": kind, "name": name, "reason": reason, "changes_motion": False}


def _left_out(element: Element, path: str, owner: str) -> Iterator[Omission]:
    """Yields an entry for each attribute and descendant of a URDF element that is not simulated."""
    for attribute in element.attrib:
        if attribute not in READ[path]:
            yield _omission(f"URDF {element.tag} attribute {prefixed(attribute)}", owner or element.get("name", ""), _UNKNOWN)
    for child in element:
        # Comments and processing instructions have a function as their tag.
        if not isinstance(child.tag, str) or (inner := f"{path}/{child.tag}") in _MUJOCO_ELEMENTS:
            continue
        name = owner or child.get("name") or child.get("reference") or f"<{prefixed(child.tag)}>"
        if inner in READ:
            yield from _left_out(child, inner, name if inner in ("robot/link", "robot/joint") else owner)
        else:
            yield _omission(f"URDF {prefixed(child.tag)}", name, LEFT_OUT.get(inner, _UNKNOWN))


def _masses(robot: Element) -> Iterator[Omission]:
    """Yields an entry for each link that has inertia and is welded to the world, so that the inertia has no effect."""
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
                "the link is welded to the world, so that its inertia has no effect; for a mobile robot pass "
                'free_base=True, or add <link name="world"/> and a joint of type floating between them'
            )
            yield _omission("URDF inertial", f"{link.get('name')} ({mass.get('value', '?')} kg)", reason)


def _end(joint: Element, which: str) -> str:
    """Name of the "parent" or "child" link of a joint, or "" if the joint does not name it."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _limits(urdf: Urdf) -> Iterator[Omission]:
    """Yields an entry for each joint limit of a URDF that is ignored.

    Ignored are empty ranges, ranges of continuous joints, and effort or velocity limits whose value stands for no limit.
    """
    for name, joint in urdf.joints.items():
        kind, limit = joint.get("type"), joint.find("limit")
        low, high = (urdf.number(name, "limit", end) for end in ("lower", "upper"))
        if kind in ("revolute", "prismatic") and (low or 0.0) >= (high or 0.0):
            yield _omission("URDF range", name, f"from {low or 0:g} to {high or 0:g} is empty, so the joint has no limits")
        if kind == "continuous" and not (low is None and high is None):
            yield _omission("URDF range", name, "a continuous joint has no limits; make it revolute")
        if kind not in _MOVABLE or limit is None:
            continue
        if limit.get("effort") is not None and urdf.effort_limit(name) is None:
            yield _omission("URDF effort limit", name, f"is {limit.get('effort')}, which counts as none: actuator forces are unbounded")
        if limit.get("velocity") is not None and urdf.speed_limit(name) is None:
            yield _omission("URDF velocity limit", name, f"is {limit.get('velocity')}, which counts as none")

"""Reading of a compiled `mujoco.MjModel`: its flags, names, and indices of the elements that the description keeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from stepper.loading.mjcf.actuators import TRN_JOINT, TRN_JOINT_IN_PARENT, reasons_to_omit

Description = dict[str, Any]

# MuJoCo's numbers, which do not change (mjtype.h); the tests compare them with the installed version's.
FREE, BALL, SLIDE, HINGE = range(4)
PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH, SDF = range(9)
VOLUMES: dict[int, Callable[[float, float, float], Description]] = {
    SPHERE: lambda x, _y, _z: {"Sphere": {"radius": x}},
    CAPSULE: lambda x, y, _z: {"Capsule": {"radius": x, "half_length": y}},
    ELLIPSOID: lambda x, y, z: {"Ellipsoid": {"radii": [x, y, z]}},
    CYLINDER: lambda x, y, _z: {"Cylinder": {"radius": x, "half_length": y}},
    BOX: lambda x, y, z: {"Box": {"half": [x, y, z]}},
}
"""Shape of a geom or site as a dictionary for the Rust library, from its three sizes (m), by MuJoCo's number of the shape."""
WRAP_JOINT, WRAP_PULLEY, WRAP_SITE = 1, 2, 3
CONNECT, WELD, JOINT, TENDON = range(4)
OBJ_BODY = 1
DISABLE = {
    "constraint": 1 << 0,
    "equality": 1 << 1,
    "frictionloss": 1 << 2,
    "limit": 1 << 3,
    "contact": 1 << 4,
    "spring": 1 << 5,
    "damper": 1 << 6,
    "gravity": 1 << 7,
    "clampctrl": 1 << 8,
    "actuation": 1 << 11,
    "refsafe": 1 << 12,
    "sensor": 1 << 13,
    "eulerdamp": 1 << 15,
}
ENABLE = {"override": 1 << 0}
"""Bits of MuJoCo's flags that take effect in stepper, by name: `DISABLE` in `opt.disableflags`, `ENABLE` in `opt.enableflags`."""
_CONSTRAINTS = ("contact", "limit", "frictionloss", "equality")
"""Features that the flag "constraint" disables too."""


class Rows:
    """Arrays of a compiled `mujoco.MjModel` as Python lists, by name. A list is made at its first use.

    Reading an entry of a list takes a tenth of the time that reading an entry of an array takes. Scenes can have a hundred thousand geoms.
    """

    def __init__(self, m: Any):
        self._m = m

    def __getattr__(self, name: str) -> Any:
        """List with the entries of an array of the model."""
        rows = getattr(self._m, name).tolist()
        setattr(self, name, rows)
        return rows


@dataclass
class Source:
    """Compiled `mujoco.MjModel`, with the list of its elements that the conversion to stepper leaves out.

    Attributes:
        m: The `mujoco.MjModel`.
        omitted: Elements that were left out so far, as the Rust crate's `Omission`.
    """

    m: Any
    omitted: list[Description] = field(default_factory=list)

    @cached_property
    def mujoco(self) -> Any:
        """The Python module `mujoco`."""
        return import_module("mujoco")

    @cached_property
    def rows(self) -> Rows:
        """Arrays of the model as lists."""
        return Rows(self.m)

    @cached_property
    def _kinds(self) -> dict[str, int]:
        """Numbers of the kinds of elements, by name without the prefix "mjOBJ_"."""
        return {name.removeprefix("mjOBJ_"): int(kind) for name, kind in self.mujoco.mjtObj.__members__.items()}

    def name(self, kind: str, index: int) -> str:
        """Name of an element, for example `name("JOINT", 3)`; an empty string if the element has no name."""
        return str(self.mujoco.mj_id2name(self.m, self._kinds[kind], index) or "")

    def label(self, kind: str, index: int) -> str:
        """Name of an element, or its index in the form "#3" if it has no name."""
        return self.name(kind, index) or f"#{index}"

    @cached_property
    def _disabled(self) -> frozenset[str]:
        """Features that the model's flags disable."""
        flags = int(self.m.opt.disableflags)
        disabled = {feature for feature, bit in DISABLE.items() if flags & bit}
        return frozenset(disabled | set(_CONSTRAINTS if "constraint" in disabled else ()))

    def off(self, feature: str) -> bool:
        """Whether the model's flags disable a feature, which is one of the keys of `DISABLE`."""
        return feature in self._disabled

    def leave_out(self, kind: str, name: str, reason: str, *, changes_motion: bool = True) -> None:
        """Adds an element to the list `omitted` of elements that stepper does not simulate.

        Args:
            kind: Kind of the element, such as "actuator".
            name: Name of the element.
            reason: Reason why it is left out.
            changes_motion: Whether the motion differs from MuJoCo's without it.
        """
        self.omitted.append({"kind": kind, "name": name, "reason": reason, "changes_motion": changes_motion})

    @cached_property
    def overrides(self) -> bool:
        """Whether `option/flag override` is enabled: friction, margin and softness of the options then apply to all contacts."""
        return bool(int(self.m.opt.enableflags) & ENABLE["override"])

    @property
    def collides(self) -> bool:
        """Whether contacts are enabled, and any geom or explicit contact pair can have a contact."""
        m = self.m
        return bool(np.any(m.geom_contype) or np.any(m.geom_conaffinity) or m.npair) and not self.off("contact")

    @property
    def skips_passive_forces(self) -> bool:
        """Whether fluid forces and gravity compensation are off: MuJoCo skips both if springs and dampers are both disabled."""
        return self.off("spring") and self.off("damper")

    def dofs(self, joint: int) -> slice:
        """Indices of the degrees of freedom of a joint, as a slice of `qvel`."""
        start = self.rows.jnt_dofadr[joint]
        return slice(start, start + (6, 3, 1, 1)[self.rows.jnt_type[joint]])

    def is_hinge_or_slide(self, joint: int) -> bool:
        """Whether a joint is a hinge or slide, with one degree of freedom."""
        return self.rows.jnt_type[joint] in (SLIDE, HINGE)

    def is_fixed(self, tendon: int) -> bool:
        """Whether a tendon is fixed, a linear combination of joint positions; other tendons are spatial."""
        return bool(self.m.wrap_type[self.m.tendon_adr[tendon]] == WRAP_JOINT)

    def reason_to_omit_equality(self, equality: int) -> str:
        """Reason why stepper cannot simulate an equality constraint; an empty string if it can."""
        known = int(self.m.eq_type[equality]) in (CONNECT, WELD, JOINT, TENDON)
        return "" if known else "constraints of deformable bodies are not simulated"

    @cached_property
    def equalities(self) -> list[int]:
        """Indices in MuJoCo's model of the equality constraints that stepper simulates."""
        return [] if self.off("equality") else [i for i in range(self.m.neq) if not self.reason_to_omit_equality(i)]

    @cached_property
    def solid_assets(self) -> dict[str, list[int]]:
        """Indices of the meshes ("MESH") and height fields ("HFIELD") that must be read, in ascending order.

        A mesh or height field must be read if one of its geoms can have contacts or be met by the ray of a range finder. Others are only
        drawn.
        """
        m = self.m
        solid = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
        solid[m.pair_geom1] = solid[m.pair_geom2] = True
        kinds = {"MESH": (MESH, SDF), "HFIELD": (HFIELD,)}
        if self.off("contact"):
            solid[:] = False
        finder, site = int(self.mujoco.mjtSensor.mjSENS_RANGEFINDER), int(self.mujoco.mjtObj.mjOBJ_SITE)
        for at in m.sensor_objid[(m.sensor_type == finder) & (m.sensor_objtype == site)].tolist():
            solid[self.geoms_visible_from(at)] = True
        return {kind: sorted({int(i) for i in m.geom_dataid[solid & np.isin(m.geom_type, types)]}) for kind, types in kinds.items()}

    def geoms_visible_from(self, site: int) -> list[int]:
        """Indices of the geoms that rays from a site can meet: geoms of other bodies that are not fully transparent."""
        m = self.m
        of_material = np.where(m.geom_matid >= 0, m.mat_rgba[m.geom_matid, 3] if m.nmat else 0, 0)
        visible = (m.geom_rgba[:, 3] != 0) | (of_material != 0)
        return [int(g) for g in np.flatnonzero(visible & (m.geom_bodyid != m.site_bodyid[site]))]

    @cached_property
    def joint_actuators(self) -> dict[int, list[int]]:
        """Indices of the actuators that act on each joint, by joint; empty for ball and free joints."""
        m = self.m
        found: dict[int, list[int]] = {joint: [] for joint in range(m.njnt)}
        for a in range(m.nactuator):
            if int(m.actuator_trntype[a]) in (TRN_JOINT, TRN_JOINT_IN_PARENT) and self.is_hinge_or_slide(int(m.actuator_trnid[a, 0])):
                found[int(m.actuator_trnid[a, 0])].append(a)
        return found

    def gear(self, actuator: int) -> float:
        """First entry of the gear (`actuator_gear`) of an actuator with one output."""
        return float(self.m.actuator_gear[self.m.actuator_outadr[actuator], 0])

    @cached_property
    def actuators(self) -> list[int]:
        """Indices in MuJoCo's model of the actuators that stepper simulates."""
        return [a for a in range(self.m.nactuator) if not reasons_to_omit(self, a)]

"""A compiled `mujoco.MjModel` as a plain description: the fields of the Rust crate's `Description` (crates/model/src/description.rs).

Each kind of element has a function. `stepper.loading.mjcf.omissions` lists elements without a description. The table in that
module marks every field of MjModel as used, without effect on the motion, or left out.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from stepper.loading.mjcf.actuators import activation, actuator
from stepper.loading.mjcf.omissions import list_omissions
from stepper.loading.mjcf.requested import (
    contact_softness,
    equality_softness,
    joint_softness,
    pair_softness,
    requested,
    soft_settings,
    tendon_softness,
)
from stepper.loading.mjcf.sensors import sensors, sites
from stepper.loading.mjcf.source import (
    CAPSULE,
    CONNECT,
    CYLINDER,
    HFIELD,
    JOINT,
    OBJ_BODY,
    PLANE,
    SPHERE,
    VOLUMES,
    WELD,
    WRAP_PULLEY,
    WRAP_SITE,
    Description,
    Source,
)


def describe(m: Any) -> Description:
    """Description of a compiled model.

    Args:
        m: A `mujoco.MjModel`.

    Returns:
        Argument of `Model.from_description`. Vertices, faces and heights are arrays, some of which share memory with `m`. The value of
        "omitted" lists the elements of `m` that the description leaves out.
    """
    source = Source(m)
    list_omissions(source)
    return {
        "name": m.names.split(b"\0", 1)[0].decode(),
        "timestep": float(m.opt.timestep),
        "gravity": [0.0, 0.0, 0.0] if source.off("gravity") else m.opt.gravity.tolist(),
        "magnetic": m.opt.magnetic.tolist(),
        "medium": _medium(source),
        "explicit_damping": source.off("eulerdamp"),
        "bodies": [_body(source, i) for i in range(m.nbody)],
        "joints": [_joint(source, i) for i in range(m.njnt)],
        "geoms": [_geom(source, i) for i in range(m.ngeom)],
        "meshes": [_mesh(source, i) for i in source.solid_assets["MESH"]],
        "height_fields": [_height_field(source, i) for i in source.solid_assets["HFIELD"]],
        "pairs": [] if source.off("contact") else [_pair(source, i) for i in range(m.npair)],
        "excludes": [[int(s) >> 16, int(s) & 0xFFFF] for s in m.exclude_signature],
        "tendons": [_tendon(source, i) for i in range(m.ntendon)],
        "equalities": [_equality(source, i) for i in source.equalities],
        "actuators": [actuator(source, i) for i in source.actuators],
        "sites": sites(source),
        "sensors": list(sensors(source)),
        "keyframes": [_keyframe(source, i) for i in range(m.nkey)],
        "qpos0": m.qpos0.tolist(),
        "qpos_spring": m.qpos_spring.tolist(),
        "omitted": source.omitted,
        "soft": soft_settings(source),
        "requested": requested(source),
    }


def _body(source: Source, i: int) -> Description:
    """Body as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    rows = source.rows
    return {
        "name": source.name("BODY", i),
        "parent": rows.body_parentid[i],
        "pos": rows.body_pos[i],
        "quat": rows.body_quat[i],
        "mass": rows.body_mass[i],
        "ipos": rows.body_ipos[i],
        "iquat": rows.body_iquat[i],
        "inertia": rows.body_inertia[i],
        "mocap": rows.body_mocapid[i] >= 0,
        "gravcomp": 0.0 if source.skips_passive_forces else rows.body_gravcomp[i],
    }


def _medium(source: Source) -> Description:
    """Density, viscosity and wind of the surrounding fluid as a dictionary for the Rust library."""
    opt = source.m.opt
    if source.skips_passive_forces:
        return {"density": 0.0, "viscosity": 0.0, "wind": [0.0, 0.0, 0.0]}
    return {"density": float(opt.density), "viscosity": float(opt.viscosity), "wind": opt.wind.tolist()}


def _joint(source: Source, i: int) -> Description:
    """Joint as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    rows = source.rows
    dof = source.dofs(i).start
    # Like MuJoCo, add rotor inertia and damping of the actuators, times gear^2, to those of the joint.
    # `min` keeps the square finite: a gear that is too large is reported as an error of the model elsewhere.
    gears = [(a, min(source.gear(a) * source.gear(a), sys.float_info.max)) for a in source.joint_actuators[i]]
    damping = rows.dof_damping[dof] + sum(g * float(source.m.actuator_damping[a]) for a, g in gears)
    return {
        "name": source.name("JOINT", i),
        "body": rows.jnt_bodyid[i],
        "kind": ("Free", "Ball", "Slide", "Hinge")[rows.jnt_type[i]],
        "pos": rows.jnt_pos[i],
        "axis": rows.jnt_axis[i],
        "stiffness": 0.0 if source.off("spring") else rows.jnt_stiffness[i],
        "damping": 0.0 if source.off("damper") else damping,
        "armature": rows.dof_armature[dof] + sum(g * float(source.m.actuator_armature[a]) for a, g in gears),
        "frictionloss": 0.0 if source.off("frictionloss") else rows.dof_frictionloss[dof],
        "range": _joint_range(source, i),
        "actuator_force_range": rows.jnt_actfrcrange[i] if rows.jnt_actfrclimited[i] else None,
        **joint_softness(source, i),
    }


def _joint_range(source: Source, i: int) -> list[float] | None:
    """Lower and upper limit of a joint, rad or m; None if the joint has no active limits.

    Both limits are moved inwards by the joint's `margin`, because MuJoCo applies limit forces already at that distance from a limit.
    """
    rows = source.rows
    if not rows.jnt_limited[i] or source.off("limit"):
        return None
    low, high = rows.jnt_range[i]
    margin = rows.jnt_margin[i]
    # A ball joint has only an upper limit, on its angle.
    return [low + margin if source.is_hinge_or_slide(i) else low, high - margin]


def _geom(source: Source, i: int) -> Description:
    """Geom as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    opt, rows = source.m.opt, source.rows
    collides = not source.off("contact")
    return {
        "name": source.name("GEOM", i),
        "body": rows.geom_bodyid[i],
        "shape": _shape(source, i),
        "pos": rows.geom_pos[i],
        "quat": rows.geom_quat[i],
        "contype": rows.geom_contype[i] & 0xFFFFFFFF if collides else 0,
        "conaffinity": rows.geom_conaffinity[i] & 0xFFFFFFFF if collides else 0,
        "condim": rows.geom_condim[i],
        "priority": rows.geom_priority[i],
        "friction": opt.o_friction[[0, 2, 3]].tolist() if source.overrides else rows.geom_friction[i],
        "restitution": 0.0,  # MJCF has no restitution: its contacts are springs and dampers
        # The margin of a contact is the sum of the margins of its two geoms.
        "margin": float(opt.o_margin / 2) if source.overrides else rows.geom_margin[i],
        "gap": rows.geom_gap[i],
        "surface_velocity": rows.geom_surfacevel[i],
        "fluid": _ellipsoid(source, i),
        **contact_softness(source, i),
    }


def _ellipsoid(source: Source, i: int) -> Description | None:
    """Coefficients of MuJoCo's ellipsoid fluid model for a geom, in the order of `geom_fluid`; None if the geom does not use that model."""
    x, kind, (a, b, c) = source.rows.geom_fluid[i], source.rows.geom_type[i], source.rows.geom_size[i]
    if x[0] <= 0:
        return None
    axes = {SPHERE: [a, a, a], CAPSULE: [a, a, b + a], CYLINDER: [a, a, b]}.get(kind, [a, b, c])
    names = ("share", "blunt_drag", "slender_drag", "angular_drag", "kutta_lift", "magnus_lift")
    return {**dict(zip(names, x, strict=False)), "virtual_mass": x[6:9], "virtual_inertia": x[9:12], "axes": axes}


def _shape(source: Source, i: int) -> str | Description:
    """Shape of a geom as a name or dictionary for the Rust library; `i` is the geom's index in MuJoCo's model."""
    rows = source.rows
    kind, asset = rows.geom_type[i], rows.geom_dataid[i]
    if kind == PLANE:
        return "Plane"
    if kind in VOLUMES:
        return VOLUMES[kind](*rows.geom_size[i])
    if kind == HFIELD:
        return {"HeightField": {"asset": source.label("HFIELD", asset)}}
    return {"Mesh": {"asset": source.label("MESH", asset), "concave": False}}


def _mesh(source: Source, i: int) -> Description:
    """Mesh asset as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    m = source.m
    vertices = slice(int(m.mesh_vertadr[i]), int(m.mesh_vertadr[i] + m.mesh_vertnum[i]))
    faces = slice(int(m.mesh_faceadr[i]), int(m.mesh_faceadr[i] + m.mesh_facenum[i]))
    return {
        "name": source.label("MESH", i),
        "vertices": m.mesh_vert[vertices],
        "faces": m.mesh_face[faces],
    }


def _height_field(source: Source, i: int) -> Description:
    """Height field asset as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    m = source.m
    rows, columns = int(m.hfield_nrow[i]), int(m.hfield_ncol[i])
    x, y, top, base = m.hfield_size[i].tolist()
    start = int(m.hfield_adr[i])
    # MuJoCo stores heights in single precision, as fractions of the largest elevation.
    heights = m.hfield_data[start : start + rows * columns].astype(float) * top
    return {
        "name": source.label("HFIELD", i),
        "shape": [rows, columns],
        "half": [x, y],
        "elevation": heights,
        "base": base,
    }


def _pair(source: Source, i: int) -> Description:
    """Explicit contact pair as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    m = source.m
    return {
        "name": source.name("PAIR", i),
        "geoms": [int(m.pair_geom1[i]), int(m.pair_geom2[i])],
        "condim": int(m.pair_dim[i]),
        "friction": (m.opt.o_friction if source.overrides else m.pair_friction[i])[[0, 2, 3]].tolist(),
        "restitution": 0.0,
        "margin": float(m.opt.o_margin if source.overrides else m.pair_margin[i]),
        "gap": float(m.pair_gap[i]),
        **pair_softness(source, i),
    }


def _tendon(source: Source, i: int) -> Description:
    """Tendon as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    m = source.m
    fixed = source.is_fixed(i)
    elements = range(int(m.tendon_adr[i]), int(m.tendon_adr[i] + m.tendon_num[i]))
    limited = bool(m.tendon_limited[i]) and not source.off("limit")
    low, high = m.tendon_range[i].tolist()
    margin = float(m.tendon_margin[i])
    return {
        "name": source.name("TENDON", i),
        "joints": [[int(m.wrap_objid[k]), float(m.wrap_prm[k])] for k in elements] if fixed else [],
        "path": [] if fixed else [_path_element(source, k) for k in elements],
        "range": [low + margin, high - margin] if limited else None,
        "stiffness": 0.0 if source.off("spring") else float(m.tendon_stiffness[i]),
        "spring_length": m.tendon_lengthspring[i].tolist(),
        "damping": 0.0 if source.off("damper") else float(m.tendon_damping[i]),
        "armature": float(m.tendon_armature[i]),
        "frictionloss": 0.0 if source.off("frictionloss") else float(m.tendon_frictionloss[i]),
        **tendon_softness(source, i),
    }


def _path_element(source: Source, k: int) -> Description:
    """Element of the path of a spatial tendon as a dictionary for the Rust library; `k` is the index in MuJoCo's list of all elements."""
    m, kind, target, parameter = source.m, int(source.m.wrap_type[k]), int(source.m.wrap_objid[k]), float(source.m.wrap_prm[k])
    if kind == WRAP_PULLEY:
        return {"Pulley": parameter}
    if kind == WRAP_SITE:
        return {"Site": target}
    side = round(parameter)
    return {"Wrap": {"geom": target, "side": side if 0 <= side < m.nsite else None}}


def _equality(source: Source, i: int) -> Description:
    """Equality constraint as a dictionary for the Rust library; `i` is the index in MuJoCo's model."""
    m, kind = source.m, int(source.m.eq_type[i])
    data, objects = m.eq_data[i].tolist(), [int(m.eq_obj1id[i]), int(m.eq_obj2id[i])]
    if kind in (CONNECT, WELD):
        shape = _points(source, i, data, objects)
    else:
        first, other = "joint" if kind == JOINT else "tendon", objects[1]
        shape = {first: objects[0], "other": objects[1] if other >= 0 else None, "polycoef": data[:5]}
    return {
        "name": source.name("EQUALITY", i),
        "kind": {("Connect", "Weld", "Joint", "Tendon")[kind]: shape},
        "active": bool(m.eq_active0[i]),
        "stiffness": np.inf,  # equalities are springs and dampers in MJCF, and rigid here
        "damping": 0.0,
        **equality_softness(source, i),
    }


def _points(source: Source, i: int, data: list[float], objects: list[int]) -> Description:
    """Bodies and anchors of a connect or weld, and the relative orientation of a weld, as a dictionary for the Rust library.

    For an equality between sites, these are the bodies of the sites and the positions and orientations of the sites in their bodies.
    """
    m, weld = source.m, int(source.m.eq_type[i]) == WELD
    anchors, relpose = ([data[3:6], data[0:3]] if weld else [data[0:3], data[3:6]]), np.array(data[6:10])
    if int(m.eq_objtype[i]) != OBJ_BODY:
        anchors, back = [m.site_pos[s].tolist() for s in objects], np.zeros(4)
        # Both sites have the same orientation in the world: q_body1 q_site1 = q_body2 q_site2.
        source.mujoco.mju_negQuat(back, m.site_quat[objects[1]])
        source.mujoco.mju_mulQuat(relpose, m.site_quat[objects[0]], back)
        objects = [int(m.site_bodyid[s]) for s in objects]
    shape: Description = {"bodies": objects, "anchors": anchors}
    return shape | {"relpose": relpose.tolist(), "torquescale": data[10]} if weld else shape


def _keyframe(source: Source, i: int) -> Description:
    """Keyframe as a dictionary for the Rust library, without controls and activations of actuators that are left out."""
    m = source.m
    qpos = np.array(m.key_qpos[i])
    source.mujoco.mj_normalizeQuat(m, qpos)
    active = [a for a in source.actuators if activation(source, a) != "None"]
    return {
        "name": source.name("KEY", i),
        "time": float(m.key_time[i]),
        "qpos": qpos.tolist(),
        "qvel": m.key_qvel[i].tolist(),
        "act": [float(m.key_act[i, m.actuator_actadr[a]]) for a in active],
        "ctrl": [float(m.key_ctrl[i, m.actuator_ctrladr[a]]) for a in source.actuators],
    }

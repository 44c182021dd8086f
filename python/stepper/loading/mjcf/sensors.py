"""Description of the sites and sensors of a compiled `mujoco.MjModel` (the Rust type is in crates/model/src/sensor.rs).

`docs/reference/sensors.md` lists which sensor types of MuJoCo are simulated and how their readings differ. A test compares this page and
the tables in this module with the installed version of MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stepper.loading.mjcf.actuators import CUBIC, PREVIOUS, delay_in_buffer, is_whole
from stepper.loading.mjcf.source import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SDF, SPHERE, VOLUMES, Description, Source
from stepper.shared.sensor_words import ACTUATORS, FRAMES, JOINTS, PROXIMITIES, SCENE, SITES, SUBTREES, TENDONS

RAY_FIELDS = ("Distance", "Direction", "Origin", "Point")
CONTACT_FIELDS = ("Found", "Force", "Torque", "Distance", "Pos", "Normal", "Tangent")
"""Names in the Rust library of the data fields of range finders and of contact sensors, in the order of MuJoCo's bits."""
REDUCTIONS = ("None", "MinDistance", "MaxForce", "NetForce")
"""Names in the Rust library of the reductions of contact sensors, by MuJoCo's number."""

MISSING = {
    "camprojection": "cameras are not part of the model",
    "tactile": "pressure on a mesh is not simulated",
    "plugin": "plugins of MuJoCo do not run here",
    "user": "callbacks of MuJoCo do not run here",
}
"""Reason why a type of sensor is not simulated, by its name in MJCF."""


class _NotReadError(Exception):
    """Error for a sensor that stepper does not simulate; the message is the reason."""


def kind_of(source: Source, i: int) -> str:
    """Type of a sensor as named in MJCF, for example "jointpos"; `i` is the sensor's index in MuJoCo's model."""
    return str(source.mujoco.mjtSensor(int(source.m.sensor_type[i])).name).removeprefix("mjSENS_").lower()


def sites(source: Source) -> list[Description]:
    """Descriptions of all sites as dictionaries for the Rust library, in the order of MuJoCo's model."""
    rows = source.rows
    return [
        {
            "name": source.name("SITE", i),
            "body": rows.site_bodyid[i],
            "pos": rows.site_pos[i],
            "quat": rows.site_quat[i],
            "shape": VOLUMES[rows.site_type[i]](*rows.site_size[i]),
        }
        for i in range(source.m.nsite)
    ]


def sensors(source: Source) -> Iterator[Description]:
    """Yields dictionaries for the Rust library of the sensors that are simulated, and adds the others to `source.omitted`."""
    m = source.m
    for i in range(m.nsensor):
        word, name = kind_of(source, i), source.label("SENSOR", i)
        if source.off("sensor"):
            source.leave_out(f"sensor {word}", name, "sensors are disabled by the model's flags", changes_motion=False)
            continue
        try:
            kind = _kind(source, i, word)
        except _NotReadError as reason:
            source.leave_out(f"sensor {word} without reading", name, str(reason), changes_motion=False)
            continue
        yield {
            "name": source.name("SENSOR", i),
            "kind": kind,
            "noise": float(m.sensor_noise[i]),
            "cutoff": float(m.sensor_cutoff[i]),
            **_history(source, i, word, name),
        }


def _history(source: Source, i: int, word: str, name: str) -> Description:
    """Delay and sampling interval of a sensor, s, as a dictionary for the Rust library.

    A delayed reading between two steps is interpolated linearly, except if the sensor has an interval. Therefore a sensor that uses the
    previous sample (`PREVIOUS`) gets an interval of one step if its delay is no whole number of steps.
    """
    m, step = source.m, float(source.m.opt.timestep)
    samples, between = (int(x) for x in m.sensor_history[i])
    interval, phase = (float(x) for x in m.sensor_interval[i])
    # Without a buffer of samples, MuJoCo reads the sensor in every step.
    interval = interval if samples else 0.0
    delay = delay_in_buffer(float(m.sensor_delay[i]), samples, interval or step, step)
    if phase:
        source.leave_out(
            f"sensor {word} phase",
            name,
            "the phase of the sampling is not simulated: the first sample is at the reset",
            changes_motion=False,
        )
    if delay and interval and between != PREVIOUS:
        reason = "samples are not interpolated: the reading is the previous sample"
        source.leave_out(f"sensor {word} interpolation", name, reason, changes_motion=False)
    elif delay and between == CUBIC and not is_whole(delay, step):
        reason = "delayed readings are interpolated linearly, not with a cubic polynomial"
        source.leave_out(f"sensor {word} interpolation", name, reason, changes_motion=False)
    if delay < float(m.sensor_delay[i]) and not is_whole((samples - 1) * interval, step):
        reason = "the oldest sample in the buffer is younger than the delay, no whole number of steps: readings may be a sample too late"
        source.leave_out(f"sensor {word} buffer", name, reason, changes_motion=False)
    if delay and between == PREVIOUS and not is_whole(delay, step):
        interval = interval or step
    return {"delay": delay, "interval": interval}


def _kind(source: Source, i: int, word: str) -> str | Description:
    """Measured quantity of a sensor, as a name or dictionary for the Rust library; a `_NotReadError` if it is not supported."""
    target = int(source.m.sensor_objid[i])
    if word in MISSING:
        raise _NotReadError(MISSING[word])
    if word.startswith("joint") and not source.is_hinge_or_slide(target):
        raise _NotReadError("limits of ball joints have no sensor yet")
    if word in ("force", "torque") and (loop := _loop(source, int(source.m.site_bodyid[target]))):
        raise _NotReadError(f"the equality {loop} also holds the bodies behind the sensor, and the sensor would lack its force")
    if word in SCENE:
        return SCENE[word]
    if word in (plain := JOINTS | SITES | SUBTREES):
        return {plain[word]: target}
    if word in TENDONS:
        return {TENDONS[word]: target}
    if word in ACTUATORS:
        if target not in source.actuators:
            raise _NotReadError(f"the actuator {source.label('ACTUATOR', target)} is left out")
        return {ACTUATORS[word]: source.actuators.index(target)}
    if word in FRAMES:
        return _frame(source, i, FRAMES[word])
    return {"insidesite": _inside, "rangefinder": _range, "contact": _contact}.get(word, _proximity)(source, i)


def _loop(source: Source, body: int) -> str | None:
    """Label of an active connect or weld between the subtree of a body and the rest of the model; None if there is none."""
    m = source.m
    carried = np.zeros(m.nbody, bool)
    carried[body] = True
    for b in range(body + 1, m.nbody):
        carried[b] = carried[m.body_parentid[b]]
    points = {int(source.mujoco.mjtEq.mjEQ_CONNECT), int(source.mujoco.mjtEq.mjEQ_WELD)}
    for i in source.equalities:
        if int(m.eq_type[i]) in points and m.eq_active0[i]:
            ends = np.array([m.eq_obj1id[i], m.eq_obj2id[i]])
            first, second = carried[ends if m.eq_objtype[i] == source.mujoco.mjtObj.mjOBJ_BODY else m.site_bodyid[ends]]
            if first != second:
                return source.label("EQUALITY", i)
    return None


def _frame(source: Source, i: int, what: str) -> Description:
    """Dictionary for the Rust library of a sensor that measures the frame of an object, such as its position or orientation."""
    m, reference = source.m, None
    if m.sensor_refid[i] >= 0 and what not in ("LinAcc", "AngAcc"):
        reference = _object(source, int(m.sensor_reftype[i]), int(m.sensor_refid[i]))
    return {"Frame": {"what": what, "object": _object(source, int(m.sensor_objtype[i]), int(m.sensor_objid[i])), "reference": reference}}


def _inside(source: Source, i: int) -> Description:
    """Dictionary for the Rust library of an insidesite sensor; `i` is the index in MuJoCo's model."""
    m = source.m
    found = _object(source, int(m.sensor_objtype[i]), int(m.sensor_objid[i]))
    return {"InsideSite": {"object": found, "site": int(m.sensor_refid[i])}}


def _object_types(source: Source) -> dict[int, str]:
    """Name in the Rust library of each type of object that has a frame, by MuJoCo's number of the type."""
    objects = source.mujoco.mjtObj
    return {
        int(objects.mjOBJ_BODY): "Body",
        int(objects.mjOBJ_XBODY): "XBody",
        int(objects.mjOBJ_GEOM): "Geom",
        int(objects.mjOBJ_SITE): "Site",
    }


def _object(source: Source, kind: int, index: int) -> Description:
    """Dictionary for the Rust library of an object with a frame: body, geom or site. Cameras raise `_NotReadError`."""
    types = _object_types(source)
    if kind not in types:
        raise _NotReadError("cameras are not part of the model")
    return {types[kind]: index}


def _geoms_of(source: Source, kind: int, index: int) -> list[int]:
    """Indices of the geoms at one end of a distance sensor: a single geom, or all geoms of a body."""
    if _object_types(source).get(kind) == "Geom":
        return [index]
    return [int(g) for g in np.flatnonzero(source.m.geom_bodyid == index)]


def _proximity(source: Source, i: int) -> Description:
    """Dictionary for the Rust library of a distance, normal or fromto sensor; `i` is the index in MuJoCo's model."""
    m, what = source.m, PROXIMITIES[kind_of(source, i)]
    first = _geoms_of(source, int(m.sensor_objtype[i]), int(m.sensor_objid[i]))
    second = _geoms_of(source, int(m.sensor_reftype[i]), int(m.sensor_refid[i]))
    for a in first:
        for b in second:
            kinds = {int(m.geom_type[a]), int(m.geom_type[b])}
            simple = kinds <= {PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX} and PLANE in kinds and len(kinds) > 1
            if not (simple or kinds <= {SPHERE, CAPSULE}):
                names = source.label("GEOM", a), source.label("GEOM", b)
                raise _NotReadError(f"the distance between geoms {names[0]} and {names[1]} is not simulated yet")
    return {"Proximity": {"what": what, "from": first, "to": second, "cutoff": float(m.sensor_cutoff[i])}}


def _fields(names: tuple[str, ...], bits: int) -> list[str]:
    """Names of the data fields of a sensor that a bit mask selects; a `_NotReadError` if it selects fields that are not simulated."""
    if bits >> len(names):
        raise _NotReadError(f"of the sensor's data only {', '.join(names)} are simulated")
    return [name for k, name in enumerate(names) if bits >> k & 1]


def _range(source: Source, i: int) -> Description:
    """Dictionary for the Rust library of a range finder; `i` is the index in MuJoCo's model."""
    m, site = source.m, int(source.m.sensor_objid[i])
    if _object_types(source).get(int(m.sensor_objtype[i])) != "Site":
        raise _NotReadError("cameras are not part of the model")
    seen = source.geoms_visible_from(site)
    other = [source.label("GEOM", g) for g in seen if int(m.geom_type[g]) == SDF]
    if other:
        raise _NotReadError(f"rays do not detect signed distance fields: {', '.join(other)}")
    fields = _fields(RAY_FIELDS, int(m.sensor_intprm[i, 0]))
    return {"RangeFinder": {"site": site, "rays": [[0.0, 0.0, 1.0]], "fields": fields, "geoms": seen}}


def _side(source: Source, kind: int, index: int) -> str | Description:
    """Filter of a contact sensor for one of the two geoms of a contact, as a name or dictionary for the Rust library.

    `kind` is MuJoCo's number of the type of object to which the geom must belong, `index` that of the object; below 0 any geom matches.
    """
    types = {**_object_types(source), int(source.mujoco.mjtObj.mjOBJ_XBODY): "Subtree"}
    if index < 0 or kind == int(source.mujoco.mjtObj.mjOBJ_UNKNOWN):
        return "Any"
    return {types[kind]: index}


def _contact(source: Source, i: int) -> Description:
    """Dictionary for the Rust library of a contact sensor; `i` is the index in MuJoCo's model."""
    m = source.m
    bits, reduction, slots = (int(x) for x in m.sensor_intprm[i, :3])
    return {
        "Contact": {
            "first": _side(source, int(m.sensor_objtype[i]), int(m.sensor_objid[i])),
            "second": _side(source, int(m.sensor_reftype[i]), int(m.sensor_refid[i])),
            "fields": _fields(CONTACT_FIELDS, bits),
            "reduction": REDUCTIONS[reduction],
            "slots": slots,
        }
    }

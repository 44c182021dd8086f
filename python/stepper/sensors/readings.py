"""Sensors that `Model.with_sensors` adds to a loaded model, including ray fans and combinations, which MJCF does not have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from stepper.shared.sensor_words import ACTUATORS, FRAMES, JOINTS, SCENE, SITES, SUBTREES, TENDONS

if TYPE_CHECKING:
    from stepper._stepper import Model

RAY_FIELDS = ("distance", "direction", "origin", "point")


@dataclass(frozen=True)
class RayFan:
    """Range finder with one or many rays in any directions, for `Model.with_sensors`.

    Attributes:
        site: Name of the site at which the rays start.
        rays: Directions in the site's frame, (n, 3), of any positive length.
        geoms: Names of the geoms that the rays can hit. None selects all except those of the site's body and purely visual meshes.
        data: Readings of each ray. Whatever the order here, the readings are in this order: "distance" (m, -1 without a hit), "direction"
            (unit vector in world axes), "origin" of the ray and hit "point" (world coordinates, m).
    """

    site: str
    rays: ArrayLike
    geoms: Sequence[str] | None = None
    data: Sequence[str] = ("distance",)


@dataclass(frozen=True)
class Combination:
    """Linear combination of readings of other sensors with equal dimensions, for `Model.with_sensors`.

    Attributes:
        terms: Coefficients by name of the sensor, which must be in the model or earlier in the argument of `with_sensors`.
    """

    terms: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """Sensor with a type of MJCF's `<sensor>`, for `Model.with_sensors`.

        model.with_sensors({
            "hand": stepper.sensors.SensorSpec(type="framepos", site="grasp", reference_body="base"),
            "spin": stepper.sensors.SensorSpec(type="gyro", site="imu"),
            "knee": stepper.sensors.SensorSpec(type="jointpos", joint="knee"),
        })

    Name exactly one measured element, except for sensors of the whole scene (clock, e_potential, e_kinetic).

    Attributes:
        type: MJCF type, here by kind of measured element: joints (jointpos, jointvel, jointactfrc, jointlimitpos, jointlimitvel,
            jointlimitfrc, ballquat, ballangvel), tendons (tendonpos and the like), actuators (actuatorpos, actuatorvel, actuatorfrc), sites
            (accelerometer, velocimeter, gyro, force, torque, magnetometer, touch), subtrees of bodies (subtreecom, subtreelinvel,
            subtreeangmom), frames (framepos, framequat, framexaxis, frameyaxis, framezaxis, framelinvel, frameangvel, framelinacc,
            frameangacc), the whole scene (clock, e_potential, e_kinetic).
        joint: Name of the joint.
        tendon: Name of the fixed tendon.
        actuator: Name of the actuator.
        site: Name of the site.
        body: Name of the body, whose body frame a frame sensor measures: MJCF's "xbody".
        inertial: Name of the body whose inertial frame (centre of mass, principal axes) a frame sensor measures: MJCF's "body".
        geom: Name of the geom.
        reference_body: Name of the body whose frame is the reference of a frame sensor; without a reference, it is the world.
        reference_inertial: Name of the body whose inertial frame is the reference.
        reference_geom: Name of the geom that is the reference.
        reference_site: Name of the site that is the reference.
    """

    type: str
    joint: str | None = None
    tendon: str | None = None
    actuator: str | None = None
    site: str | None = None
    body: str | None = None
    inertial: str | None = None
    geom: str | None = None
    reference_body: str | None = None
    reference_inertial: str | None = None
    reference_geom: str | None = None
    reference_site: str | None = None


_OBJECTS = {"body": "XBody", "inertial": "Body", "geom": "Geom", "site": "Site"}
"""Attributes of `SensorSpec` for the measured frame of a frame sensor, and their names in the Rust library."""
_OF = ("joint", "tendon", "actuator", "site", "body", "inertial", "geom")
"""Attributes of `SensorSpec` that can name the measured element."""
_WORDS: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "joint": (("joint",), JOINTS),
    "tendon": (("tendon",), TENDONS),
    "actuator": (("actuator",), ACTUATORS),
    "site": (("site",), SITES),
    "subtree": (("body",), SUBTREES),
    "frame": (tuple(_OBJECTS), FRAMES),
    "scene": ((), SCENE),
}
"""Families of sensors, such as sensors of joints, each with two entries.

The first is the attributes of `SensorSpec` that may name the measured element. The second maps each MJCF type of the family to its name in
the Rust library.
"""


def describe(model: Model, sensors: Mapping[str, RayFan | Combination | SensorSpec]) -> list[dict[str, Any]]:
    """Sensors as dictionaries for the Rust library, in order.

    Args:
        model: The model to which the sensors are added.
        sensors: Sensors by name.

    Raises:
        TypeError: An entry is no sensor, or has an attribute of a wrong type.
        ValueError: An unknown name, or a direction of length 0; the message has the sensor's name.
    """
    if not isinstance(sensors, Mapping):
        raise TypeError(f"sensors is {sensors!r}, must be a mapping of names to stepper.sensors.SensorSpec, RayFan and Combination")
    names = list(model.sensor_names)
    found = []
    for name, sensor in sensors.items():
        place = f"sensor {name!r}"
        if not isinstance(name, str):
            raise TypeError(f"{place}: its name must be a string")
        if isinstance(sensor, RayFan):
            kind: str | dict[str, Any] = {"RangeFinder": _fan(model, sensor, place)}
        elif isinstance(sensor, Combination):
            kind = {"Combination": _terms(names, sensor, place)}
        elif isinstance(sensor, SensorSpec):
            kind = _kind(model, sensor, place)
        else:
            raise TypeError(f"{place} is {sensor!r}, must be a stepper.sensors.SensorSpec, RayFan or Combination")
        found.append({"name": name, "kind": kind, "noise": 0.0, "cutoff": 0.0, "delay": 0.0, "interval": 0.0})
        names.append(name)
    return found


def _fan(model: Model, fan: RayFan, place: str) -> dict[str, Any]:
    """Ray fan as a dictionary for the Rust library; error messages begin with `place`."""
    site = _index(model.site_names, fan.site, "site", place)
    for what in ("geoms", "data"):
        given = getattr(fan, what)
        if isinstance(given, str) or not (isinstance(given, Sequence) or (what == "geoms" and given is None)):
            raise TypeError(f"{place}: {what} is {given!r}, must be a sequence of strings")
    try:
        rays = np.asarray(fan.rays, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{place}: rays is {fan.rays!r}, must be an array (n, 3) of numbers") from error
    if rays.ndim != 2 or rays.shape[1] != 3 or not len(rays):
        raise ValueError(f"{place}: rays has shape {rays.shape}, must be (n, 3)")
    lengths = np.linalg.norm(rays, axis=1)
    if not np.all(np.isfinite(lengths) & (lengths > 0)):
        worst = int(np.argmin(np.isfinite(lengths) & (lengths > 0)))
        raise ValueError(f"{place}: ray {worst} is {rays[worst].tolist()}, must be a direction")
    if unknown := [word for word in fan.data if word not in RAY_FIELDS]:
        raise ValueError(f"{place}: data has {unknown}, must be one of: {', '.join(RAY_FIELDS)}")
    seen = model.geoms_seen_from(site) if fan.geoms is None else [_index(model.geom_names, geom, "geom", place) for geom in fan.geoms]
    fields = [word.capitalize() for word in fan.data]
    return {"site": site, "rays": (rays / lengths[:, None]).tolist(), "fields": fields, "geoms": seen}


def _terms(names: Sequence[str], combination: Combination, place: str) -> list[tuple[int, float]]:
    """Index and coefficient of each sensor in a linear combination."""
    if not isinstance(combination.terms, Mapping):
        raise TypeError(f"{place}: terms is {combination.terms!r}, must be a mapping of names to coefficients")
    terms: list[tuple[int, float]] = []
    for name, coefficient in combination.terms.items():
        index = _index(names, name, "sensor", place)
        if not isinstance(coefficient, Real):
            raise TypeError(f"{place}: the coefficient of {name!r} is {coefficient!r}, must be a number")
        terms.append((index, float(coefficient)))
    return terms


def _kind(model: Model, spec: SensorSpec, place: str) -> str | dict[str, Any]:
    """Type and element of an additional sensor for the Rust library; a ValueError if the type is unknown or lacks the element."""
    family = next((family for family, (_, words) in _WORDS.items() if spec.type in list(words)), None)
    if family is None:
        known = ", ".join(word for _, words in _WORDS.values() for word in words)
        raise ValueError(f"{place}: there is no type {spec.type!r}; the types are: {known}")
    takes, words = _WORDS[family]
    given = [what for what in _OF if getattr(spec, what) is not None]
    references = [what for what in _OBJECTS if getattr(spec, f"reference_{what}") is not None]
    if [what for what in given if what in takes] != given or len(given) != bool(takes):
        needed = f"one of {', '.join(takes)}" if len(takes) > 1 else takes[0] if takes else "no element"
        raise ValueError(f"{place}: type {spec.type} needs {needed}, and {', '.join(given) or 'none'} is given")
    if references and (family != "frame" or spec.type in ("framelinacc", "frameangacc") or len(references) > 1):
        allowed = "at most one reference" if len(references) > 1 else "no reference"
        raise ValueError(f"{place}: type {spec.type} has {allowed}, and {', '.join(f'reference_{what}' for what in references)} is given")
    if not takes:
        return words[spec.type]
    index = _named(model, given[0], getattr(spec, given[0]), place)
    if family != "frame":
        return {words[spec.type]: index}
    reference = None
    if references:
        found = _named(model, references[0], getattr(spec, f"reference_{references[0]}"), place)
        reference = {_OBJECTS[references[0]]: found}
    return {"Frame": {"what": words[spec.type], "object": {_OBJECTS[given[0]]: index}, "reference": reference}}


def _named(model: Model, what: str, name: str, place: str) -> int:
    """Index of the element that an attribute of `SensorSpec` names."""
    kind = "body" if what == "inertial" else what
    return _index(getattr(model, f"{kind}_names"), name, kind, place)


def _index(names: Sequence[str], name: str, kind: str, place: str) -> int:
    """Index of a name in a list of names; a ValueError if the list does not contain it."""
    if name not in names:
        raise ValueError(f"{place}: there is no {kind} {name!r}; the names are: {', '.join(filter(None, names)) or 'none'}")
    return names.index(name)

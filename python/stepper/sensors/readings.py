"""Sensors that are added to a loaded model: what MJCF has no word for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from stepper._stepper import Model

RAY_FIELDS = ("distance", "direction", "origin", "point")


@dataclass(frozen=True)
class RayFan:
    """A range finder of many rays, or a single one of any direction, for `Model.with_sensors`.

    Attributes:
        site: Name of the site from which the rays go.
        rays: Directions in the site's frame, (n, 3), of any length above 0.
        geoms: Names of the geoms that the rays can meet; None is all simple shapes but those of the site's own body.
        data: What is read of each ray, in the order of "distance" (m, -1 where nothing is met), "direction", "origin", "point" (world, m).
    """

    site: str
    rays: ArrayLike
    geoms: Sequence[str] | None = None
    data: Sequence[str] = ("distance",)


@dataclass(frozen=True)
class Combination:
    """A linear combination of readings of other sensors of one dimension, for `Model.with_sensors`.

    Attributes:
        terms: Coefficients by the names of sensors, of the model or added before.
    """

    terms: Mapping[str, float]


def describe(model: Model, sensors: Mapping[str, RayFan | Combination]) -> list[dict[str, Any]]:
    """What the Rust crate's `Sensor` holds, for every sensor.

    Raises:
        TypeError: Something that is neither.
        ValueError: A name that nothing has, or directions that are none, with the sensor's name.
    """
    if not isinstance(sensors, Mapping):
        raise TypeError(f"sensors is {sensors!r}, must be a mapping of names to stepper.RayFan and stepper.Combination")
    names = list(model.sensor_names)
    found = []
    for name, sensor in sensors.items():
        place = f"sensor {name!r}"
        if not isinstance(name, str):
            raise TypeError(f"{place}: its name must be a string")
        if isinstance(sensor, RayFan):
            kind: dict[str, Any] = {"RangeFinder": _fan(model, sensor, place)}
        elif isinstance(sensor, Combination):
            kind = {"Combination": _terms(names, sensor, place)}
        else:
            raise TypeError(f"{place} is {sensor!r}, must be a stepper.RayFan or stepper.Combination")
        found.append({"name": name, "kind": kind, "noise": 0.0, "cutoff": 0.0, "delay": 0.0, "interval": 0.0})
        names.append(name)
    return found


def _fan(model: Model, fan: RayFan, place: str) -> dict[str, Any]:
    site = _index(model.site_names, fan.site, "site", place)
    for what in ("geoms", "data"):
        if isinstance(getattr(fan, what), str):
            raise TypeError(f"{place}: {what} is {getattr(fan, what)!r}, must be a sequence of strings")
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
        raise ValueError(f"{place}: data has {unknown}, must be of: {', '.join(RAY_FIELDS)}")
    seen = model.geoms_seen_from(site) if fan.geoms is None else [_index(model.geom_names, geom, "geom", place) for geom in fan.geoms]
    fields = [word.capitalize() for word in fan.data]
    return {"site": site, "rays": (rays / lengths[:, None]).tolist(), "fields": fields, "geoms": seen}


def _terms(names: Sequence[str], combination: Combination, place: str) -> list[tuple[int, float]]:
    if not isinstance(combination.terms, Mapping):
        raise TypeError(f"{place}: terms is {combination.terms!r}, must be a mapping of names to coefficients")
    terms: list[tuple[int, float]] = []
    for name, coefficient in combination.terms.items():
        index = _index(names, name, "sensor", place)
        if not isinstance(coefficient, Real):
            raise TypeError(f"{place}: the coefficient of {name!r} is {coefficient!r}, must be a number")
        terms.append((index, float(coefficient)))
    return terms


def _index(names: Sequence[str], name: str, kind: str, place: str) -> int:
    if name not in names:
        raise ValueError(f"{place}: no {kind} {name!r}, there are: {', '.join(filter(None, names)) or 'none'}")
    return names.index(name)

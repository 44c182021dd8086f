"""What is identified: parameters by kind and element, as numbers theta that an optimiser may move freely within bounds.

A kind says which numbers of the model a parameter stands for, and how it is written as theta: positive quantities as logarithms, an inertia
as log-Cholesky parameters, others as they are. `bind` looks the elements up in a model and gives a block of theta for each parameter.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stepper._hints import near, near_or_all
from stepper._stepper import Model
from stepper.actuators import ActuatorModel, Drive
from stepper.shared.fields import OF_PAIRS, check_pairs
from stepper.shared.rotations import matrices
from stepper.sysid import inertia as shape
from stepper.sysid.inertia import Array

REACH = math.log(1e3)
"""Without bounds, a positive quantity may become this much larger or smaller, as a logarithm."""


@dataclass(frozen=True)
class Kind:
    """A kind of parameters.

    Attributes:
        element: What it belongs to: "body", "geom", "pair" (an explicit pair of geoms), "joint", "actuator" or "sensor".
        unit: Unit of its values.
        says: What it is, in words.
        excite: What a motion must do for data to say anything of it.
        field: Field of the model, for kinds that are one number in a field; the rest have code of their own.
        column: Place in that field's row.
        log: Whether theta is the logarithm, so that values stay positive.
        bounds: Bounds of the value, if not what `REACH` says.
    """

    element: str
    unit: str
    says: str
    excite: str
    field: str = ""
    column: int | None = None
    log: bool = True
    bounds: tuple[float, float] | None = None


KINDS = {
    "mass": Kind("body", "kg", "mass; the inertia grows with it", "accelerate or lift {0} while a force is measured", "body_mass"),
    "com": Kind("body", "m", "centre of mass in the body's frame, three numbers", "hold {0} in several poses, or turn it fast", log=False),
    "moments": Kind("body", "kg m^2", "principal moments of inertia, about the model's axes", "turn {0} about three axes, fast"),
    "inertia": Kind("body", "", "all ten numbers: mass, centre of mass, moments and axes", "lift {0}, and turn it about three axes, fast"),
    "friction": Kind("geom", "", "sliding friction", "make {0} slide; name both geoms, the larger counts", "geom_friction", 0),
    "torsion": Kind("geom", "m", "torsional friction", "spin contacts of {0} about their normals", "geom_friction", 1),
    "rolling": Kind("geom", "m", "rolling friction", "let {0} roll", "geom_friction", 2),
    "restitution": Kind("geom", "", "coefficient of restitution", "let {0} bounce", "geom_restitution", log=False, bounds=(0.0, 1.0)),
    "pair_friction": Kind("pair", "", "sliding friction of an explicit pair", "make the geoms of pair {0} slide", "pair_friction", 0),
    "pair_torsion": Kind("pair", "m", "torsional friction of an explicit pair", "spin pair {0} about its normals", "pair_friction", 1),
    "pair_rolling": Kind("pair", "m", "rolling friction of an explicit pair", "let the geoms of pair {0} roll", "pair_friction", 2),
    "pair_restitution": Kind(
        "pair", "", "restitution of an explicit pair", "let the geoms of {0} bounce", "pair_restitution", log=False, bounds=(0.0, 1.0)
    ),
    "stiffness": Kind("joint", "N/m or N m/rad", "spring stiffness", "move {0} far from where its spring rests", "jnt_stiffness"),
    "damping": Kind("joint", "N s/m or N m s/rad", "viscous damping", "move {0} at several speeds", "dof_damping"),
    "armature": Kind("joint", "kg or kg m^2", "added inertia", "accelerate {0}", "dof_armature"),
    "frictionloss": Kind("joint", "N or N m", "dry friction", "move {0} slowly, back and forth", "dof_frictionloss"),
    "gain": Kind("actuator", "", "gain, whatever its bias", "drive {0} with large and changing controls", "actuator_gain", 0),
    "kp": Kind("actuator", "", "stiffness of a position servo", "drive {0} away from where it is, against a load", "actuator_gain", 0),
    "kv": Kind("actuator", "", "velocity gain of a servo", "move {0} at several speeds", "actuator_bias", 2),
    "delay": Kind("actuator", "s", "delay of the control", "change the control of {0} often", log=False, bounds=(0.0, 0.1)),
    "bias": Kind("sensor", "", "bias of every channel of the sensor", "read {0}", log=False),
    "scale": Kind("sensor", "", "scale factor of the sensor", "make {0} read more than its noise"),
    "lag": Kind("sensor", "s", "delay of the reading", "make {0} change fast", log=False, bounds=(0.0, 0.1)),
}  # fmt: skip
"""Kinds by name."""
READING = ("bias", "scale", "lag")
"""Kinds that change what is read of a motion, and not the motion."""


@dataclass(frozen=True)
class FitParameter:
    """Parameter to identify: a quantity of one or more elements, with start, bounds and prior.

    Attributes:
        kind: What it is, of `stepper.sysid.KINDS`: "mass", "friction", "damping" ...
        of: Names of elements, patterns like "left_*", or "#3" for an index. Several share one parameter: they keep the ratios that they
            have in the model.
        start: Where the search begins, in the unit of the kind; None is the model's own value.
        bounds: Lowest and highest value. None is a thousandth to a thousand times the start for what is positive, and what the kind
            allows for the rest.
        prior: Mean and standard deviation of what is known beforehand, from a data sheet or a balance; of positive quantities the
            standard deviation is relative.

    Raises:
        ValueError: An unknown kind, bounds that are none.
    """

    kind: str
    of: str | tuple[str, ...]
    start: float | None = None
    bounds: tuple[float, float] | None = None
    prior: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"there is no kind of parameter {self.kind!r}{_kinds_like(self.kind)}")
        object.__setattr__(self, "of", (self.of,) if isinstance(self.of, str) else tuple(self.of))
        if not self.of:
            raise ValueError(f"a parameter of kind {self.kind!r} needs the name of a {KINDS[self.kind].element}")
        if self.bounds is not None and not self.bounds[0] < self.bounds[1]:
            raise ValueError(f"{self}: bounds are {self.bounds}, must be (low, high)")
        if self.prior is not None and not self.prior[1] > 0:
            raise ValueError(f"{self}: the standard deviation of the prior is {self.prior[1]}, must be above 0")

    @classmethod
    def parse(cls, text: str) -> FitParameter:
        """A parameter from text: "mass:box", "friction:floor,box", with bounds "mass:box=0.1..5"."""
        head, _, limits = text.partition("=")
        kind, colon, names = head.partition(":")
        if not colon or not names:
            raise ValueError(f'"{text}" is no parameter; write kind:element, as in "mass:box" or "friction:floor,box=0.1..2"')
        bounds = None
        if limits:
            try:
                low, high = (float(end) for end in limits.split(".."))
            except ValueError:
                raise ValueError(f'"{text}": the bounds are "{limits}", must be two numbers as in "0.1..2"') from None
            bounds = (low, high)
        return cls(kind, tuple(name.strip() for name in names.split(",")), bounds=bounds)

    def __str__(self) -> str:
        return f"{self.kind}:{','.join(self.of)}"


class Variants:
    """Parameters of several environments, as they are written: what differs from the model, with the axis of the variants in front.

    Attributes:
        fields: Arrays of the model's fields by name.
        delays: Delays of actuators by name, (count,) s.
    """

    def __init__(self, model: Model, count: int):
        self.model, self.count = model, count
        self.fields: dict[str, Array] = {}
        self.delays: dict[str, Array] = {}

    def of(self, field: str) -> Array:
        """An array of a field to write to, which begins as the model's."""
        if field not in self.fields:
            own = np.asarray(getattr(self.model, field), np.float64)
            self.fields[field] = np.tile(own, (self.count, *(1,) * own.ndim))
        return self.fields[field]

    def actuators(self, known: ActuatorModel | None, index: Array | None = None) -> ActuatorModel | None:
        """Drives with these delays beside what is known of them; `index` picks a variant for every environment."""
        if not self.delays:
            return None
        drives = {}
        for name, delay in self.delays.items():
            drive = (known.drive_of(name) if known is not None else None) or Drive()
            drives[name] = replace(drive, delay=delay if index is None else delay[index])
        return ActuatorModel(drives)


class Block:
    """A parameter of a model, as a piece of theta.

    Attributes:
        parameter: What it is.
        labels, units: Of its values.
        start, low, high: Theta where the search begins, and bounds of theta: (n,).
        scale: Size of a change of theta that matters: (n,).
        prior: Mean and standard deviation of theta, or None.
    """

    def __init__(self, parameter: FitParameter, model: Model):
        self.parameter, self.kind = parameter, KINDS[parameter.kind]
        self.index = tuple(k for name in parameter.of for k in _find(model, self.kind.element, name))
        self.names = tuple(_name(model, self.kind.element, k) for k in self.index)
        kind, what = parameter.kind, self.names[0] if len(self.names) == 1 else "{" + ",".join(self.names) + "}"
        self.hint = self.kind.excite.format(" and ".join(self.names))
        self.labels: tuple[str, ...] = (f"{kind}:{what}",)
        self.units: tuple[str, ...] = (self.kind.unit,)
        self.start, self.low, self.high = np.zeros(1), np.zeros(1), np.zeros(1)
        self.prior: tuple[Array, Array] | None = None
        self._scale = 1.0
        self._prepare(model)
        self.scale = np.full(self.size, self._scale)

    @property
    def size(self) -> int:
        """Count of its numbers."""
        return len(self.start)

    def _prepare(self, model: Model) -> None:
        kind = self.kind
        field = np.asarray(getattr(model, kind.field), np.float64)
        places = _dofs(model, self.index) if kind.field.startswith("dof_") else list(self.index)
        self.places: list[tuple[int, ...]] = [(k,) if kind.column is None else (k, kind.column) for k in places]
        own = np.array([field[place] for place in self.places])
        if self.parameter.kind == "kv":
            own = -own
        if self.parameter.kind == "kp":
            bias = np.asarray(model.actuator_bias)[list(self.index)]
            if not np.allclose(bias[:, 1], -own):
                raise ValueError(
                    f"{self.parameter}: {self.names[0]} is no position servo, its bias is {bias[0].tolist()}; identify its gain"
                )
        # Where the model's value is 0, all elements have the same one.
        self.ratio = own / own[0] if own[0] > 0 else np.ones(len(own))
        self._interval(own[0])

    def _interval(self, own: float) -> None:
        """Start, bounds and prior of one number, of which the model has `own`."""
        parameter, kind = self.parameter, self.kind
        start = own if parameter.start is None else float(parameter.start)
        if kind.log and not start > 0:
            raise ValueError(f"{parameter}: it is {start:g} in the model, and is sought as a logarithm; give a start above 0")
        if parameter.bounds is not None and not parameter.bounds[0] <= start <= parameter.bounds[1]:
            if parameter.start is not None:
                raise ValueError(f"{parameter}: the start {start:g} is outside of its bounds {parameter.bounds}")
            low, high = parameter.bounds
            start = math.sqrt(low * high) if kind.log and low > 0 else (low + high) / 2
        given = parameter.bounds or kind.bounds
        if kind.log:
            low, high = (start * math.exp(-REACH), start * math.exp(REACH)) if given is None else given
            if not low > 0:
                raise ValueError(f"{parameter}: the lower bound is {low:g}, must be above 0")
            self.start, self.low, self.high = np.log([start]), np.log([low]), np.log([high])
        else:
            low, high = (-math.inf, math.inf) if given is None else given
            self.start, self.low, self.high = np.array([start]), np.array([low], float), np.array([high], float)
        if parameter.prior is not None:
            mean, std = parameter.prior
            self.prior = (np.log([mean]) if kind.log else np.array([mean])), np.array([std])

    def write(self, theta: Array, variants: Variants) -> None:
        """Writes what theta (count, size) means into variants."""
        value = self.natural(theta)[:, 0]
        for place, ratio in zip(self.places, self.ratio, strict=True):
            self._assign(variants, place, value * ratio)

    def _assign(self, variants: Variants, place: tuple[int, ...], value: Array) -> None:
        at: Any = (slice(None), *place)
        array = variants.of(self.kind.field)
        if self.parameter.kind == "mass":
            variants.of("body_inertia")[:, place[0]] *= (value / array[at])[:, None]
        if self.parameter.kind == "gain":
            # All of the gain grows together, as that of a motor whose current is scaled.
            array[:, place[0]] *= (value / array[at])[:, None]
        if self.parameter.kind == "kp":
            variants.of("actuator_bias")[:, place[0], 1] = -value
        array[at] = -value if self.parameter.kind == "kv" else value

    def natural(self, theta: Array) -> Array:
        """Values in their units (..., size) of theta (..., size)."""
        return np.exp(theta) if self.kind.log else np.asarray(theta, float)


class _OfOneBody(Block):
    def _one(self) -> int:
        if (
            len(self.index) != 1
            or self.parameter.start is not None
            or self.parameter.bounds is not None
            or self.parameter.prior is not None
        ):
            raise ValueError(
                f"{self.parameter}: several numbers of one body, which begin at the model's; give neither start, bounds nor prior"
            )
        return self.index[0]

    def _gyration(self, model: Model) -> Array:
        body = model.body(self.index[0])
        if not body.mass > 0:
            raise ValueError(f"{self.parameter}: body {body.name!r} has no mass; give it one with model.replace(body_mass=...)")
        return np.sqrt(shape.second_moments(np.asarray(body.inertia)).clip(1e-12) / body.mass)


class _Com(_OfOneBody):
    def _prepare(self, model: Model) -> None:
        body = self._one()
        self._scale = float(self._gyration(model).max())
        reach = 10 * self._scale
        self.labels = tuple(f"com:{self.names[0]}.{axis}" for axis in "xyz")
        self.units = ("m",) * 3
        self.start = np.array(model.body(body).ipos, float)
        self.low, self.high = self.start - reach, self.start + reach

    def write(self, theta: Array, variants: Variants) -> None:
        variants.of("body_ipos")[:, self.index[0]] = theta


class _Moments(_OfOneBody):
    """Theta are half the logarithms of the second moments of mass, so that the triangle inequality holds."""

    def _prepare(self, model: Model) -> None:
        self._one()
        own = np.asarray(model.body(self.index[0]).inertia)
        moments = shape.second_moments(own)
        if not moments.min() > 1e-9 * moments.max():
            raise ValueError(f"{self.parameter}: the model's moments {own.tolist()} are those of a flat body, which is a bound; thicken it")
        self.own = moments
        self.labels = tuple(f"moments:{self.names[0]}.{k}" for k in (1, 2, 3))
        self.units = ("kg m^2",) * 3
        self.start = np.zeros(3)
        self.low, self.high = np.full(3, -REACH), np.full(3, REACH)

    def write(self, theta: Array, variants: Variants) -> None:
        variants.of("body_inertia")[:, self.index[0]] = self.natural(theta)

    def natural(self, theta: Array) -> Array:
        return shape.principal_moments(self.own * np.exp(2 * theta))


class _Inertia(_OfOneBody):
    def _prepare(self, model: Model) -> None:
        self._one()
        self._gyration(model)
        self.body = model.body(self.index[0])
        self.R = matrices(np.asarray(self.body.iquat))
        parts = ("mass", "com.x", "com.y", "com.z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
        self.labels = tuple(f"inertia:{self.names[0]}.{part}" for part in parts)
        self.units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
        self.start = np.zeros(10)
        reach = np.array([REACH / 2, *(REACH,) * 3, *(10.0,) * 6])
        self.low, self.high = -reach, reach

    def _bodies(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        mass, com, moments, axes = shape.bodies(theta, self.body.mass, np.asarray(self.body.inertia))
        return mass, np.asarray(self.body.ipos) + com @ self.R.T, moments, self.R @ axes

    def write(self, theta: Array, variants: Variants) -> None:
        mass, com, moments, axes = self._bodies(theta)
        own = {"body_mass": mass, "body_ipos": com, "body_inertia": moments, "body_iquat": shape.quaternion(axes)}
        for field, value in own.items():
            variants.of(field)[:, self.index[0]] = value

    def natural(self, theta: Array) -> Array:
        mass, com, moments, axes = self._bodies(theta)
        return np.concatenate([mass[..., None], com, shape.tensor(moments, axes)], axis=-1)


class _Delay(Block):
    def _prepare(self, model: Model) -> None:
        self._interval(0.0)
        self._scale = 0.01

    def write(self, theta: Array, variants: Variants) -> None:
        for name in self.names:
            variants.delays[name] = theta[:, 0]


class _Reading(Block):
    """A parameter of sensors, which predictions take: see `Simulator`."""

    def _prepare(self, model: Model) -> None:
        if self.parameter.kind != "bias":
            self._interval(1.0 if self.parameter.kind == "scale" else 0.0)
            self._scale = 0.01 if self.parameter.kind == "lag" else 1.0
            return
        if len(self.index) != 1:
            raise ValueError(f"{self.parameter}: every sensor has a bias of its own; give a parameter for each")
        dim = model.sensor(self.index[0]).dim
        self._interval(0.0)
        if dim > 1:
            self.labels = tuple(f"bias:{self.names[0]}[{k}]" for k in range(dim))
            self.units = ("",) * dim
            self.start, self.low, self.high = (np.repeat(x, dim) for x in (self.start, self.low, self.high))
            self.prior = None if self.prior is None else (np.repeat(self.prior[0], dim), np.repeat(self.prior[1], dim))

    def write(self, theta: Array, variants: Variants) -> None:
        """A reading changes nothing of the model."""


_BLOCKS: dict[str, type[Block]] = {
    "com": _Com, "moments": _Moments, "inertia": _Inertia, "delay": _Delay, "bias": _Reading, "scale": _Reading, "lag": _Reading,
}  # fmt: skip


def bind(parameters: Sequence[FitParameter | str], model: Model) -> list[Block]:
    """Blocks of theta for parameters of a model.

    Raises:
        KeyError: A name that no element has.
        ValueError: Two parameters of one number, a parameter that cannot begin where the model is, one of geoms that an explicit pair
            overrides.
    """
    if isinstance(parameters, str | FitParameter):
        parameters = [parameters]
    given = [FitParameter.parse(p) if isinstance(p, str) else p for p in parameters]
    if not given:
        raise ValueError('there is no parameter to identify; give some, as in ["mass:box", "friction:floor,box"]')
    blocks = [_BLOCKS.get(p.kind, Block)(p, model) for p in given]
    taken: dict[tuple[str, int], FitParameter] = {}
    for block in blocks:
        same = {"inertia": ("mass", "com", "moments", "inertia"), "kp": ("kp", "gain"), "gain": ("kp", "gain")}
        for kind in same.get(block.parameter.kind, (block.parameter.kind,)):
            for k in block.index:
                if (kind, k) in taken:
                    raise ValueError(f"{block.parameter} and {taken[kind, k]} are of the same number; leave one out")
                taken[kind, k] = block.parameter
    for block in blocks:
        kind = block.kind.field
        pairs = {k for other in blocks if other.kind.field == OF_PAIRS.get(kind) for k in other.index}
        try:
            check_pairs(model, kind, block.index, pairs, f'identify "pair_{block.parameter.kind}:{{pair}}"')
        except ValueError as error:
            raise ValueError(f"{block.parameter}: {error}") from None
    return blocks


def write(blocks: Sequence[Block], theta: Array, model: Model) -> Variants:
    """What theta (count, n) of all blocks means."""
    variants = Variants(model, len(theta))
    # Moments are absolute, and a mass scales those it finds.
    for block, piece in sorted(zip(blocks, split(blocks, theta), strict=True), key=lambda part: part[0].parameter.kind == "moments"):
        block.write(piece, variants)
    return variants


def split(blocks: Sequence[Block], theta: Array) -> list[Array]:
    """The pieces of theta (..., n) that belong to blocks."""
    return np.split(theta, np.cumsum([block.size for block in blocks])[:-1], axis=-1)


def natural(blocks: Sequence[Block], theta: Array) -> Array:
    """Values in their units of theta (..., n) of all blocks."""
    return np.concatenate([block.natural(piece) for block, piece in zip(blocks, split(blocks, theta), strict=True)], axis=-1)


def _kinds_like(kind: str) -> str:
    """Hint at an unknown kind: kinds of the model's field of that name, similar kinds, or all kinds, as the end of a message."""
    of_field = [name for name, known in KINDS.items() if known.field == kind]
    if of_field:
        return f"; did you mean {' or '.join(of_field)}?"
    return near_or_all(kind, KINDS)


def _names(model: Model, element: str) -> list[str]:
    return list(getattr(model, f"{element}_names"))


def _name(model: Model, element: str, index: int) -> str:
    return _names(model, element)[index] or f"#{index}"


def _find(model: Model, element: str, name: str) -> list[int]:
    names = _names(model, element)
    if name.startswith("#") and name[1:].isdigit() and int(name[1:]) < len(names):
        return [int(name[1:])]
    if name in names:
        return [names.index(name)]
    found = [k for k, other in enumerate(names) if other and fnmatch.fnmatchcase(other, name)]
    if not found:
        listed = f"; there are: {', '.join(n or f'#{k}' for k, n in enumerate(names))}" if names else f"; the model has no {element}"
        raise KeyError(f"no {element} is named {name!r}{near(name, names) or listed}")
    return found


def _dofs(model: Model, joints: Sequence[int]) -> list[int]:
    return [dof for k in joints for dof in range(model.joint(k).dofadr, model.joint(k).dofadr + model.joint(k).nv)]

"""Parameters to identify, and their representation as a vector theta that an optimiser varies within bounds.

The kind of a parameter (`KINDS`) defines its numbers in theta. They are the logarithm of a positive quantity, log-Cholesky parameters of an
inertia, or the value itself. `bind` finds the elements in a model, and returns a `Block` of theta for each parameter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepper._hints import did_you_mean_or_all
from stepper._stepper import Model
from stepper.actuators import ActuatorModel, Drive
from stepper.shared.arguments import check_kind, check_number, check_pair
from stepper.shared.fields import OF_PAIRS, check_pairs
from stepper.shared.rotations import matrices
from stepper.shared.selectors import Selector, conflict, parse, parse_range, parts_of, rows_of
from stepper.sysid import inertia as shape
from stepper.sysid.inertia import Array

REACH = math.log(1e3)
"""Default bound of a positive parameter: largest change of its logarithm, up or down, a factor of 1000."""


@dataclass(frozen=True)
class Kind:
    """Kind of parameter that can be identified.

    Attributes:
        element: Kind of the elements that have the quantity: "body", "geom", "pair" (a contact pair of two geoms that the model defines),
            "joint", "actuator" or "sensor".
        unit: Unit of the value.
        quantity: Name of the quantity.
        excite: Advice for a motion that determines the quantity, with {0} for the names of the elements.
        log: Whether theta is the logarithm of the value, so that the value stays positive.
        bounds: Default bounds of the value. None allows a factor of 1000 up and down (`REACH`) if `log` is true, and otherwise any value.
        columns: Columns of the field that contain the value; None uses the columns of the selector.
        scaled: Field and columns that are multiplied by the same factor as the value, such as the inertia if the value is the mass. None
            if no other field changes.
    """

    element: str
    unit: str
    quantity: str
    excite: str
    log: bool = True
    bounds: tuple[float, float] | None = None
    columns: tuple[int, ...] | None = None
    scaled: tuple[str, slice] | None = None


_UNIT = (0.0, 1.0)
KINDS = {
    "body_mass": Kind(
        "body", "kg", "mass; the inertia grows with it", "accelerate or lift {0} while a force is measured",
        scaled=("body_inertia", slice(None)),
    ),
    "body_ipos": Kind("body", "m", "centre of mass in the body's frame", "hold {0} in several poses, or turn it fast", log=False),
    "body_inertia": Kind("body", "kg m^2", "principal moments of inertia, about the model's axes", "turn {0} about three axes, fast"),
    "body_inertial": Kind("body", "", "mass, centre, moments and axes: ten numbers", "lift {0}, and turn it about three axes, fast"),
    "geom_friction[0]": Kind("geom", "", "sliding friction", "make {0} slide; name both geoms, the larger counts"),
    "geom_friction[1]": Kind("geom", "m", "torsional friction", "spin contacts of {0} about their normals"),
    "geom_friction[2]": Kind("geom", "m", "rolling friction", "let {0} roll"),
    "geom_restitution": Kind("geom", "", "coefficient of restitution", "let {0} bounce", log=False, bounds=_UNIT),
    "pair_friction[0]": Kind("pair", "", "sliding friction of an explicit pair", "make the geoms of pair {0} slide"),
    "pair_friction[1]": Kind("pair", "m", "torsional friction of an explicit pair", "spin pair {0} about its normals"),
    "pair_friction[2]": Kind("pair", "m", "rolling friction of an explicit pair", "let the geoms of pair {0} roll"),
    "pair_restitution": Kind("pair", "", "restitution of an explicit pair", "let the geoms of {0} bounce", log=False, bounds=_UNIT),
    "jnt_stiffness": Kind("joint", "N/m or N m/rad", "spring stiffness", "move {0} far from where its spring rests"),
    "dof_damping": Kind("joint", "N s/m or N m s/rad", "viscous damping", "move {0} at several speeds"),
    "dof_armature": Kind("joint", "kg or kg m^2", "added inertia", "accelerate {0}"),
    "dof_frictionloss": Kind("joint", "N or N m", "dry friction", "move {0} slowly, back and forth"),
    "actuator_gainprm": Kind(
        "actuator", "", "gain, whatever its bias", "drive {0} with large and changing controls",
        columns=(0,), scaled=("actuator_gainprm", slice(1, None)),
    ),
    "actuator_kp": Kind("actuator", "", "stiffness of a position servo", "drive {0} away from where it is, against a load"),
    "actuator_kv": Kind("actuator", "", "velocity gain of a servo", "move {0} at several speeds"),
    "actuator.delay": Kind("actuator", "s", "delay of the control", "change the control of {0} often", log=False, bounds=(0.0, 0.1)),
    "sensor.bias": Kind("sensor", "", "bias of every channel of the sensor", "read {0}", log=False),
    "sensor.scale": Kind("sensor", "", "scale factor of the sensor", "make {0} read more than its noise"),
    "sensor.delay": Kind("sensor", "s", "delay of the reading", "make {0} change fast", log=False, bounds=(0.0, 0.1)),
}  # fmt: skip
"""Kinds of parameters that can be identified, by name. A name is a field of the model or another quantity, such as "body_mass".

It ends with a column in brackets if the columns of the field are different kinds, as in "geom_friction[0]".
"""
READING = ("sensor.bias", "sensor.scale", "sensor.delay")
"""Kinds of parameters that change the sensor readings but not the motion."""


@dataclass(frozen=True)
class FitParameter:
    """Parameter to identify: a quantity of one or more elements, with start, bounds and prior.

    Attributes:
        selector: Selector of the numbers, of one of the kinds in `stepper.sysid.KINDS`: "body_mass[box]", "geom_friction[floor,box][0]",
            "actuator_kp[hip]", "dof_damping[left_*]". Several elements share one parameter, and keep the ratios that they have in the
            model.
        start: Value at which the search starts, in the unit of the kind. None uses the model's value, or the middle of the bounds if the
            model's value is outside of them.
        bounds: Lowest and highest value. None allows a thousandth to a thousand times the start for positive quantities. For others,
            None uses the bounds of the kind.
        prior: Mean and standard deviation of prior knowledge, for example from a data sheet or scales. For positive quantities the
            standard deviation is relative.

    Raises:
        ValueError: The selector has an unknown kind or spelling, or the bounds or the prior are invalid.
    """

    selector: str
    start: float | None = None
    bounds: tuple[float, float] | None = None
    prior: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(_no_kind(self.parsed))
        if self.start is not None:
            check_number(f"{self}: start", self.start)
        if self.bounds is not None:
            check_pair(f"{self}: bounds", self.bounds, meaning="(low, high)")
        if self.prior is not None:
            check_pair(f"{self}: prior", self.prior, meaning="(mean, standard deviation)")
        if self.parsed.elements is None:
            raise ValueError(f"'{self}' names no {KINDS[self.kind].element}: write '{self.parsed.field}[name]'")
        if self.bounds is not None and not self.bounds[0] < self.bounds[1]:
            raise ValueError(f"{self}: bounds are {self.bounds}, must be (low, high), with low below high")
        if self.prior is not None and not self.prior[1] > 0:
            raise ValueError(f"{self}: the standard deviation of the prior is {self.prior[1]}, must be above 0")

    @property
    def parsed(self) -> Selector:
        """Parsed selector: field, elements and columns."""
        return parse(self.selector, "parameters")

    @property
    def kind(self) -> str:
        """Name of the kind in `stepper.sysid.KINDS`: the field, with the column in brackets if the selector has columns."""
        columns = self.parsed.columns
        return self.parsed.field + ("" if columns is None else f"[{','.join(map(str, columns))}]")

    @classmethod
    def parse(cls, text: str) -> FitParameter:
        """Returns a parameter from a text such as "body_mass[box]", or with bounds "geom_friction[floor,box][0]=0.1..2"."""
        selector, bounds = parse_range(text, "parameters")
        return cls(str(selector), bounds=bounds)

    def __str__(self) -> str:
        return str(self.parsed)


def _no_kind(selector: Selector) -> str:
    """Error message for a selector of numbers that `identify` cannot estimate."""
    columns = [name for name in KINDS if name.startswith(f"{selector.field}[")]
    if columns and selector.columns is None:
        which = ", ".join(
            f"'{Selector(selector.field, selector.elements or ('*',), (k,))}' ({KINDS[name].quantity})" for k, name in enumerate(columns)
        )
        return f"parameters has '{selector}', of which each column is a parameter: write {which}"
    if selector.field in KINDS:
        return f"parameters has '{selector}': {selector.field} has no columns here; leave them out"
    return f"parameters: {selector.field!r} cannot be identified{did_you_mean_or_all(selector.field, KINDS)}"


class Variants:
    """Parameter values of several variants of a model: the fields that differ from the model, with the variants as leading axis.

    Attributes:
        fields: Arrays of the model's fields by name.
        delays: Delays of actuators by name, (count,) s.
    """

    def __init__(self, model: Model, count: int):
        self.model, self.count = model, count
        self.fields: dict[str, Array] = {}
        self.delays: dict[str, Array] = {}

    def of(self, field: str) -> Array:
        """Array of a field with one row per variant, (count, ...), which starts with the model's values and can be changed in place."""
        if field not in self.fields:
            own = np.asarray(getattr(self.model, field), np.float64)
            self.fields[field] = np.tile(own, (self.count, *(1,) * own.ndim))
        return self.fields[field]

    def actuators(self, known: ActuatorModel | None, index: Array | None = None) -> ActuatorModel | None:
        """Actuator model with the delays of all variants of the model, or None if no delay is a parameter.

        Args:
            known: Actuator model of the user with the other attributes of the drives; None if there is none.
            index: Index of the variant that each environment simulates, (num_envs,). With None, environment k simulates variant k.
        """
        if not self.delays:
            return None
        known = known or ActuatorModel()
        delays = {name: delay if index is None else delay[index] for name, delay in self.delays.items()}
        return ActuatorModel({name: replace(known.drive_of(name) or Drive(), delay=delay) for name, delay in delays.items()})


class Block:
    """Block of the parameter vector theta: the numbers of one parameter, n in total.

    Attributes:
        parameter: The parameter.
        labels, units: Labels and units of the values.
        start, low, high: Start of the search and bounds, as numbers of theta, (n,).
        scale: Size of a significant change of theta, (n,): 1 for logarithms. Finite differences and tolerances are relative to it.
        prior: Mean and standard deviation of theta, (n,) each, or None.
    """

    def __init__(self, parameter: FitParameter, model: Model):
        self.parameter, self.kind = parameter, KINDS[parameter.kind]
        self.index = _indices(parameter, model)
        own = [getattr(model, f"{self.kind.element}_names")[k] for k in self.index]
        self.names = tuple(name or f"#{k}" for name, k in zip(own, self.index, strict=True))
        items = tuple(item for name, k in zip(own, self.index, strict=True) for item in ([name] if name else _unnamed(parameter, model, k)))
        self.selector = Selector(parameter.parsed.field, items, parameter.parsed.columns)
        self.hint = self.kind.excite.format(" and ".join(self.names))
        self.labels: tuple[str, ...] = (str(self.selector),)
        self.units: tuple[str, ...] = (self.kind.unit,)
        self.start, self.low, self.high = np.zeros(1), np.zeros(1), np.zeros(1)
        self.prior: tuple[Array, Array] | None = None
        self._scale = 1.0
        self._prepare(model)
        self.scale = np.full(self.size, self._scale)

    @property
    def size(self) -> int:
        """Number n of entries of the parameter vector theta that belong to this parameter."""
        return len(self.start)

    @property
    def least(self) -> Array:
        """Greatest lower bounds of the values for all theta, (n,): 0 for positive quantities, otherwise minus infinity."""
        return np.full(self.size, 0.0 if self.kind.log else -math.inf)

    def _prepare(self, model: Model) -> None:
        """Sets labels, units, start and bounds of this parameter from the model. Subclasses for other kinds of parameters override it."""
        if check := _CHECKS.get(self.parameter.kind):
            check(self.parameter, model, self.index)
        numbers = self.selector if self.kind.columns is None else replace(self.selector, columns=self.kind.columns)
        self.parts = [(part.field, part.index.reshape(-1), part.sign) for part in parts_of(model, numbers, "parameters")]
        field, places, sign = self.parts[0]
        own = sign * np.asarray(getattr(model, field), np.float64).reshape(-1)[places]
        # Ratios to the first element's value in the model, which the parameter keeps. If that value is 0, all elements get the same value.
        self.ratio = own / own[0] if own[0] > 0 else np.ones(len(own))
        self._interval(own[0])

    def _interval(self, own: float) -> None:
        """Sets start, bounds and prior of a parameter that is a single number, whose value in the model is `own`."""
        parameter, kind = self.parameter, self.kind
        start = own if parameter.start is None else float(parameter.start)
        if kind.log and not start > 0:
            raise ValueError(f"{parameter}: it is {start:g} in the model, and its logarithm is identified; give a start above 0")
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
        """Writes the parameter's values for several variants of a model into the fields of these variants.

        Args:
            theta: Entries of the parameter vector theta, (count, size).
            variants: The `count` variants, which are changed in place.
        """
        value = self.natural(theta) * self.ratio
        before = self._flat(variants, self.parts[0][0])[:, self.parts[0][1]]
        for field, places, sign in self.parts:
            self._flat(variants, field)[:, places] = sign * value
        if self.kind.scaled is not None:
            field, columns = self.kind.scaled
            variants.of(field)[:, list(self.index), columns] *= (value / before)[..., None]

    @staticmethod
    def _flat(variants: Variants, field: str) -> Array:
        """View of a field of model variants, (count, numbers), which can be changed in place."""
        return variants.of(field).reshape(variants.count, -1)

    def natural(self, theta: Array) -> Array:
        """Values of the parameter in their units, (..., size), from its entries in the parameter vector theta, (..., size)."""
        return np.exp(theta) if self.kind.log else np.asarray(theta, float)


class _OfOneBody(Block):
    """Parameter with several numbers of a single body, such as its centre of mass. The search starts at the model's values."""

    def _single_body(self) -> int:
        """Index of the parameter's body. Raises ValueError if it selects several bodies, or has a start, bounds or a prior."""
        if (
            len(self.index) != 1
            or self.parameter.start is not None
            or self.parameter.bounds is not None
            or self.parameter.prior is not None
        ):
            raise ValueError(
                f"{self.parameter}: it must select one body, without start, bounds and prior: its numbers start at the model's values"
            )
        return self.index[0]

    def _gyration(self, model: Model) -> Array:
        """Radii of gyration of the body along its principal axes, (3,) m."""
        body = model.body(self.index[0])
        if not body.mass > 0:
            raise ValueError(f"{self.parameter}: body {body.name!r} has no mass; give it one with model.replace(body_mass=...)")
        return np.sqrt(shape.second_moments(np.asarray(body.inertia)).clip(1e-12) / body.mass)


class _Com(_OfOneBody):
    """Centre of mass of a body as a parameter. Theta is its position in the body's frame, (3,) m."""

    def _prepare(self, model: Model) -> None:
        """Sets start, bounds, scale, labels and units for a centre of mass."""
        body = self._single_body()
        self._scale = float(self._gyration(model).max())
        reach = 10 * self._scale
        self.labels = tuple(f"{self.selector}[{k}]" for k in range(3))
        self.units = ("m",) * 3
        self.start = np.array(model.body(body).ipos, float)
        self.low, self.high = self.start - reach, self.start + reach

    def write(self, theta: Array, variants: Variants) -> None:
        variants.of("body_ipos")[:, self.index[0]] = theta


class _Moments(_OfOneBody):
    """Principal moments of inertia of a body as a parameter.

    Theta is half the logarithm of the ratios of the second moments of mass to the model's, so that the triangle inequality holds.
    """

    def _prepare(self, model: Model) -> None:
        """Sets start, bounds, scale, labels and units for principal moments of inertia."""
        self._single_body()
        own = np.asarray(model.body(self.index[0]).inertia)
        moments = shape.second_moments(own)
        if not moments.min() > 1e-9 * moments.max():
            raise ValueError(f"{self.parameter}: the model's moments {own.tolist()} are those of a flat body, which is a bound; thicken it")
        self.own = moments
        self.labels = tuple(f"{self.selector}[{k}]" for k in range(3))
        self.units = ("kg m^2",) * 3
        self.start = np.zeros(3)
        self.low, self.high = np.full(3, -REACH), np.full(3, REACH)

    def write(self, theta: Array, variants: Variants) -> None:
        variants.of("body_inertia")[:, self.index[0]] = self.natural(theta)

    def natural(self, theta: Array) -> Array:
        return shape.principal_moments(self.own * np.exp(2 * theta))


class _Inertia(_OfOneBody):
    """Mass, centre of mass and inertia of a body as a parameter.

    Theta is ten log-Cholesky parameters (inertia.py), 0 for the model's body.
    """

    def _prepare(self, model: Model) -> None:
        """Sets start, bounds, scale, labels and units for all inertial parameters of a body."""
        self._single_body()
        self._gyration(model)
        self.body = model.body(self.index[0])
        self.R = matrices(np.asarray(self.body.iquat))
        parts = ("mass", "com.x", "com.y", "com.z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
        self.labels = tuple(f"{self.selector}.{part}" for part in parts)
        self.units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
        self.start = np.zeros(10)
        reach = np.array([REACH / 2, *(REACH,) * 3, *(10.0,) * 6])
        self.low, self.high = -reach, reach

    @property
    def least(self) -> Array:
        return np.array([0.0, *(-math.inf,) * 3, *(0.0,) * 3, *(-math.inf,) * 3])

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
    """Delay of actuators as a parameter, s."""

    def _prepare(self, model: Model) -> None:
        self._interval(0.0)
        self._scale = 0.01

    def write(self, theta: Array, variants: Variants) -> None:
        for name in self.names:
            variants.delays[name] = theta[:, 0]


class _Reading(Block):
    """Bias, scale or delay of a sensor as a parameter. `Simulator` applies it to the predicted readings."""

    def _prepare(self, model: Model) -> None:
        if self.parameter.kind != "sensor.bias":
            self._interval(1.0 if self.parameter.kind == "sensor.scale" else 0.0)
            self._scale = 0.01 if self.parameter.kind == "sensor.delay" else 1.0
            return
        if len(self.index) != 1:
            raise ValueError(f"{self.parameter}: every sensor has a separate bias; give a parameter for each")
        dim = model.sensor(self.index[0]).dim
        self._interval(0.0)
        if dim > 1:
            self.labels = tuple(f"{self.selector}[{k}]" for k in range(dim))
            self.units = ("",) * dim
            self.start, self.low, self.high = (np.repeat(x, dim) for x in (self.start, self.low, self.high))
            self.prior = None if self.prior is None else (np.repeat(self.prior[0], dim), np.repeat(self.prior[1], dim))

    def write(self, theta: Array, variants: Variants) -> None:
        """Writes nothing, because parameters of sensors are not part of the model."""


_BLOCKS: dict[str, type[Block]] = {
    "body_ipos": _Com, "body_inertia": _Moments, "body_inertial": _Inertia, "actuator.delay": _Delay, **dict.fromkeys(READING, _Reading),
}  # fmt: skip
_SAME = {
    "body_inertial": ("body_mass", "body_ipos", "body_inertia", "body_inertial"),
    "actuator_kp": ("actuator_kp", "actuator_gainprm"),
    "actuator_gainprm": ("actuator_kp", "actuator_gainprm"),
}
"""Kinds of parameters that change some of the same numbers of a model, by name of a kind.

For example, "body_inertial" and "body_mass" both change the mass. `bind` rejects two parameters of such kinds for one element.
"""


def bind(parameters: Sequence[FitParameter | str], model: Model) -> list[Block]:
    """Blocks of the parameter vector theta, one for each parameter.

    Raises:
        ValueError: A name is unknown, two parameters change the same number, or a start is outside the bounds. The same error is raised
            if a contact pair of the model overrides a parameter of its two geoms.
    """
    if isinstance(parameters, str | FitParameter):
        parameters = [parameters]
    check_kind("model", model, Model, "stepper.load(path) reads one")
    if not isinstance(parameters, Sequence) or not all(isinstance(p, str | FitParameter) for p in parameters):
        raise TypeError(f"parameters is {parameters!r}, must be a list of selectors or FitParameter, as ['body_mass[box]']")
    given = [FitParameter.parse(p) if isinstance(p, str) else p for p in parameters]
    if not given:
        raise ValueError('there is no parameter to identify; give some, as in ["body_mass[box]", "geom_friction[floor,box][0]"]')
    blocks = [_BLOCKS.get(p.kind, Block)(p, model) for p in given]
    taken: dict[tuple[str, int], FitParameter] = {}
    for block in blocks:
        for kind in _SAME.get(block.parameter.kind, (block.parameter.kind,)):
            for k in block.index:
                if (kind, k) in taken:
                    raise conflict("parameters", taken[kind, k], block.parameter, block.parameter.parsed.field)
                taken[kind, k] = block.parameter
    for block in blocks:
        field, columns = block.selector.field, block.selector.columns
        pairs = {k for other in blocks if other.selector.field == OF_PAIRS.get(field) for k in other.index}
        try:
            column = "" if columns is None else f"[{columns[0]}]"
            check_pairs(model, field, block.index, pairs, f"identify '{OF_PAIRS.get(field)}[{{pair}}]{column}' too")
        except ValueError as error:
            raise ValueError(f"{block.parameter}: {error}") from None
    return blocks


def write(blocks: Sequence[Block], theta: Array, model: Model) -> Variants:
    """Variants of a model, one for each of the parameter vectors theta, (count, n)."""
    variants = Variants(model, len(theta))
    # Masses are written first: they scale the moments of inertia. A parameter of the kind "body_inertia" then replaces the moments.
    for block, piece in sorted(zip(blocks, split(blocks, theta), strict=True), key=lambda part: part[0].parameter.kind == "body_inertia"):
        block.write(piece, variants)
    return variants


def split(blocks: Sequence[Block], theta: Array) -> list[Array]:
    """Splits parameter vectors theta, (..., n), into one array (..., size) per parameter."""
    return np.split(theta, np.cumsum([block.size for block in blocks])[:-1], axis=-1)


def natural(blocks: Sequence[Block], theta: Array) -> Array:
    """Values of all parameters in their units, (..., n), from parameter vectors theta, (..., n)."""
    return np.concatenate([block.natural(piece) for block, piece in zip(blocks, split(blocks, theta), strict=True)], axis=-1)


def derivatives(function: Callable[[Array], Array], theta: Array, scale: Array) -> Array:
    """Derivatives of a function of the parameter vector, (p, n), by central differences.

    Args:
        function: Function of parameter vectors (count, n) that returns (count, p).
        theta: Parameter vector, (n,).
        scale: Scales of its numbers, (n,).
    """
    up, down = (function(theta + sign * np.diag(1e-6 * scale)) for sign in (1, -1))
    return np.asarray((up - down).T / (2e-6 * scale))


def value_slopes(blocks: Sequence[Block], theta: Array) -> Array:
    """Derivatives of all values with respect to the parameter vector theta, (n, n)."""
    return derivatives(lambda x: natural(blocks, x), theta, np.concatenate([block.scale for block in blocks]))


def _indices(parameter: FitParameter, model: Model) -> tuple[int, ...]:
    """Indices of a parameter's elements in the model, such as bodies. For degrees of freedom they are the indices of the joints."""
    items, where = parameter.parsed.elements or (), f"parameters has '{parameter}'"
    if not parameter.parsed.field.startswith("dof_"):
        return tuple(rows_of(model, KINDS[parameter.kind].element, items, where))
    joints = [k for k in range(model.njnt) for _ in range(model.joint(k).nv)]
    return tuple(dict.fromkeys(joints[row] for row in rows_of(model, "dof", items, where)))


def _check_gain_types(parameter: FitParameter, model: Model, index: Sequence[int]) -> None:
    """Raises ValueError unless the gains of all actuators are proportional to `gainprm` (gaintype "fixed" or "affine")."""
    for actuator in map(model.actuator, index):
        if actuator.gaintype not in ("fixed", "affine"):
            raise ValueError(
                f'{parameter}: the gaintype of actuator "{actuator.name or actuator.id}" is "{actuator.gaintype}", and gains are '
                'identified of types "fixed" and "affine" alone; leave it out, or give the source one of these'
            )


def _check_servo(parameter: FitParameter, model: Model, index: Sequence[int]) -> None:
    """Raises ValueError unless every actuator is a position servo: biasprm[1] is -gainprm[0]."""
    for actuator in map(model.actuator, index):
        if not np.isclose(actuator.biasprm[1], -actuator.gainprm[0]):
            raise ValueError(
                f"{parameter}: {actuator.name or f'#{actuator.id}'} is no position servo, its bias is "
                f"{np.asarray(actuator.biasprm).tolist()}; identify its actuator_gainprm"
            )


_CHECKS = {"actuator_gainprm": _check_gain_types, "actuator_kp": _check_servo}
"""Functions that raise ValueError if a parameter's elements do not fit its kind, by kind of parameter."""


def _unnamed(parameter: FitParameter, model: Model, index: int) -> list[int]:
    """Indices with which a selector selects an element that has no name.

    They are the index of the element, or for fields of degrees of freedom the indices of all degrees of freedom of a joint.
    """
    if not parameter.parsed.field.startswith("dof_"):
        return [index]
    joint = model.joint(index)
    return list(range(joint.dofadr, joint.dofadr + joint.nv))

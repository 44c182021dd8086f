"""Parameters of a study: what of a model, its sensors, its actuators, its settings or its drive they change, and how far.

What a parameter changes is said by its `target`:

    geom_friction, body_mass, dof_damping ...   a field of `stepper.Model` that `Model.replace` takes
    kp, kd                                      gains of position and velocity servos: gain[0] with bias[1]; bias[2]
    sensor.delay, sensor.noise_std ...          a number of `stepper.Transfer`
    actuator.delay, actuator.servo.kp ...       a number of `stepper.Drive`, its motor or its servo
    options.timestep, options.contact ...       a setting of the step; options.precision too
    drive                                       nothing of the model: the drive and the measures read it, as `now.theta[name]`
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import near
from stepper._options import Options
from stepper._stepper import Model
from stepper.actuators import PID, ActuatorModel, DCMotor, Drive
from stepper.sensors import SensorModel, Transfer
from stepper.shared.fields import OF_PAIRS, check_pairs

Array = NDArray[np.float64]
Value = float | str
Theta = Mapping[str, Value]
"""Values of parameters by name."""

ROWS_FROM_NOTHING = ("jnt_stiffness", "dof_frictionloss")
"""Fields of which a batch must have some for an environment to have any."""
CHOICES = {"contact", "integrator", "solver", "stabilization", "precision"}
"""Settings that are words."""
COUNTS = {"iterations", "max_contacts"}
"""Settings that are whole numbers."""
SETTINGS = frozenset(field.name for field in fields(Options)) | {"precision"}
LEVELS = 5


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number that may be other than it is, how far, and how one knows.

    Attributes:
        target: What it changes, see `stepper.lab.study.parameters`.
        names: Elements that change, by name or pattern: geoms (also "body/geom", and "body/*" for all of a body), explicit pairs (also
            "geom/geom"), bodies, joints, actuators, sensors, tendons; "#3" is an index.
        column: Which number of each element, e.g. 0 for the sliding friction of "geom_friction"; None is all.
        how: "set" to the value, "scale" by it, or "add" it. With body_mass, inertia is scaled alike: the same shape of another density.
        low: Least plausible value.
        high: Greatest one.
        values: Values of a sweep in place of five between low and high; words too for settings.
        nominal: The value where nothing is perturbed; None leaves the model as it is.
        unit: Of the value.
        source: Where the range comes from: a data sheet, a measurement, a paper.
    """

    target: str
    names: tuple[str, ...] = ("*",)
    column: int | None = None
    how: str = "set"
    low: float | None = None
    high: float | None = None
    values: tuple[Value, ...] | None = None
    nominal: Value | None = None
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.how not in ("set", "scale", "add"):
            raise ValueError(f'how is {self.how!r}, must be "set", "scale" or "add"')
        object.__setattr__(self, "names", (self.names,) if isinstance(self.names, str) else tuple(self.names))
        if self.values is not None:
            object.__setattr__(self, "values", tuple(self.values))
        for name in ("low", "high"):
            value = getattr(self, name)
            if value is not None and not _is_number(value):
                remedy = f': a choice among words takes values, as in values = ("{value}", ...)' if isinstance(value, str) else ""
                raise ValueError(f"{name} is {value!r}, must be a number{remedy}")
        if self.kind == "options" and self.leaf in CHOICES and self.values is None:
            raise ValueError(f"target is {self.target!r}, which is a choice among words: give values, not low and high")
        bounds = (self.low, self.high)
        if self.values is None and None in bounds:
            raise ValueError(f"low is {self.low} and high is {self.high}: give both, or values")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low is {self.low}, must be below high, which is {self.high}")
        if self.kind == "options" and self.leaf not in SETTINGS:
            guess, known = near(self.leaf, SETTINGS), ", ".join(sorted(SETTINGS))
            raise ValueError(f"target is {self.target!r}, and there is no setting {self.leaf!r}{guess or ','} settings are: {known}")
        if "." in self.target and self.kind == "field":
            guess = near(self.target.partition(".")[0], ("sensor", "actuator", "options"))
            raise ValueError(f"target is {self.target!r}: what stands before the dot must be sensor, actuator or options{guess}")

    @property
    def kind(self) -> str:
        """Of what the target is: "field", "sensor", "actuator", "options" or "drive"."""
        head = self.target.partition(".")[0]
        return head if head in ("sensor", "actuator", "options", "drive") else "field"

    @property
    def leaf(self) -> str:
        """The target behind its first dot."""
        return self.target.partition(".")[2]

    @property
    def unchanged(self) -> Value | None:
        """The value that changes nothing: the nominal one; or 1 of a factor, 0 of a sum."""
        return self.nominal if self.nominal is not None else {"scale": 1.0, "add": 0.0}.get(self.how)

    def levels(self) -> list[Value]:
        """Values of a sweep, in order."""
        if self.values is not None:
            return list(self.values)
        assert self.low is not None
        assert self.high is not None
        made = np.linspace(self.low, self.high, LEVELS)
        return [round(x) for x in made] if self.leaf in COUNTS else [float(x) for x in made]

    def check_value(self, value: Any, where: str) -> None:
        """Raises ValueError for what is no value of this parameter; `where` is what the message calls it."""
        if self.kind == "options" and self.leaf in CHOICES:
            if not isinstance(value, str):
                raise ValueError(f"{where} is {value!r}, must be a word: it is {self.leaf}")
        elif isinstance(value, str) and self.kind == "drive":
            known = [own for own in (*(self.values or ()), self.nominal) if isinstance(own, str)]
            if value not in known:
                raise ValueError(f"{where} is {value!r}, must be {'of: ' + ', '.join(known) if known else 'a number'}")
        elif not _is_number(value):
            raise ValueError(f"{where} is {value!r}, must be a finite number")
        elif self.kind == "options" and self.leaf in COUNTS and value != int(value):
            raise ValueError(f"{where} is {value!r}, must be a whole number")

    def change(self, before: Any, value: Any) -> Any:
        """A number with this parameter at a value."""
        return value if self.how == "set" else before * value if self.how == "scale" else before + value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def check(parameters: Mapping[str, Parameter], model: Model) -> None:
    """Raises ValueError for a parameter that changes nothing of a model, named."""
    for name, parameter in parameters.items():
        try:
            if parameter.kind == "field":
                _places(parameter, model)
            elif parameter.kind == "sensor":
                _chosen(parameter, [[s["name"] or f"#{i}"] for i, s in enumerate(model.sensors)], "sensor")
                _number_of(Transfer, parameter.leaf)
            elif parameter.kind == "actuator":
                _chosen(parameter, _labels(model.actuator_names), "actuator")
                part, _, leaf = parameter.leaf.rpartition(".")
                if part not in _PARTS:
                    raise ValueError(f"target is {parameter.target!r}: a drive has no {part!r}, it has: motor, servo")
                _number_of(_PARTS[part], leaf)
            elif parameter.kind == "drive" and parameter.unchanged is None:
                raise ValueError("give it a nominal value, which the drive reads where nothing is perturbed")
        except (AttributeError, TypeError, ValueError) as error:
            raise ValueError(f"parameter {name!r}: {error}") from None
    _check_pairs(parameters, model)


def _check_pairs(parameters: Mapping[str, Parameter], model: Model) -> None:
    """Raises ValueError for a field of geoms that an explicit pair overrides."""
    for name, parameter in parameters.items():
        if parameter.target not in OF_PAIRS:
            continue
        target = OF_PAIRS[parameter.target]
        pairs = {k for other in parameters.values() if other.target == target for k in _indices(other, model)}
        try:
            check_pairs(model, parameter.target, _indices(parameter, model), pairs, f'give a parameter with target "{target}" too')
        except ValueError as error:
            raise ValueError(f"parameter {name!r}: {error}") from None


def _indices(parameter: Parameter, model: Model) -> list[int]:
    """Elements that a parameter of a field changes."""
    rows, what = _elements(parameter.target, model)
    return _chosen(parameter, rows, what)


_PARTS: dict[str, type] = {"": Drive, "motor": DCMotor, "servo": PID}
"""What numbers of an actuator are of, by what stands before the last dot."""
_NO_NUMBERS = frozenset({"noise", "limits", "motor", "servo", "control"})


def _number_of(kind: type, leaf: str) -> None:
    """Raises ValueError where a transfer function or drive has no number of a name."""
    known = [field.name for field in fields(kind) if field.name not in _NO_NUMBERS]
    if leaf not in known:
        raise ValueError(f"a {kind.__name__} has no number {leaf!r}{near(leaf, known) or ','} it has: {', '.join(known)}")


def _labels(names: Sequence[str]) -> list[list[str]]:
    return [[name or f"#{i}", f"#{i}"] for i, name in enumerate(names)]


def _elements(field: str, model: Model) -> tuple[list[list[str]], str]:
    """Labels of the rows of a field, and what they are."""
    kind = field.partition("_")[0]
    if kind == "geom":
        geoms = [model.geom(i) for i in range(model.ngeom)]
        return [[g.name or f"#{g.id}", f"#{g.id}", f"{model.body(g.bodyid).name}/{g.name}"] for g in geoms], "geom"
    if kind == "pair":
        pairs = [model.pair(i) for i in range(model.npair)]
        ends = [[model.geom(g).name or f"#{g}" for g in (pair.geom1, pair.geom2)] for pair in pairs]
        return [[p.name or f"#{p.id}", f"#{p.id}", "/".join(own)] for p, own in zip(pairs, ends, strict=True)], "pair"
    if kind == "dof":
        joints = [model.joint(i) for i in range(model.njnt)]
        return [[j.name or f"#{j.id}", f"#{j.id}"] for j in joints for _ in range(j.nv)], "joint"
    names = {"body": model.body_names, "jnt": model.joint_names, "actuator": model.actuator_names, "tendon": model.tendon_names}
    return (_labels(names[kind]), kind) if kind in names else ([], field)


def _chosen(parameter: Parameter, labels: list[list[str]], what: str) -> list[int]:
    found = [i for i, own in enumerate(labels) if any(fnmatch.fnmatchcase(label, pattern) for label in own for pattern in parameter.names)]
    if not found:
        known = ", ".join(own[0] for own in labels[:30]) or "none"
        raise ValueError(f"no {what} fits {list(parameter.names)}, there are: {known}{' ...' if len(labels) > 30 else ''}")
    return found


def _fields(parameter: Parameter) -> list[tuple[str, int | None]]:
    """Fields of the model with the columns that a target stands for."""
    gains: dict[str, list[tuple[str, int | None]]] = {
        "kp": [("actuator_gain", 0), ("actuator_bias", 1)],
        "kd": [("actuator_bias", 2)],
    }
    return gains.get(parameter.target) or [(parameter.target, parameter.column)]


def _places(parameter: Parameter, model: Model) -> list[tuple[str, Any]]:
    """(field, index into it) of all numbers that change."""
    places: list[tuple[str, Any]] = []
    for field, column in _fields(parameter):
        try:
            value = np.asarray(getattr(model, field), float)
        except (AttributeError, TypeError, ValueError):
            fields_of = [name for name in dir(model) if not name.startswith("_") and isinstance(getattr(model, name, None), np.ndarray)]
            guess = near(field, [*fields_of, "kp", "kd", "drive"])
            raise ValueError(
                f"target is {parameter.target!r}, which is no field of a model that can be replaced{guess or ';'} see help(stepper.Model)"
            ) from None
        rows, what = _elements(field, model)
        if value.ndim == 0 or not rows:
            places.append((field, () if column is None else (column,)))
            continue
        chosen = _chosen(parameter, rows, what)
        if field in ("body_mass", "body_inertia"):
            # What has no mass cannot be given some.
            chosen = [i for i in chosen if np.any(value[i] > 0)]
        if column is not None and not 0 <= column < (value.shape[1] if value.ndim > 1 else 1):
            raise ValueError(f"column is {column}, and {field} has the shape {value.shape}")
        places.append((field, chosen if column is None or value.ndim == 1 else (chosen, column)))
    return places


def model_fields(parameters: Mapping[str, Parameter], model: Model, thetas: Sequence[Theta]) -> dict[str, Array]:
    """Fields that differ from those of a model, one row for every theta: (n, *shape).

    Raises:
        ValueError: A parameter that fits nothing of the model.
    """
    made: dict[str, Array] = {}
    for name, parameter in parameters.items():
        if parameter.kind != "field" or not any(name in theta for theta in thetas):
            continue
        masses = made.get("body_mass", np.asarray(model.body_mass, float)).copy()
        for field, index in _places(parameter, model):
            own = np.asarray(getattr(model, field), float)
            rows = made.setdefault(field, np.tile(own, (len(thetas), *[1] * own.ndim)))
            for env, theta in enumerate(thetas):
                if name in theta:
                    _set(rows, (env, *index) if isinstance(index, tuple) else (env, index), parameter, theta[name], field)
        if parameter.target == "body_mass":
            _scale_inertia(made, model, masses)
    return {field: rows for field, rows in made.items() if not np.array_equal(rows, np.broadcast_to(getattr(model, field), rows.shape))}


def _set(rows: Array, at: tuple[Any, ...], parameter: Parameter, value: Value, field: str) -> None:
    number = float(value)
    # The stiffness of a servo is the negative of its bias.
    signed = -number if field == "actuator_bias" and parameter.target in ("kp", "kd") and parameter.how == "set" else number
    rows[at] = parameter.change(rows[at], signed)


def _scale_inertia(made: dict[str, Array], model: Model, before: Array) -> None:
    """Scales inertia as a parameter has changed masses from those before it; what other parameters made of either stays."""
    masses, own = made["body_mass"], np.asarray(model.body_inertia, float)
    rows = made.setdefault("body_inertia", np.tile(own, (len(masses), 1, 1)))
    rows *= np.divide(masses, before, out=np.ones_like(masses), where=before > 0)[:, :, None]


def sensor_model(
    parameters: Mapping[str, Parameter], base: SensorModel | None, model: Model, thetas: Sequence[Theta]
) -> SensorModel | None:
    """Transfer functions with the values of parameters, a number for every theta; None for ideal sensors."""
    given = {name: p for name, p in parameters.items() if p.kind == "sensor" and any(name in theta for theta in thetas)}
    if not given:
        return base
    names = [s["name"] or f"#{i}" for i, s in enumerate(model.sensors)]
    named: dict[str, Transfer] = dict(base.named) if base else {}
    for name, parameter in given.items():
        for index in _chosen(parameter, [[n] for n in names], "sensor"):
            label = names[index]
            own = named.get(label) or _fitting(base, label) or Transfer()
            before = getattr(own, parameter.leaf)
            changed: dict[str, Any] = {parameter.leaf: _numbers(parameter, before, [theta.get(name) for theta in thetas])}
            named[label] = replace(own, **changed)
    return SensorModel(named, default=base.default if base else None)


def _fitting(base: SensorModel | None, name: str) -> Transfer | None:
    if base is None:
        return None
    patterns = [transfer for pattern, transfer in base.named.items() if fnmatch.fnmatchcase(name, pattern)]
    return patterns[0] if patterns else base.default


def _numbers(parameter: Parameter, before: Any, values: Sequence[Value | None]) -> Array:
    own = 0.0 if before is None else before
    return np.array([own if value is None else parameter.change(own, float(value)) for value in values], float)


def actuator_model(
    parameters: Mapping[str, Parameter], base: ActuatorModel | None, model: Model, thetas: Sequence[Theta]
) -> ActuatorModel | None:
    """Drives with the values of parameters, a number for every theta; None for ideal actuators.

    Raises:
        ValueError: A number of a servo or motor that the drive does not have.
    """
    given = {name: p for name, p in parameters.items() if p.kind == "actuator" and any(name in theta for theta in thetas)}
    if not given:
        return base
    named: dict[str, Drive] = dict(base.named) if base else {}
    for name, parameter in given.items():
        values = [theta.get(name) for theta in thetas]
        for index in _chosen(parameter, _labels(model.actuator_names), "actuator"):
            label = model.actuator_names[index] or f"#{index}"
            own = named.get(label) or (base.drive_of(label) if base else None) or Drive()
            named[label] = _driven(own, parameter, values, f"parameter {name!r}: actuator {label!r}")
    return ActuatorModel(named, default=base.default if base else None)


def _driven(own: Drive, parameter: Parameter, values: Sequence[Value | None], place: str) -> Drive:
    part, _, leaf = parameter.leaf.rpartition(".")
    holder: Drive | PID | DCMotor | None = own if not part else getattr(own, part, None)
    if holder is None or not hasattr(holder, leaf):
        raise ValueError(f"{place} has no {parameter.leaf}; give the study actuators with one")
    changed: dict[str, Any] = {leaf: _numbers(parameter, getattr(holder, leaf), values)}
    if isinstance(holder, Drive):
        return replace(holder, **changed)
    changed = {part: replace(holder, **changed)}
    return replace(own, **changed)

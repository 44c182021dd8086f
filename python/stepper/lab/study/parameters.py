"""Parameters of a study: uncertain numbers of a model, its sensors, actuators, settings or controller, with their ranges.

A selector (`stepper.shared.selectors`, docs/reference/what_can_vary.md) names the numbers that a parameter changes.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import did_you_mean, unknown_field
from stepper._options import Options
from stepper._stepper import Model
from stepper.actuators import PID, ActuatorModel, DCMotor, Drive
from stepper.sensors import SensorModel, Transfer
from stepper.shared.fields import COMPOUNDS, FIELDS, OF_PAIRS, check_pairs
from stepper.shared.selectors import Selector, conflict, numbers_of, parse, parse_range, parts_of, rows_of
from stepper.shared.tables import fitting

Array = NDArray[np.float64]
Value = float | str
Values = Mapping[str, Value]
"""Values of a study's parameters by name."""

ROWS_FROM_NOTHING = ("jnt_stiffness", "dof_frictionloss")
"""Fields of a model that add a constraint at compilation only if their value is above 0.

If any environment of a batch has a positive value, the model is compiled with the largest value. Each environment gets its value later.
"""
CHOICES = {"contact", "integrator", "solver", "stabilization", "precision"}
"""Names of the options of a step whose values are texts, such as "contact" with the value "hard"."""
COUNTS = {"iterations", "max_contacts"}
"""Names of the options of a step whose values are whole numbers."""
SETTINGS = frozenset(field.name for field in fields(Options)) | {"precision"}
"""Names of the options that can follow "options." in a selector, as in "options.timestep"."""
LEVELS = 5
"""Number of values at which a sweep evaluates a parameter with a range, from `low` to `high`."""
_HEADS = ("sensor", "actuator", "options", "controller")
"""First words of the selectors that name no field of the model, such as "sensor" of "sensor.delay[imu]"."""
OF_MODEL = frozenset({"field", "sensor", "actuator"})
"""Types of parameters (values of `Parameter.kind`) whose selectors name elements of the model."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Parameter of a study: a number that may vary, its range and the source of the range.

    Attributes:
        selector: Numbers that change, `field[names][columns]` (docs/reference/what_can_vary.md): "geom_friction[floor,box][0]",
            "actuator.delay[hip]", "options.timestep", "controller".
        operation: Operation of a value on the model's number: "set" replaces it, "scale" multiplies it, "add" adds to it. With body_mass,
            the inertia is multiplied by the same factor as the mass, as with a change of density.
        low: Lowest plausible value.
        high: Highest plausible value.
        values: Values at which a sweep evaluates the parameter. Without them, a sweep takes five values from low to high. Settings such as
            "controller" may have texts as values.
        nominal: Nominal value, for episodes in which other parameters vary; None keeps the model's number.
        unit: Unit of the value, for tables.
        source: Source of the range: a data sheet, a measurement, a paper.
    """

    selector: str = dataclasses.field(kw_only=False)
    operation: str = "set"
    low: float | None = None
    high: float | None = None
    values: tuple[Value, ...] | None = None
    nominal: Value | None = None
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.operation not in ("set", "scale", "add"):
            raise ValueError(f'operation is {self.operation!r}, must be "set", "scale" or "add"')
        self._check_values()
        for name in ("low", "high"):
            value = getattr(self, name)
            if value is not None and not _is_number(value):
                remedy = f': a choice among words takes values, as in values = ("{value}", ...)' if isinstance(value, str) else ""
                raise ValueError(f"{name} is {value!r}, must be a number{remedy}")
        if self.kind == "options" and self.leaf in CHOICES and self.values is None:
            raise ValueError(f"selector is {self.selector!r}, which is a choice among words: give values, not low and high")
        bounds = (self.low, self.high)
        if self.values is None and None in bounds:
            raise ValueError(f"low is {self.low} and high is {self.high}: give both, or values")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low is {self.low}, must be below high, which is {self.high}")
        if self.kind == "options" and self.leaf not in SETTINGS:
            guess, known = did_you_mean(self.leaf, SETTINGS), ", ".join(sorted(SETTINGS))
            raise ValueError(f"selector is {self.selector!r}, and there is no setting {self.leaf!r}{guess or ','} settings are: {known}")
        if "." in self.parsed.field and self.kind == "field":
            guess = did_you_mean(self.parsed.field.partition(".")[0], _HEADS[:3])
            raise ValueError(f"selector is {self.selector!r}: before the dot must be sensor, actuator or options{guess}")
        if self.kind != "field" and self.parsed.columns is not None:
            raise ValueError(f"selector is {self.selector!r}, which has no columns: leave them out")
        if self.kind in ("options", "controller") and self.parsed.elements is not None:
            raise ValueError(f"selector is {self.selector!r}: {self.parsed.field} has no elements; leave the brackets out")

    def _check_values(self) -> None:
        """Stores `values` as a tuple. Raises TypeError or ValueError unless `values` and `nominal` are numbers or texts."""
        if self.values is not None:
            if isinstance(self.values, str) or not isinstance(self.values, Iterable):
                raise TypeError(f"values is {self.values!r}, must be a list of values, as (0.2, 0.5, 1.0)")
            object.__setattr__(self, "values", tuple(self.values))
        nominal = () if self.nominal is None else (self.nominal,)
        for where, value in (*(("values", value) for value in self.values or ()), *(("nominal", value) for value in nominal)):
            if not isinstance(value, str) and not _is_number(value):
                raise ValueError(f"{where} of {self.selector!r} has {value!r}, must be finite numbers, or texts for a choice among words")

    @property
    def parsed(self) -> Selector:
        """Parsed selector: field, elements and columns."""
        return parse(self.selector)

    @property
    def kind(self) -> str:
        """Type of the numbers that the selector names: "field" (of the model), "sensor", "actuator", "options" or "controller"."""
        head = self.parsed.field.partition(".")[0]
        return head if head in _HEADS else "field"

    @property
    def leaf(self) -> str:
        """Text after the first dot of the selector, without brackets: "delay" of "actuator.delay[hip]". Empty without a dot."""
        return self.parsed.field.partition(".")[2]

    @property
    def unchanged(self) -> Value | None:
        """Value of the parameter in episodes that do not vary it.

        It is the nominal value. Without a nominal value it is 1 for the operation "scale", 0 for "add", and None for "set".
        """
        return self.nominal if self.nominal is not None else {"scale": 1.0, "add": 0.0}.get(self.operation)

    def levels(self) -> list[Value]:
        """Returns the values of the parameter in a sweep, in order."""
        if self.values is not None:
            return list(self.values)
        assert self.low is not None
        assert self.high is not None
        made = np.linspace(self.low, self.high, LEVELS)
        return [round(x) for x in made] if self.leaf in COUNTS else [float(x) for x in made]

    def check_value(self, value: Any, where: str) -> None:
        """Raises ValueError if a value is invalid for this parameter; `where` names the value in the message."""
        if self.kind == "options" and self.leaf in CHOICES:
            if not isinstance(value, str):
                raise ValueError(f"{where} is {value!r}, must be a text, because {self.leaf} is a choice among names")
        elif isinstance(value, str) and self.kind == "controller":
            known = [own for own in (*(self.values or ()), self.nominal) if isinstance(own, str)]
            if value not in known:
                raise ValueError(f"{where} is {value!r}, must be {'of: ' + ', '.join(known) if known else 'a number'}")
        elif not _is_number(value):
            raise ValueError(f"{where} is {value!r}, must be a finite number")
        elif self.kind == "options" and self.leaf in COUNTS and value != int(value):
            raise ValueError(f"{where} is {value!r}, must be a whole number")

    def change(self, before: Any, value: Any) -> Any:
        """Returns the number after the operation: `before` replaced by `value`, multiplied by it, or increased by it."""
        return value if self.operation == "set" else before * value if self.operation == "scale" else before + value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def selected(parameters: Mapping[str, Parameter], texts: Sequence[str], model: Model) -> dict[str, Parameter]:
    """Parameters by name, from names of a study's parameters or from selectors with a range.

    Selectors of the same numbers with the same range are one parameter.

    Raises:
        ValueError: A text is neither a name nor a selector, or two selectors of the same numbers have different ranges.
    """
    if isinstance(texts, str) or not isinstance(texts, Sequence) or not all(isinstance(text, str) for text in texts):
        raise TypeError(f"parameters is {texts!r}, must be a list of names or selectors, as ['geom_friction[floor][0]=0.2..1']")
    found: dict[str, Parameter] = {}
    changed: dict[str, frozenset[tuple[str, int]]] = {}
    for text in texts:
        name, own = (text, parameters[text]) if text in parameters else _with_range(text, parameters)
        # Two parameters of the study may change the same numbers; they are chosen by name, and are not compared.
        others = [other for other in found if not {name, other} <= parameters.keys()]
        numbers = _changed(own, model)
        same = next((other for other in others if changed[other] == numbers), None)
        if same is None:
            found[name], changed[name] = own, numbers
        elif (found[same].operation, found[same].low, found[same].high) != (own.operation, own.low, own.high):
            raise conflict("parameters", text, same, own.parsed.field, "with different ranges")
    return found


def _with_range(text: str, parameters: Mapping[str, Parameter]) -> tuple[str, Parameter]:
    """Name and parameter from a selector with its range, such as "geom_friction[floor][0]=0.2..1"."""
    selector, bounds = parse_range(text, "parameters") if _selects(text) else (None, None)
    if selector is None or bounds is None:
        raise ValueError(_no_parameter(text, parameters, "give a selector with its range, as 'geom_friction[floor][0]=0.2..1'"))
    return str(selector), Parameter(str(selector), low=bounds[0], high=bounds[1])


def _changed(parameter: Parameter, model: Model) -> frozenset[tuple[str, int]]:
    """Set of the numbers that a parameter changes, as pairs of a field and an index. Selectors of the same numbers give equal sets."""
    if parameter.kind == "field":
        return numbers_of(model, parameter.parsed, _where(parameter))
    rows = rows_of(model, parameter.kind, parameter.parsed.elements, _where(parameter)) if parameter.kind in ("sensor", "actuator") else [0]
    return frozenset((parameter.parsed.field, row) for row in rows)


def _set_numbers(parameter: Parameter, model: Model) -> frozenset[tuple[str, int]]:
    """Set of the numbers of the model or engine that a parameter replaces, as pairs of a field and an index.

    It is empty if the parameter scales numbers, adds to them, or is read by the controller.
    """
    return _changed(parameter, model) if parameter.operation == "set" and parameter.kind != "controller" else frozenset()


def _no_parameter(text: str, parameters: Mapping[str, Parameter], otherwise: str) -> str:
    """Error message for a text that is neither the name of a parameter nor a selector."""
    field = text.partition("=")[0].partition("[")[0].strip()
    head, dot, _ = field.partition(".")
    word, words = (head, _HEADS[:3]) if dot else (field, [*FIELDS, *COMPOUNDS])
    hint = did_you_mean(text, parameters) or ("" if word in words else did_you_mean(word, words))
    return f"there is no parameter {text!r}{hint or ','} there are: {', '.join(parameters) or 'none'}; or {otherwise}"


def _selects(text: str) -> bool:
    """Whether a text begins like a selector: with a field of the model, or with "sensor", "actuator" or "options"."""
    field = text.partition("=")[0].partition("[")[0].strip()
    return field in FIELDS or field in COMPOUNDS or field.partition(".")[0] in _HEADS[:3]


def with_nominal(parameters: Mapping[str, Parameter], values: Mapping[str, Value]) -> dict[str, Parameter]:
    """Parameters with new nominal values, by name or selector."""
    found = dict(parameters)
    for text, value in values.items():
        if text not in parameters and not _selects(text):
            raise ValueError(_no_parameter(text, parameters, "give a selector, as 'geom_friction[floor][0]'"))
        own = parameters.get(text) or Parameter(text, values=(value,))
        own.check_value(value, f"parameter {text!r}")
        found[text] = dataclasses.replace(own, nominal=value)
    return found


def check_value_conflicts(chosen: Mapping[str, Parameter], model: Model, values: Values | None = None) -> None:
    """Checks that no two parameters set the same number.

    Raises:
        ValueError: Two parameters with operation="set" select the same number, with different values. The message has both names.
    """
    own = {name: _set_numbers(p, model) for name, p in chosen.items()}
    for one, other in itertools.combinations(own, 2):
        if not own[one] & own[other] or (values is not None and values[one] == values[other]):
            continue
        field = min(own[one] & own[other])[0]
        raise conflict("parameters", one, other, field, "" if values is None else f"to {values[one]} and to {values[other]}")


def check_effects(names: Sequence[str], parameters: Mapping[str, Parameter], model: Model) -> None:
    """Checks that each varied parameter has an effect: that later parameters leave at least one of its numbers unchanged.

    Args:
        names: Names of the varied parameters.
        parameters: All parameters of the study by name, in the order in which they apply.
        model: The model.
    """
    order = list(parameters)
    applied = {name: _set_numbers(p, model) for name, p in parameters.items() if p.nominal is not None}
    for name in names:
        own = _changed(parameters[name], model)
        later = {other: applied[other] & own for other in order[order.index(name) + 1 :] if other in applied}
        hiding = [other for other, numbers in later.items() if numbers]
        if own and own == frozenset().union(*later.values()):
            hide = "sets" if len(hiding) == 1 else "set"
            raise ValueError(
                f"a sweep of {name!r} changes nothing, because {' and '.join(map(repr, hiding))} {hide} the same numbers after it: "
                "leave out one of them"
            )


def check(parameters: Mapping[str, Parameter], model: Model) -> None:
    """Raises ValueError if a parameter selects an element or number that the model does not have; the message has the parameter's name."""
    for name, parameter in parameters.items():
        try:
            if parameter.kind == "field":
                _places(parameter, model)
            elif parameter.kind == "sensor":
                rows_of(model, "sensor", parameter.parsed.elements, _where(parameter))
                _number_of(Transfer, parameter.leaf)
            elif parameter.kind == "actuator":
                rows_of(model, "actuator", parameter.parsed.elements, _where(parameter))
                part, _, leaf = parameter.leaf.rpartition(".")
                if part not in _PARTS:
                    raise ValueError(f"selector is {parameter.selector!r}: a drive has no {part!r}, use one of: motor, servo")
                _number_of(_PARTS[part], leaf)
            elif parameter.kind == "controller" and parameter.unchanged is None:
                raise ValueError("it has no nominal value, which the controller reads at the nominal point: give it one")
        except (AttributeError, TypeError, ValueError) as error:
            raise ValueError(f"parameter {name!r}: {error}") from None
    _check_pairs(parameters, model)


def _where(parameter: Parameter) -> str:
    """Text that names a parameter's selector in error messages."""
    return f"selector {parameter.selector!r}"


def _check_pairs(parameters: Mapping[str, Parameter], model: Model) -> None:
    """Raises ValueError if a parameter changes contact properties of geoms that an explicit contact pair overrides.

    The change is allowed if another parameter changes the same property of the pair.
    """
    for name, parameter in parameters.items():
        if parameter.parsed.field not in OF_PAIRS:
            continue
        of_pair = OF_PAIRS[parameter.parsed.field]
        pairs = {k for other in parameters.values() if other.parsed.field == of_pair for k in _rows(other, model)}
        try:
            check_pairs(model, parameter.parsed.field, _rows(parameter, model), pairs, f'give a parameter "{of_pair}[{{pair}}]..." too')
        except ValueError as error:
            raise ValueError(f"parameter {name!r}: {error}") from None


def _rows(parameter: Parameter, model: Model) -> list[int]:
    """Indices of the model's elements that a parameter changes, if its selector names a field of the model."""
    return rows_of(model, FIELDS[parameter.parsed.field].element, parameter.parsed.elements, _where(parameter))


_PARTS: dict[str, type] = {"": Drive, "motor": DCMotor, "servo": PID}
"""Classes whose numeric attributes a selector of actuators can name.

Keys are "" for "actuator.delay", "motor" for "actuator.motor.gear" and "servo" for "actuator.servo.kp".
"""
_NO_NUMBERS = frozenset({"noise", "limits", "motor", "servo", "control"})
"""Attributes of the classes in `_PARTS` and of `Transfer` that are not numbers, so that no selector can name them."""


def _number_of(kind: type, leaf: str) -> None:
    """Raises ValueError if the class `kind` (Transfer, Drive, DCMotor or PID) has no numeric attribute `leaf`."""
    known = [field.name for field in fields(kind) if field.name not in _NO_NUMBERS]
    if leaf not in known:
        raise ValueError(
            f"a {kind.__name__} has no numeric attribute {leaf!r}{did_you_mean(leaf, known) or ','} it has: {', '.join(known)}"
        )


def _places(parameter: Parameter, model: Model) -> list[tuple[str, NDArray[np.int64], float]]:
    """Numbers of the model that a parameter changes.

    Returns:
        For each changed field: its name, the indices of the numbers in the flattened field, and a sign, 1 or -1. Values of the parameter
        are multiplied by the sign, because MuJoCo stores some gains with a negative sign.
    """
    selector = parameter.parsed
    if selector.field not in FIELDS and selector.field not in COMPOUNDS:
        raise ValueError(unknown_field("selector", selector.field, [*FIELDS, *COMPOUNDS, "controller"], "docs/reference/what_can_vary.md"))
    found = []
    for part in parts_of(model, selector):
        chosen = part.index.reshape(-1)
        if part.field in ("body_mass", "body_inertia"):
            # Bodies without mass stay without mass.
            chosen = chosen[np.asarray(getattr(model, part.field), float).reshape(-1)[chosen] > 0]
        found.append((part.field, chosen, part.sign))
    return found


def model_fields(parameters: Mapping[str, Parameter], model: Model, values_by_env: Sequence[Values]) -> dict[str, Array]:
    """Fields of a model that the parameters change, with a row for each set of values: (n, *shape), in the field's unit.

    Raises:
        ValueError: A parameter selects an element or number that the model does not have.
    """
    made: dict[str, Array] = {}
    for name, parameter in parameters.items():
        if parameter.kind != "field" or not any(name in values for values in values_by_env):
            continue
        masses = made.get("body_mass", np.asarray(model.body_mass, float)).copy()
        for field, places, sign in _places(parameter, model):
            own = np.asarray(getattr(model, field), float)
            rows = made.setdefault(field, np.tile(own, (len(values_by_env), *[1] * own.ndim)))
            flat = rows.reshape(len(values_by_env), -1)
            for env, values in enumerate(values_by_env):
                if name in values:
                    flat[env, places] = sign * parameter.change(sign * flat[env, places], float(values[name]))
        if parameter.parsed.field == "body_mass":
            _scale_inertia(made, model, masses)
    return {field: rows for field, rows in made.items() if not np.array_equal(rows, np.broadcast_to(getattr(model, field), rows.shape))}


def _scale_inertia(made: dict[str, Array], model: Model, before: Array) -> None:
    """Multiplies the inertias in `made`, fields by name, by the ratios of masses after and before a change; `before` is (n, nbody), kg."""
    masses, own = made["body_mass"], np.asarray(model.body_inertia, float)
    rows = made.setdefault("body_inertia", np.tile(own, (len(masses), 1, 1)))
    rows *= np.divide(masses, before, out=np.ones_like(masses), where=before > 0)[:, :, None]


def sensor_model(
    parameters: Mapping[str, Parameter], base: SensorModel | None, model: Model, values_by_env: Sequence[Values]
) -> SensorModel | None:
    """Sensor model in which parameters of sensors have one value per environment; None for ideal sensors."""
    names = [s["name"] or f"#{i}" for i, s in enumerate(model.sensors)]
    named = _varied("sensor", names, Transfer(), base, parameters=parameters, model=model, values=values_by_env)
    return base if named is None else SensorModel(named, default=base.default if base else None)


def actuator_model(
    parameters: Mapping[str, Parameter], base: ActuatorModel | None, model: Model, values_by_env: Sequence[Values]
) -> ActuatorModel | None:
    """Actuator model in which parameters of actuators have one value per environment; None for ideal actuators."""
    names = [name or f"#{i}" for i, name in enumerate(model.actuator_names)]
    named = _varied("actuator", names, Drive(), base, parameters=parameters, model=model, values=values_by_env)
    return base if named is None else ActuatorModel(named, default=base.default if base else None)


def _varied(
    kind: str, names: Sequence[str], ideal: Any, base: Any, *, parameters: Mapping[str, Parameter], model: Model, values: Sequence[Values]
) -> dict[str, Any] | None:
    """Parts of a sensor or actuator model by name, in which parameters have one value per environment; None if no parameter changes them.

    `names` are those of all elements of the kind, `ideal` is the part of an ideal element, and `base` the study's sensor or actuator model.
    """
    given = {name: p for name, p in parameters.items() if p.kind == kind and any(name in own for own in values)}
    if not given:
        return None
    named = dict(base.named) if base else {}
    for name, parameter in given.items():
        changes = [own.get(name) for own in values]
        for index in rows_of(model, kind, parameter.parsed.elements, _where(parameter)):
            own = fitting(named, base.default if base else None, names[index]) or ideal
            named[names[index]] = _with_values(own, parameter.leaf, parameter, changes, f"parameter {name!r}: {kind} {names[index]!r}")
    return named


def _with_values(part: Any, leaf: str, parameter: Parameter, values: Sequence[Value | None], place: str) -> Any:
    """Copy of a part of a sensor or actuator model in which a parameter has one value per environment. None keeps the part's number.

    `leaf` is the name of the changed attribute, such as "delay" or "servo.kp". `place` begins error messages.
    """
    holder, _, rest = leaf.partition(".")
    before = getattr(part, holder, None)
    if rest:
        if before is None or not hasattr(before, rest):
            raise ValueError(f"{place} has no {leaf}; give the study an actuator model with one")
        return replace(part, **{holder: _with_values(before, rest, parameter, values, place)})
    number = 0.0 if before is None else before
    changed = np.array([number if value is None else parameter.change(number, float(value)) for value in values], float)
    return replace(part, **{leaf: changed})

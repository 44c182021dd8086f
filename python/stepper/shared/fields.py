"""Table of fields: arrays of a model that can vary, parameters made of several fields, and arrays that users write to a stepper.

`FIELDS` has every field of `Model.replace`; `Field.per_environment` marks those that `Stepper.randomize` takes. Selectors
(`stepper.shared.selectors`) name parts of a field. docs/reference/what_can_vary.md is this table.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stepper import _stepper

if TYPE_CHECKING:
    from stepper._stepper import Model

_ELEMENTS = {
    "nbody": "body", "ngeom": "geom", "npair": "pair", "njnt": "joint", "nv": "dof", "nq": "coordinate", "ntendon": "tendon",
    "neq": "equality", "nu": "actuator",
}  # fmt: skip
_DERIVED = {
    "qpos0": "Inverse weights of MuJoCo's contact law.",
    "body_mass": "Mass of every subtree. Inverse weights of MuJoCo's contact law, by `replace`. Inertia, by `identify` and studies alone.",
    "body_inertia": "Inverse weights of MuJoCo's contact law, by `replace`.",
    "body_ipos": "Centre of mass of every subtree. Inverse weights of MuJoCo's contact law, by `replace`.",
    "body_iquat": "Inverse weights of MuJoCo's contact law.",
    "body_pos": "Inverse weights of MuJoCo's contact law.",
    "body_quat": "Inverse weights of MuJoCo's contact law.",
    "geom_friction": "Friction of contacts: the larger of both geoms, or that of the higher priority. Explicit pairs do not change.",
    "geom_restitution": "Restitution of contacts: the larger of both geoms. Explicit pairs do not change.",
    "geom_size": "Bounding and inscribed radius; no mass and no inertia. The semi-axes of fluid forces, by `replace`.",
    "geom_pos": "Contacts and sensors; no mass, no inertia and no centre of mass.",
    "dof_armature": "Inverse weights of MuJoCo's contact law, by `replace`.",
}
"""Texts on other quantities that change, or do not change, when a field is set, by name of the field. Obvious effects are left out."""


@dataclass(frozen=True)
class Field:
    """Field of a model: an array that `Model.replace` can change.

    Attributes:
        name: Name in MuJoCo's vocabulary, such as "geom_friction".
        element: Kind of element to which one row of the array belongs: "body", "geom", "pair", "joint", "tendon", "equality", "actuator",
            "dof" (degree of freedom) or "coordinate" (entry of qpos). Selectors select rows of the last two by the name of the joint.
            Fields of the whole model have "".
        shape: Shape of the array as text, such as "(ngeom, 3)"; a single number has "".
        quantity: Description of the quantity.
        unit: Unit.
        per_environment: Whether values may differ between environments (`Stepper.randomize`).
        derived: Description of other quantities that change with the field; empty if there are none.
    """

    name: str
    element: str
    shape: str
    quantity: str
    unit: str
    per_environment: bool
    derived: str = ""


def _field(name: str, shape: str, quantity: str, unit: str, per_environment: bool) -> Field:
    """Entry of the table of fields; `shape` is a text such as "(ngeom, 3)"."""
    element = _ELEMENTS.get(shape.strip("()").partition(",")[0], "")
    return Field(name, element, shape, quantity, unit, per_environment, _DERIVED.get(name, ""))


FIELDS: dict[str, Field] = {row[0]: _field(*row) for row in _stepper.fields()}
"""Fields of a model (arrays that `Model.replace` can change) by name."""
RANDOMIZED: dict[str, str] = {name: field.element for name, field in FIELDS.items() if field.per_environment}
"""Kind of element of each field that `Stepper.randomize` takes, by name of the field, for example "geom" for "geom_friction"."""


@dataclass(frozen=True)
class Compound:
    """Parameter of an element that is stored as a number in one or more fields of the model, such as the stiffness of a servo.

    Attributes:
        element: Kind of the elements that have it, such as "actuator".
        parts: Field, column and sign of each number: a value v of the parameter sets field[element, column] = sign * v.
        quantity: Description of the quantity.
        unit: Unit.
    """

    element: str
    parts: tuple[tuple[str, int, float], ...]
    quantity: str
    unit: str


COMPOUNDS = {
    "actuator_kp": Compound(
        "actuator", (("actuator_gainprm", 0, 1.0), ("actuator_biasprm", 1, -1.0)), "stiffness of a position servo", "N/m or N m/rad"
    ),
    "actuator_kv": Compound("actuator", (("actuator_biasprm", 2, -1.0),), "velocity gain of a servo", "N s/m or N m s/rad"),
}
"""Parameters that are stored as numbers in one or more fields of a model, by name."""

APPLIED = ("qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat", "eq_active")
"""Arrays of a stepper that users write and every step reads, in the order of a pickled stepper."""
OF_PAIRS: dict[str, str] = {"geom_friction": "pair_friction", "geom_restitution": "pair_restitution"}
"""Name of the field with which an explicitly defined contact pair overrides a field of its geoms, by name of the geoms' field."""


def check_pairs(model: Model, field: str, geoms: Collection[int], pairs: Collection[int], remedy: str) -> None:
    """Checks that no contact pair that the model defines overrides a field of some geoms.

    Args:
        model: The scene.
        field: A field of geoms, such as "geom_friction".
        geoms: Indices of the geoms whose values change.
        pairs: Indices of the contact pairs whose field, such as "pair_friction", changes too. These pass the check.
        remedy: Remedy for the error message, with {pair} where the label of the pair belongs.
    """
    for k in range(model.npair if field in OF_PAIRS else 0):
        pair = model.pair(k)
        ends = [pair.geom1, pair.geom2]
        if k in pairs or not set(ends) & set(geoms) or (field == "geom_friction" and pair.dim == 1):
            continue
        one, other = (model.geom(g).name or f"#{g}" for g in ends)
        raise ValueError(
            f'contacts of geoms "{one}" and "{other}" have the {OF_PAIRS[field]} of explicit pair "{pair.name or f"#{k}"}", '
            f"not their {field}; {remedy.format(pair=pair.name or k)}"
        )

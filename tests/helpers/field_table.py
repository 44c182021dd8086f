"""The tables of docs/reference/what_can_vary.md, made of the table of fields."""

from dataclasses import fields

from stepper import Drive, Options, Transfer
from stepper.shared.fields import COMPOUNDS, FIELDS
from stepper.sysid import KINDS

ELEMENTS = {"dof": "joint", "coordinate": "joint", "": "(the whole model)"}
"""Kinds of elements whose names select rows, where they are not those of the field."""


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def identified(name: str) -> str:
    """Selectors of `identify` for a field."""
    return ", ".join(
        f"`{kind.replace('[', '[...][', 1) if '[' in kind else f'{kind}[...]'}`" for kind in KINDS if kind.partition("[")[0] == name
    )


def table() -> str:
    """All parameters, as Markdown."""
    head = ["field", "names of", "shape", "unit", "quantity", "per environment", "identified as", "derived quantities"]
    lines = [_row(*head), "|" + "---|" * len(head)]
    for field in FIELDS.values():
        identifiable = identified(field.name)
        element = ELEMENTS.get(field.element, field.element) if field.element or field.shape else "(the whole model)"
        varies = "yes" if field.per_environment else ""
        lines.append(_row(f"`{field.name}`", element, field.shape, field.unit, field.quantity, varies, identifiable, field.derived))
    for name, compound in COMPOUNDS.items():
        parts = ", ".join(f"`{field}[...][{column}]`{' (negative)' if sign < 0 else ''}" for field, column, sign in compound.parts)
        lines.append(_row(f"`{name}`", compound.element, "(nu,)", compound.unit, compound.quantity, "yes", identified(name), parts))
    for name, kind in KINDS.items():
        field = name.partition("[")[0]
        if field not in FIELDS and field not in COMPOUNDS:
            lines.append(_row(f"`{field}`", kind.element, "", kind.unit, kind.quantity, "", identified(field), ""))
    return "\n".join(lines).replace("|  |", "| |").replace("|  |", "| |") + "\n"


def others() -> str:
    """Numbers of sensors, drives and options, as Markdown."""
    rows = [("sensor", "Transfer", Transfer), ("actuator", "Drive", Drive), ("options", "Options", Options)]
    listed = [
        _row(
            f"`{head}.NAME`" + ("" if head == "options" else f", `{head}.NAME[...]`"),
            f"`stepper.{kind}`",
            ", ".join(f"`{f.name}`" for f in fields(of)),
        )
        for head, kind, of in rows
    ]
    return "\n".join([_row("selector", "attribute of", "NAME"), "|---|---|---|", *listed]) + "\n"

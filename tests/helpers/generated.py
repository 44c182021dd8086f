"""Generated sections of pages of the reference: this script writes them, and tests/test_documents.py compares them.

Usage:

    PYTHONPATH=python:tests/helpers:benches python tests/helpers/generated.py
"""

import re
from dataclasses import fields
from pathlib import Path

import api_names
import study_keys
import typer
from sections import write_section
from stepper import Drive, Options, Transfer
from stepper.cli.app import application
from stepper.shared.fields import COMPOUNDS, FIELDS
from stepper.sysid import KINDS

ELEMENTS = {"dof": "joint", "coordinate": "joint", "": "(the whole model)"}
"""Kinds of elements whose names select rows, where they are not those of the field."""


def line(text):
    """Text of a help message in one line of a table."""
    return " ".join((text or "").split()).replace("|", "\\|")


def described(command):
    """A command as Markdown: what it does, its examples, its arguments and options."""
    first, *rest = re.split(r"\n\s*\n", (command.help or "").strip())
    lines = [f"## stepper {command.name}", "", line(first), ""]
    examples = [line(part).removeprefix("Example: ") for part in rest if part.strip().startswith("Example:")]
    for part in rest:
        if not part.strip().startswith("Example:"):
            lines += [line(part), ""]
    if examples:
        lines += ["```sh", *examples, "```", ""]
    lines += ["| argument or option | meaning |", "|---|---|"]
    for parameter in command.params:
        name = ", ".join(f"`{option}`" for option in parameter.opts) if parameter.opts[0].startswith("-") else f"`{parameter.name}`"
        lines.append(f"| {name} | {line(getattr(parameter, 'help', ''))} |")
    return "\n".join(lines) + "\n"


def command_table():
    """All commands, as Markdown."""
    group = typer.main.get_command(application())
    return "\n".join(described(command) for command in group.commands.values())


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def identified(name: str) -> str:
    """Selectors of `identify` for a field."""
    return ", ".join(
        f"`{kind.replace('[', '[...][', 1) if '[' in kind else f'{kind}[...]'}`" for kind in KINDS if kind.partition("[")[0] == name
    )


def field_table() -> str:
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


def other_numbers() -> str:
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


REFERENCE = Path(__file__).parents[2] / "docs/reference"
SECTIONS = {
    "commands": (REFERENCE / "command_line.md", command_table),
    "fields": (REFERENCE / "what_can_vary.md", lambda: f"{field_table()}\n{other_numbers()}"),
    "keys": (REFERENCE / "studies.md", study_keys.table),
    **api_names.sections(),
}
"""Page and text of each section, by its name."""

if __name__ == "__main__":
    for name, (page, text) in SECTIONS.items():
        write_section(page, name, text())

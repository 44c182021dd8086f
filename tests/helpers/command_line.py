"""The tables of docs/reference/command_line.md, from the commands themselves."""

import re

import typer
from stepper.cli.app import application


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


def table():
    """All commands, as Markdown."""
    group = typer.main.get_command(application())
    return "\n".join(described(command) for command in group.commands.values())

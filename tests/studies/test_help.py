"""Files that the help of commands names are there, and keys of studies have a description (docs/reference/studies.md lists them)."""

import re
from pathlib import Path

import pytest
import typer
from stepper.cli.app import COMMANDS
from study_keys import PARTS, attributes, keys
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__.rpartition(".")[2])
def test_paths_in_help_exist(command):
    app = typer.Typer()
    app.callback()(lambda: None)
    command.register(app, typer)
    name = command.__name__.rpartition(".")[2]
    told = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "4000", "TERM": "dumb"})
    assert told.exit_code == 0, told.output
    # Of the help as it is written: a terminal breaks lines.
    text = getattr(command, name).__doc__ + told.output
    paths = set(re.findall(r"(?<![\w/])((?:examples|docs|benches|python|tests)/[\w./-]*\w)", text))
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("kind", [kind for _, kind in PARTS])
def test_each_key_has_a_description(kind):
    assert [field.name for field in keys(kind)] == list(attributes(kind))

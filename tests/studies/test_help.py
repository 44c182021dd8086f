"""Files that the help of commands names are there, and keys of studies have a description (docs/reference/studies.md lists them)."""

import re
from pathlib import Path

import pytest
from stepper.cli.app import COMMANDS, application
from study_keys import PARTS, attributes, keys
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_paths_in_help_exist(name):
    told = CliRunner().invoke(application(), [name, "--help"], env={"COLUMNS": "4000", "TERM": "dumb"})
    assert told.exit_code == 0, told.output
    paths = set(re.findall(r"(?<![\w/])((?:examples|docs|benches|python|tests)/[\w./-]*\w)", told.output))
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("kind", [kind for _, kind in PARTS])
def test_each_key_has_a_description(kind):
    assert [field.name for field in keys(kind)] == list(attributes(kind))

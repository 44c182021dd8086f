"""What commands say of themselves: the files that their examples name are there."""

import re
from pathlib import Path

import pytest
from stepper.cli.app import COMMANDS, application
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_paths_in_help_exist(name):
    told = CliRunner().invoke(application(), [name, "--help"], env={"COLUMNS": "4000", "TERM": "dumb"})
    assert told.exit_code == 0, told.output
    paths = set(re.findall(r"(?<![\w/])((?:examples|docs|benches|python|tests)/[\w./-]*\w)", told.output))
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []

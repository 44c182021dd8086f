"""Help texts of the command line: at 80 columns no word is lost."""

import re

import pytest

typer = pytest.importorskip("typer", reason="typer, which the command line needs, is not installed")
from stepper.cli.app import application  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

COMMANDS = typer.main.get_command(application()).commands


def words_of(text):
    return re.sub(r"[│╭╮╰╯─]", " ", text).split()


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"train"}))  # argparse, which has no markup, prints the help of train.
def test_every_word_of_the_help_is_shown(name):
    shown = CliRunner().invoke(application(), [name, "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80", "NO_COLOR": "1"}).output
    found = set(words_of(shown))
    command = COMMANDS[name]
    texts = [command.help, *(getattr(parameter, "help", "") or "" for parameter in command.params)]
    assert [word for text in texts for word in words_of(text) if word not in found] == []


def test_selectors_keep_their_brackets():
    """Rich takes [floor] for markup."""
    told = CliRunner().invoke(application(), ["identify", "--help"], env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"}).output
    assert "'geom_friction[floor,box][0]=0.05..2'" in told

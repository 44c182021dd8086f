"""docs/reference/studies.md: its first study runs as it says, and its keys are those of the code."""

import re
from dataclasses import fields

import stepper
from study_keys import BEGIN, END, PAGE, PARTS, attributes, table


def test_the_table_of_keys_is_that_of_the_code():
    told = PAGE.read_text().partition(BEGIN)[2].partition(END)[0].strip()
    assert told == table().strip(), "PYTHONPATH=python python tests/study_keys.py writes it"
    for _, kind in PARTS:
        assert [f.name for f in fields(kind)] == list(attributes(kind))


def test_the_first_study_runs(tmp_path):
    blocks = re.findall(r"```(?:xml|toml|python)\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for name, text in zip(("arm.xml", "reach.toml", "reach.py"), blocks, strict=False):
        (tmp_path / name).write_text(text)
    found = stepper.lab.sweep(tmp_path / "reach.toml", tmp_path / "out").sweep
    # On both sides of the goal: no success comes back beyond the delay at which the arm begins to swing.
    (cliff,) = found.cliffs
    assert (cliff.parameter, round(1e3 * cliff.high)) == ("delay", 36)
    assert [level.share for level in found.levels_of("delay")] == [1, 1, 1, 0, 0]
    assert [level.share for level in found.levels_of("friction")] == [1] * 5

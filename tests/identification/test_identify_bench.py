"""`benches/identification`: repetitions that are kept, and the tables that they fill."""

from pathlib import Path

import numpy as np
import pytest
from identification.repetitions import Kept, Row
from sections import section_of

PAGE = Path(__file__).parents[2] / "docs/benchmarks/identification.md"


def answer(seed):
    return np.array([1.0 + seed, 2.0]), np.array([0.5, 1.5]), np.array([1.5, 2.5])


def refused(seed):
    raise AssertionError(f"repetition {seed} is kept")


def test_a_run_that_was_killed_in_a_line_goes_on(tmp_path):
    path = tmp_path / "own.jsonl"
    kept = Kept(path, resume=False)
    for seed in (0, 1):
        kept.of(Row("box", (1.0, 2.0), answer, 2), seed)
    path.write_text(path.read_text()[:-20])
    again = Kept(path, resume=True)
    np.testing.assert_array_equal(again.of(Row("box", (1.0, 2.0), refused, 2), 0)[0][0], [1.0, 2.0])
    # The second was cut, and is made again, in a line of its own.
    again.of(Row("box", (1.0, 2.0), answer, 2), 1)
    last = Kept(path, resume=True)
    np.testing.assert_array_equal(last.of(Row("box", (1.0, 2.0), refused, 2), 1)[0][0], [2.0, 2.0])


def test_repetitions_of_another_version_are_refused(tmp_path):
    path = tmp_path / "own.jsonl"
    path.write_text('{"version": 0}\n')
    with pytest.raises(ValueError, match="run without --resume"):
        Kept(path, resume=True)
    assert path.read_text() == '{"version": 0}\n'


@pytest.mark.parametrize("name", ["online", "impacts", "matched", "own", "coloured", "determined", "peer"])
def test_tables_have_rows(name):
    """A heading, a rule and a row or more between the marks."""
    lines = section_of(PAGE, name).splitlines()
    assert len(lines) > 2
    assert len({line.count("|") for line in lines}) == 1

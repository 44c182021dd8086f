"""The fuzzer finds what it is there for, and a few inputs of every kind come to a documented end. `make fuzz` tries more."""

import re
from collections import Counter

import fuzz.__main__ as runner
import pytest
from fuzz.cases import KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_a_few_inputs_of_every_kind_end_as_documented(tmp_path, kind):
    outcomes = Counter()
    assert runner.run(kind, range(10**6, 10**6 + 25), tmp_path, outcomes) == []
    assert outcomes.total() == 25


@pytest.mark.parametrize(("kind", "said"), [
    ("raises", "KeyError: 'nobody expects it'"), ("aborts", "ends the process with -6"), ("exits", "ends the process with 0"),
    ("eats", "MemoryError"), ("hangs", "hangs"),
])  # fmt: skip
def test_what_goes_wrong_is_a_finding_that_keeps_its_input(tmp_path, monkeypatch, kind, said):
    monkeypatch.setattr(runner, "SECONDS", 2)
    outcomes = Counter()
    findings = runner.run(kind, range(10), tmp_path, outcomes)
    assert 0 < len(findings) < 10
    assert len(findings) + outcomes[f"{kind}: accepted"] == 10
    seed, found = re.fullmatch(rf"{kind} (\d+): (.*)", findings[0]).groups()
    assert said in found
    assert (tmp_path / f"{kind}-{seed}/input").read_text() == "kept"
    assert f"--kind {kind} --seed {seed}" in (tmp_path / f"{kind}-{seed}/finding.txt").read_text()

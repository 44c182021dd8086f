"""The episode from which the Rust reader of recordings is tested is one that this version would record."""

import json

import numpy as np
from bench_episode import EPISODE, record
from recordings import joined
from stepper.recording.format import FORMAT, read_header

RENEW = "renew it: PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/bench_episode.py; and adapt benches/src/replay.rs"


def shape_of(value):
    """Names and types in a header, without its numbers."""
    if isinstance(value, dict):
        return {name: shape_of(own) for name, own in value.items()}
    return type(value).__name__


def test_the_episode_of_the_benches_has_the_current_format(tmp_path):
    """Names, types and versions of everything in its files, which `cargo test -p stepper-benches` reads."""
    record(tmp_path / "new")
    old, new = read_header(EPISODE), read_header(tmp_path / "new")
    assert old["format"] == FORMAT
    assert shape_of(old) == shape_of(new), RENEW
    arrays = [joined(EPISODE), joined(tmp_path / "new")]
    kinds = [{name: (array.dtype.str, array.shape) for name, array in own.items()} for own in arrays]
    assert kinds[0] == kinds[1], RENEW
    np.testing.assert_array_equal(arrays[0]["kind"], arrays[1]["kind"])
    # Magic bytes and version of the model and of the state.
    assert (EPISODE / "model.stepper").read_bytes()[:12] == (tmp_path / "new/model.stepper").read_bytes()[:12], RENEW
    assert arrays[0]["0/state"][:13].tobytes() == arrays[1]["0/state"][:13].tobytes(), RENEW


def test_the_episode_of_the_benches_names_no_machine():
    head = json.loads((EPISODE / "run.json").read_text())
    assert head["model"]["source"] is None
    assert head["provenance"].keys() == {"versions"}

"""Readings that stand one row too late or too early beside their controls: both ways of identification say so."""

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from identification import strikes
from identification.repetitions import noisy
from identification.scenes import pushed
from stepper.identification.shift import EARLY, LATE, shifted, suspicious

TIGHT = stepper.Options(tolerance=1e-9)
WORDS = {LATE: "readings are one sample late", EARLY: "readings are one sample early"}


def moved(rows, shift):
    """Rows that are read one row later (`LATE`) or earlier; what is not there is not measured."""
    out = np.full_like(rows, np.nan)
    if shift == LATE:
        out[1:] = rows[:-1]
    elif shift == EARLY:
        out[:-1] = rows[1:]
    else:
        out[:] = rows
    return out


@pytest.mark.parametrize("shift", [0, LATE, EARLY])
def test_identify_names_a_shift_and_its_remedy(shift):
    scene = pushed()
    readings = {name: moved(rows, shift) for name, rows in noisy(scene.readings(TIGHT), scene, 0).items()}
    found = stepper.identify(scene.model(1.0, 0.5), [stepper.Episode(scene.ctrl, readings, 0.02)], scene.parameters, starts=2, threads=1)
    if not shift:
        assert found.warnings == ()
        return
    assert found.warnings[0].startswith(WORDS[shift])
    assert ("Pair ctrl[:-1] with readings[1:]" if shift == LATE else "Pair ctrl[1:] with readings[:-1]") in found.warnings[0]
    # And the remedy is one: the truth is in the intervals of 95 %, at this seed.
    (episode,) = [shifted(stepper.Episode(scene.ctrl, readings, 0.02), shift)]
    mended = stepper.identify(scene.model(1.0, 0.5), [episode], scene.parameters, starts=2, threads=1)
    low, high = mended.interval().T
    assert ((low <= scene.truth) & (scene.truth <= high)).all()


@pytest.mark.parametrize("shift", [0, LATE, EARLY])
def test_the_tracker_does_not_say_what_shifted_readings_make_it_think(shift):
    scene = strikes.struck()
    readings = {name: moved(rows, shift) for name, rows in strikes.readings(scene, scene.truth, np.random.default_rng(0)).items()}
    tracker = stepper.Tracker(
        scene.model(scene.start), list(scene.parameters), noise=scene.noise, period=0.02, options=TIGHT, start_std=strikes.START_STD
    )
    for k, ctrl in enumerate(scene.ctrl[:50]):
        now = tracker.update(ctrl, {name: rows[k] for name, rows in readings.items()})
    if shift:
        assert len(now.warnings) == 1
        assert now.warnings[0].startswith(WORDS[shift])
        assert not now.determined.any()
    else:
        assert now.warnings == ()
        assert now.determined.all()


@given(st.integers(2, 40), st.integers(1, 3), st.sampled_from([LATE, EARLY]))
def test_shifts_undo_one_another(rows, width, shift):
    """All rows are back where they were, but one at an end, which was not measured on the way."""
    given_ = np.arange(rows * width, dtype=float).reshape(rows, width)
    back = shifted(stepper.Episode(np.zeros((rows, 1)), {"x": moved(given_, shift)}, 0.02), shift).readings["x"]
    kept = slice(None, -1) if shift == LATE else slice(1, None)
    np.testing.assert_array_equal(back[kept], given_[kept])
    assert np.isnan(back[-1 if shift == LATE else 0]).all()


@settings(max_examples=50, deadline=None)
@given(st.integers(20, 400), st.integers(1, 6), st.integers(0, 2**20))
def test_white_noise_is_not_suspicious_and_a_shifted_wave_is(rows, width, seed):
    """So that a fit that explains the data costs no more than before. From 200 readings on, 1.5 is five standard deviations above 1."""
    noise = np.random.default_rng(seed).standard_normal((rows, width))
    if rows * width > 200:
        assert not suspicious([noise])
    wave = np.sin(np.arange(rows) / 3)[:, None] * np.ones(width)
    # Five times what chance makes of the correlation are no chance; fewer than 30 rows cannot show it.
    assert suspicious([0.3 * noise + wave]) or rows < 40

"""Readings that stand one row too late or too early beside their controls: `identify` names the shift, the tracker determines nothing."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from identification import strikes
from identification.repetitions import noisy
from identification.scenes import HARD, pushed
from stepper.sysid.fit import _freed_ratio
from stepper.sysid.shift import EARLY, LATE, RATIO, finding_of_fit, shifted, suspicious

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
    readings = {name: moved(rows, shift) for name, rows in noisy(scene.readings(HARD), scene, 0).items()}
    found = stepper.sysid.identify(
        scene.model(1.0, 0.5), [stepper.sysid.Episode(scene.ctrl, readings, 0.02)], scene.parameters, starts=2, threads=1
    )
    if not shift:
        assert found.warnings == ()
        return
    assert found.warnings[0].startswith(WORDS[shift])
    assert "A wrong initial state explains less: with an estimated one the residual falls to" in found.warnings[0]
    assert ("Pair ctrl[:-1] with readings[1:]" if shift == LATE else "Pair ctrl[1:] with readings[:-1]") in found.warnings[0]
    # And the remedy is one: the truth is in the intervals of 95 %, at this seed.
    (episode,) = [shifted(stepper.sysid.Episode(scene.ctrl, readings, 0.02), shift)]
    mended = stepper.sysid.identify(scene.model(1.0, 0.5), [episode], scene.parameters, starts=2, threads=1)
    low, high = mended.interval().T
    assert ((low <= scene.truth) & (scene.truth <= high)).all()


PENDULUM = stepper.load("""<mujoco><option timestep=".002"/><worldbody><body><joint name="hinge" axis="0 1 0" damping=".05"/>
    <geom size=".05" pos="0 0 -.5" mass="1"/></body></worldbody><sensor><jointpos name="hinge" joint="hinge"/></sensor></mujoco>""")
ANGLE = 1.0
"""Angle from which the pendulum falls, rad."""


def swing() -> np.ndarray:
    """Readings of the pendulum's angle with 1 mrad of noise, (100, 1)."""
    sim = stepper.Stepper(PENDULUM, options=HARD)
    sim.set_state([ANGLE], [0.0])
    clean = sim.rollout(np.zeros((100, 0)), 10, fields=("sensordata",))["sensordata"]
    return clean + 1e-3 * np.random.default_rng(0).standard_normal(clean.shape)


def identified(rows, angle=ANGLE, **settings):
    episode = stepper.sysid.Episode(np.zeros((100, 0)), {"hinge": rows}, 0.02, qpos=[angle], **settings)
    return stepper.sysid.identify(PENDULUM, [episode], ["dof_damping[hinge]"], noise={"hinge": 1e-3}, starts=2, threads=1)


def test_a_wrong_initial_state_is_not_taken_for_a_shift():
    found = identified(swing(), ANGLE + 0.1)
    assert found.warnings[0].startswith("the initial state is wrong, which looks like a shift of the readings by one sample")
    assert "Episode(start_std=(0.1, 1.0))" in found.warnings[0]
    # And the remedy is one: without the warning, the true damping is in the interval of 95 %, at this seed.
    mended = identified(swing(), ANGLE + 0.1, start_std=(0.1, 1.0))
    assert not any("initial state" in warning for warning in mended.warnings)
    low, high = mended.interval()[0]
    assert low <= 0.05 <= high


def test_an_initial_state_that_was_estimated_is_not_suspected():
    found = identified(moved(swing(), LATE), start_std=(1e-4, 1e-3))
    assert found.warnings[0].startswith(WORDS[LATE])
    assert found.warnings[0].endswith("A wrong initial state is not the cause: it was estimated")


def test_a_fall_does_not_tell_a_shift_from_another_initial_state():
    """Without controls, readings one sample early are those of the state one sample later."""
    scene = strikes.thrown()
    made = strikes.readings(scene, scene.truth, np.random.default_rng(0))
    model = scene.model(*scene.starts[0])
    readings = {name: rows[1:] for name, rows in made.items()}
    episode = stepper.sysid.Episode(scene.ctrl[1:], readings, 0.02, qvel=scene.velocities(model))
    found = stepper.sysid.identify(model, [episode], scene.parameters, noise=scene.noise, options=HARD, starts=2, threads=1)
    assert found.warnings[0].startswith("the initial state is wrong, or readings are one sample early")
    assert "these data do not tell which" in found.warnings[0]


@given(st.sampled_from([LATE, EARLY]), st.floats(1e-4, 0.999 * RATIO), st.none() | st.floats(1e-4, 1.0))
def test_the_warning_is_of_what_explains_the_readings_best(shift, ratio, freed):
    text = finding_of_fit(shift, ratio, freed)
    assert text.startswith("the initial state is wrong") == (freed is not None and RATIO * freed <= ratio)
    assert ("one sample late" in text) == (shift == LATE and not (freed is not None and freed < RATIO * ratio))
    for share in (ratio, *([] if freed is None else [freed])):
        assert f"{100 * share:.2g} %" in text
    assert "Do not use these values and intervals" in text


def test_the_warning_says_when_an_initial_state_could_not_be_estimated():
    """The fit that also estimates the initial state needs more readings than unknowns (the ratio is NaN without such a fit)."""
    assert "there are too few readings to estimate it" in finding_of_fit(LATE, 0.01, math.nan)


def test_initial_states_are_not_estimated_from_too_few_readings():
    """Three readings do not determine three unknowns and their errors: there is no ratio, which the warning then says."""
    few = SimpleNamespace(count=3, n=3)
    residuals = SimpleNamespace(freed=lambda start_std: few)
    assert math.isnan(_freed_ratio(residuals, best=None, solver=None))


@pytest.mark.parametrize("shift", [0, LATE, EARLY])
def test_the_tracker_does_not_say_what_shifted_readings_make_it_think(shift):
    scene = strikes.struck()
    readings = {name: moved(rows, shift) for name, rows in strikes.readings(scene, scene.truth, np.random.default_rng(0)).items()}
    tracker = stepper.sysid.Tracker(
        scene.model(*scene.starts[0]), list(scene.parameters), noise=scene.noise, period=0.02, options=HARD, start_std=strikes.START_STD
    )
    for k, ctrl in enumerate(scene.ctrl[:50]):
        now = tracker.update(ctrl, {name: rows[k] for name, rows in readings.items()})
    assert now.determined.all() if not shift else not now.determined.any()


@given(st.integers(2, 40), st.integers(1, 3), st.sampled_from([LATE, EARLY]))
def test_shifts_undo_one_another(rows, width, shift):
    """All rows are back where they were, but one at an end, which was not measured on the way."""
    given_ = np.arange(rows * width, dtype=float).reshape(rows, width)
    back = shifted(stepper.sysid.Episode(np.zeros((rows, 1)), {"x": moved(given_, shift)}, 0.02), shift).readings["x"]
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

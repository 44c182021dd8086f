"""Scenes of the failure atlas: the default setting at every time step, its alternatives at one.

The scenes, with their right answers and sources, are in benches/atlas/scenes. Known failures, with their reasons and sizes, are in
benches/atlas/known.py. `make atlas` runs the long sweep, and other engines.
"""

import math
import re
from pathlib import Path

import pytest
from atlas import scenes
from atlas.engines import Stepper, stepper_engines
from atlas.known import KNOWN, Bound, Divergence, Slope, failure
from atlas.run import FAILS, run
from atlas.scene import Scene
from atlas.world import NOT_FINITE
from known_failures import KnownFailureError, check_error, known_failure
from numerics import slope

DEFAULT, *OTHERS = [engine for engine in stepper_engines() if engine.precision == "f64"]
USUAL = 2e-3
"""Time step of a setting other than the default, or the next one of the scene, s."""
LONG = {"14": ("stepper baumgarte", "stepper newton"), "S3": ("stepper euler", "stepper newton")}
"""Settings that run for scenes whose runs take seconds, by number: the others have the same contact law and solver."""
IN_LAWS = {"1", "2", "3", "8", "10", "11"}
"""Scenes whose closed forms tests/laws and tests/reference check to rounding."""
TESTS = Path(__file__).parents[1]


def _case(scene: Scene, engine: Stepper, dt: float):
    known, name = failure(scene.title, engine.name, dt), f"{scene.name}-{engine.name}-{dt:g}"
    if known is None:
        return pytest.param(scene, engine, dt, id=name)
    assert known.size is not None, f"{name}: benches/atlas/known.py must give the size of this failure, as a test runs it"
    marks = [known_failure(known.reason)] if isinstance(known.size, Bound) else []
    return pytest.param(scene, engine, dt, id=f"{name}-{type(known.size).__name__.lower()}", marks=marks)


def _steps(scene: Scene, engine: Stepper) -> list[float]:
    """The usual time step, and where the setting is known to fail, also the next one at which it should hold."""
    nearest = sorted(scene.test_dts, key=lambda dt: abs(dt - USUAL))
    holding = [dt for dt in nearest if failure(scene.title, engine.name, dt) is None]
    return list(dict.fromkeys([*nearest[:1], *holding[:1]]))


def _cases() -> list:
    """Cases of all scenes, settings and time steps. `make atlas` runs all settings at all time steps."""
    cases = []
    for scene in (scene for scene in scenes.ALL if scene.number not in IN_LAWS):
        cases += [_case(scene, DEFAULT, dt) for dt in scene.test_dts]
        others = [engine for engine in OTHERS if engine.name in LONG.get(scene.number, (engine.name,))]
        cases += [_case(scene, engine, dt) for engine in others for dt in _steps(scene, engine)]
    return cases


@pytest.mark.parametrize(("scene", "engine", "dt"), _cases())
def test_the_error_is_within_the_tolerance_of_the_scene(scene: Scene, engine: Stepper, dt: float) -> None:
    """A known failure is within its size instead, because known.py gives each a bound, a divergence or an order."""
    known = failure(scene.title, engine.name, dt)
    size = None if known is None else known.size
    if isinstance(size, Slope):
        check_slope(scene, engine, size)
        return
    row = run(scene, engine, dt)
    if isinstance(size, Divergence):
        assert (row.outcome, row.error, row.note) == (FAILS, math.inf, NOT_FINITE)
        return
    message = f"{row.unit}, {scene.answer} ({scene.source}); {row.note}"
    check_error(row.error, row.tolerance, size.largest(dt) if isinstance(size, Bound) else None, message)


def check_slope(scene: Scene, engine: Stepper, known: Slope) -> None:
    """Check that an error is proportional to a power of the time step, and above the tolerance throughout."""
    rows = [run(scene, engine, dt) for dt in known.dts]
    assert [row.outcome for row in rows] == [FAILS] * len(rows), "the setting holds: benches/atlas/known.py says that it fails"
    errors = [row.error for row in rows]
    assert slope(known.dts, errors) == pytest.approx(known.power, abs=known.margin), (known.dts, errors)


def test_an_error_within_the_tolerance_passes():
    check_error(1.0, 1.0, 10.0, "")


@pytest.mark.parametrize("error", [1.1, 10.0])
def test_an_error_within_the_bound_is_a_known_failure(error):
    with pytest.raises(KnownFailureError, match="a message"):
        check_error(error, 1.0, 10.0, "a message")


@pytest.mark.parametrize(("error", "bound"), [(10.1, 10.0), (math.inf, 10.0), (math.nan, 10.0), (1.1, None), (math.nan, None)])
def test_any_other_error_fails(error, bound):
    with pytest.raises(AssertionError) as found:
        check_error(error, 1.0, bound, "")
    assert not isinstance(found.value, KnownFailureError)


@known_failure("an error between tolerance and bound")
def test_the_mark_expects_a_known_failure():
    check_error(2.0, 1.0, 3.0, "")


def test_all_expected_failures_have_a_bound():
    """No test marks itself, because such a mark would expect any exception."""
    own = re.compile(r"mark\.xfail\b|pytest\.xfail\b")
    files = [file.name for file in TESTS.rglob("*.py") if own.search(file.read_text())]
    assert files == ["known_failures.py"]


def test_bounds_are_finite():
    steps = {dt for scene in scenes.ALL for dt in scene.test_dts}
    for known in KNOWN:
        if isinstance(known.size, Bound):
            low, high = known.dts
            assert all(math.isfinite(known.size.largest(dt)) for dt in steps if low <= dt <= high), known.reason
            assert known.size.because

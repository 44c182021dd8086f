"""Scenes of the atlas as tests: the default setting at every time step, its alternatives at one.

The scenes, with their right answers and sources, are in benches/atlas/scenes. Known failures, with their reasons and sizes, are in
benches/atlas/known.py. `make atlas` runs the long sweep, and other engines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from atlas import scenes
from atlas.engines import Stepper, stepper_engines
from atlas.known import Bound, Divergence, Slope, failure
from atlas.run import FAILS, run
from atlas.scene import Scene
from atlas.world import NOT_FINITE
from known_failures import check_error, known_failure
from numerics import slope

DEFAULT, *OTHERS = [engine for engine in stepper_engines() if engine.precision == "f64"]
USUAL = 2e-3
"""Time step of a setting other than the default, or the next one of the scene, s."""


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


def cases(number: str, others: Sequence[str] | None = None):
    """Parametrize a test over the scenes of a number, settings and time steps.

    Args:
        number: Number of the scenes.
        others: Names of the settings to run, the default one excepted; None for all. `make atlas` runs all of all scenes.
    """
    found = []
    for scene in scenes.of(number):
        found += [_case(scene, DEFAULT, dt) for dt in scene.test_dts]
        chosen = [engine for engine in OTHERS if others is None or engine.name in others]
        found += [_case(scene, engine, dt) for engine in chosen for dt in _steps(scene, engine)]
    return pytest.mark.parametrize(("scene", "engine", "dt"), found)


def check(scene: Scene, engine: Stepper, dt: float) -> None:
    """Check the error against the tolerance of the scene, or a known failure against its size."""
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

"""Scenes of the atlas as tests: the default setting at every time step, its alternatives at one.

What a scene is, which answer is right and where that comes from is in benches/atlas/scenes; failures that are known, with their reasons, in
benches/atlas/known.py. `make atlas` runs the long sweep, with other engines beside.
"""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from atlas import scenes
from atlas.engines import Stepper, stepper_engines
from atlas.known import reason
from atlas.run import HELD, run
from atlas.scene import Scene

DEFAULT, *OTHERS = [engine for engine in stepper_engines() if engine.precision == "f64"]


def _case(scene: Scene, engine: Stepper, dt: float):
    why = reason(scene.title, engine.name, dt)
    marks = [] if why is None else [pytest.mark.xfail(reason=why, strict=True)]
    return pytest.param(scene, engine, dt, id=f"{scene.name}-{engine.name}-{dt:g}", marks=marks)


def cases(number: str, others: Sequence[str] | None = None):
    """Parametrizes a test over the scenes of a number, settings and time steps.

    Args:
        number: Of the scenes.
        others: Names of the settings beside the default one; None is all. `make atlas` runs all of all scenes.
    """
    found = []
    for scene in scenes.of(number):
        found += [_case(scene, DEFAULT, dt) for dt in scene.test_dts]
        usual = min(scene.test_dts, key=lambda dt: abs(dt - 2e-3))
        found += [_case(scene, engine, usual) for engine in OTHERS if others is None or engine.name in others]
    return pytest.mark.parametrize(("scene", "engine", "dt"), found)


def check(scene: Scene, engine: Stepper, dt: float) -> None:
    """The error is within what the scene allows."""
    row = run(scene, engine, dt)
    assert row.outcome == HELD, f"{row.error:g} {row.unit}, allowed {row.tolerance:g}: {scene.answer} ({scene.source}); {row.note}"

"""Output files of the charts of built-in scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stepper._stepper import __version__
from stepper.lab.engine_chart.draw import draw, write_csv
from stepper.lab.engine_chart.run import Effort, sweep
from stepper.lab.engine_chart.scenes import SCENES
from stepper.lab.progress import Tick
from stepper.shared.machine import one_core, package_version, provenance, require


def charts(names: Sequence[str], out: Path, effort: Effort, tick: Tick) -> list[Path]:
    """Measures scenes, and writes `chart-NAME.png` and `chart-NAME.csv` for each.

    Args:
        names: Names of the scenes in `SCENES`.
        out: Output folder, which is created if necessary.
        effort: Number and duration of the measurements.
        tick: Progress callback with a text and the fraction done.

    Returns:
        Paths of the pictures.
    """
    require("matplotlib", "to draw a chart")
    pictures = []
    for name in names:
        scene = SCENES[name]()
        with one_core():
            rows = sweep(scene, effort, lambda done, name=name: tick(f"chart {name}", done))  # type: ignore[misc]
        came_from = provenance()
        note = f"{came_from['cpu']}, one core, {came_from['utc']}, stepper {__version__}, MuJoCo {package_version('mujoco-core')}"
        write_csv(out / f"chart-{name}.csv", scene, rows, came_from)
        draw(out / f"chart-{name}.png", scene, rows, note)
        pictures.append(out / f"chart-{name}.png")
    return pictures

"""Picture of a comparison of engines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepper.lab.comparison.trial import Course
from stepper.shared.files import write_figure
from stepper.shared.machine import require


def draw(courses: Sequence[Course], path: Path) -> Path:
    """Draws overlap, force, energy and difference from hard contact against time, and returns the path of the picture.

    Lines are medians over episodes with the range between quartiles, in one colour per engine.
    """
    require("matplotlib", "to draw the comparison")
    from matplotlib.figure import Figure  # noqa: PLC0415  (optional)

    figure = Figure(figsize=(11, 7), layout="constrained")
    panels = figure.subplots(2, 2)
    hard = courses[0]
    for number, course in enumerate(courses):
        time = course.timestep * np.arange(1, len(course.depth) + 1)
        apart = np.abs(course.qpos - hard.qpos).max(axis=2)
        values = (1e3 * course.depth, course.force, course.energy, np.maximum(apart, 1e-12))
        for panel, value in zip(panels.flat, values, strict=True):
            low, middle, high = np.quantile(value, (0.25, 0.5, 0.75), axis=1)
            if panel is panels[1, 1] and course is hard:
                continue
            # The line of MuJoCo is dashed, because the line of MuJoCo's contact law in stepper is nearly the same.
            panel.plot(time, middle, "--" if number > 1 else "-", color=f"C{number}", label=course.name, linewidth=1.2)
            panel.fill_between(time, low, high, color=f"C{number}", alpha=0.2, linewidth=0)
    titles = (
        "largest penetration, mm",
        "largest normal force, N",
        "energy, J",
        "largest difference of the configuration from hard contact",
    )
    for panel, title in zip(panels.flat, titles, strict=True):
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("time, s")
        panel.grid(visible=True, alpha=0.3)
    panels[1, 1].set_yscale("log")
    panels[0, 0].legend()
    return write_figure(path, figure, dpi=130)

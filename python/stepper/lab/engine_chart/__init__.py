"""Speed against accuracy: one scene, many engines, settings and time steps, in one process on one core.

`scenes` says what is right, `run` sweeps and times, `draw` makes the picture and the table, `files` writes them.
"""

from stepper.lab.engine_chart.draw import draw, write_csv
from stepper.lab.engine_chart.files import charts
from stepper.lab.engine_chart.run import Effort, Row, sweep
from stepper.lab.engine_chart.scenes import SCENES, Scene

__all__ = ["SCENES", "Effort", "Row", "Scene", "charts", "draw", "sweep", "write_csv"]

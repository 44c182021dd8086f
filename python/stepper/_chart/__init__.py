"""Speed against accuracy: one scene, many engines, settings and time steps, in one process on one core.

`scenes` says what is right, `engines` how to step, `run` sweeps and times, `draw` makes the picture and the table.
"""

from stepper._chart.draw import draw, write_csv
from stepper._chart.run import Effort, Row, sweep
from stepper._chart.scenes import SCENES, Scene

__all__ = ["SCENES", "Effort", "Row", "Scene", "draw", "sweep", "write_csv"]

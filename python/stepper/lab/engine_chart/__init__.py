"""Charts of built-in scenes: error against cost of engines, settings and time steps, measured on one core.

- `scenes`: scenes with known solutions
- `run`: errors and times of all engines and time steps
- `draw`: picture and table
- `files`: output files
"""

from stepper.lab.engine_chart.draw import draw, write_csv
from stepper.lab.engine_chart.files import charts
from stepper.lab.engine_chart.run import Effort, Row, sweep
from stepper.lab.engine_chart.scenes import SCENES, Scene

__all__ = ["SCENES", "Effort", "Row", "Scene", "charts", "draw", "sweep", "write_csv"]

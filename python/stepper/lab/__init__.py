"""Studies of a model: charts of error against cost, tuning to an error budget, sweeps, reports, rankings, calibration.

    stepper.lab.chart("tray.toml")  # error against cost of many settings
    stepper.lab.report("tray.toml")  # a sweep of every parameter, with the causes of failures

The folder `study` has the definition of a study (`Study`, `Parameter`, `Outcome`) with sweep, rank and report; `accuracy` has chart and
tune; `calibration` has calibrate. `demo` compares stepper with MuJoCo.
docs/reference/studies.md explains studies.
"""

from stepper.lab.accuracy.chart import Chart, MeasuredTrajectories, chart
from stepper.lab.accuracy.measure import Dot
from stepper.lab.accuracy.tune import Candidate, Tuning, tune
from stepper.lab.calibration.calibrate import Calibration, MeasuredParameter, calibrate
from stepper.lab.calibration.fit import Fit
from stepper.lab.calibration.search import Certificate, Trial
from stepper.lab.calibration.trajectories import FittedSet, TrajectoryCalibration, calibrate_on_trajectories
from stepper.lab.study import Outcome, Parameter, PolicyController, Study, World
from stepper.lab.study.failure_causes import Verdict
from stepper.lab.study.journal import Table
from stepper.lab.study.ranking import Rank, Ranking, rank
from stepper.lab.study.report import Report, report, sweep
from stepper.lab.study.sweep import Cliff, Level, Statistics, Sweep

__all__ = [
    "Calibration",
    "Candidate",
    "Certificate",
    "Chart",
    "Cliff",
    "Dot",
    "Fit",
    "FittedSet",
    "Level",
    "MeasuredParameter",
    "MeasuredTrajectories",
    "Outcome",
    "Parameter",
    "PolicyController",
    "Rank",
    "Ranking",
    "Report",
    "Statistics",
    "Study",
    "Sweep",
    "Table",
    "TrajectoryCalibration",
    "Trial",
    "Tuning",
    "Verdict",
    "World",
    "calibrate",
    "calibrate_on_trajectories",
    "chart",
    "rank",
    "report",
    "sweep",
    "tune",
]

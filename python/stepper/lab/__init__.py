"""Studies of a model: charts of error against cost, tuning to an error budget, sweeps, reports, rankings, calibration.

    stepper.lab.chart("tray.toml")  # error against cost of many settings
    stepper.lab.report("tray.toml")  # a sweep of every parameter, with the causes of failures

The folder `study` has the definition of a study (`Study`, `Parameter`, `Outcome`) with sweep, rank and report; `accuracy` has chart and
tune; `calibration` has calibrate. `comparison` compares the contact laws; `demo` compares stepper with MuJoCo.
docs/reference/studies.md explains studies.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepper.lab.accuracy.chart import Chart, chart
    from stepper.lab.accuracy.dots import Dot
    from stepper.lab.accuracy.profile import CostProfile, profile
    from stepper.lab.accuracy.tune import Candidate, Tuning, tune
    from stepper.lab.calibration.calibrate import Calibration, MeasuredParameter, calibrate
    from stepper.lab.calibration.certificate import Certificate
    from stepper.lab.calibration.fit import Fit
    from stepper.lab.calibration.recordings import FittedSet, RecordedCalibration, calibrate_on_recordings
    from stepper.lab.calibration.search import Trial
    from stepper.lab.comparison import LawComparison, compare
    from stepper.lab.comparison.trial import Course
    from stepper.lab.study import ControlLog, Outcome, Parameter, PolicyController, Study, World
    from stepper.lab.study.failure_causes import Verdict
    from stepper.lab.study.ranking import Rank, Ranking, rank
    from stepper.lab.study.report import Report, report, sweep
    from stepper.lab.study.sweep import Cliff, Level, Statistics, Sweep
    from stepper.lab.study.table import Table

__all__ = [
    "Calibration",
    "Candidate",
    "Certificate",
    "Chart",
    "Cliff",
    "ControlLog",
    "CostProfile",
    "Course",
    "Dot",
    "Fit",
    "FittedSet",
    "LawComparison",
    "Level",
    "MeasuredParameter",
    "Outcome",
    "Parameter",
    "PolicyController",
    "Rank",
    "Ranking",
    "RecordedCalibration",
    "Report",
    "Statistics",
    "Study",
    "Sweep",
    "Table",
    "Trial",
    "Tuning",
    "Verdict",
    "World",
    "calibrate",
    "calibrate_on_recordings",
    "chart",
    "compare",
    "profile",
    "rank",
    "report",
    "sweep",
    "tune",
]

_FOLDERS = {
    **dict.fromkeys(("CostProfile", "Chart", "Tuning", "profile", "chart", "tune"), "accuracy"),
    **dict.fromkeys(("Calibration", "Certificate", "MeasuredParameter", "calibrate"), "calibration"),
    **dict.fromkeys(("FittedSet", "RecordedCalibration", "calibrate_on_recordings"), "calibration"),
    "Fit": "calibration.fit",
    **dict.fromkeys(("LawComparison", "compare"), "comparison"),
    **dict.fromkeys(("Cliff", "Level", "Statistics", "Sweep"), "study.sweep"),
    "Rank": "study.ranking",
    "Table": "study.table",
    "Verdict": "study.failure_causes",
    "Candidate": "accuracy.tune",
    "Course": "comparison.trial",
    "Dot": "accuracy.dots",
    "Trial": "calibration.search",
}
"""Subfolder or module with the definition of each public name, except for names in the subfolder `study`.

A subfolder is imported when one of its names is first used.
"""


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(importlib.import_module(f"{__name__}.{_FOLDERS.get(name, 'study')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)

"""Calibration: the smallest set of parameters that must be measured, with a certificate (`calibrate`).

- `search`: the smallest set, the widest tolerances, and certificates on fresh worlds
- `calibrate`: the search with a study, and its document
- `recordings`: the same for recordings of a real system
- `fit`: fits of parameters to recordings with impacts, whose losses are rough
"""

from stepper.lab.calibration.calibrate import Calibration, MeasuredParameter, calibrate
from stepper.lab.calibration.recordings import FittedSet, RecordedCalibration, calibrate_on_recordings
from stepper.lab.calibration.search import Certificate

__all__ = [
    "Calibration",
    "Certificate",
    "FittedSet",
    "MeasuredParameter",
    "RecordedCalibration",
    "calibrate",
    "calibrate_on_recordings",
]

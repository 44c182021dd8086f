"""System identification: estimates of model parameters from measurements, with their uncertainty (docs/how-to/identify.md).

Identification from recordings:

- `data`: measurements
- `parameters`: the parameters to estimate
- `simulate`: predicted readings, from one batch of environments
- `residuals`: differences between predicted and measured readings
- `fit`: the least-squares search
- `nullspace`: directions of the parameters that the data do not determine
- `combinations`: combinations of parameters that the data determine nevertheless
- `uncertainty`: covariance of the estimate, and warnings about it
- `result`: the estimate
- `shift`: detection of readings that are one sample early or late

Online identification, with an estimate after every sample:

- `online`: the tracker, with weights of its hypotheses about friction
- `horizon`: moving-horizon estimate under one hypothesis
- `rivals`: other values of friction that may explain the readings
- `problem`: the data of a tracker, and its predictions
- `linear`: derivatives over the uncertain range
"""

from stepper.sysid.combinations import Combination
from stepper.sysid.data import Episode, episodes_of
from stepper.sysid.fit import identify
from stepper.sysid.online import TrackedParameter, Tracker
from stepper.sysid.parameters import KINDS, FitParameter
from stepper.sysid.result import Identification, Search

__all__ = [
    "KINDS",
    "Combination",
    "Episode",
    "FitParameter",
    "Identification",
    "Search",
    "TrackedParameter",
    "Tracker",
    "episodes_of",
    "identify",
]  # fmt: skip

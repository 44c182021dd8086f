"""Identification: parameters of a model from what was measured, and how sure that is (docs/how-to/identify.md).

`data` reads what was measured, `parameters` defines the unknowns, `simulate` predicts readings in one batch of environments, `residuals`
compares them, `fit` searches, `uncertainty` and `findings` give the uncertainty of the answer, `result` is the answer.
`design` ranks what could be measured next.
`online` follows parameters sample by sample instead: `mixture` weighs hypotheses about friction, `horizon` estimates under one of them,
`rivals` compares other frictions, `problem` predicts, `linear` takes derivatives.
`shift` detects readings of the row before or after.
"""

from stepper.sysid.data import Episode, episodes_of
from stepper.sysid.design import Prospect, design
from stepper.sysid.fit import identify
from stepper.sysid.online import Tracked, Tracker
from stepper.sysid.parameters import KINDS, FitParameter
from stepper.sysid.result import Identification, Search

__all__ = [
    "KINDS",
    "Episode",
    "FitParameter",
    "Identification",
    "Prospect",
    "Search",
    "Tracked",
    "Tracker",
    "design",
    "episodes_of",
    "identify",
]  # fmt: skip

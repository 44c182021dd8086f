"""Accuracy of a simulation: error against cost, settings for an error budget, and pairs of bodies that need no contact.

- `traces`: runs of episodes, and distances between runs
- `reference`: converged runs, from which errors are measured
- `candidates`: settings that are compared
- `costs`: processor time of settings
- `chart`, `measure`: error against cost
- `invariants`: errors that stay meaningful in chaotic motion
- `draw`: picture of a chart
- `tune`: the cheapest settings within an error budget
- `needs`: pairs of bodies that need no contact
"""

from stepper.lab.accuracy.chart import Chart, chart
from stepper.lab.accuracy.tune import Tuning, tune

__all__ = ["Chart", "Tuning", "chart", "tune"]

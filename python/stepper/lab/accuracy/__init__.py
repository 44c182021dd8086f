"""How wrong a simulation is, and what less would do: error against cost, settings for an error budget, what a scene does not need.

`traces` runs episodes and measures how far two runs are apart, `reference` converges one, `candidates` are the settings that are
compared, `costs` times them. `chart` puts all of it together: `measure` runs the candidates within a `budget` of time, `invariants` and
`distributions` are errors that mean something under chaos, `dots` are the points in numbers, `tables` and `draw` write them. `tune`
chooses, `needs` leaves out, `account` says what was used and what it cost.
"""

from stepper.lab.accuracy.account import Account, account
from stepper.lab.accuracy.chart import Chart, chart
from stepper.lab.accuracy.tune import Tuning, tune

__all__ = ["Account", "Chart", "Tuning", "account", "chart", "tune"]

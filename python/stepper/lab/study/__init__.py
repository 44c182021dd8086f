"""Studies: a model, what drives it, what counts, and what may be otherwise, in one command.

`study` is what a user writes (`files` reads it), made of `parameters`, `outcomes` and `drives` over `worlds`, which are the environments of
one engine. `batches` runs points of it in lanes and keeps every row in a `journal`; `sweep` perturbs one parameter at a time, `ranking`
all at once, `whose` tells whose a failure is, `touching` what touches, `report` writes all of it down.
"""

from stepper.lab.study.drives import Policy, Recorded
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import Parameter
from stepper.lab.study.ranking import Ranking, rank
from stepper.lab.study.report import Report, report, sweep
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import World

__all__ = ["Outcome", "Parameter", "Policy", "Ranking", "Recorded", "Report", "Study", "World", "rank", "report", "sweep"]

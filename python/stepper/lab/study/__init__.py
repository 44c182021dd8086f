"""Studies: episodes of a model with a controller, measured outcomes and uncertain parameters.

- `study`: the definition of a study, also from TOML files
- `parameters`, `outcomes`, `controllers`: parts of the definition
- `worlds`: environments of one engine
- `batches`: runs of episodes at values of the parameters, in batches
- `episode`: selected episodes, for recordings and the viewer
- `journal`: results of finished episodes (rows) on disk
- `sweep`: variation of one parameter at a time; `ranking`: of all at once
- `failure_causes`: causes of failures; `touching`: statistics of contacts
- `report`, `document`, `draw`: documents and pictures of the results
"""

from stepper.lab.study.controllers import PolicyController
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import Parameter
from stepper.lab.study.ranking import Ranking, rank
from stepper.lab.study.report import Report, report, sweep
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import World

__all__ = ["Outcome", "Parameter", "PolicyController", "Ranking", "Report", "Study", "World", "rank", "report", "sweep"]

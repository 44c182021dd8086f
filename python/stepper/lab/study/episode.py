"""Selected episodes of a study: results (rows), recordings, and stepwise runs for the viewer.

The results equal those in the tables of a sweep bit for bit.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._stepper import Stepper
from stepper.lab.study.batches import USUAL, outcomes_of, point_at, rows_in, running, together, world_of
from stepper.lab.study.journal import Row
from stepper.lab.study.outcomes import Watch
from stepper.lab.study.parameters import Value, check_value_conflicts
from stepper.lab.study.worlds import StepperWorld
from stepper.shared.arguments import check_mapping, path_of

if TYPE_CHECKING:
    from stepper.lab.study.study import Study


class Episodes:
    """Selected episodes of a study with the same parameter values, which can be run, recorded or viewed.

    With a sensor model, sensor errors depend on the index in a batch. All episodes with these parameter values are then stepped, so that
    the selected ones have the same errors as in the tables.

    Args:
        study: The study.
        values: Values of parameters, by name or selector; the others are nominal.
        numbers: Numbers of the selected episodes, from 0.
        setting: Name of the settings.

    Raises:
        ValueError: A parameter, value, name of settings or episode is invalid.

    Attributes:
        study: The study.
        world: The environments.
        episodes: Number of each environment's episode.
        shown: Indices of the environments with the selected episodes.
    """

    def __init__(self, study: Study, values: Mapping[str, Value], numbers: Sequence[int], setting: str = USUAL):
        check_mapping("values", values, '{"friction": 0.5}')
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 0:
                raise ValueError(f"episode is {number!r}, must be 0 or more")
        if together(study) and max(numbers) >= study.episodes:
            raise ValueError(
                f"episode is {max(numbers)}, must be below episodes, which is {study.episodes} in {study.name}, because sensor errors "
                "depend on the number of episodes: give the study more episodes"
            )
        new = {name: value for name, value in values.items() if name not in study.parameters}
        study = study.at(new)
        check_value_conflicts({name: study.parameters[name] for name in values}, study.loaded[0], values)
        point = point_at(study, values, setting)
        self.study = study
        self.episodes = list(range(study.episodes)) if together(study) else list(numbers)
        self.shown = [self.episodes.index(number) for number in numbers]
        self._point = point
        self.world = world_of(study, setting, [point.values] * len(self.episodes))

    @property
    def sim(self) -> Stepper:
        """Stepper of the environments."""
        if isinstance(self.world, StepperWorld):
            return self.world.sim
        raise ValueError(f"settings {self._point.setting!r} run in MuJoCo, which cannot be viewed or recorded: choose other settings")

    def rows(self, record: str | os.PathLike[str] | None = None) -> list[Row]:
        """Runs the episodes, and records them if a folder is given.

        Returns:
            A row for each selected episode, as in the table of a sweep.
        """
        study, point = self.study, self._point
        if record is not None:
            path_of("record", record)
        with nullcontext() if record is None else self.sim.record(record, note=self.note):
            made = rows_in(self.world, study, point.setting, [point.values] * len(self.episodes), self.episodes)
        return [made[env] for env in self.shown]

    def repeated_steps(self) -> Iterator[dict[str, Any] | None]:
        """Runs the episodes step by step, and repeats them without end.

        Yields:
            None after the start and after every step except the last. After the last step, the outcomes of the selected episodes by
            name; NaN for episodes that diverged.
        """
        outcomes = tuple(self.study.all_outcomes)
        while True:
            watch: Watch | None = None
            controls = 0
            for looks in running(self.study, self.world, self.episodes, by_step=True):
                if looks and watch is not None:
                    watch.record(self.world)
                    controls += 1
                watch = watch or Watch(outcomes, self.world)
                # The outcomes are yielded before the next reset, so that the viewer shows the final state with them.
                last = looks and controls == self.study.num_control_steps
                yield {name: value[self.shown] for name, value in outcomes_of(watch, self.world).items()} if last else None

    @property
    def note(self) -> str:
        """Description for recordings: study, seed, episodes, settings and values of parameters."""
        values = ", ".join(f"{name} {value}" for name, value in self._point.values.items())
        numbers = ", ".join(map(str, self.episodes))
        text = f"study {self.study.name}, seed {self.study.seed}, episode {numbers}, settings {self._point.setting}"
        return f"{text}, {values}" if values else text

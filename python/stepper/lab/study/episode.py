"""One episode of a study by itself, as it is in the table: its row, a recording of it, and its steps for those who look on."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._stepper import Stepper
from stepper.lab.study.batches import outcomes_of, rows_in, running, together, world_of
from stepper.lab.study.journal import Row
from stepper.lab.study.outcomes import Watch
from stepper.lab.study.parameters import Value
from stepper.lab.study.points import USUAL, point_at
from stepper.lab.study.worlds import StepperWorld

if TYPE_CHECKING:
    from stepper.lab.study.study import Study


class Episodes:
    """Episodes of one point of a study, to be run or watched.

    With errors of sensors, which follow from the place in a batch, all episodes of the point are stepped, whatever is asked for: an episode
    has then the errors that it has in the table.

    Args:
        study: The study.
        values: Of parameters, by name or selector; the others are nominal.
        numbers: Of the episodes that are asked for.
        setting: Name of the settings.

    Raises:
        ValueError: No such parameter, value, settings or episode.

    Attributes:
        study: The study.
        world: The environments.
        episodes: Number of each environment's episode.
        asked: Environments of the episodes that were asked for.
    """

    def __init__(self, study: Study, values: Mapping[str, Value], numbers: Sequence[int], setting: str = USUAL):
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 0:
                raise ValueError(f"episode is {number!r}, must be 0 or more")
        if together(study) and max(numbers) >= study.episodes:
            raise ValueError(
                f"episode is {max(numbers)}, and {study.name}, whose sensors have errors of each episode's own, has {study.episodes}: give "
                "it more episodes"
            )
        study = study.at({name: value for name, value in values.items() if name not in study.parameters})
        point = point_at(study, values, setting)
        self.study = study
        self.episodes = list(range(study.episodes)) if together(study) else list(numbers)
        self.asked = [self.episodes.index(number) for number in numbers]
        self._point = point
        self.world = world_of(study, setting, [point.theta] * len(self.episodes))

    @property
    def sim(self) -> Stepper:
        """What steps.

        Raises:
            ValueError: MuJoCo does.
        """
        if isinstance(self.world, StepperWorld):
            return self.world.sim
        raise ValueError(f"settings {self._point.setting!r} are of MuJoCo, of which there is no view and no recording: choose others")

    def rows(self, record: str | os.PathLike[str] | None = None) -> list[Row]:
        """Runs the episodes, and records them where a folder is given.

        Returns:
            A row for each that was asked for, as in the table of a sweep.
        """
        study, point = self.study, self._point
        with nullcontext() if record is None else self.sim.record(record, note=self.note):
            made = rows_in(self.world, study, point.setting, [point.theta] * len(self.episodes), self.episodes)
        return [made[env] for env in self.asked]

    def watched(self) -> Iterator[dict[str, Any] | None]:
        """Runs the episodes step by step from the start.

        Yields:
            None after the start and after every step but the last; after that the outcomes of those that were asked for, by name, NaN
            where an episode diverged. It then begins anew, for ever.
        """
        outcomes = tuple(self.study.all_outcomes)
        while True:
            watch: Watch | None = None
            controls = 0
            for looks in running(self.study, self.world, self.episodes, by_step=True):
                if looks and watch is not None:
                    watch.look(self.world)
                    controls += 1
                watch = watch or Watch(outcomes, self.world)
                # A moment before the end, so that the state that was reached is the one that is seen.
                last = looks and controls == self.study.controls
                yield {name: value[self.asked] for name, value in outcomes_of(watch, self.world).items()} if last else None

    @property
    def note(self) -> str:
        """What they are, in words."""
        values = ", ".join(f"{name} {value}" for name, value in self._point.theta.items())
        numbers = ", ".join(map(str, self.episodes))
        told = f"study {self.study.name}, seed {self.study.seed}, episode {numbers}, settings {self._point.setting}"
        return f"{told}, {values}" if values else told

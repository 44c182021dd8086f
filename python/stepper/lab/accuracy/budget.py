"""Time budget of a chart: shares of its stages, and the time at which each must end."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

QUICK = 120.0
"""Default time budget of a quick chart, s."""
_DRAWING = (20.0, 0.15)
"""Time reserved for pictures and pages, s, and its largest share of the budget."""


@dataclass(frozen=True)
class Stage:
    """Stage of the work, with the time at which it must end.

    Attributes:
        end: End by `time.time`, which is valid on other machines too, s; infinite without a budget.
    """

    end: float = math.inf

    @property
    def left(self) -> float:
        """Remaining time, s; not below 0."""
        return max(0.0, self.end - time.time())

    @property
    def limited(self) -> bool:
        """Whether the stage has an end."""
        return math.isfinite(self.end)

    def within(self, seconds: float) -> Stage:
        """Stage inside this one that lasts at most `seconds`."""
        return Stage(min(self.end, time.time() + seconds))

    def one(self, share: float) -> Stage:
        """Stage inside this one, with a share of the remaining time.

        The first of k remaining runs has the share 1/k. A run that does not finish then takes no time from the others, and one that
        finishes early leaves them its rest.
        """
        return Stage(time.time() + share * self.left) if self.limited else self


@dataclass(frozen=True)
class Budget:
    """Time budget of a chart.

    Attributes:
        seconds: Wall-clock time, s; infinite for no bound.
        begin: Start by `time.time`, s.
    """

    seconds: float
    begin: float

    @classmethod
    def from_seconds(cls, seconds: float) -> Budget:
        """Budget that starts now."""
        return cls(seconds, time.time())

    def stage(self, share: float) -> Stage:
        """Stage that ends when a share of the budget is spent, after the time for pictures is set aside."""
        drawing = min(_DRAWING[0], _DRAWING[1] * self.seconds)
        return Stage(self.begin + share * (self.seconds - drawing)) if math.isfinite(self.seconds) else Stage()

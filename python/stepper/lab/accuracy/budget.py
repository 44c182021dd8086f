"""Time budget of a chart, and of the stages of its computation, in processor time of this process.

Processor time does not depend on other load of the machine.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

QUICK = 120.0
"""Default time budget of a quick chart, s of processor time."""
_DRAWING = (20.0, 0.15)
"""Time reserved for pictures and documents, s, and bound of this time as a fraction of the time budget. The smaller one applies."""


@dataclass(frozen=True)
class Stage:
    """Stage of a computation, with the time at which it must end.

    Attributes:
        end: End of the stage as a value of `time.process_time`, s. Infinite without a budget.
    """

    end: float = math.inf

    @property
    def left(self) -> float:
        """Remaining time of the stage, s; not below 0."""
        return max(0.0, self.end - time.process_time())

    @property
    def limited(self) -> bool:
        """Whether the stage has a finite end."""
        return math.isfinite(self.end)

    def within(self, seconds: float) -> Stage:
        """Stage that ends when this one ends, or `seconds` from now if that is earlier."""
        return Stage(min(self.end, time.process_time() + seconds))

    def one(self, share: float) -> Stage:
        """Stage for one of several runs, with a fraction of the remaining time.

        Give the next of k remaining runs the fraction 1/k. A run that does not finish then takes no time from the others, and a run that
        finishes early leaves its time to them.
        """
        return Stage(time.process_time() + share * self.left) if self.limited else self


@dataclass(frozen=True)
class Budget:
    """Time budget of a chart.

    Attributes:
        seconds: Processor time, s; infinite for no bound.
        begin: Start time from `time.process_time`, s.
    """

    seconds: float
    begin: float

    @classmethod
    def from_seconds(cls, seconds: float) -> Budget:
        """Time budget of the given length, s, that starts now."""
        return cls(seconds, time.process_time())

    def stage(self, share: float) -> Stage:
        """Stage of the computation, which ends when the fraction `share` of the time budget has passed since its start.

        The time reserved for drawing pictures is subtracted from the budget first. With an infinite budget, the stage has no end.
        """
        drawing = min(_DRAWING[0], _DRAWING[1] * self.seconds)
        return Stage(self.begin + share * (self.seconds - drawing)) if math.isfinite(self.seconds) else Stage()

"""The time that a chart may take: shares of it for what is done one after the other, and when a run has to stop."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

QUICK = 120.0
"""Seconds that a quick chart may take where nothing else is asked for."""
_DRAWING = (20.0, 0.15)
"""Seconds that are kept for pictures and pages, and the share of the budget that they are at the most."""


@dataclass(frozen=True)
class Stage:
    """A part of the work, and when it has to be done.

    Attributes:
        end: By `time.time`, which tasks on other machines know too; infinite without a budget.
    """

    end: float = math.inf

    @property
    def left(self) -> float:
        """Seconds; not below 0."""
        return max(0.0, self.end - time.time())

    @property
    def limited(self) -> bool:
        """Whether there is an end."""
        return math.isfinite(self.end)

    def within(self, seconds: float) -> Stage:
        """A stage within this one that ends after some seconds at the latest."""
        return Stage(min(self.end, time.time() + seconds))

    def one(self, share: float) -> Stage:
        """A stage within this one, which has a share of what is left.

        One of k runs that are to come has 1/k: one that does not come to its end takes nothing from the others, and one that is done before
        leaves them the rest.
        """
        return Stage(time.time() + share * self.left) if self.limited else self


@dataclass(frozen=True)
class Budget:
    """The time that a chart may take, from when it is made.

    Attributes:
        seconds: Of the clock on the wall; infinite for all that it takes.
        begin: By `time.time`.
    """

    seconds: float
    begin: float

    @classmethod
    def from_seconds(cls, seconds: float) -> Budget:
        """A budget that begins now."""
        return cls(seconds, time.time())

    def stage(self, share: float) -> Stage:
        """What has to be done when a share of the budget is spent, of that which pictures leave."""
        drawing = min(_DRAWING[0], _DRAWING[1] * self.seconds)
        return Stage(self.begin + share * (self.seconds - drawing)) if math.isfinite(self.seconds) else Stage()

"""Base class of runs that are timed repeatedly, in rounds that alternate with those of other runs."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Timed(ABC):
    """Run that is repeated for timing. Abstract.

    Attributes:
        times: Mean processor time of the run in each round so far, s.
    """

    times: list[float]

    @abstractmethod
    def once(self) -> float:
        """Execute this run once from its start, and return the processor time, s."""

    def measure(self, seconds: float) -> None:
        """Measures one round: repeats the run for at least `seconds`, and appends the mean processor time to `times`."""
        runs, total = 0, 0.0
        while total < seconds:
            total += self.once()
            runs += 1
        self.times.append(total / runs)

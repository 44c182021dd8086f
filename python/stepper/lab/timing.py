"""Repeated timing of a run, in rounds that are interleaved with those of other runs."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Timed(ABC):
    """Run that is repeated for timing.

    Attributes:
        times: Mean processor time of a run in every round, s.
    """

    times: list[float]

    @abstractmethod
    def once(self) -> float:
        """Processor time of one run from the start, s."""

    def measure(self, seconds: float) -> None:
        """Repeats the run for at least `seconds`, and records its mean processor time."""
        runs, total = 0, 0.0
        while total < seconds:
            total += self.once()
            runs += 1
        self.times.append(total / runs)

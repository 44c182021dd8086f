"""What is timed beside others, in rounds."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Timed(ABC):
    """A run that is made again and again.

    Attributes:
        times: Mean processor seconds of a run, of every round.
    """

    times: list[float]

    @abstractmethod
    def once(self) -> float:
        """Processor seconds of one run from the start."""

    def measure(self, seconds: float) -> None:
        """Runs for at least `seconds` and notes the mean of a run."""
        runs, total = 0, 0.0
        while total < seconds:
            total += self.once()
            runs += 1
        self.times.append(total / runs)

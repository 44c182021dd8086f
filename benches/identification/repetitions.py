"""Repetitions of an identification with noise of their own, and what they say together."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import stepper

from identification.scenes import Scene

Readings: TypeAlias = "dict[str, np.ndarray[Any, Any]]"
Answer: TypeAlias = "tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]"
"""Values (2,), lower and upper ends of 95 % intervals (2,)."""


@dataclass
class Tally:
    """What repetitions from one start came to.

    Attributes:
        truth: True values.
        answers: Of each repetition.
        seconds: Time of each.
    """

    truth: np.ndarray[Any, Any]
    answers: list[Answer] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def coverage(self) -> Any:
        """Share of the repetitions whose interval has the truth in it, for each value."""
        return np.mean([(low <= self.truth) & (self.truth <= high) for _, low, high in self.answers], axis=0)

    def error(self) -> Any:
        """Root mean square of the relative errors."""
        return np.sqrt(np.mean([(value / self.truth - 1) ** 2 for value, _, _ in self.answers], axis=0))

    def width(self) -> Any:
        """Median half width of the intervals, relative to the truth."""
        return np.median([(high - low) / 2 / self.truth for _, low, high in self.answers], axis=0)

    def row(self) -> str:
        """The figures as cells of a Markdown table."""
        mass, friction = (
            f"{100 * e:.2g} % | {100 * w:.2g} % | {100 * c:.0f} %"
            for e, w, c in zip(self.error(), self.width(), self.coverage(), strict=True)
        )
        return f"{mass} | {friction} | {np.median(self.seconds):.2g} s"


HEAD = "error of the mass | interval | covers | error of the friction | interval | covers | time"


def noisy(clean: Readings, scene: Scene, seed: int, colour: float = 0.0) -> Readings:
    """Readings with Gaussian noise of the scene's standard deviations, white or of first-order autocorrelation `colour`."""
    rng = np.random.default_rng(seed)
    out = {}
    for name, rows in clean.items():
        noise: Any = rng.standard_normal(rows.shape)
        for k in range(1, len(noise)):
            noise[k] *= np.sqrt(1 - colour**2)
            noise[k] += colour * noise[k - 1]
        out[name] = rows + scene.noise[name] * noise
    return out


@dataclass(frozen=True)
class Trial:
    """A scene with its readings, and how they are predicted.

    Attributes:
        scene: The scene.
        clean: What ideal sensors read.
        options, threads: Of stepper.
    """

    scene: Scene
    clean: Readings
    options: stepper.Options
    threads: int

    def identified(self, start: tuple[float, float], readings: Readings, seed: int) -> Answer:
        """One identification by stepper, which is not told the noise."""
        scene = self.scene
        episode = stepper.Episode(scene.ctrl, readings, scene.period)
        found = stepper.identify(scene.model(*start), [episode], scene.parameters, options=self.options, seed=seed, threads=self.threads)
        ends = found.interval()
        return found.values, ends[:, 0], ends[:, 1]

    def repeat(
        self,
        count: int,
        start: tuple[float, float],
        peer: Callable[[Scene, tuple[float, float], Readings], Answer] | None = None,
        *,
        first: int = 0,
        colour: float = 0.0,
    ) -> Tally:
        """As many identifications as `count`, each with noise of its own (seeds from `first` on), by stepper or a peer."""
        tally = Tally(np.array(self.scene.truth))
        for seed in range(first, first + count):
            readings = noisy(self.clean, self.scene, seed, colour)
            began = time.perf_counter()
            answer = self.identified(start, readings, seed) if peer is None else peer(self.scene, start, readings)
            tally.seconds.append(time.perf_counter() - began)
            tally.answers.append(answer)
        return tally

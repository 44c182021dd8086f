"""Repetitions of an identification with different noise, and their statistics."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import stepper

from identification.scenes import Scene

Readings: TypeAlias = "dict[str, np.ndarray[Any, Any]]"
Answer: TypeAlias = "tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]"
"""Result of an identification: estimated values (k,), and lower and upper bounds of their 95 % intervals (k,) each."""
Peer: TypeAlias = "Callable[[Scene, tuple[float, float], Readings], Answer]"
"""Identification by another library: function of scene, initial values of both parameters, and noisy readings."""

VERSION = 2
"""Version of scenes, noise and initial values. Stored results of another version are not reused."""


@dataclass
class Tally:
    """Results of repeating an identification with different noise, with the same initial values of the search.

    Attributes:
        truth: True values.
        answers: Estimated values with their intervals, one entry for each repetition.
        seconds: Processor time of each repetition, s.
    """

    truth: np.ndarray[Any, Any]
    answers: list[Answer] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def coverage(self) -> Any:
        """Fraction of the repetitions whose interval contains the true value, for each parameter."""
        return np.mean([(low <= self.truth) & (self.truth <= high) for _, low, high in self.answers], axis=0)

    def error(self) -> Any:
        """Relative error of each parameter, as root mean square over the repetitions."""
        return np.sqrt(np.mean([(value / self.truth - 1) ** 2 for value, _, _ in self.answers], axis=0))

    def width(self) -> Any:
        """Half width of the interval of each parameter relative to its true value, as median over the repetitions."""
        return np.median([(high - low) / 2 / self.truth for _, low, high in self.answers], axis=0)

    def cells(self) -> list[str]:
        """Cells of the row of a table, in the order of `HEAD`."""
        columns = zip(self.error(), self.width(), self.coverage(), strict=True)
        cells = [text for e, w, c in columns for text in (f"{100 * e:.2g} %", f"{100 * w:.2g} %", f"{100 * c:.0f} %")]
        return [*cells, f"{np.median(self.seconds):.2g} s"]


HEAD = ("mass error", "interval", "coverage", "friction error", "interval", "coverage", "CPU time")
"""Headings of the columns with the results, without the first column."""


def noisy(clean: Readings, scene: Scene, seed: int, colour: float = 0.0) -> Readings:
    """Ideal readings with added Gaussian noise. `colour` is the correlation of consecutive noise values; 0 is white noise."""
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
    """Identification task: a scene with its ideal readings.

    Attributes:
        scene: Scene.
        clean: Ideal sensor readings by channel.
        options: Options of stepper.
        threads: Number of threads of stepper.
    """

    scene: Scene
    clean: Readings
    options: stepper.Options
    threads: int

    def once(self, start: tuple[float, float], seed: int, peer: Peer | None = None, *, colour: float = 0.0, starts: int = 4) -> Answer:
        """Identify both parameters once from readings with random noise, with stepper, which also estimates the noise, or another library.

        Args:
            start: Initial values of both parameters.
            seed: Seed of the noise, and of `stepper.sysid.identify`.
            peer: Identification by another library. None selects stepper.
            colour: Autocorrelation of consecutive noise values; 0 is white noise.
            starts: Number of initial values of stepper's search: `start`, and random ones.

        Returns:
            Estimated values and their 95 % intervals.
        """
        scene, readings = self.scene, noisy(self.clean, self.scene, seed, colour)
        if peer is not None:
            return peer(scene, start, readings)
        episode = stepper.sysid.Episode(scene.ctrl, readings, scene.period)
        settings: dict[str, Any] = {"options": self.options, "seed": seed, "threads": self.threads, "starts": starts}
        found = stepper.sysid.identify(scene.model(*start), [episode], scene.parameters, **settings)
        ends = found.interval()
        return found.values, ends[:, 0], ends[:, 1]


@dataclass(frozen=True)
class Row:
    """Repeated identification, as a row of a table.

    Attributes:
        name: Text of the first cell.
        truth: True values.
        once: Function from a seed to the result of a repetition.
        count: Number of repetitions.
        first: Seed of the first repetition.
    """

    name: str
    truth: tuple[float, ...]
    once: Callable[[int], Answer]
    count: int
    first: int = 0


class Kept:
    """Store of the results of repetitions in a file, one line each, so that an interrupted run can be resumed.

    Args:
        path: File of the store.
        resume: Whether to reuse the results in the file. Otherwise the file is emptied.

    Raises:
        ValueError: The file has another version.
    """

    def __init__(self, path: Path, resume: bool):
        self._path = path
        self._answers: dict[tuple[str, int], tuple[Answer, float]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        head = json.dumps({"version": VERSION, "stepper": stepper.__version__}) + "\n"
        if not resume or not path.exists():
            path.write_text(head)
            return
        text = path.read_text()
        # A killed run may have left an incomplete last line.
        whole = text[: text.rfind("\n") + 1]
        if whole and not whole.startswith(head):
            raise ValueError(f"{path} begins with {whole.splitlines()[0][:80]}, must begin with {head.strip()}: run without --resume")
        path.write_text(whole or head)
        for line in whole.splitlines()[1:]:
            made = json.loads(line)
            value, low, high = (np.array(made[name]) for name in ("value", "low", "high"))
            self._answers[made["row"], made["seed"]] = (value, low, high), made["seconds"]

    def of(self, row: Row, seed: int) -> tuple[Answer, float]:
        """Result of one repetition, and its processor time, s. The repetition runs only if the store does not have its result yet.

        Args:
            row: Repeated identification.
            seed: Seed of the repetition.
        """
        if (row.name, seed) not in self._answers:
            began = time.process_time()
            answer = row.once(seed)
            seconds = time.process_time() - began
            self._answers[row.name, seed] = answer, seconds
            line = {"row": row.name, "seed": seed, "seconds": seconds}
            line |= {name: np.asarray(x).tolist() for name, x in zip(("value", "low", "high"), answer, strict=True)}
            with self._path.open("a") as file:
                file.write(json.dumps(line) + "\n")
        return self._answers[row.name, seed]


def repeated(rows: Sequence[Row], kept: Kept) -> list[tuple[str, Tally]]:
    """Results of all repetitions, by row name. The rows take turns, so that an interrupted run has some repetitions of each row."""
    tallies = [Tally(np.array(row.truth)) for row in rows]
    most = max(row.count for row in rows)
    for k in range(most):
        for row, tally in zip(rows, tallies, strict=True):
            if k < row.count:
                answer, seconds = kept.of(row, row.first + k)
                tally.answers.append(answer)
                tally.seconds.append(seconds)
        print(f"{k + 1} of {most} repetitions", flush=True)
    return [(row.name, tally) for row, tally in zip(rows, tallies, strict=True)]

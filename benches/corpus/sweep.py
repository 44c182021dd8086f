"""Measurement of all model files of the corpus packages, each in a separate process with a time limit."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from rows import unflatten

from corpus.download import DownloadError, unpacked
from corpus.files import candidates
from corpus.measure import library
from corpus.packages import Package
from corpus.row import ABSENT, FAILED, LATE, MEASURED, REFUSED, Row


@dataclass
class Sweep:
    """Measurement of all files of some packages: settings and results.

    Attributes:
        cache: Folder of the downloaded packages.
        workers: Number of parallel processes.
        limit: Largest wall time for a file, s.
        only: Text that the paths of the measured files contain. An empty text selects all files.
        again: Whether to repeat existing measurements.
        rows: Measurements by package, version and file. The sweep adds new ones.
    """

    cache: Path
    workers: int
    limit: float
    only: str = ""
    again: bool = False
    rows: dict[tuple[str, str, str], Row] = field(default_factory=dict)

    def run(self, packages: Iterable[Package], keep: Callable[[Row], None]) -> None:
        """Measure all files that this build of stepper has not measured yet, package by package."""
        begun = {row.key for row in self.rows.values() if row.stepper == library()} if not self.again else set()
        for package in packages:
            try:
                folder = unpacked(package, self.cache)
            except DownloadError as error:
                self._add(Row(package.name, package.version, "", library(), ABSENT, str(error)), keep)
                continue
            files = [f for f in candidates(package, folder) if self.only in f and (package.name, package.version, f) not in begun]
            with ThreadPoolExecutor(self.workers) as pool:
                for done in as_completed([pool.submit(self._measure, package, file) for file in files]):
                    self._add(done.result(), keep)

    def _add(self, row: Row, keep: Callable[[Row], None]) -> None:
        """Store the measurements of one file in `rows`, and call `keep` with them."""
        self.rows[row.key] = row
        keep(row)

    def _known(self, key: tuple[str, str, str]) -> list[str]:
        """Digests of the models that this build has measured in files other than `key` (package, version, file)."""
        rows = list(self.rows.values())
        return [r.model for r in rows if r.model and r.outcome in (MEASURED, REFUSED) and r.stepper == library() and r.key != key]

    def _measure(self, package: Package, file: str) -> Row:
        """Measure a model file in another process with a time limit, and return the measurements."""
        key = (package.name, package.version, file)
        command: Sequence[str] = [sys.executable, "-m", "corpus.measure", package.name, file, "--cache", str(self.cache)]
        try:
            known = json.dumps(self._known(key))
            done = subprocess.run(command, input=known, capture_output=True, text=True, timeout=self.limit, check=False, env=_one_thread())
        except subprocess.TimeoutExpired:
            return Row(*key, library(), LATE, f"stopped after {self.limit:g} s: give a larger --limit")
        if done.returncode < 0:
            return Row(*key, library(), FAILED, f"signal {signal.Signals(-done.returncode).name}")
        if done.returncode > 0:
            message = done.stderr.strip().splitlines()[-1:] or ["no message"]
            return Row(*key, library(), FAILED, f"the process failed: {message[0]}")
        return unflatten(Row, json.loads(done.stdout.splitlines()[-1]))


def _one_thread() -> dict[str, str]:
    """Environment variables of a worker, in which NumPy's linear algebra uses one thread."""
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

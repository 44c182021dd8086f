"""All files of the packages, each in a process of its own, with a time limit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from corpus.download import DownloadError, unpacked
from corpus.files import candidates
from corpus.measure import library
from corpus.packages import Package
from corpus.row import ABSENT, FAILED, LATE, MEASURED, REFUSED, Row, unflatten


@dataclass
class Sweep:
    """What is measured, and how.

    Attributes:
        cache: Folder of downloads.
        workers: Processes at a time.
        limit: Time that one file may take, s.
        only: Part of the path of every file that is measured; empty is all.
        again: Whether to measure what has been measured already.
        rows: By file, what is known; filled as it goes.
    """

    cache: Path
    workers: int
    limit: float
    only: str = ""
    again: bool = False
    rows: dict[tuple[str, str, str], Row] = field(default_factory=dict)

    def run(self, packages: Iterable[Package], keep: Callable[[Row], None]) -> None:
        """Measures what is missing, package by package.

        Args:
            packages: Which.
            keep: Called after every row.
        """
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
        self.rows[row.key] = row
        keep(row)

    def _known(self, key: tuple[str, str, str]) -> list[str]:
        """Digests of models that this library has measured, in another file than this."""
        rows = list(self.rows.values())
        return [r.model for r in rows if r.model and r.outcome in (MEASURED, REFUSED) and r.stepper == library() and r.key != key]

    def _measure(self, package: Package, file: str) -> Row:
        key = (package.name, package.version, file)
        command: Sequence[str] = [sys.executable, "-m", "corpus.measure", package.name, file, "--cache", str(self.cache)]
        try:
            known = json.dumps(self._known(key))
            done = subprocess.run(command, input=known, capture_output=True, text=True, timeout=self.limit, check=False, env=_one_thread())
        except subprocess.TimeoutExpired:
            return Row(*key, library(), LATE, f"it took more than {self.limit:g} s; --limit gives it more")
        if done.returncode < 0:
            return Row(*key, library(), FAILED, f"the process was ended by {signal.Signals(-done.returncode).name}")
        if done.returncode > 0:
            said = done.stderr.strip().splitlines()[-1:] or ["without a message"]
            return Row(*key, library(), FAILED, f"the process ended with {said[0]}")
        row: Row = unflatten(Row, json.loads(done.stdout.splitlines()[-1]))
        return row


def _one_thread() -> dict[str, str]:
    """The environment of a worker, in which NumPy's linear algebra takes one core."""
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

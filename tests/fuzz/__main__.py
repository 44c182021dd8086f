"""Runs kinds of inputs in turn for some minutes: `python -m fuzz --minutes 5`, or one again: `python -m fuzz --kind state --seed 17`.

Every input is made of its kind and seed alone, and tried in a worker process with limits of time and memory. A crash, a panic, a hang or
an exception that is not documented is a finding: its seed and its input are kept in the folder `--out`.
"""

import argparse
import itertools
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from fuzz.cases import KINDS

SECONDS = 120
"""What an input may take, also on a busy machine."""
START = 100
"""What a worker may take to begin."""
INPUTS = 200
"""After so many a worker makes room for a fresh one, and the next kind has its turn."""


class Worker:
    """A process that tries inputs of one kind, one after the other, and says what it begins and how it ended."""

    def __init__(self, kind: str, seeds: range, folder: Path):
        command = [sys.executable, "-m", "fuzz.worker", kind, str(seeds.start), str(seeds.stop), str(folder)]
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", env=os.environ | {"PYTHONPATH": paths}
        )
        self.lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line.rstrip("\n"))
        self.lines.put(None)

    def line(self, seconds: float) -> str | None:
        """The next line; None at the end. `queue.Empty` after so many seconds."""
        return self.lines.get(timeout=seconds)

    def end(self) -> int:
        """Ends it, and says its return code."""
        self.process.kill()
        return self.process.wait()


def run(kind: str, seeds: range, out: Path, outcomes: Counter[str], deadline: float = float("inf")) -> list[str]:
    """Tries the inputs of these seeds, each finding in a fresh worker. Returns the findings."""
    findings = []
    while seeds and time.monotonic() < deadline:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            worker, seed, said = Worker(kind, seeds, folder), None, []
            what = None
            while True:
                try:
                    line = worker.line(START if seed is None else SECONDS)
                except queue.Empty:
                    what = f"hangs: more than {SECONDS} s"
                    break
                if line is None:
                    code = worker.process.wait()
                    what = f"ends the process with {code}" if code != 0 or seed is not None else None
                    break
                word, _, rest = line.partition(" ")
                if word == "begin":
                    seed, said = int(rest), []
                elif word == "end" and seed is not None:
                    outcomes[f"{kind}: {rest}"] += 1
                    seeds, seed = range(seed + 1, seeds.stop), None
                    if time.monotonic() > deadline:
                        break
                elif word == "finding":
                    what = rest
                    break
                else:
                    said.append(line)
            worker.end()
            if what is None:
                return findings
            if seed is None:
                raise RuntimeError(f"the worker of {kind} {what}: {said}")
            kept = out / f"{kind}-{seed}"
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(folder, kept)
            (kept / "finding.txt").write_text(f"python -m fuzz --kind {kind} --seed {seed}\n{what}\n" + "\n".join(said) + "\n")
            findings.append(f"{kind} {seed}: {what}")
            print(f"FINDING {findings[-1]} ({kept})", flush=True)
            seeds = range(seed + 1, seeds.stop)
    return findings


def main() -> int:
    """The command line. Returns whether there were findings."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--kind", choices=KINDS, help="one kind of inputs; all in turn without it")
    parser.add_argument("--seed", type=int, help="one input again, of one kind; else the first seed is 0")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="folder for findings")
    given = parser.parse_args()
    kinds, outcomes, findings = [given.kind] if given.kind else list(KINDS), Counter[str](), []
    deadline = time.monotonic() + 60 * given.minutes
    if given.seed is not None:
        findings = [found for kind in kinds for found in run(kind, range(given.seed, given.seed + 1), given.out, outcomes)]
    else:
        for first in itertools.count(given.first, INPUTS):
            for kind in kinds:
                findings += run(kind, range(first, first + INPUTS), given.out, outcomes, deadline)
            if time.monotonic() > deadline:
                break
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:8} {outcome}")
    print(f"{sum(outcomes.values()) + len(findings)} inputs, {len(findings)} findings")
    return int(bool(findings))


if __name__ == "__main__":
    sys.exit(main())

"""Studies that are killed: commands get SIGKILL at random moments, are resumed, and leave the same files as a run that was not killed.

    python benches/kills.py STUDY... --command sweep --command rank --kills 30

Of every study and command: one run to its end; then rounds, each in a new folder, of starts that are killed until one gets through; until
there were as many kills as asked for. Of four kills, one is after a time drawn uniformly from nothing to the length of the whole run, which
meets imports and pages too, and three are up to 50 ms after the journal has a number of rows drawn uniformly from those that it lacks.
Printed are the kills, how many of them met a journal with rows, the share of the rows that it had then, and whether all files but the
journal are the same to the byte and the journal has the same rows. Ends with 1 where they are not.
"""

from __future__ import annotations

import argparse
import math
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from stepper.lab.study.journal import rows_of
from stepper.lab.study.results import JOURNAL

BY_TIME = 0.25
"""Share of the kills whose moment is a time."""
LATE, POLL = 0.05, 0.002
"""Seconds up to which a kill is later than the rows that it waits for, and between looks at the journal."""
COMMAND = "import sys; from stepper.cli import main; sys.argv[0] = 'stepper'; main()"


@dataclass
class Count:
    """What was seen of the kills of one command.

    Attributes:
        rows: Rows that the journal had at each kill.
        rounds: Runs that got through after kills.
        wrong: What differed.
    """

    rows: list[int] = field(default_factory=list)
    rounds: int = 0
    wrong: list[str] = field(default_factory=list)


def start(command: str, study: Path, out: Path, more: list[str]) -> subprocess.Popen[bytes]:
    """Starts a command of stepper."""
    with out.with_suffix(".log").open("wb") as log:
        return subprocess.Popen([sys.executable, "-c", COMMAND, command, str(study), "--out", str(out), *more], stdout=log, stderr=log)


def keys_of(out: Path) -> list[str]:
    """Keys of the rows in the journal of the one study in a folder."""
    return [row["key"] for path in out.glob(f"*/{JOURNAL}") for row in rows_of(path)]


def differences(whole: Path, cut: Path) -> Iterator[str]:
    """What is otherwise in a folder than in that of the run that was not killed."""
    names = {path.relative_to(folder) for folder in (whole, cut) for path in folder.rglob("*") if path.is_file()}
    for name in sorted(names):
        if name.name == JOURNAL:
            keys, theirs = keys_of(cut), keys_of(whole)
            if sorted(keys) != sorted(theirs):
                yield f"{name}: {len(keys)} rows, must be the {len(theirs)} of the whole run"
        elif not ((whole / name).exists() and (cut / name).exists()):
            yield f"{name}: not in both"
        elif (whole / name).read_bytes() != (cut / name).read_bytes():
            yield f"{name}: other bytes"


def kill(command: str, study: Path, folder: Path, *, kills: int, more: list[str], draw: random.Random) -> tuple[Count, int, float]:
    """Kills a command until there were as many kills as asked for, and it got through once more after the last."""
    whole, cut = folder / f"{study.stem} {command} whole", folder / f"{study.stem} {command} cut"
    for out in (whole, cut):
        shutil.rmtree(out, ignore_errors=True)
    begin = time.monotonic()
    if start(command, study, whole, more).wait():
        raise SystemExit(f"{command} of {study} does not end well: {whole.with_suffix('.log')} says why")
    length, total = time.monotonic() - begin, len(keys_of(whole))
    count = Count()
    while len(count.rows) < kills:
        with start(command, study, cut, more) as process:
            moment = time.monotonic() + draw.uniform(0.0, length) if draw.random() < BY_TIME else math.inf
            # Of a journal that has all rows, it gets through.
            known, late = len(keys_of(cut)), draw.uniform(0.0, LATE)
            rows = draw.randint(known + 1, total) if known < total else math.inf
            while (code := process.poll()) is None and time.monotonic() < moment:
                time.sleep(POLL)
                if math.isinf(moment) and len(keys_of(cut)) >= rows:
                    moment = time.monotonic() + late
            if code is None:
                process.send_signal(signal.SIGKILL)
                process.wait()
                count.rows.append(len(keys_of(cut)))
                continue
        count.wrong += [f"it ended with {code}"] if code else differences(whole, cut)
        count.rounds += 1
        shutil.rmtree(cut, ignore_errors=True)
    if cut.exists():
        code = start(command, study, cut, more).wait()
        count.wrong += [f"it ended with {code}"] if code else differences(whole, cut)
        count.rounds += 1
    return count, total, length


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="+", type=Path)
    parser.add_argument("--command", action="append", choices=("sweep", "report", "rank"), help="several times for several; all by default")
    parser.add_argument("--kills", type=int, default=30, help="of every study and command")
    parser.add_argument("--samples", type=int, default=16, help="of rank")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/kills"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    draw, failed = random.Random(asked.seed), False
    print("| study | command | whole run | rows | kills | met rows | share of them: least, median, most | got through |")
    print("|---|---|---|---|---|---|---|---|")
    for study in asked.study:
        for command in asked.command or ("sweep", "report", "rank"):
            more = ["--samples", str(asked.samples)] if command == "rank" else []
            count, rows, length = kill(command, study, asked.out, kills=asked.kills, more=more, draw=draw)
            shares = sorted(k / rows for k in count.rows if k)
            told = f"{shares[0]:.2f}, {shares[len(shares) // 2]:.2f}, {shares[-1]:.2f}" if shares else "-"
            end = "; ".join(dict.fromkeys(count.wrong)) or "every time with the same bytes"
            print(
                f"| {study.stem} | {command} | {length:.0f} s | {rows} | {len(count.rows)} | {len(shares)} | {told} | "
                f"{count.rounds}, {end} |",
                flush=True,
            )
            failed |= bool(count.wrong)
    raise SystemExit(failed)


if __name__ == "__main__":
    main()

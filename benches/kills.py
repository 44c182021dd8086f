"""Crash test of studies: SIGKILL at random moments, resumption, and comparison of the results with an uninterrupted run.

    python benches/kills.py STUDY... --command sweep --command rank --kills 30

For each study and command, the script first runs the command to its end. Then it starts the command in a new folder, kills it, and starts
it again until a run finishes. It repeats this until the given number of kills is reached. A quarter of the kills happen at a uniformly
random time of the run, so that they also hit imports and the writing of pages. The others happen up to 50 ms after the journal (the file
with a row for each finished episode) reaches a random number of rows.

The table has the number of kills, and the number of kills at which the journal had rows. For these kills it has the fraction of all rows
that the journal had. The last column compares the results: all files except the journal must be equal to the byte, and the journals must
have the same rows. The exit code is 1 if they differ.
"""

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
"""Fraction of the kills that happen at a random time.

The other kills happen when the study's journal (a file with a row for each finished episode) has a random number of rows.
"""
LATE, POLL = 0.05, 0.002
"""Largest delay of a kill after the study's journal has the chosen number of rows, s; and time between two reads of the journal, s."""
COMMAND = "import sys; from stepper.cli import main; sys.argv[0] = 'stepper'; main()"


@dataclass
class Count:
    """Results of killing one command repeatedly.

    Attributes:
        rows: Number of rows in the study's journal (one for each finished episode) at each kill.
        rounds: Number of runs that finished, usually after kills and resumptions.
        wrong: Descriptions of the differences of these runs from the uninterrupted run.
    """

    rows: list[int] = field(default_factory=list)
    rounds: int = 0
    wrong: list[str] = field(default_factory=list)


def start(command: str, study: Path, out: Path, more: list[str]) -> subprocess.Popen[bytes]:
    """Start a command of stepper for a study as a process."""
    with out.with_suffix(".log").open("wb") as log:
        return subprocess.Popen([sys.executable, "-c", COMMAND, command, str(study), "--out", str(out), *more], stdout=log, stderr=log)


def keys_of(out: Path) -> list[str]:
    """Identifiers of all finished episodes, from the journals (files with a row for each finished episode) in the subfolders of `out`."""
    return [row["key"] for path in out.glob(f"*/{JOURNAL}") for row in rows_of(path)]


def differences(whole: Path, cut: Path) -> Iterator[str]:
    """Yield descriptions of the differences between two output folders: `whole` of the uninterrupted run, and `cut` of a resumed run."""
    names = {path.relative_to(folder) for folder in (whole, cut) for path in folder.rglob("*") if path.is_file()}
    for name in sorted(names):
        if name.name == JOURNAL:
            keys, theirs = keys_of(cut), keys_of(whole)
            if sorted(keys) != sorted(theirs):
                yield f"{name}: {len(keys)} rows, not the same {len(theirs)} rows as the uninterrupted run"
        elif not ((whole / name).exists() and (cut / name).exists()):
            yield f"{name}: exists in one of the folders only"
        elif (whole / name).read_bytes() != (cut / name).read_bytes():
            yield f"{name}: content differs"


def kill(command: str, study: Path, folder: Path, *, kills: int, more: list[str], draw: random.Random) -> tuple[Count, int, float]:
    """Kill a command repeatedly, restart it each time, and let it finish after the last kill.

    Args:
        command: Name of the command.
        study: File of the study.
        folder: Folder for all output.
        kills: Number of kills.
        more: Further arguments of the command.
        draw: Random number generator.

    Returns:
        Results, number of finished episodes in the journal of an uninterrupted run, and duration of that run, s.
    """
    whole, cut = folder / f"{study.stem} {command} whole", folder / f"{study.stem} {command} cut"
    for out in (whole, cut):
        shutil.rmtree(out, ignore_errors=True)
    begin = time.monotonic()
    if start(command, study, whole, more).wait():
        raise SystemExit(f"stepper {command} {study} failed without a kill: see {whole.with_suffix('.log')}")
    length, total = time.monotonic() - begin, len(keys_of(whole))
    count = Count()
    while len(count.rows) < kills:
        with start(command, study, cut, more) as process:
            moment = time.monotonic() + draw.uniform(0.0, length) if draw.random() < BY_TIME else math.inf
            # If the journal already has all rows, only a random time can kill the run.
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
        count.wrong += [f"exit code {code}"] if code else differences(whole, cut)
        count.rounds += 1
        shutil.rmtree(cut, ignore_errors=True)
    if cut.exists():
        code = start(command, study, cut, more).wait()
        count.wrong += [f"exit code {code}"] if code else differences(whole, cut)
        count.rounds += 1
    return count, total, length


def main() -> None:
    """Kill and resume all given commands, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="+", type=Path)
    parser.add_argument("--command", action="append", choices=("sweep", "report", "rank"), help="command to test; may be repeated [all]")
    parser.add_argument("--kills", type=int, default=30, help="number of kills of each study and command [30]")
    parser.add_argument("--samples", type=int, default=16, help="option --samples of the command rank [16]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/kills"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    draw, failed = random.Random(asked.seed), False
    print("| study | command | whole run | rows | kills | kills with rows | share of rows: least, median, most | finished runs, results |")
    print("|---|---|---|---|---|---|---|---|")
    for study in asked.study:
        for command in asked.command or ("sweep", "report", "rank"):
            more = ["--samples", str(asked.samples)] if command == "rank" else []
            count, rows, length = kill(command, study, asked.out, kills=asked.kills, more=more, draw=draw)
            shares = sorted(k / rows for k in count.rows if k)
            share_text = f"{shares[0]:.2f}, {shares[len(shares) // 2]:.2f}, {shares[-1]:.2f}" if shares else "-"
            end = "; ".join(dict.fromkeys(count.wrong)) or "equal to the byte"
            print(
                f"| {study.stem} | {command} | {length:.0f} s | {rows} | {len(count.rows)} | {len(shares)} | {share_text} | "
                f"{count.rounds}, {end} |",
                flush=True,
            )
            failed |= bool(count.wrong)
    raise SystemExit(failed)


if __name__ == "__main__":
    main()

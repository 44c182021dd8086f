"""`make identify`: noisy repetitions from four starts, beside a peer, and sample by sample.

The tables are those of docs/benchmarks/identification.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import stepper
from sections import write_section
from stepper.shared.machine import provenance

from identification import online, strikes, sysid
from identification.repetitions import HEAD, Kept, Row, Trial, repeated
from identification.scenes import HARD, SCENES

PAGE = Path(__file__).parents[2] / "docs/benchmarks/identification.md"
OUT = Path("out/identification")
COLOUR = 0.8


def _table(title: str, rows: Sequence[Row], kept: Kept) -> str:
    lines = [f"| {title} | {HEAD} |", "|" + "---|" * (HEAD.count("|") + 2)]
    lines += [f"| {name} | {tally.row()} |" for name, tally in repeated(rows, kept)]
    print("\n".join(lines), flush=True)
    return "\n".join(lines)


def _trials(threads: int) -> list[Trial]:
    return [Trial(scene, scene.readings(HARD), HARD, threads) for scene in (make() for make in SCENES)]


def _own(count: int, threads: int) -> list[Row]:
    """Hard contact, white noise, from each start."""
    return [
        Row(f"{t.scene.name}, from {start[0]:g} kg and {start[1]:g}", t.scene.truth, partial(t.once, start), count, first=k * count)
        for t in _trials(threads)
        for k, start in enumerate(t.scene.starts)
    ]


def _coloured(count: int, threads: int) -> list[Row]:
    """Noise that is correlated in time."""
    return [
        Row(
            f"{t.scene.name}, noise of autocorrelation {COLOUR:g}", t.scene.truth, partial(t.once, t.scene.starts[0], colour=COLOUR), count
        )
        for t in _trials(threads)
    ]  # fmt: skip


def _beside(count: int, threads: int) -> list[Row]:
    """MuJoCo's own motion, identified by both, with MuJoCo's law."""
    rows = []
    for make in SCENES:
        scene = make()
        trial = Trial(scene, sysid.readings(scene), stepper.Options.from_model(scene.model(*scene.truth)), threads)
        for start in scene.starts:
            place = f"{scene.name}, from {start[0]:g} kg and {start[1]:g}"
            runs = {f"stepper, {n} start{'s' * (n > 1)}": partial(trial.once, start, starts=n) for n in (4, 1)}
            for name, settings in sysid.SETTINGS.items():
                runs[f"mujoco.sysid, {name}"] = partial(trial.once, start, peer=partial(sysid.identified, settings=settings))
            rows += [Row(f"{place}: {name}", scene.truth, once, count) for name, once in runs.items()]
    return rows


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m identification", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="repetitions from each start")
    parser.add_argument("--count-beside", type=int, default=10, help="repetitions beside mujoco.sysid")
    parser.add_argument("--count-online", type=int, default=25, help="runs that are followed sample by sample, of each kind")
    parser.add_argument("--count-strikes", type=int, default=200, help="runs of each scene in which contacts begin and end")
    parser.add_argument("--threads", type=int, default=0, help="threads of stepper; 0 is all")
    parser.add_argument("--only", choices=["own", "coloured", "beside", "online", "strikes"], help="one of the tables")
    parser.add_argument("--resume", action="store_true", help=f"take repetitions from {OUT} that an earlier run has made")
    parser.add_argument("--update-docs", action="store_true", help=f"write the tables into {PAGE.name}")
    given = parser.parse_args()
    about = provenance()
    print(f"{about['cpu']}, {about['cores']} cores, load {about['load_average']}")
    tables = {}
    if given.only in (None, "own"):
        tables["own"] = _table("scene", _own(given.count, given.threads), Kept(OUT / "own.jsonl", given.resume))
    if given.only in (None, "coloured"):
        tables["coloured"] = _table("scene", _coloured(given.count, given.threads), Kept(OUT / "coloured.jsonl", given.resume))
    if given.only in (None, "online"):
        tables["online"] = online.table(given.count_online)
    if given.only in (None, "strikes"):
        tables["strikes"] = strikes.table(given.count_strikes)
    if given.only in (None, "beside"):
        if missing := sysid.available():
            print(f"not beside mujoco.sysid: {missing}")
        else:
            tables["beside"] = _table("scene", _beside(given.count_beside, given.threads), Kept(OUT / "beside.jsonl", given.resume))
    if given.update_docs:
        for name, table in tables.items():
            write_section(PAGE, name, table)
        print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()

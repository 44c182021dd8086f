"""Command `make identify`: repeated identification with noise, the comparison with mujoco.sysid, and online identification.

The tables are those of docs/benchmarks/identification.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import stepper
from sections import Table, write_section
from stepper.shared.machine import provenance

from identification import determined, online, strikes, sysid
from identification.repetitions import HEAD, Kept, Row, Trial, repeated
from identification.scenes import HARD, SCENES

PAGE = Path(__file__).parents[2] / "docs/benchmarks/identification.md"
OUT = Path("out/identification")
COLOUR = 0.8
"""Correlation of consecutive noise values in the table "coloured"."""


def _table(rows: Sequence[Row], kept: Kept) -> Table:
    """Table of repeated identifications. `kept` is the store of finished repetitions."""
    results = repeated(rows, kept)
    made = Table("scene", *HEAD)
    for name, tally in results:
        made.add(name, *tally.cells())
    return made


def _trials(threads: int) -> list[Trial]:
    """Identification task of each scene."""
    return [Trial(scene, scene.readings(HARD), HARD, threads) for scene in (make() for make in SCENES)]


def _own(count: int, threads: int) -> list[Row]:
    """Rows of `count` repetitions for stepper with hard contact and white noise, for each scene and each initial value of the search."""
    return [
        Row(f"{t.scene.name}, from {start[0]:g} kg and {start[1]:g}", t.scene.truth, partial(t.once, start), count, first=k * count)
        for t in _trials(threads)
        for k, start in enumerate(t.scene.starts)
    ]


def _coloured(count: int, threads: int) -> list[Row]:
    """Rows of `count` repetitions for readings with noise that is correlated in time."""
    return [
        Row(
            f"{t.scene.name}, noise of autocorrelation {COLOUR:g}", t.scene.truth, partial(t.once, t.scene.starts[0], colour=COLOUR), count
        )
        for t in _trials(threads)
    ]  # fmt: skip


def _with_peer(count: int, threads: int) -> list[Row]:
    """Rows of `count` repetitions that compare stepper with mujoco.sysid.

    MuJoCo simulates the motion, and both libraries identify the parameters: stepper with MuJoCo's contact law, and mujoco.sysid.
    """
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
    """Compute the tables of the identification benchmark, and print or write them."""
    parser = argparse.ArgumentParser(prog="python -m identification", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="number of repetitions from each start [100]")
    parser.add_argument("--count-peer", type=int, default=10, help="number of repetitions in the comparison with mujoco.sysid [10]")
    parser.add_argument("--count-online", type=int, default=25, help="number of online runs of each kind [25]")
    parser.add_argument("--count-impacts", type=int, default=200, help="number of online runs of each scene with impacts [200]")
    parser.add_argument("--count-determined", type=int, default=200, help="number of runs of each scene that is determined in part [200]")
    parser.add_argument("--threads", type=int, default=0, help="number of threads of stepper; 0 uses all cores [0]")
    parser.add_argument(
        "--only", choices=["own", "coloured", "determined", "peer", "online", "impacts", "matched"], help="compute one table only [all]"
    )
    parser.add_argument("--resume", action="store_true", help=f"reuse the repetitions of an earlier run in {OUT}")
    parser.add_argument("--update-docs", action="store_true", help=f"write the tables into {PAGE.name}")
    given = parser.parse_args()
    about = provenance()
    print(f"{about['cpu']}, {about['cores']} cores, load {about['load_average']}")

    def kept(name: str) -> Kept:
        return Kept(OUT / f"{name}.jsonl", given.resume)

    makers: dict[str, Callable[[], Table]] = {
        "own": lambda: _table(_own(given.count, given.threads), kept("own")),
        "coloured": lambda: _table(_coloured(given.count, given.threads), kept("coloured")),
        "determined": lambda: determined.table(given.count_determined, kept("determined")),
        "online": lambda: online.table(given.count_online),
        "impacts": lambda: strikes.table(given.count_impacts),
        "matched": lambda: strikes.table(given.count_impacts, strikes.follow_matched),
        "peer": lambda: _table(_with_peer(given.count_peer, given.threads), kept("peer")),
    }
    names = list(makers) if given.only is None else [given.only]
    if "peer" in names and (missing := sysid.available()):
        print(f"skipped the comparison with mujoco.sysid: {missing}")
        names.remove("peer")
    tables = {name: makers[name]() for name in names}
    if given.update_docs:
        for name, table in tables.items():
            write_section(PAGE, name, str(table))
        print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()

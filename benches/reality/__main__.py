"""Engines against measurements of real motions (`make reality`). The tables are those of docs/benchmarks/reality.md."""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from reality import pendulum, report, tosses


def main() -> None:
    """Fit engines to one half of each data set, predict the other half, and write the results."""
    parser = argparse.ArgumentParser(prog="python -m reality", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder with the data sets, a subfolder each")
    parser.add_argument("--engine", nargs="+", default=[], metavar="NAME", help="engines with one of these texts in their name [all]")
    parser.add_argument("--set", nargs="+", default=[], choices=report.SETS, help="data sets [all]")
    parser.add_argument("--out", type=Path, default=Path("out/reality"), help="folder of the results, a file per engine [out/reality]")
    parser.add_argument(
        "--update-docs", action="store_true", help="write the results in --out to docs/benchmarks/reality*.csv and reality.png"
    )
    parser.add_argument("--pairs", action="store_true", help="compare engines with published parameters pairwise: reality_pairs.csv")
    given = parser.parse_args()
    if given.update_docs:
        report.update_docs(given.out)
        return
    if given.data is None:
        parser.error("no data: give the folder that has cube_toss/cube_toss.npz with --data (make reality DATA=FOLDER)")
    if given.pairs:
        print(report.update_pairs(given.data))
        return

    runs: list[tuple[str, Any, Callable[[Any, Path], Iterator[dict[str, Any]]]]] = [
        *((own.name, engine, partial(tosses.measured, experiment=own)) for own in tosses.EXPERIMENTS for engine in own.made_engines()),
        *(("multiarm_pendulum", engine, pendulum.measured) for engine in pendulum.ENGINES),
    ]
    chosen = [
        run
        for run in runs
        if (not given.set or run[0] in given.set) and (not given.engine or any(text in run[1].name for text in given.engine))
    ]
    if not chosen:
        parser.error(f"no engine matches {given.engine}: give parts of names in the tables of docs/benchmarks/reality.md")
    for name, engine, measured in chosen:
        print(report.write_rows(given.out / f"{name} {engine.name}.csv", list(measured(engine, given.data))), flush=True)


if __name__ == "__main__":
    main()

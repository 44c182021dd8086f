"""Engines against measurements of real motions (`make reality`). The tables are those of docs/benchmarks/reality.md."""

import argparse
from pathlib import Path

from stepper.shared.files import write_csv

from reality import cube, report
from reality.engines import engines


def main() -> None:
    """Fit engines to one half of each data set, predict the other half, and write the results."""
    parser = argparse.ArgumentParser(prog="python -m reality", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder with the data sets, a subfolder each")
    parser.add_argument("--engine", nargs="+", default=[], metavar="NAME", help="engines with one of these texts in their name [all]")
    parser.add_argument("--out", type=Path, default=Path("out/reality"), help="folder of the results, a file per engine [out/reality]")
    parser.add_argument("--update-docs", action="store_true", help="write the results in --out to docs/benchmarks/reality.csv and .png")
    given = parser.parse_args()
    if given.update_docs:
        report.update_docs(given.out)
        return
    if given.data is None:
        parser.error("no data: give the folder that has cube_toss/cube_toss.npz with --data (make reality DATA=FOLDER)")
    chosen = [e for e in engines() if not given.engine or any(text in e.name for text in given.engine)]
    if not chosen:
        parser.error(f"no engine matches {given.engine}: give parts of " + ", ".join(e.name for e in engines()))
    for engine in chosen:
        rows = [row for nuisances in (False, True) for row in cube.measured(engine, given.data, nuisances=nuisances)]
        print(write_csv(given.out / f"cube_toss {engine.name}.csv", [rows[0], *(row.values() for row in rows)]), flush=True)


if __name__ == "__main__":
    main()

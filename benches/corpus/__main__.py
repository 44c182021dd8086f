"""Comparison of stepper with MuJoCo on all robot models of some Python packages: `python -m corpus`.

The command measures the model files that have no measurement of this build yet. It writes the page corpus.md and the measurements
corpus.csv. Both files are in out/corpus, or in docs/benchmarks with --update-docs.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from rows import read_csv, write_csv
from stepper.shared.machine import provenance

from corpus import judge
from corpus.packages import PACKAGES
from corpus.report import write_markdown
from corpus.row import MEASURED, Row
from corpus.sweep import Sweep

PAGES = Path("docs/benchmarks")
"""Folder of the page corpus.md, and of corpus.csv, the measurements from which the page is made."""


def main() -> None:
    """Measure the models of the corpus that have no measurement of this build yet, and write the report."""
    parser = argparse.ArgumentParser(prog="corpus", description=__doc__)
    parser.add_argument("--package", action="append", choices=[p.name for p in PACKAGES], help="package to measure; may be repeated [all]")
    parser.add_argument("--only", default="", metavar="SUBSTRING", help="measure only files with this in their path")
    parser.add_argument("--workers", type=int, default=2, help="number of parallel processes [2]")
    parser.add_argument("--limit", type=float, default=300.0, help="largest wall time for a file, s [300]")
    parser.add_argument("--again", action="store_true", help="also repeat measurements that exist for this build of stepper")
    parser.add_argument("--from-csv", action="store_true", help="write the report from corpus.csv, without measuring")
    parser.add_argument("--out", type=Path, default=Path("out/corpus"), help="folder for the report [out/corpus]")
    parser.add_argument("--update-docs", action="store_true", help=f"write into {PAGES} instead of --out")
    parser.add_argument("--cache", type=Path, default=Path("out/corpus"), help="folder of the downloaded packages [out/corpus]")
    args = parser.parse_args()
    if args.update_docs:
        args.out = PAGES
    args.out.mkdir(parents=True, exist_ok=True)
    data = args.out / "corpus.csv"
    rows, notes = read_csv(data, Row)
    sweep = Sweep(args.cache.resolve(), args.workers, args.limit, args.only, args.again, {row.key: row for row in rows})
    if not args.from_csv:
        notes = provenance()

        def keep(row: Row) -> None:
            _print_row(row)
            write_csv(data, _ordered(sweep.rows.values()), notes)

        sweep.run([p for p in PACKAGES if not args.package or p.name in args.package], keep)
    write_markdown(args.out / "corpus.md", _ordered(sweep.rows.values()), notes)


def _ordered(rows: Iterable[Row]) -> list[Row]:
    """Sort measurements (rows) by package in the order of `PACKAGES`, then by file. Rows of other packages or versions are left out."""
    places = {(p.name, p.version): i for i, p in enumerate(PACKAGES)}
    return sorted((r for r in rows if (r.package, r.version) in places), key=lambda r: (places[r.package, r.version], r.file))


def _print_row(row: Row) -> None:
    """Print the result of measuring a model file to stderr."""
    text = "; ".join(map(str, judge.faults(row))) or "steps well" if row.outcome == MEASURED else f"{row.outcome} {row.note}"
    sys.stderr.write(f"{row.package:24} {row.file:60} {text}\n")


if __name__ == "__main__":
    main()

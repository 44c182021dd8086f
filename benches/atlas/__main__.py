"""Sweep of the failure atlas: `python -m atlas` writes atlas.md with the pages of its groups, atlas.png and atlas.csv into out/atlas.

A sweep runs scenes in engines. With --update-docs, a sweep of all scenes and engines replaces the page in docs/benchmarks. With --add too,
a sweep of some scenes or engines replaces only their rows in that page.
"""

import argparse
import sys
import time
from pathlib import Path

from rows import read_csv, write_csv
from stepper.shared.machine import one_core, provenance

from atlas import scenes
from atlas.engines import peers, stepper_engines
from atlas.picture import draw
from atlas.report import write_markdown
from atlas.run import Row, sweep
from atlas.world import World

PAGES = Path("docs/benchmarks")
"""Folder of the page atlas.md, its figure atlas.png, and atlas.csv, the results from which the page is made."""


def main() -> None:
    """Run the sweep of scenes and engines, and write the report of the failure atlas."""
    parser = argparse.ArgumentParser(prog="atlas", description=__doc__)
    numbers = list(dict.fromkeys(s.number for s in scenes.ALL))
    parser.add_argument(
        "scenes", nargs="*", choices=[*numbers, []], metavar="scene", help=f"number of a scene, one of {', '.join(numbers)} [all]"
    )
    parser.add_argument("--out", type=Path, default=Path("out/atlas"), help="folder for the report [out/atlas]")
    parser.add_argument("--limit", type=float, default=10.0, help="largest processor time of one run, s [10]")
    parser.add_argument("--ours", action="store_true", help="run stepper without the other engines")
    parser.add_argument("--add", action="store_true", help="with --update-docs: replace these rows and keep all others")
    parser.add_argument("--update-docs", action="store_true", help=f"write into {PAGES} instead of --out")
    parser.add_argument("--from-csv", action="store_true", help="write the report from atlas.csv, without running scenes")
    args = parser.parse_args()
    chosen = [s for s in scenes.ALL if not args.scenes or s.number in args.scenes]
    if args.update_docs and (args.scenes or args.ours) and not args.add:
        parser.error("--update-docs with some scenes or engines would drop the rows of all others; give --add, which keeps them")
    out = PAGES if args.update_docs else args.out
    out.mkdir(parents=True, exist_ok=True)
    data = out / "atlas.csv"
    if args.from_csv:
        rows, notes = read_csv(data, Row)
    else:
        World.limit = args.limit
        begin = time.monotonic()
        engines = [*stepper_engines(), *([] if args.ours else peers())]
        with one_core():
            rows = sweep(chosen, engines, _print_row)
        notes = provenance() | {"seconds": round(time.monotonic() - begin)}
        if args.add:
            rows, notes = _added(rows, notes, data)
        write_csv(data, rows, notes)
    groups = {
        name: (title, [s for s in scenes.ALL if any(s in topic.SCENES for topic in topics)])
        for name, (title, topics) in scenes.GROUPS.items()
    }
    write_markdown(out, groups, rows, notes)
    draw(out / "atlas.png", rows)


def _added(rows: list[Row], notes: dict[str, object], data: Path) -> tuple[list[Row], dict[str, object]]:
    """Rows and notes of the existing report with new rows added. A new row replaces old rows with the same scene number and engine."""
    kept, before = read_csv(data, Row)
    renewed = {(row.number, row.engine) for row in rows}
    numbers = [scene.number for scene in scenes.ALL]
    merged = [*(row for row in kept if (row.number, row.engine) not in renewed), *rows]
    merged.sort(key=lambda row: numbers.index(row.number))
    added = f"scenes {', '.join(dict.fromkeys(row.number for row in rows))}: {notes['utc']}, {notes['cpu']}, {notes['seconds']} s"
    earlier = before.get("added")
    return merged, before | {"added": f"{earlier}; {added}" if earlier else added}


def _print_row(row: Row) -> None:
    """Print the result of a scene in an engine at a time step to stderr."""
    sys.stderr.write(f"{row.number:>3} {row.name:45} {row.dt:7.0e} {row.engine:24} {row.outcome:10} {row.error:9.2e}\n")


if __name__ == "__main__":
    main()

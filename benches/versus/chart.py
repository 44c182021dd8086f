"""Speed against accuracy at full effort: writes chart-SCENE.png and chart-SCENE.csv."""

from __future__ import annotations

import argparse
from pathlib import Path

from stepper.experiments.chart import SCENES, Effort, charts
from stepper.experiments.progress import progress, show_files


def main() -> None:
    """Reads the arguments and draws."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help=f"of {', '.join(SCENES)}; default: all")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder; default: out")
    parser.add_argument("--repeats", type=int, default=Effort().repeats, help="timed rounds over all cases")
    parser.add_argument("--seconds", type=float, default=Effort().seconds, help="least time of a case in a round, s")
    args = parser.parse_args()
    unknown = sorted(set(args.scenes) - set(SCENES))
    if unknown:
        parser.error(f"no such scene: {', '.join(unknown)}; there are: {', '.join(SCENES)}")
    with progress() as tick:
        pictures = charts(args.scenes, args.out, Effort(repeats=args.repeats, seconds=args.seconds), tick)
    show_files(pictures)


if __name__ == "__main__":
    main()

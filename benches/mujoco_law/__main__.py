"""One step of MuJoCo's contact law in stepper and in MuJoCo, model by model.

`--update-docs` replaces the table of docs/benchmarks/mujoco_law.md and its csv.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import mujoco
import stepper

from mujoco_law.models import Source, sources
from mujoco_law.parity import compare, prepare, states
from mujoco_law.report import Row, write_csv, write_table

PAGES = Path("docs/benchmarks")
"""Folder of the page mujoco_law.md with its rows."""


def main() -> None:
    """Reads the arguments, measures, writes."""
    parser = argparse.ArgumentParser(prog="mujoco_law", description=__doc__)
    parser.add_argument(
        "--only", action="append", default=[], metavar="SUBSTRING", help="models with this in their name; may be given again"
    )
    parser.add_argument("--states", type=int, default=100, help="states of each model; default: 100")
    parser.add_argument("--integrator", choices=("euler", "implicitfast", "implicit", "discrete", "rk4"), help="instead of the model's own")
    parser.add_argument("--cone", choices=("pyramidal", "elliptic"), help="instead of the model's own")
    parser.add_argument("--noslip", type=int, metavar="SWEEPS", help="sweeps that take the slip out of friction at the most; default: none")
    parser.add_argument("--out", type=Path, help="folder of mujoco_law.csv")
    parser.add_argument("--update-docs", action="store_true", help=f"write the csv and the table of the page into {PAGES}")
    args = parser.parse_args()
    rows = []
    for source in sources(args.only):
        row = _measure(source, args)
        rows.append(row)
        sys.stderr.write(f"{row}\n")
    if args.out:
        write_csv(args.out / "mujoco_law.csv", rows)
    if args.update_docs:
        write_csv(PAGES / "mujoco_law.csv", rows)
        write_table(PAGES / "mujoco_law.md", rows)


def _measure(source: Source, args: argparse.Namespace) -> Row:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            compiled = mujoco.MjModel.from_xml_path(str(source.path))
            prepare(compiled)
            if args.integrator:
                name = args.integrator.upper()
                compiled.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name}")
            if args.noslip:
                compiled.opt.noslip_iterations = args.noslip
            if args.cone:
                compiled.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{args.cone.upper()}")
            model = stepper.load(compiled, strict=False)
        left_out = sorted({str(o[0]) for o in model.omitted if o[-1]})
        return Row(source.name, model.nv, ", ".join(left_out), compare(model, states(compiled, args.states)))
    except (ValueError, stepper.ModelError) as error:
        return Row(source.name, 0, " ".join(str(error).split())[:200], None)


if __name__ == "__main__":
    main()

"""Comparison of one step with MuJoCo's contact law in stepper and in MuJoCo, for each model.

`--update-docs` replaces the table of docs/benchmarks/mujoco_law.md and its CSV file.
"""

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
"""Folder of the page mujoco_law.md, and of mujoco_law.csv, the results in the page's table."""


def main() -> None:
    """Compare single steps of stepper and MuJoCo for all models, and write the results."""
    parser = argparse.ArgumentParser(prog="mujoco_law", description=__doc__)
    parser.add_argument(
        "--only", action="append", default=[], metavar="SUBSTRING", help="compare only models with this in their name; may be repeated"
    )
    parser.add_argument("--states", type=int, default=100, help="number of states of each model [100]")
    parser.add_argument("--integrator", choices=("euler", "implicitfast", "implicit", "rk4"), help="integrator [that of the model]")
    parser.add_argument("--cone", choices=("pyramidal", "elliptic"), help="friction cone [that of the model]")
    parser.add_argument("--noslip", type=int, metavar="ITERATIONS", help="iterations of MuJoCo's noslip solver [0]")
    parser.add_argument("--out", type=Path, help="folder for mujoco_law.csv")
    parser.add_argument("--update-docs", action="store_true", help=f"write the CSV file and the table of the page in {PAGES}")
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
    """Compare one model in stepper and in MuJoCo. Returns the result as a row of the table."""
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

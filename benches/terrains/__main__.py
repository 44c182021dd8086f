"""Step time of a quadruped on terrain: `python -m terrains` measures all grounds in stepper and in MuJoCo and prints a table."""

import argparse
import json
from pathlib import Path

from many_contacts.measure import Plan
from stepper.shared.machine import provenance, require

from terrains.grounds import GROUNDS
from terrains.measure import measured
from terrains.report import steps, times, update_page


def main() -> None:
    """Measure the step times on all grounds, and print the tables."""
    parser = argparse.ArgumentParser(prog="terrains", description=__doc__)
    parser.add_argument("--ground", nargs="+", default=[], metavar="NAME", help="grounds with one of these texts in their name [all]")
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--peers", type=int, default=64, help="number of environments in MuJoCo; 0 omits MuJoCo [64]")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--noise", type=float, default=1.0, help="standard deviation of the actions; 0 is standing [1]")
    parser.add_argument("--no-law", action="store_true", help="do not measure MuJoCo's contact law")
    parser.add_argument("--out", type=Path, default=Path("out/terrains"), help="folder for the models and terrains.json [out/terrains]")
    parser.add_argument("--cache", type=Path, default=Path("out/corpus"), help="folder of the downloaded packages [out/corpus]")
    parser.add_argument("--update-docs", action="store_true", help="write the tables into docs/benchmarks/terrain.md")
    args = parser.parse_args()
    grounds = [g for g in GROUNDS if not args.ground or any(part in g.name for part in args.ground)]
    if not grounds:
        parser.error(f"no ground matches {args.ground}: give parts of " + ", ".join(g.name for g in GROUNDS))
    require("mujoco", "to compare stepper with MuJoCo").set_mju_user_warning(lambda message: None)
    settings = ("default",) if args.no_law else ("default", "law")
    plan = Plan(args.num_envs, args.peers, settings=settings, rounds=args.rounds, patience=float("inf"))
    rows = []
    for ground in grounds:
        rows.append(measured(ground, plan, args.steps, args.noise, cache=args.cache, out=args.out))
        print(times(rows[-1:]).splitlines()[-1], flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    came_from = provenance()
    (args.out / "terrains.json").write_text(json.dumps({"rows": rows, "provenance": came_from}, indent=1) + "\n", encoding="utf-8")
    print(f"{times(rows)}\n\n{steps(rows)}")
    if args.update_docs:
        update_page(rows, came_from)


if __name__ == "__main__":
    main()

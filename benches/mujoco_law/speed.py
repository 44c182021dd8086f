"""Speed of MuJoCo's contact law with the integrator and cone of the model, compared with `mujoco.batch`, in turns on one core."""

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import geometric_mean, median
from typing import Any

from comparison.throughput import Case, cases, ratio
from many_contacts.targets import grouped_mean
from stepper import Options
from stepper.lab.demo.race import Plan, race
from stepper.lab.engines import EngineBatch, MujocoBatch, MujocoEngine, StepperBatch
from stepper.shared.machine import one_core, provenance, require


@dataclass(frozen=True)
class Newton(MujocoEngine):
    """Engine MuJoCo with the integrator and cone of the model, and with Newton's solver, which is the fastest solver on most models."""

    def configure(self, mujoco: Any, model: Any) -> None:
        """Write the settings into a compiled model."""
        model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON


def main() -> None:
    """Measure the speed of MuJoCo's contact law in stepper for all models, and print the table."""
    parser = argparse.ArgumentParser(prog="mujoco_law.speed", description=__doc__)
    parser.add_argument("models", nargs="*", help="parts of the names of models [all]")
    parser.add_argument("--num-envs", type=int, default=256, help="number of environments in stepper [256]")
    parser.add_argument("--peers", type=int, default=64, help="number of environments in MuJoCo [64]")
    parser.add_argument("--steps", type=int, default=200, help="number of steps with random controls [200]")
    parser.add_argument(
        "--many-contacts",
        type=Path,
        metavar="JSON",
        help="print the table from a result file of `many_contacts --settings law`, without measuring",
    )
    args = parser.parse_args()
    if args.many_contacts:
        print(many_contacts(args.many_contacts))
        return
    plan = Plan(num_envs=args.num_envs, peers=args.peers, steps=args.steps, rest=0)
    require("mujoco", "to compare stepper with MuJoCo").set_mju_user_warning(lambda message: None)
    found = []
    print("| model | integrator | us f64 | us f32 | us MuJoCo own / Newton | f64 x | f32 x | residual m/s f64 / f32 | Newton steps |")
    print("|---|---|---|---|---|---|---|---|---|")
    for case in cases(plan, args.models):
        if isinstance(case, str):
            print(f"skipped {case}")
            continue
        found.append(_measure(case, plan))
    means = [geometric_mean(f[k] for f in found) for k in (0, 1)]
    print(f"| **geometric mean** | | | | | **{means[0]:.1f}** | **{means[1]:.1f}** | | |")
    print(", ".join(f"{key} {value}" for key, value in provenance().items() if key in ("cpu", "load_average", "versions")))


def many_contacts(path: Path) -> str:
    """Table of the scenes with many contacts, from a result file of `many_contacts --settings law`."""
    rows = [row for row in json.loads(path.read_text(encoding="utf-8"))["rows"] if row["ours"]]
    lines = ["| scene | f64 x | f32 x | unsolved % f64 / f32 | Newton steps |", "|---|---|---|---|---|"]
    for row in rows:
        f64, f32 = (row["ours"][f"{precision} law"] for precision in ("f64", "f32"))
        unsolved = " / ".join(f"{100 * ours['unsolved']:.2g}" for ours in (f64, f32))
        lines.append(f"| {row['row']} | **{f64['ratio']:.1f}** | **{f32['ratio']:.1f}** | {unsolved} | {f64['newton_steps']:.1f} |")
    means = [grouped_mean((row["group"], row["ours"][f"{precision} law"]["ratio"]) for row in rows) or 0.0 for precision in ("f64", "f32")]
    return "\n".join([*lines, f"| **geometric mean over scenes** | **{means[0]:.1f}** | **{means[1]:.1f}** | | |"])


def _measure(case: Case, plan: Plan) -> tuple[float, float]:
    """Speedups of stepper over MuJoCo on a model, in f64 and f32."""
    options = Options.from_model(case.model)
    with one_core():
        ours = [StepperBatch(case.model, plan.num_envs, precision=p, threads=1, options=options, setting="law") for p in ("f64", "f32")]
        theirs: list[EngineBatch] = [
            MujocoBatch.from_file(case.path, plan.num_peers, threads=1),
            MujocoBatch.from_file(case.path, plan.num_peers, threads=1, settings=Newton("Newton")),
        ]
        tracks = race([*ours, *theirs], case.control, plan, clock=time.process_time, progress=lambda *_: None, what=case.name, referee=None)
    times = {name: track.times["control"] for name, track in tracks.items()}
    names = list(times)
    ratios = [min(ratio(times[name], times[peer]) for peer in names[2:]) for name in names[:2]]
    us = [median(times[name]) for name in names]
    residual = [batch.solver_statistics["control"].worst_residual for batch in ours]
    steps = float(ours[0].sim.newton_steps.mean())
    print(
        f"| {case.name} | {options.integrator} | {us[0]:.2f} | {us[1]:.2f} | {us[2]:.1f} / {us[3]:.1f} | **{ratios[0]:.1f}** |"
        f" **{ratios[1]:.1f}** | {residual[0]:.0e} / {residual[1]:.0e} | {steps:.1f} |",
        flush=True,
    )
    return ratios[0], ratios[1]


if __name__ == "__main__":
    main()

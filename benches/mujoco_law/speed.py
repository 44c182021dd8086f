"""Speed of MuJoCo's contact law with the integrator and cone of the model, compared with `mujoco.batch`, in turns on one core."""

import argparse
import time
from statistics import geometric_mean, median

from comparison.throughput import Case, cases, ratio
from sections import Table
from stepper import Options
from stepper.lab.demo.race import Plan, race
from stepper.lab.engines import EngineBatch, MujocoBatch, MujocoEngine, StepperBatch
from stepper.shared.machine import one_core, provenance, require

NEWTON = MujocoEngine("Newton", {"solver": "newton"})
"""Settings of MuJoCo with the integrator and cone of the model, and with Newton's solver, which is the fastest solver on most models."""


def main() -> None:
    """Measure the speed of MuJoCo's contact law in stepper for all models, and print the table."""
    parser = argparse.ArgumentParser(prog="mujoco_law.speed", description=__doc__)
    parser.add_argument("models", nargs="*", help="parts of the names of models [all]")
    parser.add_argument("--num-envs", type=int, default=256, help="number of environments in stepper [256]")
    parser.add_argument("--peers", type=int, default=64, help="number of environments in MuJoCo [64]")
    parser.add_argument("--steps", type=int, default=200, help="number of steps with random controls [200]")
    args = parser.parse_args()
    plan = Plan(num_envs=args.num_envs, peers=args.peers, steps=args.steps, rest=0)
    require("mujoco", "to compare stepper with MuJoCo").set_mju_user_warning(lambda message: None)
    found = []
    head = ("us f64", "us f32", "us MuJoCo own / Newton", "f64 x", "f32 x", "residual m/s f64 / f32", "Newton steps")
    table = Table("model", "integrator", *head)
    for case in cases(plan, args.models):
        if isinstance(case, str):
            print(f"skipped {case}")
            continue
        found.append(_measure(case, plan, table))
    means = [geometric_mean(f[k] for f in found) for k in (0, 1)]
    table.add("**geometric mean**", "", "", "", "", *(f"**{mean:.1f}**" for mean in means), "", "")
    print(", ".join(f"{key} {value}" for key, value in provenance().items() if key in ("cpu", "load_average", "versions")))


def _measure(case: Case, plan: Plan, table: Table) -> tuple[float, float]:
    """Speedups of stepper over MuJoCo on a model, in f64 and f32, of which a row is added to the table."""
    options = Options.from_model(case.model)
    with one_core():
        ours = [StepperBatch(case.model, plan.num_envs, precision=p, threads=1, options=options, setting="law") for p in ("f64", "f32")]
        theirs: list[EngineBatch] = [
            MujocoBatch.from_file(case.path, plan.num_peers, threads=1),
            MujocoBatch.from_file(case.path, plan.num_peers, threads=1, settings=NEWTON),
        ]
        tracks = race([*ours, *theirs], case.control, plan, clock=time.process_time, progress=lambda *_: None, what=case.name, referee=None)
    times = {name: track.times["control"] for name, track in tracks.items()}
    names = list(times)
    ratios = [min(ratio(times[name], times[peer]) for peer in names[2:]) for name in names[:2]]
    us = [median(times[name]) for name in names]
    residual = [batch.solver_statistics["control"].worst_residual for batch in ours]
    steps = float(ours[0].sim.newton_steps.mean())
    cells = (f"{us[0]:.2f}", f"{us[1]:.2f}", f"{us[2]:.1f} / {us[3]:.1f}", *(f"**{speedup:.1f}**" for speedup in ratios))
    table.add(case.name, options.integrator, *cells, f"{residual[0]:.0e} / {residual[1]:.0e}", f"{steps:.1f}")
    return ratios[0], ratios[1]


if __name__ == "__main__":
    main()

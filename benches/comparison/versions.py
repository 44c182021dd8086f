"""Step times of two builds of stepper for common training robots, in turns on one core.

Each build runs in a separate process, which imports the package from a given folder: `python/` of a checkout after `maturin develop`, or an
unpacked wheel. Both get the same random controls. The results are medians of processor time over the turns. The processes run
with old builds too, as they use only features that the first version had.

    python benches/comparison/versions.py old/python new/python
    python benches/comparison/versions.py old/python new/python --integrator euler --num-envs 1024 --precision f32
"""

import argparse
import json
import os
import subprocess
import sys
import time
import warnings
from importlib.util import find_spec
from pathlib import Path
from statistics import geometric_mean, median
from typing import Any

import numpy as np
from stepper import Options, Stepper, load

MODELS = (
    *(("gymnasium", f"envs/mujoco/assets/{name}.xml") for name in ("ant", "humanoid", "half_cheetah", "hopper", "walker2d_v5")),
    *(("dm_control", f"suite/{name}.xml") for name in ("humanoid", "quadruped", "humanoid_CMU", "cheetah", "walker")),
    ("robosuite", "models/assets/robots/panda/robot.xml"),
    ("gymnasium_robotics", "envs/assets/hand/reach.xml"),
)
"""Packages and files of the robots of throughput.py. Robots that are not installed are skipped, with a message."""
WARM_UP, STEPS = 50, 150
"""Numbers of steps of each measurement: steps before the time is taken, and timed steps."""


def main() -> None:
    """Print a markdown table with the step times of two builds for each robot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("builds", nargs="*", metavar="FOLDER", help="two folders with the package `stepper`: before and after")
    parser.add_argument("--integrator", default="", help="integrator [default of each build]")
    parser.add_argument("--precision", default="f64", choices=("f64", "f32"))
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        answer(given.integrator, given.precision, given.num_envs)
        return
    if len(given.builds) != 2 or not all((Path(folder) / "stepper/__init__.py").is_file() for folder in given.builds):
        parser.error(f"folders are {given.builds}: give two folders with the package stepper")
    workers = []
    for folder in given.builds:
        environment = os.environ | {"PYTHONPATH": str(Path(folder).resolve())}
        command = [sys.executable, __file__, "--worker", *sys.argv[1:]]
        workers.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment))
    print("| robot | before, us | after, us | ratio |\n|---|---|---|---|")
    ratios = []
    for package, file in MODELS:
        found = find_spec(package)
        if found is None or found.origin is None:
            print(f"skipped {file}: {package} is not installed", file=sys.stderr)
            continue
        times: list[list[float]] = [[], []]
        for turn in range(given.turns):
            for k in (0, 1) if turn % 2 else (1, 0):
                times[k].append(ask(workers[k], str(Path(found.origin).parent / file), turn))
        ratio = median(after / before for before, after in zip(*times, strict=True))
        ratios.append(ratio)
        print(f"| {package}/{Path(file).stem} | {median(times[0]):.2f} | {median(times[1]):.2f} | {ratio:.2f} |", flush=True)
    print(f"| geometric mean | | | {geometric_mean(ratios):.2f} |")


def ask(worker: subprocess.Popen[str], path: str, seed: int) -> float:
    """Step time per environment, us, that the worker process of a build of stepper measures on request."""
    assert worker.stdin is not None and worker.stdout is not None
    print(json.dumps([path, seed]), file=worker.stdin, flush=True)
    reply = worker.stdout.readline()
    if not reply:
        raise SystemExit(f"the process of a build exited at {path}: see its error message above")
    return float(reply)


def answer(integrator: str, precision: Any, num_envs: int) -> None:
    """Answer requests of `ask` until standard input ends, with the build of stepper that this process has imported."""
    warnings.simplefilter("ignore")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    settings: dict[str, Any] = {"integrator": integrator} if integrator else {}
    sims = {}
    for line in sys.stdin:
        path, seed = json.loads(line)
        if path not in sims:
            model = load(path, strict=False)
            sims[path] = (model, Stepper(model, num_envs, options=Options(**settings), precision=precision, threads=1))
        model, sim = sims[path]
        low, high = np.nan_to_num(np.asarray(model.actuator_ctrlrange), neginf=-1.0, posinf=1.0).T
        controls = np.random.default_rng(seed).uniform(low, high, (WARM_UP + STEPS, num_envs, len(low)))
        sim.reset()
        for control in controls[:WARM_UP]:
            sim.step(control)
        begin = time.process_time()
        for control in controls[WARM_UP:]:
            sim.step(control)
        print((time.process_time() - begin) / STEPS / num_envs * 1e6, flush=True)


if __name__ == "__main__":
    main()

"""Step times of two builds of stepper for common training robots, in turns on one core.

Each build runs in a separate process, which imports the package from a given folder: `python/` of a checkout after `maturin develop`, or an
unpacked wheel. Both get the same random controls. The results are medians of processor time over the turns.

    python benches/comparison/versions.py old/python new/python
    python benches/comparison/versions.py old/python new/python --integrator euler --num-envs 1024 --precision f32
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import geometric_mean, median

from stepper.shared.machine import MissingPackageError, package_file

MODELS = (
    *(("gymnasium", f"envs/mujoco/assets/{name}.xml") for name in ("ant", "humanoid", "half_cheetah", "hopper", "walker2d_v5")),
    *(("dm_control", f"suite/{name}.xml") for name in ("humanoid", "quadruped", "humanoid_CMU", "cheetah", "walker")),
    ("robosuite", "models/assets/robots/panda/robot.xml"),
    ("gymnasium_robotics", "envs/assets/hand/reach.xml"),
)
"""Packages and files of the robots of throughput.py. Robots that are not installed are skipped, with a message."""


def main() -> None:
    """Print a markdown table with the step times of two builds for each robot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("builds", nargs="*", metavar="FOLDER", help="two folders with the package `stepper`: before and after")
    parser.add_argument("--integrator", default="", help="integrator [default of each build]")
    parser.add_argument("--precision", default="f64", choices=("f64", "f32"))
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--turns", type=int, default=5)
    given = parser.parse_args()
    if len(given.builds) != 2 or not all((Path(folder) / "stepper/__init__.py").is_file() for folder in given.builds):
        parser.error(f"folders are {given.builds}: give two folders with the package stepper")
    worker = str(Path(__file__).with_name("step_times.py"))
    workers = []
    for folder in given.builds:
        environment = os.environ | {"PYTHONPATH": str(Path(folder).resolve())}
        command = [sys.executable, worker, given.integrator or "default", given.precision, str(given.num_envs)]
        workers.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment))
    print("| robot | before, us | after, us | ratio |\n|---|---|---|---|")
    ratios = []
    for package, file in MODELS:
        try:
            path = str(package_file(package, file, "to step its robots"))
        except MissingPackageError as error:
            print(f"skipped {file}: {error}", file=sys.stderr)
            continue
        times: list[list[float]] = [[], []]
        for turn in range(given.turns):
            for k in (0, 1) if turn % 2 else (1, 0):
                times[k].append(ask(workers[k], path, turn))
        ratio = median(after / before for before, after in zip(*times, strict=True))
        ratios.append(ratio)
        print(f"| {package}/{Path(file).stem} | {median(times[0]):.2f} | {median(times[1]):.2f} | {ratio:.2f} |", flush=True)
    print(f"| geometric mean | | | {geometric_mean(ratios):.2f} |")


def ask(worker: subprocess.Popen[str], path: str, seed: int) -> float:
    """Step time per environment, us, that the worker process of a build of stepper measures on request."""
    assert worker.stdin is not None and worker.stdout is not None
    print(json.dumps([path, seed]), file=worker.stdin, flush=True)
    answer = worker.stdout.readline()
    if not answer:
        raise SystemExit(f"the process of a build exited at {path}: see its error message above")
    return float(answer)


if __name__ == "__main__":
    main()

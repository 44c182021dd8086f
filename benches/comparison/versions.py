"""Step times of two builds of stepper for common training robots, or for scenes with many contacts, in turns on one core.

Each build runs in a separate process, which imports the package from a given folder: `python/` of a checkout after `maturin develop`, or an
unpacked wheel. Both get the same random controls. The results are medians of processor time over the turns. The processes run
with old builds too, as they use only features that the first version had.

    python benches/comparison/versions.py old/python new/python
    python benches/comparison/versions.py old/python new/python --integrator euler --num-envs 1024 --precision f32
    python benches/comparison/versions.py old/python new/python --scene wall "heap of thirty" --num-envs 32
"""

import argparse
import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from statistics import geometric_mean, median
from typing import Any

import numpy as np
from stepper import Options, Stepper, load

BENCHES = Path(__file__).parents[1]
"""Folder of the benches, from which worker processes import `many_contacts`."""
WARM_UP, STEPS = 50, 150
"""Numbers of steps of each measurement: steps before the time is taken, and timed steps."""


def main() -> None:
    """Print a markdown table with the step times of two builds for each robot, or for each phase of scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("builds", nargs="*", metavar="FOLDER", help="two folders with the package `stepper`: before and after")
    parser.add_argument("--integrator", default="", help="integrator [default of each build]")
    parser.add_argument("--precision", default="f64", choices=("f64", "f32"))
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--scene", nargs="+", metavar="NAME", help="scenes of `python -m many_contacts --list`, in place of robots")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        answer(given.integrator, given.precision, given.num_envs, scenes=given.scene is not None)
        return
    if len(given.builds) != 2 or not all((Path(folder) / "stepper/__init__.py").is_file() for folder in given.builds):
        parser.error(f"folders are {given.builds}: give two folders with the package stepper")
    workers = []
    for folder in given.builds:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(Path(folder).resolve()), str(BENCHES)))}
        command = [sys.executable, __file__, "--worker", *sys.argv[1:]]
        workers.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment))
    print("| robot or phase | before, us | after, us | ratio |\n|---|---|---|---|")
    ratios = []
    for request in given.scene or robots():
        times: list[list[dict[str, float]]] = [[], []]
        for turn in range(given.turns):
            for k in (0, 1) if turn % 2 else (1, 0):
                times[k].append(ask(workers[k], request, turn))
        for row in times[0][0]:
            before, after = ([each[row] for each in builds] for builds in times)
            ratios.append(median(b / a for a, b in zip(before, after, strict=True)))
            print(f"| {row} | {median(before):.2f} | {median(after):.2f} | {ratios[-1]:.2f} |", flush=True)
    print(f"| geometric mean | | | {geometric_mean(ratios):.2f} |")


def robots() -> Iterator[str]:
    """Robots of throughput.py whose packages are installed: package and file, "gymnasium/envs/...". Prints a message for all others."""
    # throughput.py needs a current build of stepper, which worker processes may not have.
    for package, file in import_module("throughput").MODELS:
        if find_spec(package) is None:
            print(f"skipped {file}: {package} is not installed", file=sys.stderr)
        else:
            yield f"{package}/{file}"


def ask(worker: subprocess.Popen[str], request: str, seed: int) -> dict[str, float]:
    """Step times per environment, us, that the worker process of a build of stepper measures on request, by robot or phase."""
    assert worker.stdin is not None and worker.stdout is not None
    print(json.dumps([request, seed]), file=worker.stdin, flush=True)
    reply = worker.stdout.readline()
    if not reply:
        raise SystemExit(f"the process of a build exited at {request}: see its error message above")
    return dict(json.loads(reply))


def answer(integrator: str, precision: Any, num_envs: int, *, scenes: bool) -> None:
    """Answer requests of `ask` until standard input ends, with the build of stepper that this process has imported."""
    warnings.simplefilter("ignore")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    measured: dict[str, Callable[[int], dict[str, float]]] = {}
    for line in sys.stdin:
        request, seed = json.loads(line)
        if request not in measured:
            measured[request] = (
                scene_times(request, precision, num_envs) if scenes else robot_times(request, integrator, precision, num_envs)
            )
        print(json.dumps(measured[request](seed)), flush=True)


def robot_times(robot: str, integrator: str, precision: Any, num_envs: int) -> Callable[[int], dict[str, float]]:
    """Function that steps a robot under random controls, whose seed is its argument."""
    package, _, file = robot.partition("/")
    found = find_spec(package)
    assert found is not None and found.origin is not None
    model = load(str(Path(found.origin).parent / file), strict=False)
    settings: dict[str, Any] = {"integrator": integrator} if integrator else {}
    sim = Stepper(model, num_envs, options=Options(**settings), precision=precision, threads=1)

    def measure(seed: int) -> dict[str, float]:
        low, high = np.nan_to_num(np.asarray(model.actuator_ctrlrange), neginf=-1.0, posinf=1.0).T
        controls = np.random.default_rng(seed).uniform(low, high, (WARM_UP + STEPS, num_envs, len(low)))
        sim.reset()
        for control in controls[:WARM_UP]:
            sim.step(control)
        begin = time.process_time()
        for control in controls[WARM_UP:]:
            sim.step(control)
        return {f"{package}/{Path(file).stem}": (time.process_time() - begin) / STEPS / num_envs * 1e6}

    return measure


def scene_times(name: str, precision: Any, num_envs: int) -> Callable[[int], dict[str, float]]:
    """Function that plays the episode of a scene of `many_contacts`, with stepper alone."""
    assets, measure, scenes = (import_module(f"many_contacts.{part}") for part in ("assets", "measure", "scenes"))
    scene = next((scene for scene in scenes.ALL if scene.name == name), None)
    if scene is None:
        raise SystemExit(f"no scene is called {name!r}: python -m many_contacts --list")
    # Each process writes another file, so that none reads what the other writes.
    file = Path(f"out/versions/{os.getpid()}/{name.replace(' ', '_')}.xml")
    play = measure.player(scene, assets.written(scene.spec(assets.Assets(Path("out/corpus"))), file), num_envs, precision)
    return lambda _: play()


if __name__ == "__main__":
    main()

"""Time to load a robot, compared with MuJoCo's compiler, as a markdown table.

stepper reads MJCF with MuJoCo's compiler, whose time is therefore included. Columns:

* first: the first load in a new process;
* again: the second load of the same model in that process, where MuJoCo has cached the meshes;
* saved: the load of a file of `Model.save` in a new process.

Times are wall times, as MuJoCo's compiler has threads, with files in the page cache. Engines take turns, and the results are
medians over turns. The robots come from the packages of benches/corpus, or from given files. See docs/benchmarks/performance.md.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from statistics import median

from corpus.download import unpacked
from corpus.packages import PACKAGES
from sections import Table
from stepper import Stepper, load
from stepper.shared.machine import provenance, require

ROBOTS = (
    ("robosuite-models", "robosuite_models/assets/robots/h1/robot.xml"),
    ("gymnasium-robotics", "gymnasium_robotics/envs/assets/fetch/slide.xml"),
    ("robosuite", "robosuite/models/assets/robots/panda/robot.xml"),
    ("dm-control", "dm_control/third_party/kinova/jaco_arm.xml"),
)
"""Packages and files of the robots: Unitree's H1, a Fetch arm, Franka's Panda, Kinova's Jaco."""


def seconds(engine: str, file: str) -> list[float]:
    """Times in which an engine loads a file for the first and the second time in this process, s.

    `engine` is "mujoco", "stepper", or "saved" for stepper with a file of `Model.save`.
    """
    mujoco = require("mujoco", "to read MJCF") if engine != "saved" else None
    times = []
    for _ in range(2):
        start = time.perf_counter()
        if mujoco is not None and engine == "mujoco":
            mujoco.MjModel.from_xml_path(file)
        else:
            Stepper(load(file, strict=False))
        times.append(time.perf_counter() - start)
    return times


def in_turns(file: Path, turns: int) -> dict[str, list[float]]:
    """Times to load a file for the first and for the second time in a process, s: two numbers for each engine, by name.

    The numbers are medians over `turns` new processes.
    """
    times: dict[str, list[list[float]]] = {engine: [] for engine in ("mujoco", "stepper", "saved")}
    with tempfile.TemporaryDirectory() as folder:
        saved = Path(folder) / "model.stepper"
        load(file, strict=False).save(saved)
        for _ in range(turns):
            for engine, seen in times.items():
                command = [sys.executable, __file__, "--once", engine, str(saved if engine == "saved" else file)]
                seen.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    return {engine: [median(column) for column in zip(*seen, strict=True)] for engine, seen in times.items()}


def main() -> None:
    """Measure the load times of all robots, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="MJCF files of further robots")
    parser.add_argument("--turns", type=int, default=7, help="number of processes of each engine [7]")
    parser.add_argument("--cache", type=Path, default=Path("out/corpus"), help="folder of the downloaded packages [out/corpus]")
    parser.add_argument("--once", nargs=2, metavar=("ENGINE", "FILE"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.once:
        print(json.dumps(seconds(*args.once)))
        return
    packages = {package.name: package for package in PACKAGES}
    robots = [(f"{name}: {Path(file).parent.name}/{Path(file).name}", unpacked(packages[name], args.cache) / file) for name, file in ROBOTS]
    robots += [(path.name, path) for path in args.files]
    milliseconds = ("MuJoCo first ms", "first ms", "MuJoCo again ms", "again ms", "saved ms")
    table = Table("model", "first x", "again x", "saved x", *milliseconds)
    for name, path in robots:
        found = in_turns(path.resolve(), args.turns)
        (first, again), (ours, ours_again), (saved, _) = found["mujoco"], found["stepper"], found["saved"]
        ratios = (f"{ratio:.2f}" for ratio in (ours / first, ours_again / again, saved / first))
        table.add(name, *ratios, *(f"{1e3 * x:.0f}" for x in (first, ours, again, ours_again, saved)))
    machine = provenance()
    print(f"\nMedians of {args.turns} turns; {machine['cpu']}, load {machine['load_average']}, {machine['versions']}")


if __name__ == "__main__":
    main()

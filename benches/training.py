"""Learning curves, and transfer of policies between engines and contact laws: docs/benchmarks/training.md.

    python benches/training.py curves                       # learning_curves.csv and .png from the runs in out/train
    python benches/training.py evaluate                     # returns of the policies of these runs in fresh episodes
    python benches/training.py follow                       # velocity errors of Go1 and G1, which follow commanded velocities
    python benches/training.py transfer                     # policies of examples/policies in other engines and contact laws
    python benches/training.py engines                      # training of the Go1 in stepper and mujoco.batch, with the same task

The script writes tables into a copy of docs/benchmarks/training.md in out/training, or with --update-docs into the page itself. `curves`
adds rows to learning_curves.csv, so that runs can be added one by one. `engines` trains by itself, and resumes interrupted runs.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import gymnasium
import mujoco_vector
import numpy as np
import stepper.envs
from sections import Table, section_of, write_section
from stepper.envs.locomotion import G1Velocity, Go1Velocity, VelocityTask
from stepper.policies import Comparison, Policy, compare, evaluate, load
from stepper.shared.machine import one_core, require

DOCS = Path(__file__).parents[1] / "docs"
OUT = Path("out/training")
EXAMPLES = Path(__file__).parents[1] / "examples"
POLICIES = EXAMPLES / "policies"
RUNS = Path("out/train")
COLORS = {"stepper, MuJoCo's law": "C0", "stepper, hard contact": "C1", "MuJoCo": "C2"}
FRESH = 20
"""Number of episodes in which the policy of a training run is evaluated."""
KEPT = 50
"""Number of rows of each training run in learning_curves.csv."""
COLUMNS = ("run", "seed", "steps", "seconds", "processor", "return", "length")


def outputs(*, update_docs: bool) -> tuple[Path, Path, Path]:
    """Page with the tables, CSV file with the learning curves, and folder of the figures.

    They are those of the documentation with `update_docs`, otherwise copies in out/training.
    """
    page, curves = DOCS / "benchmarks/training.md", DOCS / "benchmarks/learning_curves.csv"
    if update_docs:
        return page, curves, DOCS / "images"
    OUT.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copy(page, OUT)), Path(shutil.copy(curves, OUT)), OUT


def collect(runs: Path, curves: Path) -> list[dict[str, str]]:
    """Rows of the learning curves of all runs: those of new training runs, and those in a file of earlier runs.

    A new run replaces an earlier run of the same name.
    """
    rows: list[dict[str, str]] = []
    if curves.exists():
        with curves.open() as file:
            rows = list(csv.DictReader(file))
    for curve in sorted(runs.glob("*/seed*/curve.csv")):
        run, seed = curve.parent.parent.name, curve.parent.name.removeprefix("seed")
        if not _is_known(run):
            continue
        with curve.open() as file:
            # Episodes of equal length end together; rows in between repeat the returns and are dropped.
            rows_by_episodes = {row["episodes"]: row for row in reversed(list(csv.DictReader(file))) if row["return"] != "nan"}
            own = list(rows_by_episodes.values())[::-1]
        every = max(1, len(own) // KEPT)
        rows = [row for row in rows if (row["run"], row["seed"]) != (run, seed)]
        for row in own[::-every][::-1]:
            rows.append({"run": run, "seed": seed, **{name: f"{float(row[name]):.6g}" for name in COLUMNS[2:]}})
    rows.sort(key=lambda row: (row["run"], row["seed"], float(row["steps"])))
    with curves.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return rows


def draw(rows: list[dict[str, str]], path: Path) -> None:
    """Plot returns over steps, with a panel for each task and a line for each seed."""
    plt = require("matplotlib.pyplot", "to draw learning curves")
    tasks: dict[str, dict[str, dict[str, list[dict[str, str]]]]] = {}
    for row in rows:
        engine, task = _named(row["run"])
        tasks.setdefault(task, {}).setdefault(engine, {}).setdefault(row["seed"], []).append(row)
    columns = min(3, len(tasks))
    lines = -(-len(tasks) // columns)
    figure, axes = plt.subplots(lines, columns, figsize=(4.0 * columns, 3.0 * lines), squeeze=False, layout="constrained")
    for axis in axes.flat[len(tasks) :]:
        axis.axis("off")
    for axis, (task, engines) in zip(axes.flat, sorted(tasks.items()), strict=False):
        for engine, seeds in sorted(engines.items()):
            for j, own in enumerate(seeds.values()):
                x, y = ([float(row[name]) for row in own] for name in ("steps", "return"))
                axis.plot(
                    np.array(x) / 1e6,
                    y,
                    marker="." if len(x) < 20 else None,
                    color=COLORS[engine],
                    lw=1.2,
                    alpha=0.8,
                    label=engine if j == 0 else None,
                )
        axis.set_title(task, fontsize=10)
        axis.set_xlabel("million steps")
        axis.set_ylabel("return")
        axis.grid(alpha=0.3)
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
        if len(engines) > 1:
            axis.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)


def _is_known(run: str) -> bool:
    """Whether the environment of a folder of training runs is registered with Gymnasium; prints a line if it is not."""
    known = re.sub(r"^stepper_", "stepper/", re.sub(r"(-v\d+)_\w+$", r"\1", run)) in gymnasium.registry
    if not known:
        print(f"skipped {run}: its environment is not registered")
    return known


def _named(run: str) -> tuple[str, str]:
    """Engine with contact law, and task, from the name of a folder of training runs.

    Examples of names are "stepper_Hopper-v5", "stepper_Hopper-v5_hard" and "Hopper-v5".
    """
    match = re.fullmatch(r"(stepper_)?(.+?-v\d+)(?:_(\w+))?", run)
    if match is None:
        raise ValueError(f"{run} is not the name of a folder of stepper train: give a folder as stepper_Hopper-v5")
    if match[1] is None:
        return "MuJoCo", match[2]
    task = gymnasium.spec(f"stepper/{match[2]}").kwargs["task"]
    law = match[3] or (stepper.envs.TASKS[task] if isinstance(task, str) else task).contact
    return f"stepper, {_LAWS[law]}", match[2]


def table_of_runs(page: Path, runs: Path, episodes: int) -> str:
    """Markdown table of training time, steps and evaluation of each training run.

    Runs in the folder `runs` are evaluated in `episodes` episodes each. The rows of other runs are copied from the page.
    """
    head, line, *kept = section_of(page, "evaluate").split("\n")
    rows = {tuple(_cells(row)[:3]): row for row in kept}
    for file in sorted(runs.glob("*/seed*/policy.npz")):
        if not _is_known(file.parent.parent.name):
            continue
        policy = load(file)
        t = policy.training
        own = {"contact": _law(policy), "precision": t["precision"]} if t["env"].startswith("stepper/") else {}
        found = evaluate(policy, t["env"], episodes=episodes, seed=2**32, **own)
        low, high = found.interval()
        engine, task = _named(file.parent.parent.name)
        cells = [task, engine, str(t["seed"]), *_spent(file.parent)]
        digits = _digits(found.mean)
        cells += [f"{found.mean:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}", f"{found.returns.min():.{digits}f}"]
        rows[tuple(cells[:3])] = "| " + " | ".join(cells) + " |"
        print(rows[tuple(cells[:3])], flush=True)
    return "\n".join([head, line, *(rows[name] for name in sorted(rows))])


def _digits(mean: float) -> int:
    """Number of decimals with which a table shows returns, by their mean."""
    return 0 if abs(mean) > 100.0 else 2


def _spent(run: Path) -> list[str]:
    """Table cells of a run: million steps, minutes of wall time, and minutes of processor time."""
    with (run / "curve.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    return [f"{float(last[name]) / scale:.1f}" for name, scale in (("steps", 1e6), ("seconds", 60.0), ("processor", 60.0))]


VELOCITY_TASKS: dict[str, type[VelocityTask]] = {
    "Go1Velocity-v0": Go1Velocity,
    "Go1VelocityReal-v0": Go1Velocity,
    "G1Velocity-v0": G1Velocity,
}
"""Tasks of robots that follow a commanded velocity."""


def table_of_following(page: Path, runs: Path, episodes: int, only: str) -> str:
    """Table of velocity errors and falls in evaluation episodes of robots that follow commanded velocities.

    Each policy has a row for the contact law of its training and one for the other law. For comparison, each task has a row for a robot
    that stands still. Only rows of tasks with `only` in their names are computed; other rows are copied from the page.
    """
    head, line, *kept = section_of(page, "follow").split("\n")
    table = {tuple(_cells(row)[:3]): row for row in kept}
    for name, task in VELOCITY_TASKS.items():
        if only not in name:
            continue
        env, still = f"stepper/{name}", np.zeros((episodes, task().model().nu))
        rows: list[tuple[list[str], Any, str]] = [
            ([name, "stands still", _LAWS["hard"], "", "", ""], lambda observation, act=still: act, "hard")
        ]
        for file in sorted(runs.glob(f"stepper_{name}/seed*/policy.npz")):
            policy = load(file)
            for law in (_law(policy), *(_LAWS.keys() - {_law(policy)})):
                rows.append(([name, file.parent.name.removeprefix("seed"), _LAWS[law], *_spent(file.parent)], policy, law))
        for cells, act, law in rows:
            found = evaluate(act, env, episodes=episodes, seed=2**32, infos=("tracking_error",), precision="f32", contact=law)
            errors = found.infos["tracking_error"]
            low, high = found.interval(info="tracking_error")
            cells += [f"{found.mean:.0f}", f"{errors.mean():.3f}", f"{low:.3f} to {high:.3f}", f"{errors.max():.2f}"]
            key = tuple(cells[:3])
            table[key] = "| " + " | ".join([*cells, f"{np.sum(found.lengths < found.lengths.max())} of {episodes}"]) + " |"
            print(table[key], flush=True)
    return "\n".join([head, line, *table.values()])


def _law(policy: Policy) -> str:
    """Contact law of the environment in which a policy was trained: "hard" or "mujoco"."""
    return str(policy.environment["options"]["contact"])


STEPPER: dict[str, tuple[str, dict[str, Any]]] = {
    "stepper, hard contact": ("stepper/{}", {"contact": "hard"}),
    "stepper, MuJoCo's law": ("stepper/{}", {"contact": "mujoco"}),
}
"""Environments of stepper with each contact law, by the label in the tables.

A value has the pattern of the environment's id, in which {} stands for the task, and the arguments of the environment.
"""
TRANSFERS = STEPPER | {"MuJoCo": ("{}", {})}
"""Environments between which policies are transferred."""
ENGINES = STEPPER | {"mujoco.batch": ("mujoco_batch/{}", {})}
"""Environments that the command `engines` compares."""


def table_of_transfers(page: Path, episodes: int, only: str) -> str:
    """Table of the returns of the policies in examples/policies, in the environment of their training and in others.

    All episodes are in 64 bits and start from the same states. Only rows of files with `only` in their names are computed; other rows are
    copied from the page.
    """
    head, line, *kept = section_of(page, "transfer").split("\n")
    rows = {tuple(_cells(row)[:3]): row for row in kept}
    for file in sorted(POLICIES.glob(f"*{only}*.npz")):
        policy = load(file)
        task = str(policy.training["env"]).removeprefix("stepper/")
        if task not in gymnasium.registry:  # Tasks with commanded velocities exist in stepper only.
            continue
        engine = "MuJoCo" if task == policy.training["env"] else f"stepper, {_LAWS[_law(policy)]}"
        home = TRANSFERS[engine]
        for column, (name, settings) in TRANSFERS.items():
            if column == engine:
                continue
            envs = home[0].format(task), name.format(task)
            both: Comparison = compare(policy, *envs, episodes=episodes, seed=2**33, alpha=0.025, settings=(home[1], settings))
            (low, high), share = both.interval, 100.0 / abs(both.one.mean)
            digits = _digits(both.one.mean)
            rows[task, engine, engine] = f"| {task} | {engine} | {engine} | {episodes} | {both.one.mean:.{digits}f} | | | |"
            cells = [task, engine, column, f"{episodes}", f"{both.other.mean:.{digits}f}"]
            cells += [f"{both.difference:+.{digits}f} ({share * both.difference:+.2f} %)"]
            cells += [f"{share * low:+.2f} % to {share * high:+.2f} %", both.verdict]
            rows[task, engine, column] = "| " + " | ".join(cells) + " |"
            print(rows[task, engine, column], flush=True)
    # The environment of the training comes first.
    return "\n".join([head, line, *(rows[name] for name in sorted(rows, key=lambda name: (*name[:2], name[1] != name[2], name[2])))])


def engines(task: str, runs: Path, episodes: int, steps: int | None = None) -> str:
    """Train a robot to follow velocities in each engine, with the same task, learner, hyperparameters and seed, on one thread."""
    train: Any = importlib.import_module("train")
    mujoco_vector.register(task)
    columns = (text for name in ENGINES for text in (f"error in {name}, m/s", "falls"))
    table = Table("trained in", "million steps", "processor min", *columns)
    with one_core():
        for name, (env, own) in ENGINES.items():
            folder = runs / re.sub(r"\W+", "_", f"{task} {name}")
            given = {} if steps is None else {"steps": steps}
            settings = train.Settings.of_task(env.format(task), **own, threads=1, seed=1, **given)
            run = train.train(settings, folder, quiet=True)
            cells = [name, f"{run.steps / 1e6:.1f}", f"{run.processor / 60.0:.1f}"]
            for other, law in ENGINES.values():
                arguments = law | ({"precision": "f32"} if law else {})
                found = evaluate(run.policy(), other.format(task), episodes=episodes, seed=2**32, infos=("tracking_error",), **arguments)
                fell = int(np.sum(found.lengths < found.lengths.max()))
                cells += [f"{found.infos['tracking_error'].mean():.3f}", f"{fell} of {episodes}"]
            table.add(*cells)
    return str(table)


_LAWS = {"mujoco": "MuJoCo's law", "hard": "hard contact"}


def _cells(row: str) -> list[str]:
    """Cells of a row of a Markdown table."""
    return [cell.strip() for cell in row.strip("|").split("|")]


def main() -> None:
    """Run the command that the command line names, such as "curves" or "follow", and write its table or figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("curves", "evaluate", "follow", "transfer", "engines"))
    parser.add_argument("--runs", type=Path, default=RUNS, help=f"folder of the runs; engines uses a subfolder [{RUNS}]")
    parser.add_argument("--episodes", type=int, help="number of evaluation episodes per policy [evaluate: 20, others: 200]")
    parser.add_argument(
        "--only", default="", metavar="NAME", help="compute only policies (transfer) or tasks (follow) with NAME in their names"
    )
    parser.add_argument("--task", default="Go1Velocity-v0", help="task of engines [%(default)s]")
    parser.add_argument("--steps", type=int, help="environment steps per run of engines [default of the task]")
    parser.add_argument("--update-docs", action="store_true", help=f"write into the documentation instead of copies in {OUT}")
    given = parser.parse_args()
    page, curves, images = outputs(update_docs=given.update_docs)
    sys.path.append(str(EXAMPLES))
    if given.what == "engines":
        write_section(page, "engines", engines(given.task, given.runs / "engines", given.episodes or 200, given.steps))
    elif given.what == "curves":
        draw(collect(given.runs, curves), images / "learning_curves.png")
    elif given.what == "evaluate":
        write_section(page, "evaluate", table_of_runs(page, given.runs, given.episodes or FRESH))
    elif given.what == "follow":
        write_section(page, "follow", table_of_following(page, given.runs, given.episodes or 200, given.only))
    else:
        write_section(page, "transfer", table_of_transfers(page, given.episodes or 200, given.only))


if __name__ == "__main__":
    main()

"""Learning curves and the transfer of policies between engines and laws of contact: docs/benchmarks/training.md.

    python benches/training.py curves                       # from the runs in out/train: learning_curves.csv and .png
    python benches/training.py evaluate                     # fresh episodes of their policies
    python benches/training.py follow                       # how far Go1 and G1 are from the velocities that they are commanded
    python benches/training.py transfer                     # examples/policies/ in other environments, from the same starts
    python benches/training.py race                         # HalfCheetah here, in EnvPool and in Gymnasium's own: learning_race.png
    python benches/training.py engines                      # the Go1 learns here and on mujoco.batch, with the same task and learner

Tables go into a copy of docs/benchmarks/training.md in out/training, and with --update-docs into the page itself. `curves` adds to the
rows of learning_curves.csv: runs may be made one after the other.
`race` and `engines` train themselves, and go on where they were stopped; EnvPool is left out where it is not installed.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import re
import shutil
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import envpool_vector
import gymnasium
import mujoco_vector
import numpy as np
import stepper.envs
from sections import section_of, write_section
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
"""Fresh episodes of a run."""
KEPT = 50
"""Rows of a run that are kept."""
COLUMNS = ("run", "seed", "steps", "seconds", "processor", "return", "length")


@dataclass(frozen=True)
class Report:
    """Files that hold the results: the page with its tables, the rows of learning curves, and the folder of pictures."""

    page: Path
    curves: Path
    images: Path

    @classmethod
    def of_docs(cls) -> Report:
        """Files of the documentation."""
        return cls(DOCS / "benchmarks/training.md", DOCS / "benchmarks/learning_curves.csv", DOCS / "images")

    @classmethod
    def copied(cls) -> Report:
        """Copies of them in out/training, so that a trial changes no documentation."""
        docs = cls.of_docs()
        OUT.mkdir(parents=True, exist_ok=True)
        return cls(Path(shutil.copy(docs.page, OUT)), Path(shutil.copy(docs.curves, OUT)), OUT)


def collect(runs: Path, curves: Path) -> list[dict[str, str]]:
    """Rows of learning curves: those of a file, with the runs of a folder in place of those of the same name."""
    rows: list[dict[str, str]] = []
    if curves.exists():
        with curves.open() as file:
            rows = list(csv.DictReader(file))
    for curve in sorted(runs.glob("*/seed*/curve.csv")):
        run, seed = curve.parent.parent.name, curve.parent.name.removeprefix("seed")
        if not _is_known(run):
            continue
        with curve.open() as file:
            # Episodes of the same length end together: rows in between repeat the returns.
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
    """Draws returns against steps, a panel for each task and a line for each seed."""
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
    """Whether the environment of a folder of runs is registered; says so where it is not: a study's, say."""
    known = re.sub(r"^stepper_", "stepper/", re.sub(r"(-v\d+)_\w+$", r"\1", run)) in gymnasium.registry
    if not known:
        print(f"{run} is left out: its environment is not registered")
    return known


def _named(run: str) -> tuple[str, str]:
    """Engine with its law, and task, of the name of a folder of runs: "stepper_Hopper-v5", "stepper_Hopper-v5_hard", "Hopper-v5"."""
    match = re.fullmatch(r"(stepper_)?(.+?-v\d+)(?:_(\w+))?", run)
    if match is None:
        raise ValueError(f"{run} is no folder of a run of stepper train")
    if match[1] is None:
        return "MuJoCo", match[2]
    task = gymnasium.spec(f"stepper/{match[2]}").kwargs["task"]
    law = match[3] or (stepper.envs.TASKS[task] if isinstance(task, str) else task).contact
    return f"stepper, {_LAWS[law]}", match[2]


def table_of_runs(page: Path, runs: Path, episodes: int) -> str:
    """Time, steps and fresh episodes of every run, a row each: those of the page, with the runs of a folder in place of the same ones."""
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
    """Places after the point that a table shows of returns about a mean."""
    return 0 if abs(mean) > 100.0 else 2


def _spent(run: Path) -> list[str]:
    """Million steps of a run, minutes by the clock, and minutes of processor time."""
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
    """Fresh episodes of every run of a robot that follows commands, a row each, of tasks that have `only` in their names; other rows stay.

    How far they are from the commanded velocity, and how often they fall, under the law of contact that they were trained in and then under
    the other; beside one that stands still.
    """
    head, line, *kept = section_of(page, "follow").split("\n")
    table = {tuple(_cells(row)[:3]): row for row in kept}
    for name, task in VELOCITY_TASKS.items():
        if only not in name:
            continue
        env, stance = f"stepper/{name}", task().episode_state(episodes)["last"]
        rows: list[tuple[list[str], Any, str]] = [
            ([name, "stands still", _LAWS["hard"], "", "", ""], lambda observation, act=stance: act, "hard")
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
    """The law of contact that a policy was trained in."""
    return str(policy.environment["options"]["contact"])


TRANSFERS: dict[str, tuple[str, dict[str, Any]]] = {
    "stepper, MuJoCo's law": ("stepper/{}", {"contact": "mujoco"}),
    "stepper, hard contact": ("stepper/{}", {"contact": "hard"}),
    "MuJoCo": ("{}", {}),
}
"""Environments that policies are tried in: what they are called, name of the environment, arguments."""


def table_of_transfers(page: Path, episodes: int, only: str) -> str:
    """Policies of examples/policies/ where they were trained and elsewhere, from the same starts, all in 64 bits.

    Rows of the page stay unless they are made again: `only` is in the names of the files whose rows are.
    """
    head, line, *kept = section_of(page, "transfer").split("\n")
    rows = {tuple(_cells(row)[:3]): row for row in kept}
    for file in sorted(POLICIES.glob(f"*{only}*.npz")):
        policy = load(file)
        task = str(policy.training["env"]).removeprefix("stepper/")
        if task not in gymnasium.registry:  # Those of robots that follow commands are stepper's alone.
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
    # Where it was trained comes first.
    return "\n".join([head, line, *(rows[name] for name in sorted(rows, key=lambda name: (*name[:2], name[1] != name[2], name[2])))])


RACERS: dict[str, tuple[str, dict[str, Any]]] = {
    "stepper, f32": ("stepper/{}", {"precision": "f32"}),
    "stepper, f64": ("stepper/{}", {"precision": "f64"}),
    "EnvPool": ("envpool/{}", {}),
    "Gymnasium's own": ("{}", {}),
}
"""Whose environments the learner is put to: what a row is called, name of the environment, settings. All have MuJoCo's law."""
RACE: dict[str, Any] = {"num_envs": 128, "horizon": 64, "minibatch": 1024, "epochs": 8, "threads": 1}
"""Settings of a race: fewer environments than those of the task, so that returns of whole episodes are seen early."""
RACE_SEEDS = (1, 2, 3)


def race(task: str, steps: int, runs: Path, report: Report) -> str:
    """Trains in the same task of every engine, with the same learner, settings and seeds, on one core and one thread.

    Policies are evaluated in Gymnasium's own environment. Draws learning_race.png.

    Args:
        task: Gymnasium's name of it.
        steps: Environment steps of each run.
        runs: Folder of the runs.
        report: Where the picture goes, and the page with the head of the table.

    Returns:
        A table, a row for each engine.
    """
    train: Any = importlib.import_module("train")
    curves: dict[str, list[list[dict[str, str]]]] = {}
    spent: dict[str, float] = {}
    head, line, *_ = section_of(report.page, "race").split("\n")
    rows = [head, line]
    with one_core():
        for name, (env, own) in RACERS.items():
            if name == "EnvPool":
                if not find_spec("envpool"):
                    print("EnvPool is left out: it is not installed")
                    continue
                envpool_vector.register(task)
            times, returns, curves[name] = [], [], []
            for seed in RACE_SEEDS:
                folder = runs / re.sub(r"\W+", "_", f"{task} {name} {seed}")
                settings = train.Settings.of_task(env.format(task), **own, **RACE, seed=seed, steps=steps)
                run = train.train(settings, folder, quiet=True)
                times.append(run.processor)
                returns.append(evaluate(run.policy(), task, episodes=FRESH, seed=2**32).mean)
                with (folder / "curve.csv").open() as file:
                    curves[name].append([row for row in csv.DictReader(file) if row["return"] != "nan"])
            spent[name] = float(np.mean(times))
            beside = spent[name] / spent[next(iter(RACERS))]
            cells = [name, f"{run.steps:,}", f"{spent[name]:.0f}", f"{beside:.1f}", ", ".join(f"{mean:.0f}" for mean in returns)]
            rows.append("| " + " | ".join(cells) + " |")
            print(rows[-1], flush=True)
    draw_race(curves, task, report.images / "learning_race.png")
    return "\n".join(rows)


ENGINES: dict[str, tuple[str, dict[str, Any]]] = {
    "stepper, hard contact": ("stepper/{}", {"contact": "hard"}),
    "stepper, MuJoCo's law": ("stepper/{}", {"contact": "mujoco"}),
    "mujoco.batch": ("mujoco_batch/{}", {}),
}
"""Engines that the same task of a robot is put to: what a row is called, name of the environment, settings."""


def engines(task: str, runs: Path, episodes: int, steps: int | None = None) -> str:
    """Trains a robot that follows commands in every engine, with the same task, learner, settings and seed, on one core and one thread.

    Args:
        task: Name of the task, one of `VELOCITY_TASKS`.
        runs: Folder of the runs.
        episodes: Fresh episodes of each policy in each engine.
        steps: Environment steps of each run; None is those of the task.

    Returns:
        A table, a row for each engine that trained: processor time, and the errors and falls in each engine.
    """
    train: Any = importlib.import_module("train")
    mujoco_vector.register(task)
    columns = " | ".join(f"error in {name}, m/s | falls" for name in ENGINES)
    rows = [f"| trained in | million steps | minutes of processor | {columns} |", "|" + "---|" * (3 + 2 * len(ENGINES))]
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
            rows.append("| " + " | ".join(cells) + " |")
            print(rows[-1], flush=True)
    return "\n".join(rows)


def draw_race(curves: dict[str, list[list[dict[str, str]]]], task: str, path: Path) -> None:
    """Draws returns in training against processor time, a line for each seed."""
    plt = require("matplotlib.pyplot", "to draw learning curves")
    figure, axis = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
    for color, (name, seeds) in enumerate(curves.items()):
        for k, rows in enumerate(seeds):
            changed = [row for i, row in enumerate(rows) if not i or row["episodes"] != rows[i - 1]["episodes"]]
            seconds, returns = ([float(row[column]) for row in changed] for column in ("processor", "return"))
            axis.plot(seconds, returns, f"C{color}", marker="o", ms=3, lw=1, label=None if k else name)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("seconds of processor")
    axis.set_ylabel("return in training")
    axis.set_title(task, fontsize=10)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)


_LAWS = {"mujoco": "MuJoCo's law", "hard": "hard contact"}


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip("|").split("|")]


def main() -> None:
    """Makes what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("curves", "evaluate", "follow", "transfer", "race", "engines"))
    parser.add_argument("--runs", type=Path, default=RUNS, help="folder of the runs; those of a race are in its folder race")
    parser.add_argument("--episodes", type=int, help="20 of each run, 200 of each transfer and of each robot that follows commands")
    parser.add_argument(
        "--only", default="", metavar="NAME", help="files of policies (transfer) or tasks (follow) that have this in their names"
    )
    parser.add_argument("--task", help="of a race [HalfCheetah-v5], or of engines [Go1Velocity-v0]")
    parser.add_argument("--steps", type=int, help="of each run of a race [400000], or of engines [those of the task]")
    parser.add_argument("--update-docs", action="store_true", help=f"write into the documentation; default: into copies in {OUT}")
    given = parser.parse_args()
    report = Report.of_docs() if given.update_docs else Report.copied()
    page = report.page
    sys.path.append(str(EXAMPLES))
    if given.what == "race":
        write_section(
            page,
            "race",
            race(given.task or "HalfCheetah-v5", given.steps or 400_000, given.runs / "race", report),
        )
    elif given.what == "engines":
        write_section(page, "engines", engines(given.task or "Go1Velocity-v0", given.runs / "engines", given.episodes or 200, given.steps))
    elif given.what == "curves":
        draw(collect(given.runs, report.curves), report.images / "learning_curves.png")
    elif given.what == "evaluate":
        write_section(page, "evaluate", table_of_runs(page, given.runs, given.episodes or FRESH))
    elif given.what == "follow":
        write_section(page, "follow", table_of_following(page, given.runs, given.episodes or 200, given.only))
    else:
        write_section(page, "transfer", table_of_transfers(page, given.episodes or 200, given.only))


if __name__ == "__main__":
    main()

"""Benchmark of scenes with many contacts: `python -m many_contacts` measures stepper and MuJoCo, and prints a table."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from corpus.download import DownloadError
from stepper import ModelError
from stepper.shared.machine import provenance, require

from many_contacts.assets import Assets, written
from many_contacts.episodes import floors, save_robots
from many_contacts.kinematics import UnreachableError
from many_contacts.measure import SETTINGS, Plan, measure, save_episodes
from many_contacts.report import Report
from many_contacts.scene import Scene
from many_contacts.scenes import ALL
from many_contacts.targets import robots

FAILURES = (DownloadError, ModelError, UnreachableError, RuntimeError)
"""Errors for which a scene is skipped. MuJoCo's errors are RuntimeErrors."""


def main() -> None:
    """Measure the scenes with many contacts, and write the report."""
    parser = argparse.ArgumentParser(prog="many_contacts", description=__doc__)
    parser.add_argument("--scene", nargs="+", default=[], metavar="NAME", help="scenes with one of these texts in their name [all]")
    parser.add_argument("--num-envs", nargs="+", type=int, default=[64, 256], help="numbers of environments in stepper [64 256]")
    parser.add_argument("--peers", type=int, default=64, help="largest number of environments in MuJoCo [64]")
    parser.add_argument("--precision", nargs="+", choices=("f64", "f32"), default=["f64", "f32"])
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=["default", "fast", "pgs"])
    parser.add_argument("--rounds", type=int, default=5, help="number of repetitions, for medians [5]")
    parser.add_argument("--patience", type=float, default=120.0, help="time after which no new round of a scene starts, s [120]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="rough figures: two rounds with default settings")
    parser.add_argument("--add", action="store_true", help="keep other rows of many_contacts.json")
    parser.add_argument("--update-docs", action="store_true", help="write the page docs/benchmarks/many_contacts.md")
    parser.add_argument("--from-json", action="store_true", help="print the tables from many_contacts.json, without measuring")
    parser.add_argument(
        "--targets", action="store_true", help="print the targets with the results in many_contacts.json, without measuring"
    )
    parser.add_argument(
        "--save-episodes", type=Path, metavar="DIR", help="record the timed phases as episodes for the program `anatomy`, without measuring"
    )
    parser.add_argument("--list", action="store_true", help="list the scenes with their descriptions")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for many_contacts.json [out]")
    parser.add_argument("--cache", type=Path, default=Path("out/corpus"), help="folder of the downloaded packages [out/corpus]")
    args = parser.parse_args()
    scenes = [s for s in ALL if not args.scene or any(part in s.name for part in args.scene)]
    if not scenes:
        parser.error(f"no scene matches {args.scene}: give parts of " + ", ".join(s.name for s in ALL))
    if args.list:
        print("\n".join(f"{s.name:24} {s.about}" for s in scenes))
        return
    if args.quick:
        args.rounds, args.patience, args.settings = min(args.rounds, 2), min(args.patience, 15.0), ["default"]
    require("mujoco", "to compare stepper with MuJoCo").set_mju_user_warning(lambda message: None)
    if args.save_episodes:
        _save(scenes, args)
        return
    path = args.out / "many_contacts.json"
    saved = args.from_json or args.targets
    kept = json.loads(path.read_text(encoding="utf-8")) if (args.add or saved) and path.exists() else {"rows": []}
    for num_envs in () if saved else args.num_envs:
        for scene in scenes:
            rows = _measured(scene, _plan(args, num_envs), args.cache, args.out)
            others = [row for row in kept["rows"] if (row["scene"], row["num_envs"]) != (scene.name, num_envs)]
            kept = {"rows": others + rows, "provenance": provenance()}
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    order = [s.name for s in ALL]
    found = sorted((row for row in kept["rows"] if row["scene"] in order), key=lambda row: order.index(row["scene"]))
    if not found:
        parser.error(f"{path} has no rows: run without --from-json and --targets first")
    if not any("f64 default" in row["ours"] or "f32 default" in row["ours"] for row in found):
        print(f"wrote {path}; no report, as it needs default settings")
        return
    report = Report(found, kept["provenance"], floors(args.out / "floors.json"), robots(args.out / "throughput.json"))
    print(f"\n{report.targets() if args.targets else report.show()}")
    if args.update_docs:
        Path("docs/benchmarks/many_contacts.md").write_text(report.page(ALL), encoding="utf-8")


def _plan(args: argparse.Namespace, num_envs: int) -> Plan:
    """Extent of the measurement (`Plan`) from the arguments of the command line."""
    return Plan(num_envs, args.peers, tuple(args.precision), tuple(args.settings), args.rounds, args.patience, args.seed)


def _save(scenes: Sequence[Scene], args: argparse.Namespace) -> None:
    """Record controls and states of all scenes in files, which the program `anatomy` (benches/src/bin) steps again to count operations."""
    for num_envs in args.num_envs:
        for scene in scenes:
            try:
                save_episodes(scene, _path(scene, args.cache, args.out), _plan(args, num_envs), args.save_episodes)
                text = "recorded"
            except FAILURES as error:
                text = _words(error)
            sys.stderr.write(f"{scene.name}, {num_envs} environments: {text}\n")
    save_robots(args.save_episodes, args.precision, args.scene)


def _path(scene: Scene, cache: Path, out: Path) -> Path:
    """Write the MJCF file of a scene, and return its path."""
    return written(scene.spec(Assets(cache)), out / "many_contacts" / f"{scene.name.replace(' ', '_')}.xml")


def _words(error: Exception) -> str:
    """Type and message of an error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _measured(scene: Scene, plan: Plan, cache: Path, out: Path) -> list[dict[str, Any]]:
    """Measure a scene, and return a dictionary of measurements for each timed phase.

    If the scene fails, the dictionaries have the error as a note, and no measurements.
    """
    begin = time.perf_counter()
    try:
        rows = measure(scene, _path(scene, cache, out), plan)
        text = "; ".join(" ".join([row["row"], *(f"{found['ratio']:.2f}" for found in row["ours"].values())]) for row in rows)
    except FAILURES as error:
        text = _words(error)
        empty = {"scene": scene.name, "group": scene.group or scene.name, "num_envs": plan.num_envs, "note": text, "ours": {}, "theirs": {}}
        rows = [empty | {"row": scene.row(phase)} for phase in scene.phases if phase.timed]
    sys.stderr.write(f"{scene.name}, {plan.num_envs} environments, {time.perf_counter() - begin:.0f} s: {text}\n")
    return rows


if __name__ == "__main__":
    main()

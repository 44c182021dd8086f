"""The command of the golden trajectories: see `golden.test_golden`."""

import argparse
import json
import pickle
from pathlib import Path

from stepper.doctor import cpu_levels

from golden import kept
from golden.record import record
from golden.trajectories import TRAJECTORIES


def renew() -> None:
    """Keeps the digests of this build, provided that all CPU levels of this machine agree on them."""
    levels = cpu_levels()
    first, *others = (kept.entries_at(level) for level in levels)
    for level, entries in zip(levels[1:], others, strict=True):
        if different := [name for name in first if entries[name] != first[name]]:
            raise SystemExit(f"not kept: {levels[0]} and {level} differ in {', '.join(different)}")
    before = kept.read()["trajectories"] if kept.KEPT.exists() else {}
    kept.write(first)
    for name in [name for name in first | before if first.get(name) != before.get(name)]:
        if name in first and name in before:
            print(f"{name}: the final state moved by up to {kept.moved(before[name], first[name]):.1e}")
        else:
            print(f"{name}: {'gone' if name in before else 'new'}")
    print(f"kept {len(first)} trajectories, which {', '.join(levels)} agree on")


def save(folder: Path, names: list[str]) -> None:
    """Writes what is read of trajectories, a file for each."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / f"{name}.pickle").write_bytes(pickle.dumps(record(TRAJECTORIES[name]).readings))


def compare(folder: Path, names: list[str]) -> None:
    """Says of trajectories where they part from what `save` wrote."""
    for name in names:
        part = kept.first_difference(pickle.loads((folder / f"{name}.pickle").read_bytes()), record(TRAJECTORIES[name]).readings)
        print(f"{name}: {part or 'the same'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m golden", description=__doc__)
    parser.add_argument("names", nargs="*", default=list(TRAJECTORIES), help="trajectories; none are all")
    task = parser.add_mutually_exclusive_group()
    task.add_argument("--renew", action="store_true", help="keep the digests of this build")
    task.add_argument("--save", type=Path, metavar="FOLDER", help="write everything that is read, to be compared with another build")
    task.add_argument("--against", type=Path, metavar="FOLDER", help="say where trajectories part from what --save wrote")
    asked = parser.parse_args()
    if asked.renew:
        renew()
    elif asked.save:
        save(asked.save, asked.names)
    elif asked.against:
        compare(asked.against, asked.names)
    else:
        print(json.dumps({name: record(TRAJECTORIES[name]).entry() for name in asked.names}))

"""The digests that are kept in the repository, those of this build, and what their difference means."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco

KEPT = Path(__file__).with_name("golden.json")
RENEW = "PYTHONPATH=tests:tests/helpers .venv/bin/python -m golden --renew"


def read() -> dict[str, Any]:
    """What is kept: MuJoCo's version at the time, and an entry for every trajectory (`golden.record.Record.entry`)."""
    return json.loads(KEPT.read_text())


def write(entries: dict[str, Any]) -> None:
    """Keeps the entries of this build."""
    lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
    KEPT.write_text(f'{{\n "mujoco": {json.dumps(mujoco.__version__)},\n "trajectories": {{\n{lines}\n }}\n}}\n')


def moved(kept: dict[str, Any], found: dict[str, Any]) -> float:
    """Largest difference between the final states of two entries, in SI units; infinite between states of different models."""
    before, after = kept.get("final", []), found["final"]
    return max((abs(a - b) for a, b in zip(before, after, strict=True)), default=0.0) if len(before) == len(after) else float("inf")


def entries_at(level: str) -> dict[str, Any]:
    """Entries of every trajectory at a CPU level, from a process of its own: a process has one level, from its first step on."""
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    env = os.environ | {"STEPPER_CPU_LEVEL": level, "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-W", "ignore", "-m", "golden"], env=env, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"the golden trajectories fail at the CPU level {level}:\n{done.stderr}")
    return json.loads(done.stdout)


def verdict(kept: dict[str, Any], found: dict[str, Any], version: str) -> str:
    """What a difference between two entries of a trajectory means; empty when there is none.

    Args:
        kept: The entry of the repository.
        found: The entry of this build.
        version: MuJoCo's version when the entry was kept.
    """
    same_model, same_bits = kept["model"] == found["model"], kept["bits"] == found["bits"]
    if same_model and same_bits:
        return "" if kept == found else f"the counts in the entry are not those of its trajectory: {found}, kept {kept}"
    if same_model:
        return (
            f"the step changed: the compiled model is the one that was kept, and the trajectory is another "
            f"({found['contacts']} contacts, {found['flags']}; kept {kept['contacts']}, {kept['flags']}). The final state of the first "
            f"environment moved by up to {moved(kept, found):.1e}. If that is meant: {RENEW}"
        )
    compiler = f"MuJoCo {mujoco.__version__} compiled it, {version} compiled the one that was kept"
    if same_bits:
        return f"the step did not change: the trajectory is the one that was kept, and the model has other bytes: {compiler}. {RENEW}"
    return (
        f"the compiled model changed, so that its trajectory says nothing of the step: {compiler}. With the same version the loader "
        f"or the form of a model changed. If the step is known to be the same: {RENEW}"
    )


def first_difference(before: list[tuple[str, bytes]], after: list[tuple[str, bytes]]) -> str:
    """When two runs of a trajectory part, and in what; empty when they do not."""
    for (label, data), (other, changed) in zip(before, after, strict=False):
        if label != other:
            return f"{label} became {other}"
        if data != changed:
            return label
    return "" if len(before) == len(after) else "the number of readings"

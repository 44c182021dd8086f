"""Tables of observations and actions of all registered tasks, docs/reference/tasks.md: written by this script, compared by a test.

    PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/task_page.py

It needs the packages that have the models: dm_control, mjlab and myo_sim.
"""

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stepper.envs
from stepper.envs import StepperEnv, Task

PAGE = Path(__file__).parents[2] / "docs/reference/tasks.md"
HEAD = """# Observations and actions

Columns of the observations and actions of all registered tasks. [Environments](environments.md) describes the tasks.

* "any" is every finite number. Ranges of observations are those after clipping.
* A row with several kinds of numbers has their units in their order.
* The unit of a motor's control is the force or torque of the control 1.
* `[k]` is the k-th number of a quantity, and `envs.observation_structure` has the rows and their sizes in Python.

`python tests/helpers/task_page.py` writes this page from the tasks.
"""
FAMILIES = {
    "Gymnasium's MuJoCo tasks": lambda name: name.endswith("-v5"),
    "dm_control's suite": lambda name: name.startswith("dm_control."),
    "MyoSuite's pose tasks": lambda name: name.startswith("myosuite."),
    "Legged robots": lambda name: "Velocity" in name or "Rough" in name,
    "Basic tasks": lambda name: True,
}
UNITS = {
    "cfrc_ext": "N m, N",
    "cinert": "kg m^2, kg m, kg",
    "cvel": "rad/s, m/s",
    "qfrc_actuator": "N or N m",
    "qfrc_constraint": "N or N m",
    "sensordata": "of the sensors",
}
"""Units of quantities of the stepper, but for those of single joints."""
AXES = ("x", "y", "z")
HEAD_OF = "## {}\n"


def page() -> str:
    """The whole page."""
    sections = {family: [HEAD_OF.format(family)] for family in FAMILIES}
    tables: dict[tuple[str, str], list[str]] = {}
    for name in sorted(name.removeprefix("stepper/") for name in gymnasium.registry if name.startswith("stepper/")):
        family = next(family for family, belongs in FAMILIES.items() if belongs(name))
        tables.setdefault((family, tables_of(f"stepper/{name}")), []).append(name)
    for (family, table), names in tables.items():
        sections[family].append(f"### {', '.join(names)}\n\n{table}")
    return "\n".join([HEAD, *("\n".join(parts) for parts in sections.values())])


def tables_of(name: str) -> str:
    """Tables of an environment's observations and actions."""
    arguments: dict[str, Any] = dict(gymnasium.spec(name).kwargs)
    with warnings.catch_warnings(action="ignore"):
        env = StepperEnv(arguments.pop("task"), **arguments)
    observations = table("observation", observation_rows(env))
    actions = table("action", action_rows(env))
    return f"{observations}\n{actions}"


def table(kind: str, rows: list[tuple[int, int, str, str, str]]) -> str:
    """A table in Markdown, of rows with the first index, the number of indices, name, unit and range."""
    lines = [f"| index | {kind} | unit | range |", "|---|---|---|---|"]
    for first, count, name, unit, bounds in rows:
        index = f"{first}" if count == 1 else f"{first} to {first + count - 1}"
        lines.append(f"| {index} | {name} | {unit} | {bounds} |")
    return "\n".join(lines) + "\n"


def observation_rows(env: StepperEnv) -> list[tuple[int, int, str, str, str]]:
    """Rows of the observation: one for each number of qpos and qvel, one for each other quantity."""
    rows, at = [], 0
    for row, width in zip(env.task.observations(), env.observation_structure.values(), strict=True):
        bounds = "any" if row.clip is None else f"{row.scale * row.clip[0]:g} to {row.scale * row.clip[1]:g}"
        if row.func is None and row.name in ("qpos", "qvel"):
            labels = coordinates(env.sim.model, row.name)[row.columns or slice(None)]
            rows += [(at + k, 1, f"{row.name}: {label}", unit, bounds) for k, (label, unit) in enumerate(labels)]
        else:
            unit = row.unit if row.func is not None else UNITS.get(row.name, "")
            part = (
                "" if row.columns is None else f"[{row.columns.start or 0}{f' to {row.columns.stop - 1}' if row.columns.stop else ' on'}]"
            )
            rows.append((at, width, row.name + part, unit, bounds))
        at += width
    return rows


def coordinates(model: stepper.Model, quantity: str) -> list[tuple[str, str]]:
    """Name and unit of each number of qpos or qvel."""
    found = []
    for joint in map(model.joint, range(model.njnt)):
        name = joint.name or f"joint {joint.id}"
        places = [(f"{name} {axis}", "m") for axis in AXES]
        turns = [(f"{name} quaternion {axis}", "") for axis in ("w", *AXES)]
        rates = [(f"{name} about {axis}", "rad/s") for axis in AXES]
        if quantity == "qpos":
            found += {"free": places + turns, "ball": turns, "slide": [(name, "m")], "hinge": [(name, "rad")]}[joint.type]
        else:
            speeds = [(label, "m/s") for label, _ in places]
            found += {"free": speeds + rates, "ball": rates, "slide": [(name, "m/s")], "hinge": [(name, "rad/s")]}[joint.type]
    return found


def action_rows(env: StepperEnv) -> list[tuple[int, int, str, str, str]]:
    """Rows of the actions: one for each actuator, or one for actions that are not controls."""
    space, model = env.action_space, env.sim.model
    ranges = [span(low, high) for low, high in zip(space.low, space.high, strict=True)]
    own = type(env.task).action_bounds is not Task.action_bounds
    if own and len(ranges) != model.nu:
        return [(0, len(ranges), "action", "", ranges[0])]
    rows = []
    for actuator, bounds in zip(map(model.actuator, range(model.nu)), ranges, strict=True):
        name, unit = actuator_name(model, actuator), "" if own else actuator_unit(model, actuator)
        rows.append((actuator.id, 1, name, unit, bounds))
    return rows


def span(low: float, high: float) -> str:
    """Range in words."""
    return f"{low:g} to {high:g}" if np.isfinite([low, high]).all() else "any"


def actuator_name(model: stepper.Model, actuator: Any) -> str:
    """Name of an actuator, or what it moves."""
    names = {"joint": model.joint_names, "tendon": model.tendon_names, "site": model.site_names}
    return actuator.name or names[actuator.trntype][actuator.trnid] or f"actuator {actuator.id}"


def actuator_unit(model: stepper.Model, actuator: Any) -> str:
    """Unit of a control: that of the position for servos, a number of N or N m for motors."""
    kind = model.joint(actuator.trnid).type if actuator.trntype == "joint" else actuator.trntype
    servo, turns = actuator.biasprm[1] != 0.0, kind in ("hinge", "ball", "free")
    if servo:
        return "" if kind in ("tendon", "site") else "rad" if turns else "m"
    return f"{actuator.gainprm[0] * actuator.gear[0]:g} {'N m' if turns else 'N'}"


if __name__ == "__main__":
    PAGE.write_text(page())

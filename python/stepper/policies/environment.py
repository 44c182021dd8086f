"""Description of an environment's settings, which is stored with a policy and compared with other environments."""

from __future__ import annotations

import dataclasses
import json
import platform
from collections.abc import Iterator
from typing import Any

import numpy as np

from stepper._stepper import __version__
from stepper.shared.machine import package_version

Description = dict[str, Any]
"""Settings as JSON data: numbers, strings, lists and dictionaries."""

_PACKAGES = ("gymnasium", "mujoco-core", "numpy")
"""Packages whose versions are settings of an environment."""
_LONGEST = 60
"""Largest number of characters of a setting's value in the text of a difference; longer values are cut."""


def describe(env: Any) -> Description:
    """Returns the settings of a single or vector environment.

    Args:
        env: Environment of `stepper.envs`, or MuJoCo environment of Gymnasium. For other environments, the result has only spaces and
            versions.

    Returns:
        Dictionary with engine and versions; the task with its arguments; name and digest of the model; options, time step and steps per
        action; precision; structure of the observation; bounds of the actions; models of actuators and sensors. The key "randomized" has
        the parameters that were set by `Stepper.randomize`: the smallest and largest value of each element over the environments.
    """
    base = env.unwrapped
    base = base.envs[0].unwrapped if hasattr(base, "envs") else base
    found = _of_stepper(base) if hasattr(base, "sim") else _of_mujoco(base) if hasattr(base, "model") else _of_other(base)
    space = getattr(base, "single_action_space", base.action_space)
    found["action"] = {"low": np.asarray(space.low, float).tolist(), "high": np.asarray(space.high, float).tolist()}
    versions = {name: version for name in _PACKAGES if (version := package_version(name))}
    found["versions"] = {"stepper": __version__, "python": platform.python_version()} | versions
    plain: Description = json.loads(json.dumps(found, default=_plain))  # Tuples become lists, as after reading from a file.
    return plain


def _plain(value: Any) -> Any:
    """Conversion for `json.dumps` of values that JSON cannot represent: lists for arrays, and `repr` for anything else."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else repr(value)


def _of_stepper(base: Any) -> Description:
    """Settings of an environment of `stepper.envs`, before conversion to JSON data."""
    sim, task = base.sim, base.task
    options = dataclasses.asdict(sim.options) | {"timestep": sim.timestep, "tolerance": sim.tolerance}
    options["integrator"] = options["integrator"] or ("midpoint" if options["contact"] == "hard" else "of the model")
    drives = sim.randomized.get("actuators")
    numbers = {name: np.asarray(values) for name, values in sim.randomized.items() if name != "actuators"}
    ranges = {name: {"min": n.min(axis=0).tolist(), "max": n.max(axis=0).tolist()} for name, n in numbers.items()}
    return {
        "engine": "stepper",
        "task": {
            "name": type(task).__name__,
            **(dataclasses.asdict(task) if dataclasses.is_dataclass(task) and not isinstance(task, type) else {}),
        },
        "rewards": base.reward_weights,
        "model": {"name": sim.model.name, "sha256": sim.model.digest},
        "options": options,
        "frame_skip": task.frame_skip,
        "precision": sim.precision,
        "observation": dict(of_policy(base.observation_structure)),
        "randomized": ranges,
        "drives": "drawn for each environment" if drives is not None else None,
        "actuators": None if sim.actuators is None else sim.actuators.to_dict(),
        "sensors": None if sim.sensors is None else sim.sensors.to_dict(),
    }


def of_policy(value: Any) -> Any:
    """Part for the policy of a dictionary or space by observation group; the argument itself if there are no groups."""
    groups = getattr(value, "spaces", value)
    return groups["policy"] if isinstance(groups, dict) and not isinstance(groups.get("policy", 0), int) else value


def _of_mujoco(base: Any) -> Description:
    """Settings of a MuJoCo environment of Gymnasium. The digest of the model is absent, because stepper's digests are not comparable."""
    option = base.model.opt
    integrators = ("euler", "rk4", "implicit", "implicitfast", "discrete")
    return {
        "engine": "MuJoCo",
        "task": {"name": type(base).__name__.removesuffix("Env")},
        "options": {
            "contact": "mujoco",
            "timestep": float(option.timestep),
            "integrator": integrators[int(option.integrator)],
            "iterations": int(option.iterations),
            "tolerance": float(option.tolerance),
        },
        "frame_skip": base.frame_skip,
        "precision": "f64",
        "observation": {"size": int(base.observation_space.shape[0])},
        "randomized": {},
    }


def _of_other(base: Any) -> Description:
    """Settings of an environment on an engine other than stepper and MuJoCo: name of its class and size of the observation."""
    space = getattr(base, "single_observation_space", base.observation_space)
    return {"engine": type(base).__name__, "observation": {"size": int(space.shape[0])}}


def differences(one: Description, other: Description) -> list[str]:
    """Returns the differences between the settings of two environments, such as "options.contact: 'mujoco' there, 'hard' here".

    A setting that only one environment has also counts, except if the engines differ. Randomised parameters count only if the second
    environment has any, because tasks draw them at the first reset.

    Args:
        one: Result of `describe` for the first environment, "there".
        other: Result of `describe` for the second environment, "here".

    Returns:
        One line per difference.
    """
    if not other.get("randomized"):
        one = {name: value for name, value in one.items() if name != "randomized"}
    there, here = dict(_leaves(one)), dict(_leaves(other))
    names = sorted(there.keys() | here.keys()) if one.get("engine") == other.get("engine") else sorted(there.keys() & here.keys())
    return [f"{name}: {_text(there, name)} there, {_text(here, name)} here" for name in names if there.get(name) != here.get(name)]


def _leaves(description: Description, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields dotted path and value of every entry of nested dictionaries that is not a dictionary itself."""
    for name, value in description.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def _text(leaves: dict[str, Any], name: str) -> str:
    """Value of a setting as text, shortened to 60 characters; "nothing" if the setting is missing."""
    if name not in leaves:
        return "nothing"
    text = repr(leaves[name])
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."

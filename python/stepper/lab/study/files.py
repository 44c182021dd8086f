"""Studies from files: TOML, or Python with a `Study` named `study`. docs/reference/studies.md has all keys."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepper._hints import did_you_mean
from stepper._options import Options
from stepper.actuators import ActuatorModel
from stepper.lab.study.controllers import PolicyController, find, load_file
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import Parameter
from stepper.policies import load
from stepper.sensors import SensorModel
from stepper.shared.files import existing
from stepper.shared.tables import read_file

if TYPE_CHECKING:
    from stepper.lab.study.study import Study


def check_keys(given: Iterable[str], known: Collection[str], place: str) -> None:
    """Raises ValueError for unknown entries of a table in a study file; the message has similar known entries."""
    unknown = sorted(set(given) - set(known))
    if unknown:
        guesses = "".join(did_you_mean(name, known) for name in unknown[:1])
        raise ValueError(f"{place} has unknown entries {unknown}{guesses or ','} it may have: {', '.join(sorted(known))}")


def read_study(path: Path, kind: type[Study]) -> Study:
    """Study from a TOML or Python file, for `Study.from_file`. `kind` is the class `Study`."""
    existing(path, "study")
    if path.suffix == ".py":
        module = load_file(path)
        study = getattr(module, "study", None)
        if not isinstance(study, kind):
            raise ValueError(f"{path}: it has no stepper.lab.Study named study")
        # The default name is that of the file, as in TOML.
        return replace(study, name=path.stem) if study.name == kind.name else study
    if path.suffix not in (".toml", ".json"):
        raise ValueError(f"{path} is no study: give a study's file, whose name ends in .toml or .py")
    data = read_file(path)
    try:
        return _made(data, path, kind)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _made(data: dict[str, Any], path: Path, kind: type[Study]) -> Study:
    """Study from the contents of a TOML file."""
    folder, given = path.resolve().parent, dict(data)
    known = {field.name for field in fields(kind) if not field.name.startswith("_")} | {"policy"}
    check_keys(given, known, "the study")
    if "model" not in given:
        raise ValueError("model is missing: give the path of an MJCF, URDF or saved model")
    given.setdefault("name", path.stem)
    given["model"] = _model(given["model"], folder)
    if "policy" in given:
        if "controller" in given:
            raise ValueError("give controller or policy, not both")
        given["controller"] = _policy(given.pop("policy"), folder)
    elif given.get("controller") not in (None, "random"):
        given["controller"] = _controller(given["controller"], folder)
    if "start" in given:
        given["start"] = find(given["start"], folder)
    if "outcomes" in given:
        if not isinstance(given["outcomes"], list):
            raise TypeError(f"outcomes is {given['outcomes']!r}, must be tables: begin each with the line [[outcomes]]")
        given["outcomes"] = [_part(Outcome, _measured(table, folder), f"outcome {k + 1}") for k, table in enumerate(given["outcomes"])]
    given["parameters"] = _parameters(given.get("parameters", {}))
    if "options" in given:
        given["options"] = _part(Options, given["options"], "options")
    for name, model in (("sensors", SensorModel), ("actuators", ActuatorModel)):
        if name in given:
            own = given[name]
            given[name] = model.from_file(folder / own) if isinstance(own, str) else model.from_dict(_tables(own, name), name)
    return kind(**given)


def _tables(own: dict[str, Any], name: str) -> dict[str, Any]:
    """Dictionary for `SensorModel.from_dict` or `ActuatorModel.from_dict` from a table of a study file."""
    return {name: {k: v for k, v in own.items() if k != "default"}} | ({"default": own["default"]} if "default" in own else {})


def _model(source: str, folder: Path) -> Any:
    """Source of a model from its text in a study file: MJCF text, a function, or a path relative to the folder."""
    if "<" in source:
        return source
    if ":" in source and not os.path.exists(folder / source):
        return find(source, folder)
    return str(folder / source)


def _policy(source: str, folder: Path) -> PolicyController:
    """Controller from the entry `policy` of a study file."""
    if source.endswith(".npz"):
        return PolicyController(load(folder / source))
    found = find(source, folder)
    return PolicyController(found() if isinstance(found, type) else found)


def _controller(source: str, folder: Path) -> Callable[[Any], Any]:
    """Controller from the entry `controller` of a study file."""
    found: Callable[[Any], Any] = find(source, folder)
    # A controller with internal state is an object of the class that the file names.
    return found() if isinstance(found, type) else found


def _measured(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Copy of the table of an outcome in a study file, with the measure function instead of its name "file.py:function"."""
    measure = table.get("measure", "")
    return table | {"measure": find(measure, folder)} if ":" in measure else table


def _parameters(tables: Any) -> dict[str, Parameter]:
    """Parameters of a study from the tables of its file, by name."""
    if not isinstance(tables, dict):
        raise TypeError(f"parameters is {tables!r}, must be tables: begin each with a line such as [parameters.friction]")
    return {name: _part(Parameter, table, f"parameter {name!r}") for name, table in tables.items()}


def _part(kind: type[Any], table: Any, place: str) -> Any:
    """Object of a dataclass, from a table of a study file."""
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table")
    known = {field.name for field in fields(kind)}
    check_keys(table, known, place)
    required = [field.name for field in fields(kind) if field.default is MISSING and field.default_factory is MISSING]
    if missing := [name for name in required if name not in table]:
        raise ValueError(f"{place} has no {missing[0]}: add {missing[0]} = ...")
    try:
        return kind(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{place}: {error}") from None

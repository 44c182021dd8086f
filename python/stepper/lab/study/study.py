"""Definition of a study (`stepper.lab.Study`): model, controller, outcomes and parameters; studies from files."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Protocol, get_args, get_type_hints, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stepper import _stepper
from stepper._hints import did_you_mean
from stepper._options import Options, Precision
from stepper._stepper import Model, __version__
from stepper.actuators import ActuatorModel
from stepper.lab.study import controllers
from stepper.lab.study.batches import USUAL
from stepper.lab.study.episode import Episodes
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import CHOICES, OF_MODEL, SETTINGS, Parameter, Value, Values, check, check_value_conflicts, with_nominal
from stepper.lab.study.worlds import MUJOCO_SETTINGS, World, check_mujoco
from stepper.loading import Origin, compile_source, is_saved, load
from stepper.policies import load as load_policy
from stepper.sensors import SensorModel
from stepper.shared.arguments import check_file_name, check_mapping, check_number, check_takes, check_whole, path_of
from stepper.shared.files import existing
from stepper.shared.machine import package_version, require
from stepper.shared.tables import read_file

Array = NDArray[np.float64]
Start = Callable[[World, list[np.random.Generator]], tuple[Any, Any]]
"""Function of a `World` and a list of one random number generator per environment.

It returns the initial qpos (num_envs, nq), m and rad, and qvel (num_envs, nv), m/s and rad/s.
"""

_HOLD = 0.02
"""Default control period, s."""
_ROWS = 5
"""Version of the rows (results of episodes), which is part of the rows' keys in the journal.

It increases when the same study gives other rows. Changes by version:

2: Episodes that diverge have no outcome. 3: Inverse weights of MuJoCo's law follow masses, inertias, centres of mass and armatures.
4: Rows name the values of parameters "parameters". 5: Rows name the quality of steps "quality".
"""


class _Source:
    """Source of a study's model, which is loaded at the first use. Copies of a study by `dataclasses.replace` share it."""

    def __init__(self, model: Any):
        self.model = model

    @cached_property
    def loaded(self) -> tuple[Model, Any]:
        """Model, and `mujoco.MjModel` of the same source (None for saved models and models made in code)."""
        source = self.model() if callable(self.model) else self.model
        if isinstance(source, Model):
            return source, None
        with warnings.catch_warnings():
            # The report lists these warnings.
            warnings.simplefilter("ignore")
            compiled = None if is_saved(source) else compile_source(Origin(source))
            return load(source if compiled is None else compiled, strict=False), compiled


@runtime_checkable
class Trajectories(Protocol):
    """Measured trajectories of a real system, `stepper.lab.MeasuredTrajectories`, as a study uses them."""

    @property
    def qpos(self) -> NDArray[np.float64]:
        """Measured positions, (episodes, control periods, nq), m and rad."""

    @property
    def noise(self) -> float | NDArray[np.float64]:
        """Standard deviation of the measured positions, a number or (nq,), m and rad."""

    def section(self, study: Study) -> Any:
        """Section of the report with the distances of the study's runs from the measured trajectories."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Simulation experiment: episodes of a model with a controller, measured outcomes and uncertain parameters.

    If selectors or measures contain names of elements, the constructor loads the model to check them.

    Attributes:
        model: Source of the model, as for `stepper.load`, or a `Model`, or a function that returns one of these.
        name: Name in tables and of the folder of results; for studies in files the default is the name of the file.
        controller: Source of the controls: a function of a `World`, `PolicyController(function)`, or "random". None
            keeps the controls of the keyframe, or 0.
        outcomes: Measured results of an episode, of which at most one has a condition of success. `chart` and `tune` need no outcome.
        parameters: Uncertain parameters by name.
        settings: Alternative settings for the same episodes, by name. Each entry has attributes of `Options` and "precision". An entry with
            {"engine": "mujoco"} runs in MuJoCo. It has MuJoCo's settings instead: integrator, cone, solver, impratio, noslip_iterations,
            iterations, tolerance, timestep.
        seconds: Length of an episode, s.
        control: Control period, s, which all settings share. None selects the multiple of the model's time step that is nearest to 20 ms.
        episodes: Number of episodes at each point (set of parameter values).
        seed: Seed of all random numbers. Episode k has the same initial state, random controls and sensor errors at every point.
        start: Function that returns the initial states. None starts at the keyframe, or without a keyframe at the reference pose.
        keyframe: Keyframe of the initial state, by name or index.
        qpos_noise: Standard deviation of noise on initial positions, m and rad.
        qvel_noise: Standard deviation of noise on initial velocities, m/s and rad/s.
        options: Options of the step.
        precision: "f64" or "f32".
        sensors: Errors of the sensors; None leaves the sensors ideal.
        actuators: Drives of the actuators; None leaves the actuators ideal.
        batch: Largest number of episodes that are stepped together. With a sensor model all episodes of a point are stepped together,
            because sensor errors depend on the index in a batch.
        threads: Number of threads that step environments; 0 uses all cores.
        trajectories: Measured trajectories of the episodes, in their order: the ground truth of `chart`, `tune` and `report`.
    """

    model: Any
    name: str = "study"
    controller: Any = None
    outcomes: Outcome | Sequence[Outcome] | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = 1.0
    control: float | None = None
    episodes: int = 8
    seed: int = 0
    start: Start | None = None
    keyframe: str | int | None = None
    qpos_noise: float = 0.0
    qvel_noise: float = 0.0
    options: Options = field(default_factory=Options)
    precision: Precision = "f64"
    sensors: SensorModel | None = None
    actuators: ActuatorModel | None = None
    batch: int = 256
    threads: int = 1
    trajectories: Trajectories | None = None
    _source: _Source | None = field(default=None, repr=False, compare=False)

    def _check_functions(self) -> None:
        """Raises an error unless controller and start are functions that can be called with the right arguments."""
        if not (self.controller is None or self.controller == "random" or callable(self.controller)):
            raise TypeError(f'controller is {self.controller!r}, must be a function, PolicyController, "random" or None')
        if not (self.start is None or callable(self.start)):
            raise TypeError(f'start is {self.start!r}, must be a function or None: "file.py:function" works only in TOML files')
        for name, arguments in (("controller", ["now"]), ("start", ["now", "rngs"])):
            if callable(function := getattr(self, name)):
                check_takes(function, arguments, name)
        if callable(self.model) and not isinstance(self.model, type):
            check_takes(self.model, [], "model")

    def __post_init__(self) -> None:
        source = self._source if self._source is not None and self._source.model is self.model else _Source(self.model)
        object.__setattr__(self, "_source", source)
        self._check_kinds()
        object.__setattr__(self, "parameters", dict(self.parameters))
        object.__setattr__(self, "settings", {name: dict(given) for name, given in self.settings.items()})
        self._check_numbers()
        self._check_functions()
        names = [outcome.name for outcome in self.all_outcomes]
        if len(set(names)) < len(names):
            raise ValueError(f"outcomes have the names {names}, which must differ: rename one")
        decisive = [outcome.name for outcome in self.all_outcomes if outcome.success is not None]
        if len(decisive) > 1:
            raise ValueError(f"outcomes {decisive} have a success, must be one at most: combine the measures, or leave out a success")
        if USUAL in self.settings:
            raise ValueError(f"settings has the name {USUAL!r}, which stands for the study's options: choose another name")
        for name, given in self.settings.items():
            self.setting(name, given)
        _check_options({"precision": self.precision})
        if any(isinstance(o.measure, str) for o in self.all_outcomes) or any(p.kind in OF_MODEL for p in self.parameters.values()):
            _ = self.loaded

    def _check_numbers(self) -> None:
        """Raises TypeError or ValueError if the name or a number of the study is of another type, or out of its range."""
        check_file_name("name", self.name, "the folder of the results")
        check_number("seconds", self.seconds, above=0.0)
        if self.control is not None:
            check_number("control", self.control, above=0.0, most=self.seconds)
        for name in ("qpos_noise", "qvel_noise"):
            check_number(name, getattr(self, name), least=0.0)
        for name, least in (("episodes", 1), ("batch", 1), ("seed", 0), ("threads", 0)):
            check_whole(name, getattr(self, name), least=least)

    def _check_kinds(self) -> None:
        """Raises TypeError or ValueError if outcomes or parameters have wrong types."""
        if self.outcomes is not None and not isinstance(self.outcomes, Outcome):
            if isinstance(self.outcomes, str) or not isinstance(self.outcomes, Sequence):
                raise TypeError(f"outcomes is {self.outcomes!r}, must be a stepper.lab.Outcome or a list of them")
            if not self.outcomes:
                raise ValueError(f"outcomes is {self.outcomes!r}, so the study has no outcome: give one, or leave outcomes out")
        for outcome in self.all_outcomes:
            if not isinstance(outcome, Outcome):
                raise TypeError(f"outcomes has {outcome!r}, must be a stepper.lab.Outcome, as Outcome(name=..., measure=...)")
        check_mapping("settings", self.settings, '{"fast": {"integrator": "euler"}}')
        for name, setting in self.settings.items():
            check_mapping(f"settings {name!r}", setting, '{"integrator": "euler"}')
        if not isinstance(self.parameters, Mapping):
            raise TypeError(f"parameters is {self.parameters!r}, must be a dict of stepper.lab.Parameter by name")
        if not isinstance(self.trajectories, Trajectories | None):
            raise TypeError("trajectories must be stepper.lab.MeasuredTrajectories(qpos, noise) or None, so give them in a study in Python")
        for name, kind in (("options", Options), ("sensors", SensorModel), ("actuators", ActuatorModel)):
            value = getattr(self, name)
            if not isinstance(value, kind) and not (value is None and name != "options"):
                given = ", ".join(f"{key}=..." for key in value) if isinstance(value, Mapping) and name == "options" else "..."
                raise TypeError(f"{name} is {value!r}, must be a stepper.{kind.__name__}: write stepper.{kind.__name__}({given})")
        for name, parameter in self.parameters.items():
            if not isinstance(parameter, Parameter):
                raise TypeError(
                    f"parameter {name!r} is {parameter!r}, must be a stepper.lab.Parameter: Parameter(selector, low=..., high=...)"
                )

    @classmethod
    def from_model(cls, source: Any, **changed: Any) -> Study:
        """Returns a study of a model, with random controls and small random initial velocities.

        Args:
            source: Source of a model, as for `stepper.load`. A study, or the file of one, is also accepted and returned with the changes.
            **changed: Attributes of the study to set.
        """
        if isinstance(source, Study):
            return replace(source, **changed)
        if isinstance(source, str | Path) and str(source).endswith((".toml", ".py")):
            return replace(cls.from_file(source), **changed)
        name = Path(str(source)).stem if isinstance(source, str | Path) and "<" not in str(source) else "model"
        return cls(**({"model": source, "name": name, "controller": "random", "qvel_noise": 0.01} | changed))

    @classmethod
    def from_file(cls, path: str | Path, data: str | Path | None = None) -> Study:
        """Reads a study from a TOML file, or from a Python file that defines a `Study` named `study`, or a function that returns one.

        Args:
            path: The file.
            data: Folder of the data that the function `study` of a Python file reads, its argument.

        Raises:
            ValueError: The file does not contain a valid study, or its study lacks or takes no data; the message has its path.
        """
        path = existing(path_of("path", path), "study")
        study = getattr(controllers.load_file(path), "study", None) if path.suffix == ".py" else None
        if callable(study) != (data is not None):
            words = "needs data: give their folder with" if data is None else "takes no data: leave out"
            raise ValueError(f"{path}: its study {words} --data, in Python data=")
        if path.suffix == ".py":
            if data is not None and callable(study):
                check_takes(study, ["data"], "study")
                study = study(path_of("data", data))
            if not isinstance(study, Study):
                raise ValueError(f"{path}: it has no stepper.lab.Study named study")
            # The default name is that of the file, as in TOML.
            return replace(study, name=path.stem) if study.name == cls.name else study
        if path.suffix not in (".toml", ".json"):
            raise ValueError(f"{path} is no study: give a study's file, whose name ends in .toml or .py")
        described = read_file(path)
        try:
            return _made(described, path)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from error

    @cached_property
    def loaded(self) -> tuple[Model, Any]:
        """Model, and `mujoco.MjModel` of the same source (None for saved models and models made in code).

        Raises:
            ModelError: The model cannot be loaded.
            ValueError: A parameter or measure names an element that the model does not have.
        """
        assert self._source is not None
        model, compiled = self._source.loaded
        check(self.parameters, model)
        for outcome in self.all_outcomes:
            outcome.check(model)
        return model, compiled

    @cached_property
    def control_period(self) -> float:
        """Control period, s: the time between two calls of the controller."""
        if self.control is not None:
            return self.control
        timestep = self.options.timestep or float(self.loaded[0].timestep)
        return min(max(1, round(_HOLD / timestep)) * timestep, self.seconds)

    @property
    def num_control_steps(self) -> int:
        """Number of control periods in an episode."""
        return max(1, round(self.seconds / self.control_period))

    @property
    def all_outcomes(self) -> tuple[Outcome, ...]:
        """Outcomes of the study as a tuple."""
        return (self.outcomes,) if isinstance(self.outcomes, Outcome) else tuple(self.outcomes or ())

    @property
    def success_outcome(self) -> Outcome | None:
        """Outcome with the condition of success; None if no outcome has one."""
        return next((outcome for outcome in self.all_outcomes if outcome.success is not None), None)

    @property
    def nominal(self) -> dict[str, Any]:
        """Nominal values of the parameters, by name; parameters without a nominal value are left out."""
        return {name: p.nominal for name, p in self.parameters.items() if p.nominal is not None}

    def batch_controller(self) -> Any:
        """Returns the controller for the next batch of episodes: a function of a `World`, or None, which keeps the initial controls.

        For the controller "random" it is a new object whose random numbers start from the beginning.
        """
        return controllers.Random(self.seed) if isinstance(self.controller, str) else self.controller

    def setting(self, name: str, given: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Returns the alternative settings of a given name: values of the changed options of the step, by name of the option.

        The result is empty for the name "stepper", which stands for the options of the study itself.

        Args:
            name: Name of the settings.
            given: Settings that are checked and returned in place of the study's. None returns the study's settings of this name.

        Raises:
            ValueError: There are no settings of this name, or an option is unknown.
        """
        if not isinstance(name, str):
            raise TypeError(f"setting is {name!r}, must be the name of settings of the study, as {USUAL!r}")
        if name == USUAL:
            return {}
        if given is None:
            if name not in self.settings:
                raise ValueError(f"there are no settings {name!r}, there are: {', '.join([USUAL, *self.settings])}")
            return dict(self.settings[name])
        own = {key: value for key, value in given.items() if key != "engine"}
        if given.get("engine", "stepper") not in ("stepper", "mujoco"):
            raise ValueError(f'settings {name!r}: engine is {given["engine"]!r}, must be "stepper" or "mujoco"')
        try:
            if given.get("engine") == "mujoco":
                installed = package_version("mujoco-core") is not None
                check_mujoco(own, require("mujoco", "to run a study in MuJoCo") if installed else None)
            else:
                _check_options(own)
        except ValueError as error:
            raise ValueError(f"settings {name!r}: {error}") from None
        return dict(given)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Values and digests of the study (JSON types) on which the results of an episode depend.

        An episode's results also depend on its parameter values, its settings and its number, which are not included.
        """
        model, _ = self.loaded
        measured = [
            {
                **{f.name: getattr(o, f.name) for f in fields(o) if f.name != "measure"},
                "measure": controllers.name_of(o.measure),
                "sha256": controllers.digest_of(o.measure),
            }
            for o in self.all_outcomes
        ]
        return {
            "rows": _ROWS,
            "model": {"name": model.name, "sha256": model.digest, "omitted": len(model.omitted)},
            "controller": {"name": controllers.name_of(self.controller), "sha256": controllers.digest_of(self.batch_controller())},
            "start": {"name": controllers.name_of(self.start), "sha256": controllers.digest_of(self.start), "keyframe": self.keyframe},
            "noise": [self.qpos_noise, self.qvel_noise],
            "outcomes": measured,
            "seconds": self.seconds,
            "control": self.control_period,
            "seed": self.seed,
            "options": asdict(self.options),
            "precision": self.precision,
            "sensors": self.sensors.to_dict() if self.sensors else None,
            "actuators": self.actuators.to_dict() if self.actuators else None,
            "versions": {"stepper": __version__, "numpy": np.__version__, "mujoco": package_version("mujoco-core")},
        }

    @property
    def notes(self) -> list[str]:
        """Elements of the model's source that stepper leaves out, and settings of the source that the default options do not use."""
        model, _ = self.loaded
        left = [f"{kind} {name}: {reason}" for kind, name, reason in model.omitted]
        return left + [f"set in the file, not used by the default options: {line}" for line in model.deviations]

    def resolved_settings(self) -> dict[str, Any]:
        """Returns provenance of the study's results: `identity`, machine, interpreter, digest of the binary, and `notes`."""
        return self._resolved_settings

    @cached_property
    def _resolved_settings(self) -> dict[str, Any]:
        binary = hashlib.sha256(Path(_stepper.__file__).read_bytes()).hexdigest()
        return self.identity | {
            "notes": self.notes,
            "compiled": self._compiled_digest,
            "python": platform.python_version(),
            "system": sys.platform,
            "machine": platform.machine(),
            "binary": binary,
        }

    @cached_property
    def _compiled_digest(self) -> str | None:
        """SHA-256 of the study's `mujoco.MjModel`, which includes settings that stepper leaves out; None if there is no `MjModel`."""
        compiled = self.loaded[1]
        if compiled is None:
            return None
        mujoco = require("mujoco", "to run a study in MuJoCo")
        buffer = np.zeros(mujoco.mj_sizeModel(compiled), np.uint8)
        mujoco.mj_saveModel(compiled, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    def key(self, values: Values, setting: str, episode: int) -> str:
        """Returns the key of the row (result) of an episode in the journal: a digest of everything on which the result depends.

        Args:
            values: Values of the parameters by name.
            setting: Name of the settings.
            episode: Number of the episode.
        """
        given = self.setting(setting)
        # Only keys of MuJoCo's rows contain this digest: a change of the model that stepper does not read leaves stepper's keys unchanged.
        compiled = [self._compiled_digest] if given.get("engine") == "mujoco" else []
        own = {name: [value, str(p.parsed), p.operation] for name, value in sorted(values.items()) for p in [self.parameters[name]]}
        return _digest([self._identity_digest, own, given, episode, *compiled])

    @cached_property
    def _identity_digest(self) -> str:
        return _digest(self.identity)

    def episode(
        self,
        values: Mapping[str, Value] | None = None,
        number: int = 0,
        *,
        seed: int | None = None,
        setting: str = USUAL,
        record: str | os.PathLike[str] | None = None,
    ) -> dict[str, Any]:
        """Runs one episode. Its results equal those in the tables of `sweep`, `report` and `rank`, bit for bit.

        Args:
            values: Values of parameters, by name or selector; the others are nominal.
            number: Number of the episode, which determines its initial state, random controls and sensor errors.
            seed: Seed; None keeps the seed of the study.
            setting: Name of the settings.
            record: New folder for a recording, which `stepper view` shows and `stepper.recording.verify` repeats. It has a row for every
                control period. With a sensor model, it has an environment for every episode of the point.

        Returns:
            Row of the episode: "parameters" (values by name), "outcomes" by name, "success", "quality" (worst status, residual and
            violations of its steps), "settings" of the engine.

        Raises:
            ValueError: A parameter, value, name of settings or episode is invalid, or `record` is given with settings that run in MuJoCo.
            FileExistsError: The folder is not empty.
        """
        study = self if seed is None else replace(self, seed=seed)
        (row,) = Episodes(study, values or {}, [number], setting).rows(record)
        return row

    def at(self, values: Mapping[str, Value]) -> Study:
        """Returns a copy of the study with other nominal values.

        Args:
            values: Values (numbers or texts) by name of a parameter, or by selector, such as "geom_friction[floor][0]".

        Raises:
            ValueError: A parameter is unknown, a value is invalid, or two parameters set the same number to different values.
        """
        check_mapping("values", values, '{"friction": 0.5}')
        made = replace(self, parameters=with_nominal(self.parameters, values))
        if len(values) > 1:
            check_value_conflicts({name: made.parameters[name] for name in values}, made.loaded[0], values)
        return made

    def generators(self, episodes: Sequence[int]) -> list[np.random.Generator]:
        """Returns the random number generator of the initial state of each episode."""
        return [np.random.default_rng([self.seed, int(e), 0]) for e in episodes]


def _check_options(given: Mapping[str, Any]) -> None:
    """Raises ValueError for unknown options of the step, and for words that an option cannot have. A `Stepper` checks numbers."""
    if unknown := sorted(given.keys() - SETTINGS):
        of_mujoco = '; MuJoCo has it: add engine = "mujoco",' if unknown[0] in MUJOCO_SETTINGS else ""
        hint = of_mujoco or did_you_mean(unknown[0], SETTINGS) or ","
        raise ValueError(f"unknown {unknown}{hint} must be one of: {', '.join(sorted(SETTINGS))}")
    for name, words in _words().items():
        if name in given and given[name] not in words:
            listed = [repr(word) for word in words if word is not None]
            guess = did_you_mean(str(given[name]), [str(word) for word in words])
            raise ValueError(f"{name} is {given[name]!r}{guess or ','} must be one of: {', '.join(listed)}")


@cache
def _words() -> dict[str, tuple[Any, ...]]:
    """Allowed values of each option of the step whose values are texts, by name of the option.

    Values include None for options in which None selects a default.
    """
    hints = get_type_hints(Options) | {"precision": Precision}
    return {name: tuple(word for part in (get_args(hints[name]) or ()) for word in _members(part)) for name in CHOICES}


def _members(part: Any) -> tuple[Any, ...]:
    """Allowed values of an option from one part of its type annotation: the words of a Literal, None for `NoneType`, or the part itself."""
    return get_args(part) or ((None,) if part is type(None) else (part,))


def _digest(value: Any) -> str:
    """Digest of a value of JSON: 32 hexadecimal digits."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:32]


def _check_keys(given: Iterable[str], known: Collection[str], place: str) -> None:
    """Raises ValueError for unknown entries of a table in a study file; the message has similar known entries."""
    unknown = sorted(set(given) - set(known))
    if unknown:
        guesses = "".join(did_you_mean(name, known) for name in unknown[:1])
        raise ValueError(f"{place} has unknown entries {unknown}{guesses or ','} it may have: {', '.join(sorted(known))}")


def _made(data: dict[str, Any], path: Path) -> Study:
    """Study from the contents of a TOML file."""
    folder, given = path.resolve().parent, dict(data)
    known = {field.name for field in fields(Study) if not field.name.startswith("_")} | {"policy"}
    _check_keys(given, known, "the study")
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
        given["start"] = controllers.find(given["start"], folder)
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
    return Study(**given)


def _tables(own: dict[str, Any], name: str) -> dict[str, Any]:
    """Dictionary for `SensorModel.from_dict` or `ActuatorModel.from_dict` from a table of a study file."""
    return {name: {k: v for k, v in own.items() if k != "default"}} | ({"default": own["default"]} if "default" in own else {})


def _model(source: str, folder: Path) -> Any:
    """Source of a model from its text in a study file: MJCF text, a function, or a path relative to the folder."""
    if "<" in source:
        return source
    if ":" in source and not os.path.exists(folder / source):
        return controllers.find(source, folder)
    return str(folder / source)


def _policy(source: str, folder: Path) -> controllers.PolicyController:
    """Controller from the entry `policy` of a study file."""
    if source.endswith(".npz"):
        return controllers.PolicyController(load_policy(folder / source))
    found = controllers.find(source, folder)
    return controllers.PolicyController(found() if isinstance(found, type) else found)


def _controller(source: str, folder: Path) -> Callable[[Any], Any]:
    """Controller from the entry `controller` of a study file."""
    found: Callable[[Any], Any] = controllers.find(source, folder)
    # A controller with internal state is an object of the class that the file names.
    return found() if isinstance(found, type) else found


def _measured(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Copy of the table of an outcome in a study file, with the measure function instead of its name "file.py:function"."""
    measure = table.get("measure", "")
    return table | {"measure": controllers.find(measure, folder)} if ":" in measure else table


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
    _check_keys(table, known, place)
    required = [field.name for field in fields(kind) if field.default is MISSING and field.default_factory is MISSING]
    if missing := [name for name in required if name not in table]:
        raise ValueError(f"{place} has no {missing[0]}: add {missing[0]} = ...")
    try:
        return kind(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{place}: {error}") from None

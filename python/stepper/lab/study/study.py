"""`stepper.lab.Study`: a model, what drives it, what counts, and what may be otherwise; run in lanes, kept in a journal."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper import _stepper
from stepper._hints import Hinting, hint_keywords, near
from stepper._options import Options, Precision
from stepper._stepper import Model, __version__
from stepper.actuators import ActuatorModel
from stepper.lab.study import drives
from stepper.lab.study.episode import Episodes
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import OF_MODEL, Parameter, Theta, Value, check, moved
from stepper.lab.study.points import USUAL
from stepper.lab.study.worlds import World
from stepper.loading import compile_source, is_saved, load
from stepper.sensors import SensorModel
from stepper.shared.machine import package_version, require

Array = NDArray[np.float64]
Start = Callable[[World, list[np.random.Generator]], tuple[Any, Any]]
"""From a `World` and a generator for every environment, qpos (num_envs, nq) and qvel (num_envs, nv)."""

Exact = Callable[[World, Array], tuple[Any, Any]]
"""From a `World` at the start and times (T,) in s from 0 on, qpos (T, num_envs, nq) and qvel (T, num_envs, nv)."""

_HOLD = 0.02
"""s that a control is held where a study does not say it."""
_ROWS = 3
"""Part of what a row follows from: another number where the same study gives other rows.

2: Episodes that diverge have no outcome. 3: Inverse weights of MuJoCo's law follow masses, inertias, centres of mass and armatures.
"""


@hint_keywords("stepper.lab.Study")
@dataclass(frozen=True, kw_only=True)
class Study(metaclass=Hinting):
    """Episodes of a model under a drive, measured, where parameters may be other than one thinks.

    Names in selectors and in the words of measures are looked up in the model at once, which loads it.

    Attributes:
        model: As of `stepper.load`, or a `Model`, or a function that returns one of those.
        name: In tables, and the folder of its results; of a file that says none, the file's stem.
        drive: What controls it: a function of a `World` that returns controls, `Recorded(path)`, `Policy(function)`, "random", or None for
            no controls (those of the keyframe, else 0).
        outcomes: What is measured; one of them may have a success, which decides. None is nothing: such a study can be charted and tuned.
        parameters: What may be otherwise, by name.
        settings: Other ways to run the same episodes, by name: attributes of `Options` and "precision"; or {"engine": "mujoco"} with
            MuJoCo's integrator, cone, solver, impratio, noslip_iterations, iterations, tolerance, timestep.
        seconds: Length of an episode, s.
        control: Time that a control is held, s, whatever the time step is; None is the multiple of the model's time step nearest to 20 ms.
        episodes: Episodes of every point.
        seed: Of everything random. Episode k has the same start, random controls and errors of sensors at every point.
        start: Where episodes start; None is the keyframe or the model's reference, with noise.
        keyframe: Of the model, to start from.
        exact: What is right, where a closed form is known: a function of a `World` at the start and of times (T,) that returns
            qpos (T, num_envs, nq) and qvel (T, num_envs, nv). `chart` and `tune` measure errors from it, in place of converging runs.
        qpos_noise: Standard deviation of starts in m and rad.
        qvel_noise: Standard deviation of starts in m/s and rad/s.
        options: Settings of the step.
        precision: "f64" or "f32".
        sensors: What sensors make of the truth.
        actuators: What becomes of controls.
        batch: Episodes that are stepped together at the most. With errors of sensors, which follow from the place in a batch, all episodes
            of a point are stepped together whatever it is: their memory is that of `episodes` environments.
        threads: Threads that step; 0 is all.
        ray: Whether batches run as tasks of Ray, on all machines of its cluster; the rows are the same.
    """

    model: Any
    name: str = "study"
    drive: Any = None
    outcomes: Outcome | Sequence[Outcome] | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = 1.0
    control: float | None = None
    episodes: int = 8
    seed: int = 0
    start: Start | None = None
    keyframe: str | int | None = None
    exact: Exact | None = None
    qpos_noise: float = 0.0
    qvel_noise: float = 0.0
    options: Options = field(default_factory=Options)
    precision: Precision = "f64"
    sensors: SensorModel | None = None
    actuators: ActuatorModel | None = None
    batch: int = 256
    threads: int = 1
    ray: bool = False

    def __post_init__(self) -> None:
        self._check_kinds()
        object.__setattr__(self, "parameters", dict(self.parameters))
        object.__setattr__(self, "settings", {name: dict(given) for name, given in self.settings.items()})
        for name in ("seconds", "episodes", "batch"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, must be above 0")
        for name in ("qpos_noise", "qvel_noise"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, must be at least 0 and finite")
        if self.control is not None and not 0 < self.control <= self.seconds:
            raise ValueError(f"control is {self.control} s, must be above 0 and at most seconds, which is {self.seconds}")
        if not (self.drive is None or self.drive == "random" or callable(self.drive)):
            raise TypeError(f'drive is {self.drive!r}, must be a function, Recorded, Policy, "random" or None')
        if not (self.exact is None or callable(self.exact)):
            raise TypeError(f"exact is {self.exact!r}, must be a function of a world and times that returns qpos and qvel, or None")
        names = [outcome.name for outcome in self.all_outcomes]
        if len(set(names)) < len(names):
            raise ValueError(f"two outcomes have one name: {names}")
        judged = [outcome.name for outcome in self.all_outcomes if outcome.success is not None]
        if len(judged) > 1:
            raise ValueError(f"outcomes {judged} all have a success, and one decides: make one measure of them, or leave the others' out")
        if USUAL in self.settings:
            raise ValueError(f"settings {USUAL!r} are the study's own options; choose another name")
        for name, given in self.settings.items():
            self.setting(name, given)
        if any(isinstance(o.measure, str) for o in self.all_outcomes) or any(p.kind in OF_MODEL for p in self.parameters.values()):
            _ = self.loaded

    def _check_kinds(self) -> None:
        """Raises TypeError and ValueError for outcomes and parameters that are none."""
        if self.outcomes is not None and not isinstance(self.outcomes, Outcome):
            if isinstance(self.outcomes, str) or not isinstance(self.outcomes, Sequence):
                raise TypeError(f"outcomes is {self.outcomes!r}, must be a stepper.lab.Outcome or a list of them")
            if not self.outcomes:
                raise ValueError(f"outcomes is {self.outcomes!r}, so the study has no outcome: give one, or leave outcomes out")
        for outcome in self.all_outcomes:
            if not isinstance(outcome, Outcome):
                raise TypeError(f"outcomes has {outcome!r}, must be a stepper.lab.Outcome, as Outcome(name=..., measure=...)")
        if not isinstance(self.parameters, Mapping):
            raise TypeError(f"parameters is {self.parameters!r}, must be a dict of stepper.lab.Parameter by name")
        for name, parameter in self.parameters.items():
            if not isinstance(parameter, Parameter):
                raise TypeError(
                    f"parameter {name!r} is {parameter!r}, must be a stepper.lab.Parameter: Parameter(selector, low=..., high=...)"
                )

    @classmethod
    def from_model(cls, source: Any, **changed: Any) -> Study:
        """A study of a model alone: random controls, from slightly different velocities. A study is given back as it is, but for changes.

        Args:
            source: As of `load`; or a study, or the file of one (.toml, or .py with a name `study`).
            **changed: Attributes of the study.
        """
        if isinstance(source, Study):
            return replace(source, **changed)
        if isinstance(source, str | Path) and str(source).endswith((".toml", ".py")):
            return replace(cls.from_file(source), **changed)
        name = Path(str(source)).stem if isinstance(source, str | Path) and "<" not in str(source) else "model"
        return cls(**({"model": source, "name": name, "drive": "random", "qvel_noise": 0.01} | changed))

    @classmethod
    def from_file(cls, path: str | Path) -> Study:
        """Reads a study from a TOML file, or from a Python file that has a `Study` named `study`.

        Raises:
            ValueError: What the file says is no study; named with the file.
        """
        # A circle otherwise: files make studies.
        from stepper.lab.study.files import read_study  # noqa: PLC0415

        return read_study(Path(path), cls)

    @cached_property
    def loaded(self) -> tuple[Model, Any]:
        """The model, and MuJoCo's of the same source where there is one."""
        source = self.model() if callable(self.model) else self.model
        with warnings.catch_warnings():
            # The report has what runs otherwise than the source asks for.
            warnings.simplefilter("ignore")
            if isinstance(source, Model):
                model, compiled = source, None
            else:
                compiled = None if is_saved(source) else compile_source(source)
                model = load(source if compiled is None else compiled, strict=False)
        check(self.parameters, model)
        for outcome in self.all_outcomes:
            outcome.check(model)
        return model, compiled

    @cached_property
    def hold(self) -> float:
        """Time that a control is held, s."""
        if self.control is not None:
            return self.control
        timestep = self.options.timestep or float(self.loaded[0].timestep)
        return min(max(1, round(_HOLD / timestep)) * timestep, self.seconds)

    @property
    def controls(self) -> int:
        """Controls of an episode."""
        return max(1, round(self.seconds / self.hold))

    @property
    def all_outcomes(self) -> tuple[Outcome, ...]:
        """What is measured, however many."""
        return (self.outcomes,) if isinstance(self.outcomes, Outcome) else tuple(self.outcomes or ())

    @property
    def decisive(self) -> Outcome | None:
        """The outcome whose success counts."""
        return next((outcome for outcome in self.all_outcomes if outcome.success is not None), None)

    @property
    def nominal(self) -> dict[str, Any]:
        """Theta of the unperturbed point."""
        return {name: p.nominal for name, p in self.parameters.items() if p.nominal is not None}

    def driven(self) -> Any:
        """The drive, for one batch; None holds what is in force."""
        return drives.Random(self.seed) if isinstance(self.drive, str) else self.drive

    def setting(self, name: str, given: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """What settings of a name change.

        Raises:
            ValueError: No settings of that name, or no such setting.
        """
        if name == USUAL:
            return {}
        if given is None:
            if name not in self.settings:
                raise ValueError(f"there are no settings {name!r}, there are: {', '.join([USUAL, *self.settings])}")
            given = self.settings[name]
        known = {f.name for f in fields(Options)} | {"precision"}
        if given.get("engine", "stepper") not in ("stepper", "mujoco"):
            raise ValueError(f'settings {name!r}: engine is {given["engine"]!r}, must be "stepper" or "mujoco"')
        if given.get("engine") != "mujoco" and (unknown := set(given) - known - {"engine"}):
            guess = near(min(unknown), known)
            raise ValueError(f"settings {name!r}: unknown {sorted(unknown)}{guess or ','} must be of: {', '.join(sorted(known))}")
        return dict(given)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Everything that a row follows from but theta, settings and episode, as plain values with digests."""
        model, _ = self.loaded
        measured = [
            {
                **{f.name: getattr(o, f.name) for f in fields(o) if f.name not in ("measure", "whose")},
                "measure": drives.name_of(o.measure),
                "sha256": drives.digest_of(o.measure),
            }
            for o in self.all_outcomes
        ]
        return {
            "rows": _ROWS,
            "model": {"name": model.name, "sha256": model.digest, "omitted": len(model.omitted), "forces": _force_types(model)},
            "drive": {"name": drives.name_of(self.drive), "sha256": drives.digest_of(self.driven())},
            "start": {"name": drives.name_of(self.start), "sha256": drives.digest_of(self.start), "keyframe": self.keyframe},
            "noise": [self.qpos_noise, self.qvel_noise],
            "outcomes": measured,
            "seconds": self.seconds,
            "control": self.hold,
            "seed": self.seed,
            "options": asdict(self.options),
            "precision": self.precision,
            "sensors": self.sensors.to_dict() if self.sensors else None,
            "actuators": self.actuators.to_dict() if self.actuators else None,
            "versions": {"stepper": __version__, "numpy": np.__version__, "mujoco": package_version("mujoco-core")},
        }

    @property
    def notes(self) -> list[str]:
        """What of the model's source is left out, and what it asks for that is by default otherwise."""
        model, _ = self.loaded
        left = [f"{kind} {name}: {reason}" for kind, name, reason in model.omitted]
        return left + [f"asked for, and by default otherwise: {line}" for line in model.deviations]

    @cached_property
    def in_force(self) -> dict[str, Any]:
        """`identity` with what it ran on, the interpreter and the digest of the binary, and with `notes`."""
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
        """SHA-256 of MuJoCo's model, which has what stepper's leaves out (its solver's settings); None where there is none."""
        compiled = self.loaded[1]
        if compiled is None:
            return None
        mujoco = require("mujoco", "to run a study in MuJoCo")
        buffer = np.zeros(mujoco.mj_sizeModel(compiled), np.uint8)
        mujoco.mj_saveModel(compiled, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    def key(self, theta: Theta, setting: str, episode: int) -> str:
        """What tells a row from all others: a digest of everything that it follows from."""
        given = self.setting(setting)
        # Of MuJoCo's rows alone: what stepper does not read makes none of its rows anew.
        compiled = [self._compiled_digest] if given.get("engine") == "mujoco" else []
        own = {name: [value, str(p.parsed), p.how] for name, value in sorted(theta.items()) for p in [self.parameters[name]]}
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
        """Runs one episode: the same, to the bit, as in the tables of `sweep`, `report` and `rank`.

        Args:
            values: Of parameters, by name or selector; the others are nominal.
            number: Which episode; it has its own start, random controls and errors of sensors.
            seed: In place of the study's own.
            setting: Name of the settings.
            record: A new folder for a recording, which `stepper view` shows and `stepper.replay` repeats. It has a row for every control.
                With errors of sensors, which follow from the place in a batch, it has an environment for every episode of the point.

        Returns:
            Its row: "theta", "outcomes" by name, "success", "certificate" (what the steps say of themselves), "settings" in force.

        Raises:
            ValueError: No such parameter, value, settings or episode; a recording of MuJoCo.
            FileExistsError: There is something in the folder.
        """
        study = self if seed is None else replace(self, seed=seed)
        (row,) = Episodes(study, values or {}, [number], setting).rows(record)
        return row

    def at(self, values: Mapping[str, Value]) -> Study:
        """The study with these nominal values.

        Args:
            values: Numbers or words by name of a parameter, or by selector, as "geom_friction[floor][0]".

        Raises:
            ValueError: No such parameter, or a value that it may not have.
        """
        return replace(self, parameters=moved(self.parameters, values))

    def generators(self, episodes: Sequence[int]) -> list[np.random.Generator]:
        """Random numbers of the starts of episodes."""
        return [np.random.default_rng([self.seed, int(e), 0]) for e in episodes]


def _force_types(model: Model) -> list[str]:
    """Types of the gain and bias of every actuator: the digest of a model does not have them, and parameters of gains depend on them."""
    return [f"{actuator.gaintype} {actuator.biastype}" for actuator in map(model.actuator, range(model.nu))]


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:32]

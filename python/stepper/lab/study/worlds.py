"""Worlds: environments of a study in one engine, with the same interface for stepper and MuJoCo."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stepper._hints import did_you_mean, no_attribute
from stepper._options import Options, Precision
from stepper._status import Status
from stepper._stepper import Model, ModelError, Stepper
from stepper.actuators import ActuatorModel
from stepper.lab.study.parameters import ROWS_FROM_NOTHING
from stepper.loading import load
from stepper.sensors import SensorModel
from stepper.shared.fields import RANDOMIZED
from stepper.shared.machine import require
from stepper.shared.streams import Rng, Streams
from stepper.shared.view import BatchView

Array = NDArray[np.float64]
_WEIGHT_FIELDS = frozenset({"body_mass", "body_inertia", "body_ipos", "dof_armature"})
"""Fields of `Stepper.randomize` that determine the inverse weights of MuJoCo's contact law."""
_LARGEST_STATE = 1e10
"""Absolute value of a position (m, rad) or velocity (m/s, rad/s) above which an episode counts as diverged.

MuJoCo resets an environment at the same value (mjMAXVAL).
"""
_WORST = ("residual", "max_penetration", "max_limit_violation", "max_equality_violation")
"""Quantities of `Stepper` whose largest values `World.solver_quality` returns."""
_RNG_KEY = 2
"""Last of the three numbers that seed `World.rng`, after the study's seed and the episode's number.

Initial states use 0 in its place, and random controls use 1, so that all these random numbers are independent.
"""


@dataclass(frozen=True)
class Plan:
    """Specification of a batch of episodes: model, parameters and settings.

    Attributes:
        model: Model of the scene.
        fields: Fields with values per environment, (num_envs, *shape), in the field's unit, by name.
        options: Options of stepper's step.
        precision: "f64" or "f32".
        mujoco: Settings of MuJoCo's step; None selects the engine stepper.
        compiled: `mujoco.MjModel` of the scene, if it has one.
        sensors: Sensor model; None leaves the sensors ideal.
        actuators: Actuator model; None leaves the actuators ideal.
        threads: Number of threads.
    """

    model: Model
    fields: Mapping[str, Array]
    options: Options
    precision: Precision = "f64"
    mujoco: Mapping[str, Any] | None = None
    compiled: Any = None
    sensors: SensorModel | None = None
    actuators: ActuatorModel | None = None
    threads: int = 1


class ParameterValues(dict[str, NDArray[Any]]):
    """Values of a study's parameters by name, (num_envs,) each. The error for an unknown name lists the known names."""

    def __missing__(self, name: str) -> NDArray[Any]:
        known = ", ".join(self) or "none"
        raise KeyError(f"the study has no parameter {name!r} with a value{did_you_mean(str(name), self) or ','} there are: {known}")


CHANGING = frozenset({"step", "reset", "set_state", "randomize", "rollout", "record", "copy_state", "linearize", "view", "save_problem"})
"""Names of the methods of `Stepper` that a `World`, the environments of a study, does not offer. Most of them change the stepper."""


class World(BatchView):
    """Environments of a study in one engine, which controllers and measures read. Abstract.

    It has these attributes of `Stepper`, with the environments as the leading axis: `qpos`, `qvel`, `xpos`, `xquat`, `site_xpos`,
    `geom_xpos`, `sensordata`, `sensordata_ideal`, `body_contact_force`, `contacts()` and `read(name, of)`. With the engine stepper it has
    all other attributes of `Stepper` too. Arrays of real numbers are float64. `xfrc_applied` is writable.

    Attributes:
        engine: "stepper" or "mujoco".
        model: Model of the scene, without values that differ between environments.
        num_envs: Number of environments.
        timestep: Time step, s.
        time: Time since the start of the episode, (num_envs,) s.
        ideal: Whether this run has ideal sensors even if the study has a sensor model, as in charts, tuning and diagnoses of failures.
            Controllers that simulate sensor errors themselves, such as a field of view, must then leave them out.
        last_ctrl: Last return value of the controller: controls (num_envs, nu) or (nu,), or None if it kept the previous controls.
        parameters: Values of the study's parameters by name: (num_envs,), numbers or texts.
        episodes: Number of each environment's episode, (num_envs,).
    """

    engine: ClassVar[str]

    def __init__(self, plan: Plan, num_envs: int):
        self.model, self.num_envs, self.time = plan.model, num_envs, np.zeros(num_envs)
        self.parameters = ParameterValues()
        self.episodes: NDArray[np.int64] = np.arange(num_envs)
        self.timestep = 0.0
        self.last_ctrl: Any = None
        self.ideal = False
        self._streams, self._period = Streams(num_envs, 0), 1.0
        self.default_qpos: Array = np.asarray(plan.model.qpos0, np.float64)
        self._stored: dict[str, Any] = {}
        self._stored_at: Any = None
        self._quality: dict[str, NDArray[Any]] = {"status": np.zeros(num_envs, np.int64)} | {name: np.zeros(num_envs) for name in _WORST}

    def __getattr__(self, name: str) -> Any:
        # Python calls this only for attributes that do not exist.
        raise no_attribute(World, name, more=set(dir(type(self))) | set(dir(Stepper)) - CHANGING)

    def rng(self, name: str) -> Rng:
        """Returns a random number generator for all environments at this time; see `BatchView.rng`."""
        # The age is the number of control periods. The tolerance is for sums of time steps.
        self._streams.ages[:] = np.floor(self.time / self._period + 1e-6)
        return super().rng(name)

    def stored(self) -> dict[str, Any]:
        """Returns values that were computed from the present state, by name."""
        if self._stored_at is not self.time:  # A step replaces the array of times.
            self._stored_at, self._stored = self.time, {}
        return self._stored

    def seed_episodes(self, seed: int, episodes: Sequence[int], period: float) -> None:
        """Sets the numbers of the episodes, resets the time to 0, and seeds `rng`.

        Args:
            seed: Seed of the study.
            episodes: Number of each environment's episode, (num_envs,).
            period: Control period, s.
        """
        self.episodes, self.time, self._period = np.array(episodes), np.zeros(self.num_envs), period
        words = [int(np.random.SeedSequence([seed, int(e), _RNG_KEY]).generate_state(1, np.uint64)[0]) for e in episodes]
        self._streams.seed(np.arange(self.num_envs), words)

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """Starts an episode in all environments.

        Args:
            qpos: Initial positions, (num_envs, nq), m and rad.
            qvel: Initial velocities, (num_envs, nv), m/s and rad/s.
            keyframe: Keyframe of the initial controls and activations; None sets them to 0.
            seed: Seed of the sensor errors.
        """
        raise NotImplementedError

    def step(self, ctrl: Any, nstep: int) -> None:
        """Steps all environments `nstep` times, without an update of the values that `solver_quality` returns. Benchmarks time this method.

        Args:
            ctrl: Controls, (num_envs, nu) or (nu,), in the actuators' units; None keeps the last ones.
            nstep: Number of steps.
        """
        raise NotImplementedError

    def advance(self, ctrl: Any, nstep: int) -> None:
        """Steps all environments as `step` does, and updates the status flags, residuals and violations that `solver_quality` returns."""
        self.step(ctrl, nstep)
        self._update_quality()
        # MuJoCo itself checks this state only in the next step.
        state = np.concatenate([self.qpos, self.qvel], axis=1)
        self._quality["status"][~(np.abs(state) <= _LARGEST_STATE).all(axis=1)] |= int(Status.NON_FINITE)

    def _update_quality(self) -> None:
        """Adds the quality of the last steps to `_quality`."""
        raise NotImplementedError

    def solver_quality(self) -> dict[str, NDArray[Any]]:
        """Returns the quality of the steps of the episode so far, by name, (num_envs,) each.

        "status" has the flags of `Status` that any step set. "residual" (m/s) is the largest of the steps that end a call of `advance`. The
        others are largest values of all steps: "max_penetration" (m), "max_limit_violation" and "max_equality_violation" (m, rad). In
        MuJoCo, the penetration is that after control periods, and the other values are NaN.
        """
        return self._quality

    def settings(self) -> dict[str, Any]:
        """Returns all settings of the engine, with defaults filled in."""
        raise NotImplementedError

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Whether each environment's episode diverged, (num_envs,): a state was not finite or too large, or the engine reset itself."""
        lost: NDArray[np.bool_] = (self.solver_quality()["status"] & int(Status.NON_FINITE)) != 0
        return lost


class StepperWorld(World):
    """World of the engine stepper. Its attribute `sim` is the `Stepper`."""

    engine = "stepper"

    def __init__(self, plan: Plan, num_envs: int):
        super().__init__(plan, num_envs)
        model, varying = _split(plan)
        self.model = model
        self.sim = Stepper(
            model,
            num_envs,
            options=plan.options,
            precision=plan.precision,
            threads=plan.threads,
            sensors=plan.sensors,
            actuators=plan.actuators,
        )
        if varying:
            self.sim.randomize(**varying)
        self.timestep = float(self.sim.timestep)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "sim" or name in CHANGING or not hasattr(Stepper, name):
            return super().__getattr__(name)
        value = getattr(self.sim, name)
        return np.asarray(value, np.float64) if isinstance(value, np.ndarray) and value.dtype == np.float32 else value

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """Starts an episode in all environments; see `World.start`."""
        if keyframe is not None:
            self.sim.reset(keyframe=keyframe)
            held = np.array(self.sim.ctrl)
            self.sim.reset(qpos=qpos, qvel=qvel, seed=seed)
            self.sim.set_state(act=np.tile(self.model.keyframe(keyframe).act, (self.num_envs, 1)))
            self._held: Any = held
        else:
            self.sim.reset(qpos=qpos, qvel=qvel, seed=seed)
            self._held = None
        for worst in self._quality.values():
            worst[:] = 0
        self.time = np.zeros(self.num_envs)

    def step(self, ctrl: Any, nstep: int) -> None:
        """Steps all environments; see `World.step`."""
        if ctrl is None:
            ctrl = self._held
        # After a step the simulation itself holds the controls.
        self._held = None
        self.sim.step(ctrl, nstep)
        self.time = self.time + nstep * self.timestep

    def _update_quality(self) -> None:
        self._quality["status"] |= np.asarray(self.sim.status, np.int64)
        for name in _WORST:
            self._quality[name] = np.maximum(self._quality[name], np.asarray(getattr(self.sim, name), float))

    def settings(self) -> dict[str, Any]:
        """All settings of the step, with defaults filled in."""
        options = asdict(self.sim.options) | {"timestep": self.timestep, "tolerance": float(self.sim.tolerance)}
        integrator = options["integrator"] or _default_integrator(self.sim)
        return {"engine": self.engine} | options | {"integrator": integrator, "precision": self.sim.precision}


def _default_integrator(sim: Stepper) -> str:
    """Name of the integrator that a stepper uses if its option `integrator` is None."""
    if sim.options.contact == "hard":
        return "midpoint"
    return Options.from_model(sim.model).integrator or "euler" if sim.model.requested else "euler"


def own_fields(options: Options) -> frozenset[str]:
    """Names of the fields that may differ between environments of a batch, with these options.

    In MuJoCo's contact law, the resistance of constraints depends on inverse weights of bodies and joints at the reference pose.
    `Stepper.randomize` does not change them; `Model.replace` computes them, as `mj_setConst` does.
    """
    return frozenset(RANDOMIZED) - _WEIGHT_FIELDS if options.contact == "mujoco" else frozenset(RANDOMIZED)


def _split(plan: Plan) -> tuple[Model, dict[str, Array]]:
    """Model with the values of a plan that all environments share, and the other fields by name, (num_envs, *shape) each."""
    shared, varying, may_vary = {}, {}, own_fields(plan.options)
    for field, rows in plan.fields.items():
        before = np.asarray(getattr(plan.model, field), float)
        if field in ROWS_FROM_NOTHING and np.any((rows > 0) & (before == 0)):
            shared[field] = np.where(before > 0, before, rows.max(axis=0))
            varying[field] = rows
        elif field in may_vary:
            varying[field] = rows
        elif np.array_equal(rows, np.broadcast_to(rows[0], rows.shape)):
            shared[field] = rows[0]
        else:
            raise ValueError(f"{field} differs between environments of a batch, and stepper needs one value: split the batch by its values")
    return (plan.model.replace(**shared) if shared else plan.model), varying


MUJOCO_SETTINGS = ("integrator", "cone", "solver", "impratio", "noslip_iterations", "iterations", "tolerance", "timestep")
"""Names of the options that settings with engine="mujoco" can have."""
_MUJOCO_ENUMS = {"integrator": ("mjtIntegrator", "mjINT_"), "cone": ("mjtCone", "mjCONE_"), "solver": ("mjtSolver", "mjSOL_")}
"""MuJoCo's enumeration of the values of an option, and the prefix of the enumeration's members, by name of the option."""
_MUJOCO_COUNTS = frozenset({"iterations", "noslip_iterations"})
"""Names of MuJoCo's options whose values are whole numbers."""
_MUJOCO_POSITIVE = frozenset({"impratio", "timestep"})
"""Names of MuJoCo's options whose values must be above 0."""


_OF_DATA = frozenset({"xpos", "xquat", "site_xpos", "geom_xpos", "sensordata"})
"""Names of the quantities of a stepper that an `MjData` has in the same form."""


class MujocoWorld(World):
    """World of the engine MuJoCo: an MjData for each environment, and an MjModel for each set of parameters."""

    engine = "mujoco"

    def __init__(self, plan: Plan, num_envs: int):
        super().__init__(plan, num_envs)
        self._mujoco = require("mujoco", "to run a study in MuJoCo")
        if plan.compiled is None:
            raise ModelError("MuJoCo cannot run studies of saved models and models made in code; give the study MJCF, URDF or an MjModel")
        if plan.sensors is not None or plan.actuators is not None:
            raise ModelError("MuJoCo has no sensor errors and no drives; remove sensors and actuators from the study to run it in MuJoCo")
        if plan.model.nu != plan.compiled.nu or plan.model.nsensordata != plan.compiled.nsensordata:
            raise ModelError(
                "stepper leaves out actuators or sensors of this model, so that its controls differ from MuJoCo's: model.explain() lists "
                "them; remove them from the file"
            )
        warned = self._mujoco.mjtWarning
        # MuJoCo resets by itself if a state is not finite, and leaves out contacts beyond its capacity; it counts both.
        self._flags = (
            (Status.NON_FINITE, (warned.mjWARN_BADQPOS, warned.mjWARN_BADQVEL, warned.mjWARN_BADQACC)),
            (Status.CONTACTS_FULL, (warned.mjWARN_CONTACTFULL, warned.mjWARN_CNSTRFULL)),
        )
        self._models = self._models_of(plan, num_envs)
        self._data = [self._mujoco.MjData(m) for m in self._models]
        self._seen = [self._mujoco.MjData(m) for m in self._models]
        # Whether `_seen` belongs to the current state, and whether forces were applied in the last step.
        self._is_current, self._pushed = False, False
        self.timestep = float(self._models[0].opt.timestep)
        self._applied = np.zeros((num_envs, plan.model.nbody, 6))

    def _models_of(self, plan: Plan, num_envs: int) -> list[Any]:
        """Compiled `MjModel` of each environment of a plan; environments with equal parameters share one."""
        base = plan.compiled.__copy__()
        configure(self._mujoco, base, plan.mujoco or {})
        made: dict[bytes, Any] = {}
        models = []
        for env in range(num_envs):
            key = b"".join(rows[env].tobytes() for rows in plan.fields.values())
            if key not in made:
                made[key] = with_fields(self._mujoco, base, {field: rows[env] for field, rows in plan.fields.items()})
            models.append(made[key])
        return models

    def __getattr__(self, name: str) -> Any:
        if name not in _OF_DATA:
            return super().__getattr__(name)
        return np.array([getattr(data, name) for data in self._now()])

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """Starts an episode in all environments; see `World.start`. MuJoCo's sensors have no errors, so that the seed has no effect."""
        for data, model, q, v in zip(self._data, self._models, qpos, qvel, strict=True):
            if keyframe is None:
                self._mujoco.mj_resetData(model, data)
            else:
                self._mujoco.mj_resetDataKeyframe(model, data, self.model.keyframe(keyframe).id)
            data.qpos[:], data.qvel[:], data.time = q, v, 0.0
        self._applied[:] = 0.0
        for name, worst in self._quality.items():
            worst[:] = 0 if name in ("status", "max_penetration") else np.nan
        self.time, self._is_current, self._pushed = np.zeros(self.num_envs), False, False

    def _update_quality(self) -> None:
        for env, data in enumerate(self._data):
            depth = max((float(c.includemargin - c.dist) for c in data.contact), default=0.0)
            self._quality["max_penetration"][env] = max(self._quality["max_penetration"][env], depth)
            for flag, kinds in self._flags:
                if any(data.warning[kind].number for kind in kinds):
                    self._quality["status"][env] |= flag

    def step(self, ctrl: Any, nstep: int) -> None:
        """Steps all environments; see `World.step`."""
        rows = None if ctrl is None else np.broadcast_to(np.asarray(ctrl, float), (self.num_envs, self.model.nu))
        pushed = self._pushed or bool(self._applied.any())
        self._pushed = bool(self._applied.any())
        with self._quiet():
            for env, (data, model) in enumerate(zip(self._data, self._models, strict=True)):
                if rows is not None:
                    data.ctrl[:] = rows[env]
                if pushed:
                    data.xfrc_applied[:] = self._applied[env]
                self._mujoco.mj_step(model, data, nstep)
        self.time = self.time + nstep * self.timestep
        self._is_current = False

    @contextlib.contextmanager
    def _quiet(self) -> Iterator[None]:
        """Context manager in which MuJoCo writes no MUJOCO_LOG.TXT to the working directory. Its warning counters still count."""
        before = self._mujoco.get_mju_user_warning()
        self._mujoco.set_mju_user_warning(_ignore)
        try:
            yield
        finally:
            self._mujoco.set_mju_user_warning(before)

    def _now(self) -> list[Any]:
        """MjData of each environment with derived quantities of the current state, because `mj_step` leaves those of the previous state."""
        if not self._is_current:
            with self._quiet():
                for data, seen, model in zip(self._data, self._seen, self._models, strict=True):
                    seen.qpos[:], seen.qvel[:], seen.ctrl[:], seen.time = data.qpos, data.qvel, data.ctrl, data.time
                    seen.act[:], seen.xfrc_applied[:], seen.qacc_warmstart[:] = data.act, data.xfrc_applied, data.qacc_warmstart
                    self._mujoco.mj_forward(model, seen)
            self._is_current = True
        return self._seen

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), m and rad."""
        return np.array([data.qpos for data in self._data])

    @property
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), m/s and rad/s."""
        return np.array([data.qvel for data in self._data])

    @property
    def sensordata_ideal(self) -> Array:
        """Readings without errors, (num_envs, nsensordata); in MuJoCo the same as `sensordata`."""
        readings: Array = self.sensordata
        return readings

    @property
    def body_contact_force(self) -> Array:
        """Contact force (N) and torque about the centre of mass (N m) on each body, world axes, (num_envs, nbody, 6)."""
        out = np.zeros((self.num_envs, self.model.nbody, 6))
        contacts = self.contacts()
        xipos = np.array([data.xipos for data in self._data])
        force, torque = (np.einsum("ij,ijk->ik", contacts[name], contacts["frame"]) for name in ("force", "torque"))
        for side, sign in enumerate((-1.0, 1.0)):
            at = (contacts["env"], contacts["body"][:, side])
            np.add.at(out, at, sign * np.concatenate([force, torque + np.cross(contacts["pos"] - xipos[at], force)], axis=1))
        return out

    def contacts(self) -> NDArray[np.void]:
        """Contacts of the last step, a structured array (ncontact,) with the units of `Stepper.contacts`."""
        rows, wrench = [], np.zeros(6)
        for env, (data, model) in enumerate(zip(self._data, self._models, strict=True)):
            for i, contact in enumerate(data.contact):
                self._mujoco.mj_contactForce(model, data, i, wrench)
                frame = contact.frame.reshape(3, 3)
                own = {
                    "env": env, "geom": contact.geom, "body": model.geom_bodyid[contact.geom], "pos": contact.pos, "normal": frame[0],
                    "distance": contact.dist - contact.includemargin, "force": wrench[:3], "torque": wrench[3:], "frame": frame,
                }  # fmt: skip
                rows.append(tuple(own[name].copy() if isinstance(own[name], np.ndarray) else own[name] for name in _contact_type().names))
        return np.array(rows, _contact_type())

    @property
    def xfrc_applied(self) -> Array:
        """Applied force (N) and torque (N m) on each body, world axes, (num_envs, nbody, 6); writable."""
        return self._applied

    def settings(self) -> dict[str, Any]:
        """All settings of the step, with defaults filled in."""
        opt, mujoco = self._models[0].opt, self._mujoco
        return {
            "engine": self.engine,
            "contact": "mujoco",
            "timestep": self.timestep,
            "integrator": mujoco.mjtIntegrator(opt.integrator).name.removeprefix("mjINT_").lower(),
            "solver": mujoco.mjtSolver(opt.solver).name.removeprefix("mjSOL_").lower(),
            "cone": mujoco.mjtCone(opt.cone).name.removeprefix("mjCONE_").lower(),
            **{name: getattr(opt, name) for name in ("iterations", "tolerance", "impratio", "noslip_iterations")},
            "precision": "f64",
        }


@functools.cache
def _contact_type() -> Any:
    """NumPy type of the rows of the structured array that `Stepper.contacts` returns."""
    return Stepper(load("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")).contacts().dtype


def _ignore(_: str) -> None:
    """Handler of MuJoCo's warnings that does nothing, because MuJoCo counts them."""


def with_fields(mujoco: Any, base: Any, fields: Mapping[str, Array]) -> Any:
    """Copy of a `mujoco.MjModel` with other values of some fields."""
    model = base.__copy__()
    for field, value in fields.items():
        if hasattr(model.opt, field):
            # Fields of `MjOption`: gravity, wind, density, viscosity, impratio.
            setattr(model.opt, field, value)
        elif hasattr(model, field) and getattr(model, field).shape == value.shape:
            getattr(model, field)[:] = value
        else:
            raise ModelError(f"MuJoCo has no {field}; remove its parameter from the study to run it in MuJoCo")
    if fields:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def check_mujoco(settings: Mapping[str, Any], mujoco: Any = None) -> None:
    """Checks settings of MuJoCo's step.

    Args:
        settings: Values by name, without "engine".
        mujoco: The module `mujoco`, to check words such as "elliptic"; None leaves them unchecked.
    """
    for name, value in settings.items():
        if name not in MUJOCO_SETTINGS:
            guess = did_you_mean(name, MUJOCO_SETTINGS) or ","
            raise ValueError(f"MuJoCo has no setting {name!r}{guess} there are: {', '.join(MUJOCO_SETTINGS)}")
        if name in _MUJOCO_ENUMS:
            if mujoco is not None:
                _mujoco_choice(mujoco, name, value)
            continue
        kind = int if name in _MUJOCO_COUNTS else int | float
        lowest = np.nextafter(0.0, 1.0) if name in _MUJOCO_POSITIVE else 0.0
        if isinstance(value, bool) or not isinstance(value, kind) or not lowest <= value < np.inf:
            must = f"{'whole ' if kind is int else ''}number {'above 0' if lowest else 'of at least 0'}"
            raise ValueError(f"MuJoCo's {name} is {value!r}, must be a {must}")


def _mujoco_choice(mujoco: Any, name: str, value: Any) -> Any:
    """Member of MuJoCo's enumeration for the word of a setting, such as "elliptic" for the setting "cone"."""
    kind, prefix = _MUJOCO_ENUMS[name]
    choice = getattr(getattr(mujoco, kind), prefix + str(value).upper(), None)
    if choice is None:
        words = sorted(word.removeprefix(prefix).lower() for word in dir(getattr(mujoco, kind)) if word.startswith(prefix))
        raise ValueError(f"MuJoCo has no {name} {value!r}{did_you_mean(str(value).lower(), words) or ','} there are: {', '.join(words)}")
    return choice


def configure(mujoco: Any, model: Any, settings: Mapping[str, Any]) -> None:
    """Writes settings of the step into a `mujoco.MjModel`; other settings keep their values.

    Raises:
        ValueError: MuJoCo does not have a setting or a value of it.
    """
    check_mujoco(settings)
    for name, value in settings.items():
        setattr(model.opt, name, _mujoco_choice(mujoco, name, value) if name in _MUJOCO_ENUMS else value)


def make_world(plan: Plan, num_envs: int) -> World:
    """World of a plan with this number of environments, in stepper or in MuJoCo."""
    return StepperWorld(plan, num_envs) if plan.mujoco is None else MujocoWorld(plan, num_envs)


def stacked(values: Sequence[Any]) -> NDArray[Any]:
    """Values of a parameter in all environments, (num_envs,): an array of numbers, or of objects if there are texts."""
    return np.array(values) if all(isinstance(v, int | float) for v in values) else np.array(values, dtype=object)

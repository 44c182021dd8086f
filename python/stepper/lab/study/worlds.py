"""Environments of one engine at one time: what drives and measures see, the same in stepper and in MuJoCo."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stepper._hints import near, no_attribute
from stepper._options import Options, Precision
from stepper._quantities import read
from stepper._status import Status
from stepper._stepper import Model, ModelError, Stepper
from stepper.actuators import ActuatorModel
from stepper.lab.study.parameters import ROWS_FROM_NOTHING
from stepper.loading import load
from stepper.sensors import SensorModel
from stepper.shared.fields import RANDOMIZED
from stepper.shared.machine import require

Array = NDArray[np.float64]
_WEIGHED = frozenset({"body_mass", "body_inertia", "body_ipos", "dof_armature"})
"""Fields of `Stepper.randomize` from which the inverse weights of MuJoCo's law follow."""
_HUGE = 1e10
"""m, rad and those over s, beyond which a state is that of no motion: MuJoCo's mjMAXVAL, at which it begins anew, for both engines."""


@dataclass(frozen=True)
class Plan:
    """What a batch of episodes is made of.

    Attributes:
        model: The scene.
        fields: Numbers of the model that environments have of their own, (num_envs, *shape).
        options: Settings of stepper's step.
        precision: "f64" or "f32".
        mujoco: Settings of MuJoCo's step in place of those; None is stepper.
        compiled: MuJoCo's model, where there is one.
        sensors: What sensors make of the truth.
        actuators: What becomes of controls.
        threads: Threads that step.
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


class Thetas(dict[str, NDArray[Any]]):
    """Values of parameters by name; asked for one that there is not, it names those that there are."""

    def __missing__(self, name: str) -> NDArray[Any]:
        known = ", ".join(self) or "none"
        raise KeyError(f"the study has no parameter {name!r} with a value{near(str(name), self) or ','} there are: {known}")


CHANGING = frozenset({"step", "reset", "set_state", "randomize", "rollout", "record", "copy_state", "linearize", "view", "save_problem"})
"""Methods of a stepper that are not for reading."""


class World:
    """Environments of one engine at one time, for drives and measures.

    It reads as a `Stepper` does, with the environments in front: `qpos`, `qvel`, `xpos`, `xquat`, `site_xpos`, `geom_xpos`, `sensordata`,
    `sensordata_ideal`, `body_contact_force`, `contacts()` and `read(name, of)`; in stepper itself all other attributes too. Arrays of real
    numbers have 64 bits. `xfrc_applied` may be written to.

    Attributes:
        engine: "stepper", "mujoco" or "rapier".
        model: The scene, without differences between environments.
        num_envs: Number of environments.
        timestep: s.
        time: Since the start of the episode, (num_envs,) s.
        senses: Whether a sensor was read.
        ideal: Whether sensors are to have no errors whatever the study gives them: where episodes are run again to tell whose a failure is,
            in a chart and in a tuning. A drive that has errors of its own, as a field of view, leaves them out then.
        last_ctrl: Last controls of the drive; None where it holds those in force.
        theta: Values of the study's parameters by name: (num_envs,), numbers or words.
        episodes: Number of each environment's episode, (num_envs,).
    """

    engine: ClassVar[str]

    def __init__(self, plan: Plan, num_envs: int):
        self.model, self.num_envs, self.time = plan.model, num_envs, np.zeros(num_envs)
        self.theta = Thetas()
        self.episodes: NDArray[np.int64] = np.arange(num_envs)
        self.timestep = 0.0
        self.last_ctrl: Any = None
        self.senses = self.ideal = False

    def __getattr__(self, name: str) -> Any:
        # Python calls this only for attributes that are not found otherwise.
        raise no_attribute(World, name)

    def read(self, name: str, of: str | int | Sequence[str | int] | None = None) -> NDArray[Any]:
        """Values of a quantity for all its elements, or for some by name or index: see `Stepper.read`."""
        return read(self, name, of)

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """Begins an episode in all environments."""
        raise NotImplementedError

    def advance(self, ctrl: Any, nstep: int) -> None:
        """Makes steps with controls (num_envs, nu) or (nu,); None holds those in force."""
        raise NotImplementedError

    def step(self, ctrl: Any, nstep: int) -> None:
        """`advance` without looking at how the steps went: what is timed."""
        raise NotImplementedError

    def certificate(self) -> dict[str, NDArray[Any]]:
        """What the steps of the episode say of themselves, the worst of each environment: (num_envs,)."""
        raise NotImplementedError

    def settings(self) -> dict[str, Any]:
        """Everything that the engine was set to, as it is in force."""
        raise NotImplementedError

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Environments whose episode is lost: a state was not finite or beyond all bounds, or the engine began anew: (num_envs,)."""
        lost: NDArray[np.bool_] = (self.certificate()["status"] & Status.NON_FINITE) != 0
        return lost

    def _beyond(self) -> NDArray[np.bool_]:
        """Environments whose state is now not finite or huge."""
        state = np.concatenate([self.qpos, self.qvel], axis=1)
        beyond: NDArray[np.bool_] = ~(np.abs(state) <= _HUGE).all(axis=1)
        return beyond


class StepperWorld(World):
    """Environments of a `Stepper`, which is `sim`."""

    engine = "stepper"

    def __init__(self, plan: Plan, num_envs: int):
        super().__init__(plan, num_envs)
        model, own = _split(plan)
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
        if own:
            self.sim.randomize(**own)
        self.timestep = float(self.sim.timestep)
        names = ("residual", "max_penetration", "max_limit_violation", "max_equality_violation")
        self._worst: dict[str, NDArray[Any]] = {"status": np.zeros(num_envs, np.int64)} | {name: np.zeros(num_envs) for name in names}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "sim" or name in CHANGING or not hasattr(Stepper, name):
            return super().__getattr__(name)
        self.senses |= name in ("sensordata", "sensordata_ideal")
        value = getattr(self.sim, name)
        return np.asarray(value, np.float64) if isinstance(value, np.ndarray) and value.dtype == np.float32 else value

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """See `World.start`."""
        if keyframe is not None:
            self.sim.reset(keyframe=keyframe)
            held = np.array(self.sim.ctrl)
            self.sim.reset(qpos=qpos, qvel=qvel, seed=seed)
            self.sim.set_state(act=np.tile(self.model.keyframe(keyframe).act, (self.num_envs, 1)))
            self._held: Any = held
        else:
            self.sim.reset(qpos=qpos, qvel=qvel, seed=seed)
            self._held = None
        for worst in self._worst.values():
            worst[:] = 0
        self.time = np.zeros(self.num_envs)

    def advance(self, ctrl: Any, nstep: int) -> None:
        """See `World.advance`."""
        self.step(ctrl, nstep)
        worst = self._worst
        worst["status"] = worst["status"] | np.asarray(self.sim.status, np.int64)
        worst["status"][self._beyond()] |= Status.NON_FINITE
        for name in ("residual", "max_penetration", "max_limit_violation", "max_equality_violation"):
            worst[name] = np.maximum(worst[name], np.asarray(getattr(self.sim, name), float))

    def step(self, ctrl: Any, nstep: int) -> None:
        """See `World.step`."""
        if ctrl is None:
            ctrl = self._held
        # After a step the simulation itself holds what is in force.
        self._held = None
        self.sim.step(ctrl, nstep)
        self.time = self.time + nstep * self.timestep

    def certificate(self) -> dict[str, NDArray[Any]]:
        """See `World.certificate`: flags of `Status`, residual of the last step of every control, and violations of positions."""
        return self._worst

    def settings(self) -> dict[str, Any]:
        """See `World.settings`."""
        told = asdict(self.sim.options) | {"timestep": self.timestep, "tolerance": float(self.sim.tolerance)}
        integrator = told["integrator"] or _default_integrator(self.sim)
        return {"engine": self.engine} | told | {"integrator": integrator, "precision": self.sim.precision}


def _default_integrator(sim: Stepper) -> str:
    if sim.options.contact == "hard":
        return "midpoint"
    asked = sim.model.requested
    return Options.from_model(sim.model).integrator or "euler" if asked else "euler"


def own_fields(options: Options) -> frozenset[str]:
    """Fields that environments of a batch may have of their own in steps with these options.

    By MuJoCo's law the resistance of constraints follows from inverse weights of bodies and joints at the reference pose.
    `Stepper.randomize` leaves them as they are; `Model.replace` computes them, as `mj_setConst` does.
    """
    return frozenset(RANDOMIZED) - _WEIGHED if options.contact == "mujoco" else frozenset(RANDOMIZED)


def _split(plan: Plan) -> tuple[Model, dict[str, Array]]:
    """The model with what all environments share, and what each has of its own."""
    shared, own, varying = {}, {}, own_fields(plan.options)
    for field, rows in plan.fields.items():
        before = np.asarray(getattr(plan.model, field), float)
        if field in ROWS_FROM_NOTHING and np.any((rows > 0) & (before == 0)):
            shared[field] = np.where(before > 0, before, rows.max(axis=0))
            own[field] = rows
        elif field in varying:
            own[field] = rows
        elif np.array_equal(rows, np.broadcast_to(rows[0], rows.shape)):
            shared[field] = rows[0]
        else:
            raise ValueError(f"{field} differs between environments of a batch, which stepper cannot do")
    return (plan.model.replace(**shared) if shared else plan.model), own


MUJOCO_SETTINGS = ("integrator", "cone", "solver", "impratio", "noslip_iterations", "iterations", "tolerance", "timestep")


class MujocoWorld(World):
    """Environments in MuJoCo: one MjData each, and a model for every environment with numbers of its own."""

    engine = "mujoco"

    def __init__(self, plan: Plan, num_envs: int):
        super().__init__(plan, num_envs)
        self._mujoco = require("mujoco", "to run a study in MuJoCo")
        if plan.compiled is None:
            raise ModelError(
                "MuJoCo has no part in studies of saved models and models made in code; give the study MJCF, URDF or an MjModel"
            )
        if plan.sensors is not None or plan.actuators is not None:
            raise ModelError("MuJoCo has no errors of sensors and no drives; take them out of the study to run it there")
        if plan.model.nu != plan.compiled.nu or plan.model.nsensordata != plan.compiled.nsensordata:
            raise ModelError(
                "stepper leaves out actuators or sensors of this model, so that its controls are not MuJoCo's; see model.explain()"
            )
        warned = self._mujoco.mjtWarning
        # MuJoCo begins anew by itself where a state is not finite, and leaves out contacts without room; it counts both.
        self._flags = (
            (Status.NON_FINITE, (warned.mjWARN_BADQPOS, warned.mjWARN_BADQVEL, warned.mjWARN_BADQACC)),
            (Status.CONTACTS_FULL, (warned.mjWARN_CONTACTFULL, warned.mjWARN_CNSTRFULL)),
        )
        self._models = self._made(plan, num_envs)
        self._data = [self._mujoco.MjData(m) for m in self._models]
        self._seen = [self._mujoco.MjData(m) for m in self._models]
        self._fresh, self._pushed = False, False
        self.timestep = float(self._models[0].opt.timestep)
        self._applied = np.zeros((num_envs, plan.model.nbody, 6))
        self._depth = np.zeros(num_envs)
        self._status = np.zeros(num_envs, np.int64)

    def _made(self, plan: Plan, num_envs: int) -> list[Any]:
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

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """See `World.start`."""
        for data, model, q, v in zip(self._data, self._models, qpos, qvel, strict=True):
            if keyframe is None:
                self._mujoco.mj_resetData(model, data)
            else:
                self._mujoco.mj_resetDataKeyframe(model, data, self.model.keyframe(keyframe).id)
            data.qpos[:], data.qvel[:], data.time = q, v, 0.0
        self._applied[:] = 0.0
        self._depth[:], self._status[:] = 0.0, 0
        self.time, self._fresh, self._pushed = np.zeros(self.num_envs), False, False

    def advance(self, ctrl: Any, nstep: int) -> None:
        """See `World.advance`."""
        self.step(ctrl, nstep)
        for env, data in enumerate(self._data):
            depth = max((float(c.includemargin - c.dist) for c in data.contact), default=0.0)
            self._depth[env] = max(self._depth[env], depth)
            for flag, kinds in self._flags:
                if any(data.warning[kind].number for kind in kinds):
                    self._status[env] |= flag
        # A state that MuJoCo would look at in the next step alone.
        self._status[self._beyond()] |= Status.NON_FINITE

    def step(self, ctrl: Any, nstep: int) -> None:
        """See `World.step`."""
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
        self._fresh = False

    @contextlib.contextmanager
    def _quiet(self) -> Iterator[None]:
        """Keeps MuJoCo from writing its warnings, which are counted here, to MUJOCO_LOG.TXT in the working directory."""
        before = self._mujoco.get_mju_user_warning()
        self._mujoco.set_mju_user_warning(_ignore)
        try:
            yield
        finally:
            self._mujoco.set_mju_user_warning(before)

    def _now(self) -> list[Any]:
        """Data with everything at the present state, as `mj_step` leaves only what was before it."""
        if not self._fresh:
            with self._quiet():
                for data, seen, model in zip(self._data, self._seen, self._models, strict=True):
                    seen.qpos[:], seen.qvel[:], seen.ctrl[:], seen.time = data.qpos, data.qvel, data.ctrl, data.time
                    seen.act[:], seen.xfrc_applied[:], seen.qacc_warmstart[:] = data.act, data.xfrc_applied, data.qacc_warmstart
                    self._mujoco.mj_forward(model, seen)
            self._fresh = True
        return self._seen

    @property
    def qpos(self) -> Array:
        """See `Stepper.qpos`."""
        return np.array([data.qpos for data in self._data])

    @property
    def qvel(self) -> Array:
        """See `Stepper.qvel`."""
        return np.array([data.qvel for data in self._data])

    @property
    def xpos(self) -> Array:
        """See `Stepper.xpos`."""
        return np.array([data.xpos for data in self._now()])

    @property
    def xquat(self) -> Array:
        """See `Stepper.xquat`."""
        return np.array([data.xquat for data in self._now()])

    @property
    def site_xpos(self) -> Array:
        """See `Stepper.site_xpos`."""
        return np.array([data.site_xpos for data in self._now()])

    @property
    def geom_xpos(self) -> Array:
        """See `Stepper.geom_xpos`."""
        return np.array([data.geom_xpos for data in self._now()])

    @property
    def sensordata(self) -> Array:
        """See `Stepper.sensordata`."""
        return np.array([data.sensordata for data in self._now()])

    @property
    def sensordata_ideal(self) -> Array:
        """See `Stepper.sensordata_ideal`."""
        return self.sensordata

    @property
    def body_contact_force(self) -> Array:
        """See `Stepper.body_contact_force`."""
        out = np.zeros((self.num_envs, self.model.nbody, 6))
        contacts = self.contacts()
        xipos = np.array([data.xipos for data in self._data])
        force, torque = (np.einsum("ij,ijk->ik", contacts[name], contacts["frame"]) for name in ("force", "torque"))
        for side, sign in enumerate((-1.0, 1.0)):
            at = (contacts["env"], contacts["body"][:, side])
            np.add.at(out, at, sign * np.concatenate([force, torque + np.cross(contacts["pos"] - xipos[at], force)], axis=1))
        return out

    def energy(self) -> tuple[Array, Array]:
        """Potential and kinetic energy: see `Stepper.energy`."""
        found = []
        for data, model in zip(self._now(), self._models, strict=True):
            self._mujoco.mj_energyPos(model, data)
            self._mujoco.mj_energyVel(model, data)
            found.append(data.energy.copy())
        potential, kinetic = np.array(found).T
        return potential, kinetic

    @property
    def max_limit_violation(self) -> Array:
        """Farthest that a hinge or slide is beyond its range at the present state, (num_envs,) in rad or m."""
        m, joints = self._models[0], self._mujoco.mjtJoint
        one = (m.jnt_limited != 0) & np.isin(m.jnt_type, [joints.mjJNT_HINGE, joints.mjJNT_SLIDE])
        q = self.qpos[:, m.jnt_qposadr[one]]
        low, high = np.array([model.jnt_range[one] for model in self._models]).transpose(2, 0, 1)
        beyond: Array = np.max(np.maximum(low - q, q - high), axis=1, initial=0.0)
        return beyond

    def contacts(self) -> NDArray[np.void]:
        """Contacts of the last step: see `Stepper.contacts`."""
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
        """See `Stepper.xfrc_applied`."""
        return self._applied

    def certificate(self) -> dict[str, NDArray[Any]]:
        """See `World.certificate`. MuJoCo reports no residual in m/s and no violation; the penetration is the last step's."""
        nothing = dict.fromkeys(("residual", "max_limit_violation", "max_equality_violation"), np.full(self.num_envs, np.nan))
        return {"status": self._status, "max_penetration": self._depth, **nothing}

    def settings(self) -> dict[str, Any]:
        """See `World.settings`."""
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
    """Type of a row of `Stepper.contacts`."""
    return Stepper(load("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")).contacts().dtype


def _ignore(_: str) -> None:
    """Takes a warning that is counted elsewhere."""


def with_fields(mujoco: Any, base: Any, fields: Mapping[str, Array]) -> Any:
    """A copy of an `MjModel` with some fields as `model_fields` has them.

    Raises:
        ModelError: MuJoCo does not have a field.
    """
    model = base.__copy__()
    for field, value in fields.items():
        if hasattr(model.opt, field):
            # Gravity, wind, density, viscosity, impratio.
            setattr(model.opt, field, value)
        elif hasattr(model, field) and getattr(model, field).shape == value.shape:
            getattr(model, field)[:] = value
        else:
            raise ModelError(f"MuJoCo has no {field}; take it out of the study to run it there")
    if fields:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def configure(mujoco: Any, model: Any, settings: Mapping[str, Any]) -> None:
    """Writes settings into an `MjModel`; what is not named stays.

    Raises:
        ValueError: A setting or choice that MuJoCo does not have.
    """
    if unknown := set(settings) - set(MUJOCO_SETTINGS):
        raise ValueError(f"MuJoCo has no settings {sorted(unknown)}, there are: {', '.join(MUJOCO_SETTINGS)}")
    enums = {"integrator": ("mjtIntegrator", "mjINT_"), "cone": ("mjtCone", "mjCONE_"), "solver": ("mjtSolver", "mjSOL_")}
    for name, value in settings.items():
        if name not in enums:
            setattr(model.opt, name, value)
            continue
        kind, prefix = enums[name]
        choice = getattr(getattr(mujoco, kind), prefix + str(value).upper(), None)
        if choice is None:
            raise ValueError(f"MuJoCo has no {name} {value!r}")
        setattr(model.opt, name, choice)


def make_world(plan: Plan, num_envs: int) -> World:
    """The environments of a plan."""
    return StepperWorld(plan, num_envs) if plan.mujoco is None else MujocoWorld(plan, num_envs)


def stacked(values: Sequence[Any]) -> NDArray[Any]:
    """Values of a parameter over environments: numbers, or words."""
    return np.array(values) if all(isinstance(v, int | float) for v in values) else np.array(values, dtype=object)

"""Engines that run the scenes of the atlas: stepper, MuJoCo and rapier. Each engine with its settings is a column of the atlas's tables."""

import dataclasses
from dataclasses import dataclass, field
from functools import lru_cache

import mujoco
import numpy as np
import stepper
from numpy.typing import ArrayLike
from stepper.lab.engines import MujocoBatch, MujocoEngine, configure

from atlas.world import NOT_FINITE, Array, CannotRunError, DivergedError, Touch, World


@dataclass(frozen=True)
class Stepper:
    """The simulator stepper with some settings. Its results are a column of the atlas's tables.

    Attributes:
        name: Name in the table.
        options: Options; the scene replaces their time step.
        precision: "f64" or "f32".
    """

    name: str
    options: stepper.Options = field(default_factory=stepper.Options)
    precision: str = "f64"

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        """Load a scene, as environments of this engine with its settings. The arguments are those of `Engine.start`."""
        options = dataclasses.replace(self.options, timestep=dt)
        if iterations is not None:
            options = dataclasses.replace(options, iterations=iterations)
        return _StepperWorld(mjcf, options, num_envs, self.precision, restitution)


@lru_cache(maxsize=8)
def _load(mjcf: str) -> stepper.Model:
    """Model of a scene. An unsupported element raises `CannotRunError`."""
    try:
        return stepper.load(mjcf)
    except stepper.ModelError as error:
        raise CannotRunError(f"stepper does not simulate this: {error}") from error


class _StepperWorld(World):
    """Environments of a scene in stepper.

    Args:
        mjcf: Model in MJCF.
        options: Options of the step.
        num_envs: Number of environments.
        precision: "f64" or "f32".
        restitution: Coefficient of restitution of every contact. With None contacts are inelastic.
    """

    def __init__(self, mjcf: str, options: stepper.Options, num_envs: int, precision: str, restitution: float | None) -> None:
        super().__init__(mjcf, options.timestep or 0.0, num_envs)
        model = _load(mjcf)
        if restitution is not None:
            model = model.replace(geom_restitution=np.full(model.ngeom, restitution))
        if (concave := self.surfaces).any():
            model = model.replace(geom_concave=concave.astype(float))
        self.sim = stepper.Stepper(model, num_envs, options=options, precision=precision)

    @property
    def qpos(self) -> Array:
        return np.array(self.sim.qpos, dtype=np.float64)

    @property
    def qvel(self) -> Array:
        return np.array(self.sim.qvel, dtype=np.float64)

    def set(self, qpos: ArrayLike | None = None, qvel: ArrayLike | None = None) -> None:
        self.sim.set_state(qpos, qvel)

    def push(self, body: str, force: ArrayLike, torque: ArrayLike = (0, 0, 0)) -> None:
        self.sim.xfrc_applied[:, self.body(body), :3] = force
        self.sim.xfrc_applied[:, self.body(body), 3:] = torque

    def touches(self, env: int = 0) -> list[Touch]:
        found = self.sim.contacts(env)
        return [Touch((int(c["geom"][0]), int(c["geom"][1])), c["normal"], float(c["force"][0])) for c in found]

    def _advance(self, ctrl: Array | None, nstep: int) -> None:
        self.sim.step(ctrl, nstep=nstep)

    def _check(self) -> None:
        flags = np.atleast_1d(self.sim.status)
        for flag in stepper.Status:
            if count := int(np.count_nonzero(flags & flag)):
                self.flags[str(flag.name)] += count
        if (flags & stepper.Status.NON_FINITE).any():
            raise DivergedError(NOT_FINITE)


DEFAULTS = {"integrator": "euler", "cone": "pyramidal", "solver": "newton", "impratio": 1.0, "noslip_iterations": 0}
"""Options of MuJoCo's step with their default values."""


@dataclass(frozen=True)
class Mujoco:
    """The simulator MuJoCo with some settings. Its results are a column of the atlas's tables.

    Attributes:
        name: Name in the table.
        settings: Integrator, cone, solver, impratio.
        solref: Time constant of contacts, limits and equalities, in time steps. None keeps that of the model.
    """

    name: str
    settings: MujocoEngine
    solref: float | None = None

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        """Load a scene, as environments of this engine with its settings. The arguments are those of `Engine.start`."""
        return _MujocoWorld(self, mjcf, dt, num_envs, restitution=restitution, iterations=iterations)


class _MujocoWorld(World):
    """Environments of a scene in MuJoCo.

    Args:
        engine: Engine with its settings.
        mjcf: Model in MJCF.
        dt: Time step, s.
        num_envs: Number of environments.
        restitution: Coefficient of restitution of every contact. With None contacts are inelastic.
        iterations: Iterations of the contact solver; None keeps the number of iterations of the engine.
    """

    def __init__(self, engine: Mujoco, mjcf: str, dt: float, num_envs: int, *, restitution: float | None, iterations: int | None) -> None:
        super().__init__(mjcf, dt, num_envs)
        model = self.model
        if self.surfaces.any():
            raise CannotRunError("MuJoCo replaces meshes by their convex hulls")
        configure(model, engine.settings)
        model.opt.timestep = dt
        if iterations is not None:
            model.opt.iterations = iterations
        if engine.solref is not None:
            _stiffen(model, engine.solref * dt, restitution)
        self._batch = MujocoBatch(model, num_envs, contacts=True)

    @property
    def qpos(self) -> Array:
        return self._batch.qpos

    @property
    def qvel(self) -> Array:
        return self._batch.qvel

    def set(self, qpos: ArrayLike | None = None, qvel: ArrayLike | None = None) -> None:
        for name, given in (("qpos", qpos), ("qvel", qvel)):
            if given is not None:
                self._batch.bind(name)[:] = given

    def push(self, body: str, force: ArrayLike, torque: ArrayLike = (0, 0, 0)) -> None:
        wrench = self._batch.bind("xfrc_applied")[:, self.body(body)]
        wrench[:, :3], wrench[:, 3:] = force, torque

    def touches(self, env: int = 0) -> list[Touch]:
        d, out, force = self._batch.data(env), [], np.zeros(6)
        for i, c in enumerate(d.contact):
            mujoco.mj_contactForce(self.model, d, i, force)
            out.append(Touch((int(c.geom[0]), int(c.geom[1])), c.frame[:3].copy(), float(force[0])))
        return out

    def _advance(self, ctrl: Array | None, nstep: int) -> None:
        self._batch.step(ctrl, nstep)

    def _check(self) -> None:
        if self._batch.restarted.any():
            raise DivergedError("MuJoCo reset an environment because of a bad state")


ELASTIC_STEPS = 10.0
"""Duration of an elastic impact in MuJoCo with tuned contacts, in time steps. Elastic contacts are springs in MuJoCo."""


def _stiffen(model: mujoco.MjModel, time_constant: float, restitution: float | None) -> None:
    """Set contacts, limits and equalities as stiff as the time step allows.

    Section "Solver parameters" of MuJoCo's documentation advises a time constant of two time steps. With restitution e, solref of contacts
    has the direct format (-stiffness, -damping). Half a period of the spring is `ELASTIC_STEPS` time steps, and the damping ratio zeta
    follows from e = exp(-pi zeta / sqrt(1 - zeta^2)).
    """
    reference = np.array([time_constant, 1.0])
    model.jnt_solref[:] = reference
    model.eq_solref[:] = reference
    model.tendon_solref_lim[:] = reference
    if restitution:
        log = -np.log(restitution) / np.pi
        zeta = log / np.sqrt(1.0 + log**2)
        rate = np.pi / (ELASTIC_STEPS * time_constant / 2.0)
        reference = np.array([-(rate**2), -max(2.0 * zeta * rate, 1e-12)])
    model.geom_solref[:] = reference
    model.pair_solref[:] = reference


@dataclass(frozen=True)
class Rapier:
    """Engine rapier from its Python wheel, with default settings. It computes in 32 bits.

    A contact has the larger friction coefficient of its two geoms, as in MuJoCo.
    """

    name: str

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        """Load a scene, as environments of this engine with its settings. The arguments are those of `Engine.start`."""
        from atlas.rapier import RapierWorld  # noqa: PLC0415  (optional)

        return RapierWorld(mjcf, dt, num_envs, restitution, iterations)


def stepper_engines() -> list[Stepper]:
    """Settings of stepper, the default first."""
    settings = {
        "euler": {"integrator": "euler"},
        "baumgarte": {"stabilization": "baumgarte"},
        "euler, baumgarte": {"integrator": "euler", "stabilization": "baumgarte"},
        "rk4": {"integrator": "rk4"},
        "implicit": {"integrator": "implicit"},
        "newton": {"solver": "newton"},
        "fine": {"tolerance": 1e-6},
    }
    default = stepper.Options()
    out = [Stepper("stepper"), *(Stepper(f"stepper {name}", dataclasses.replace(default, **s)) for name, s in settings.items())]
    return [*out, Stepper("stepper f32", default, "f32")]


def peers() -> list[Stepper | Mujoco | Rapier]:
    """Other engines: stepper with MuJoCo's contact law, MuJoCo with defaults and with two tunings, and rapier if it is installed."""
    tuned = DEFAULTS | {"cone": "elliptic"}
    out: list[Stepper | Mujoco | Rapier] = [
        Stepper("MuJoCo's law in stepper", stepper.Options(contact="mujoco", integrator="euler")),
        Mujoco("MuJoCo", MujocoEngine("default", DEFAULTS)),
        Mujoco("MuJoCo tuned", MujocoEngine("implicitfast, impratio 100", tuned | {"integrator": "implicitfast", "impratio": 100.0}), 2.0),
        Mujoco("MuJoCo tuned, discrete", MujocoEngine("discrete, impratio 10", tuned | {"integrator": "discrete", "impratio": 10.0}), 2.0),
    ]
    try:
        import rapier3d  # noqa: F401, PLC0415  (optional)
    except ModuleNotFoundError:
        return out
    return [*out, Rapier("rapier")]

"""Tasks of `stepper.envs` with MuJoCo's physics: the same observations, rewards and resets over `mujoco.batch`.

    python benches/environments.py        # speed of whole environments, compared with stepper
    python benches/training.py engines    # the Go1 learns in both engines

`MujocoSim` replaces the `Stepper` of a vector environment. It has the attributes and methods that tasks use. It steps the MuJoCo model from
which stepper's model was loaded. Positions and velocities of bodies are those of MuJoCo's last evaluation, as in Gymnasium's environments.
"""

import copy
import importlib
import warnings
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stepper import Model
from stepper.envs import Group, StepperVectorEnv, Task
from stepper.envs.locomotion import RoughTask
from stepper.lab.engines import MujocoFields
from stepper.loading import compile_source, origin_of
from stepper.shared.selectors import randomized_fields

Array = NDArray[Any]

_READ = {
    **{name: name for name in ("qpos", "qvel", "act", "ctrl", "xpos", "xquat", "site_xpos", "geom_xpos", "subtree_com", "xipos", "cinert")},
    **{name: name for name in ("cvel", "cfrc_ext", "qacc", "actuator_force", "qfrc_actuator", "qfrc_constraint", "sensordata")},
    **{"sensordata_ideal": "sensordata", "closed_eq_data": "time"},  # A `TaskView` reads the second one to detect changes alone.
}
"""Attributes of `Stepper` that `MujocoSim` reads from MuJoCo's data, each with the name of the corresponding field of MuJoCo."""
_DERIVED = {"body_mass", "body_inertia", "body_ipos", "dof_armature"}
"""Names of model fields from which MuJoCo derives constants. After a change of such a field, `randomize` recomputes the constants."""


def reads_contact_forces(task: Task) -> bool:
    """Whether a task observes `cfrc_ext`."""
    given = task.observations()
    groups = given.values() if isinstance(given, Mapping) else [given]
    return any(row.name == "cfrc_ext" for rows in groups for row in (rows.table() if isinstance(rows, Group) else rows))


def mujoco_model(model: Model, *, with_contact_forces: bool) -> Any:
    """MuJoCo model from the same source as a stepper model. An added accelerometer makes MuJoCo compute `cfrc_ext` in each step.

    Raises:
        ValueError: The model was not loaded from MJCF in this process.
    """
    mujoco: Any = importlib.import_module("mujoco")
    origin = origin_of(model)
    if origin is None:
        raise ValueError(f"model {model.name!r} was not loaded from MJCF in this process: load it with stepper.load")
    if not with_contact_forces:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # stepper.load has already issued these warnings.
            return copy.copy(compile_source(origin))
    source = origin.source
    return with_an_acceleration(mujoco.MjSpec.from_file(source) if origin.is_file else mujoco.MjSpec.from_string(source))


def with_an_acceleration(spec: Any) -> Any:
    """Compiled model of a `mujoco.MjSpec`, with an added sensor of the acceleration of its first body."""
    mujoco: Any = importlib.import_module("mujoco")
    sensor = spec.add_sensor(name="acceleration", type=mujoco.mjtSensor.mjSENS_FRAMELINACC)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_XBODY, spec.bodies[1].name
    return spec.compile()


class MujocoSim(MujocoFields):
    """Batch of MuJoCo environments with the part of `Stepper`'s interface that tasks use.

    Args:
        model: stepper's model of the scene.
        num_envs: Number of environments.
        threads: Number of threads.
        m: MuJoCo's model. None compiles the source of `model`.
        reads_contacts: Whether `contacts` works.
    """

    def __init__(self, model: Model, num_envs: int, *, threads: int = 1, m: Any = None, reads_contacts: bool = False):
        m = mujoco_model(model, with_contact_forces=False) if m is None else m
        # The last argument of `mujoco.batch` keeps an MjData per environment, whose contacts `contacts` reads.
        kept = [True] if reads_contacts else []
        super().__init__(importlib.import_module("mujoco.batch").Batch(m, num_envs, threads, *kept), num_envs)
        self.model, self._m = model, m
        self.timestep = float(m.opt.timestep)
        self.status = np.zeros(num_envs, dtype=np.uint32)
        self.randomized: dict[str, Array] = {}
        self._arrays: dict[str, Array] = {}

    def __getattr__(self, name: str) -> Any:
        # Python calls this method for missing attributes only.
        if name not in _READ:
            raise AttributeError(f"MujocoSim has no attribute {name!r}: add it to _READ in benches/mujoco_vector.py")
        if name not in self._arrays:  # As a `Stepper` does, later reads return the same array until the state changes.
            known = _READ[name] in self._bound
            values = self.bind(_READ[name])
            if not known:
                # The first read computes the quantity from the current state.
                self._batch.forward()
            self._arrays[name] = np.array(values)
        return self._arrays[name]

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """Steps all environments with controls (num_envs, nu); None keeps the last controls."""
        self._arrays.clear()
        super().step(ctrl, nstep)

    @property
    def body_angvel(self) -> Array:
        """Angular velocities of the bodies in world axes, (num_envs, nbody, 3) rad/s."""
        return np.array(self.bind("cvel")[..., :3])

    @property
    def body_linvel(self) -> Array:
        """Velocities of the origins of the bodies in world axes, (num_envs, nbody, 3) m/s."""
        # MuJoCo's `cvel` has the velocity of the body's point that is now at the centre of mass of the body's tree.
        arms = self.bind("xpos") - self.bind("subtree_com")[:, self._m.body_rootid]
        return np.array(self.bind("cvel")[..., 3:]) + np.cross(self.body_angvel, arms)

    def contacts(self) -> Array:
        """Contacts of the last step: a structured array (ncontact,) with env, geom (2,) and force (3,) N, normal force first."""
        mujoco: Any = importlib.import_module("mujoco")
        rows, wrench = [], np.zeros(6)
        for env in range(self.num_envs):
            data = self._batch.get_data(env)
            for k, geoms in enumerate(data.contact.geom):
                mujoco.mj_contactForce(self._m, data, k, wrench)
                rows.append((env, geoms, wrench[:3]))
        return np.array(rows, [("env", np.int64), ("geom", np.int64, 2), ("force", np.float64, 3)])

    # Signature of `Stepper.reset` as tasks call it.
    def reset(self, envs: Array | None = None, *, qpos: Array | None = None, qvel: Array | None = None, seed: Any = None) -> None:
        """Reset some or all environments. MuJoCo's physics has no random numbers, so `seed` is ignored."""
        ids = self._indices(envs)
        self._batch.reset(ids)
        self.set_state(qpos, qvel, None if envs is None else np.asarray(envs))

    def set_state(
        self,
        qpos: Array | None = None,
        qvel: Array | None = None,
        envs: Array | None = None,
        *,
        act: Array | None = None,
        keep_warmstart: bool = False,
    ) -> None:
        """Set states of some or all environments.

        Each array has one row per environment of the batch, one row per environment in `envs`, or is a single row for all of these. With
        `keep_warmstart` MuJoCo's derived quantities stay as they are, without an evaluation of the forward dynamics.
        """
        ids = self._indices(envs)
        self._arrays.clear()
        for name, given in (("qpos", qpos), ("qvel", qvel), ("act", act)):
            if given is not None:
                target = self.bind(name)
                target[ids] = given if np.ndim(given) == 1 or len(given) == len(ids) else np.asarray(given)[ids]
        if not keep_warmstart:
            self._batch.forward(ids)

    def randomize(self, values: Mapping[str, Any] | None = None, /, envs: Array | None = None, **fields: Array) -> None:
        """Set model parameters of the environments `envs` (None selects all)."""
        if values is not None:
            sim: Any = self
            fields = randomized_fields(sim, values, envs, fields)
        ids = self._indices(envs)
        self._arrays.clear()
        for name, given in fields.items():
            rows = given if len(given) == len(ids) else given[ids]
            self._batch.expand(name)[ids] = rows
            own = np.asarray(getattr(self.model, name))
            self.randomized.setdefault(name, np.array(np.broadcast_to(own, (self.num_envs, *own.shape))))[ids] = rows
        if _DERIVED & set(fields):
            self._batch.set_const(ids)

    def _indices(self, envs: Array | None) -> Array:
        """Indices of environments, (n,), from a mask (num_envs,), from indices, or from None, which is all environments."""
        ids: Array = np.arange(self.num_envs)[slice(None) if envs is None else envs]
        return ids


class MujocoVectorEnv(VectorEnv[Array, Array, Array]):
    """Vector environment of a task of `stepper.envs` with MuJoCo's physics. It cannot be pickled.

    Args:
        task: Task, task class, or name of a task.
        num_envs: Number of environments.
        threads: Number of threads.
        m: MuJoCo's model. None compiles the source of the task's model.
        settings: Arguments of `StepperVectorEnv`, such as autoreset_mode and max_episode_steps, and of the task.
    """

    def __init__(self, task: Task | type[Task] | str, num_envs: int, *, threads: int = 1, m: Any = None, **settings: Any):
        self._envs = envs = StepperVectorEnv(task, num_envs, **settings)
        batch = envs._batch
        if m is None:
            m = mujoco_model(batch.sim.model, with_contact_forces=reads_contact_forces(envs.task))
        sim: Any = MujocoSim(batch.sim.model, num_envs, threads=threads, m=m, reads_contacts=isinstance(envs.task, RoughTask))
        batch.sim = sim
        batch.clear_last_step()
        self.num_envs, self.metadata = num_envs, envs.metadata
        self.single_observation_space, self.single_action_space = envs.single_observation_space, envs.single_action_space
        self.observation_space, self.action_space = envs.observation_space, envs.action_space

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Reset environments to the same initial states as stepper's. Arguments and results are those of `StepperVectorEnv.reset`."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        return self._envs.reset(seed=seed, options=options)

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Step all environments by one action. Arguments and results are those of `StepperVectorEnv.step`."""
        return self._envs.step(actions)

    def set_state(self, qpos: Array, qvel: Array, envs: Any = None) -> Array:
        """Set states and return observations. Arguments and results are those of `StepperVectorEnv.set_state`."""
        observations: Array = self._envs.set_state(qpos, qvel, envs)
        return observations


def register(name: str) -> str:
    """Register the task "stepper/NAME" with MuJoCo's physics in Gymnasium, as "mujoco_batch/NAME". Returns this id."""
    known = f"mujoco_batch/{name}"
    if known not in gymnasium.registry:
        spec = gymnasium.spec(f"stepper/{name}")
        gymnasium.register(
            known,
            vector_entry_point=f"{__name__}:{MujocoVectorEnv.__name__}",
            max_episode_steps=spec.max_episode_steps,
            kwargs={"autoreset_mode": AutoresetMode.NEXT_STEP, **spec.kwargs},
        )
    return known

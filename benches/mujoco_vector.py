"""Tasks of `stepper.envs` on MuJoCo: the same code of observations, rewards and resets over `mujoco.batch`, or over mjbatch.

    python benches/environments.py        # steps of whole environments, beside stepper's
    python benches/training.py go1        # the Go1 learns in both engines

The stepper of a batch of environments is replaced by `MujocoSim`, which has what tasks read and call. Models are those that stepper's were
loaded from. Places and velocities of bodies are those of MuJoCo's last evaluation, as Gymnasium's own environments have them, so that
nothing is computed twice.
"""

from __future__ import annotations

import copy
import importlib
import warnings
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stepper import Model
from stepper.envs import StepperVectorEnv, Task
from stepper.loading import compile_source, origin_of

Array = NDArray[Any]

_READ = {
    **{name: name for name in ("qpos", "qvel", "act", "ctrl", "xpos", "xquat", "site_xpos", "geom_xpos", "subtree_com", "xipos", "cinert")},
    **{name: name for name in ("cvel", "cfrc_ext", "qacc", "actuator_force", "qfrc_actuator", "qfrc_constraint")},
    "sensordata_ideal": "sensordata",
    "sensordata": "sensordata",
}
"""Quantities of stepper and MuJoCo's names of them."""
_DERIVED = {"body_mass", "body_inertia", "body_ipos", "dof_armature"}
"""Parameters from which MuJoCo derives constants."""


def reads_contact_forces(task: Task) -> bool:
    """Whether a task observes `cfrc_ext`."""
    return any(row.name == "cfrc_ext" for row in task.observations())


def mujoco_model(model: Model, *, with_contact_forces: bool) -> Any:
    """MuJoCo's model of a scene, of what stepper's was loaded from.

    Args:
        model: stepper's.
        with_contact_forces: Whether a step computes `cfrc_ext`, which it does for a sensor of accelerations.

    Raises:
        ValueError: The source of the model is not known.
    """
    mujoco: Any = importlib.import_module("mujoco")
    origin = origin_of(model)
    if origin is None:
        raise ValueError(f"model {model.name!r} was not loaded from MJCF here: MuJoCo cannot step it")
    if not with_contact_forces:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Whoever loaded the model has seen them.
            return copy.copy(compile_source(origin.source, origin.package_dirs))
    source = origin.source
    return with_an_acceleration(mujoco.MjSpec.from_file(source) if origin.is_file else mujoco.MjSpec.from_string(source))


def with_an_acceleration(spec: Any) -> Any:
    """The compiled model of a `mujoco.MjSpec` with a sensor of its first body's acceleration."""
    mujoco: Any = importlib.import_module("mujoco")
    sensor = spec.add_sensor(name="acceleration", type=mujoco.mjtSensor.mjSENS_FRAMELINACC)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_XBODY, spec.bodies[1].name
    return spec.compile()


class MujocoSim:
    """A batch of MuJoCo's with what tasks read of a `stepper.Stepper`, and what they call.

    Args:
        model: stepper's model of the scene.
        num_envs: Number of environments.
        engine: "mujoco.batch" or "mjbatch".
        threads: Threads that step.
        m: MuJoCo's model; None is made of `model`.
    """

    def __init__(self, model: Model, num_envs: int, *, engine: str = "mujoco.batch", threads: int = 1, m: Any = None):
        if engine not in ("mujoco.batch", "mjbatch"):
            raise ValueError(f"engine is {engine!r}, must be 'mujoco.batch' or 'mjbatch'")
        m = mujoco_model(model, with_contact_forces=False) if m is None else m
        self._batch: Any = importlib.import_module(engine).Batch(m, num_envs, threads)
        self._bound: dict[str, Array] = {}
        self.model, self.num_envs = model, num_envs
        self.timestep = float(m.opt.timestep)
        self.status = np.zeros(num_envs, dtype=np.uint32)
        self.randomized: dict[str, Array] = {}

    def __getattr__(self, name: str) -> Any:
        # Called for what is not an attribute only.
        if name not in _READ:
            raise AttributeError(f"MuJoCo's batch has no {name!r}: benches/mujoco_vector.py has what tasks read of it")
        known = _READ[name] in self._bound
        values = self.bind(_READ[name])
        if not known:
            # What is asked for the first time is computed from the state as it is.
            self._batch.forward()
        return np.array(values)

    def bind(self, name: str) -> Array:
        """Live view of a field of `MjData`, (num_envs, ...), in MuJoCo's unit. Fields of the state are writable."""
        if name not in self._bound:
            self._bound[name] = self._batch.bind(name)
        return self._bound[name]

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """Makes steps with controls (num_envs, nu), or with the present ones."""
        if ctrl is not None:
            self.bind("ctrl")[:] = ctrl
        self._batch.step(nstep=nstep)

    # Signature of `Stepper.reset` as tasks call it.
    def reset(self, envs: Array | None = None, *, qpos: Array | None = None, qvel: Array | None = None, seed: Any = None) -> None:
        """Begins episodes in the environments of a mask; there is nothing that a seed is for."""
        ids = np.arange(self.num_envs) if envs is None else np.flatnonzero(envs)
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
        """Sets configurations, velocities and activations. Derived quantities follow unless `keep_warmstart`, as Gymnasium's do."""
        ids = np.arange(self.num_envs) if envs is None else np.flatnonzero(envs)
        for name, given in (("qpos", qpos), ("qvel", qvel), ("act", act)):
            if given is not None:
                target = self.bind(name)
                target[ids] = np.broadcast_to(given, target.shape)[ids]
        if not keep_warmstart:
            self._batch.forward(ids)

    def randomize(self, envs: Array | None = None, **fields: Array) -> None:
        """Gives environments parameters of their own."""
        ids = np.arange(self.num_envs) if envs is None else np.flatnonzero(envs)
        for name, values in fields.items():
            self._batch.expand(name)[ids] = values[ids]
            self.randomized.setdefault(name, np.array(values))[ids] = values[ids]
        if _DERIVED & set(fields):
            self._batch.set_const(ids)


class MujocoVectorEnv(VectorEnv[Array, Array, Array]):
    """Environments of a task of `stepper.envs` whose physics is MuJoCo's. It does not pickle.

    Args:
        task: A task, its class, or its name.
        num_envs: Number of environments.
        engine: "mujoco.batch" or "mjbatch".
        threads: Threads that step.
        m: MuJoCo's model; None is made of the task's.
        settings: Of `StepperVectorEnv`: autoreset mode, limit of episodes; and arguments of the task.
    """

    def __init__(
        self,
        task: Task | type[Task] | str,
        num_envs: int,
        *,
        engine: str = "mujoco.batch",
        threads: int = 1,
        m: Any = None,
        **settings: Any,
    ):
        self._envs = envs = StepperVectorEnv(task, num_envs, **settings)
        batch = envs._batch
        if m is None:
            m = mujoco_model(batch.sim.model, with_contact_forces=reads_contact_forces(envs.task))
        batch.sim = MujocoSim(batch.sim.model, num_envs, engine=engine, threads=threads, m=m)  # type: ignore[assignment]
        batch.forget()
        self.num_envs, self.metadata = num_envs, envs.metadata
        self.single_observation_space, self.single_action_space = envs.single_observation_space, envs.single_action_space
        self.observation_space, self.action_space = envs.observation_space, envs.action_space

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """As of `StepperVectorEnv`, with its starts."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        return self._envs.reset(seed=seed, options=options)

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """As of `StepperVectorEnv`."""
        return self._envs.step(actions)

    def set_state(self, qpos: Array, qvel: Array, envs: Any = None) -> Array:
        """As of `StepperVectorEnv`."""
        return self._envs.set_state(qpos, qvel, envs)


def register(name: str) -> str:
    """Has Gymnasium know a task of stepper's, "Go1Velocity-v0", on MuJoCo's batch as "mujoco_batch/Go1Velocity-v0", which it returns."""
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

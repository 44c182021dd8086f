"""The binary: models and steppers.

Arrays are C-contiguous NumPy arrays, float64 unless `precision="f32"`. With `num_envs=None` the leading axis is absent. SI units,
quaternions (w, x, y, z).
"""

import builtins
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._actuators import ActuatorModel
from stepper._options import Options
from stepper._readings import Combination, RayFan
from stepper._record import Recorder
from stepper._sensors import SensorModel

__all__ = ["Model", "ModelError", "State", "Stepper", "__version__", "cpu_levels"]
__version__: Final[str]

_Array: TypeAlias = NDArray[Any]

def cpu_levels() -> list[str]:
    """CPU levels of this machine, slowest first; STEPPER_CPU_LEVEL chooses one. Results have the same bits at every level."""

class ModelError(ValueError):
    """A model that cannot be simulated: what is wrong, where in the model, and what to do."""

@final
class Model:
    """A scene, immutable: bodies, joints, geoms, actuators, sensors.

    Any field that `replace` takes can be read as an attribute, e.g. `model.geom_friction` (ngeom, 3).
    """

    name: Final[str]
    nq: Final[int]
    nv: Final[int]
    nu: Final[int]
    na: Final[int]
    nbody: Final[int]
    njnt: Final[int]
    ngeom: Final[int]
    nsensordata: Final[int]
    body_names: Final[list[str]]
    joint_names: Final[list[str]]
    geom_names: Final[list[str]]
    actuator_names: Final[list[str]]
    sensor_names: Final[list[str]]
    site_names: Final[list[str]]
    keyframe_names: Final[list[str]]
    sensors: Final[list[dict[str, Any]]]
    """name, type, adr (of the first reading), dim, datatype; and what the source declares: noise, cutoff, delay, interval."""
    omitted: Final[list[tuple[str, str, str]]]
    """(kind, name, reason) of everything in the source that this model leaves out."""
    digest: Final[str]
    """SHA-256 of the model, in hexadecimal."""

    @staticmethod
    def from_description(description: dict[str, Any], strict: bool) -> Model:
        """The model of a plain description (the fields of the Rust crate's `Model`), checked.

        Raises:
            ModelError: The description is not valid, or strict and it has elements that are not simulated.
        """
    @staticmethod
    def from_bytes(bytes: bytes) -> Model:
        """The inverse of `to_bytes`."""
    @staticmethod
    def from_file(path: str | PathLike[str]) -> Model:
        """A model that `save` wrote."""
    def to_bytes(self) -> bytes:
        """The contents of a saved model."""
    def save(self, path: str | PathLike[str]) -> None:
        """Writes the model so that `stepper.load(path)` gives the same one, bit for bit, without the MJCF reader."""
    def explain(self) -> str:
        """What is modelled, what was left out and why, and what rigid bodies cannot model."""
    def replace(self, **fields: ArrayLike) -> Model:
        """A new model with other values in some fields, e.g. `geom_restitution=` (ngeom,); what derives from a field follows.

        Raises:
            ValueError: A wrong shape.
            ModelError: An unknown field, or values that the model cannot have.
        """
    def with_sensors(self, sensors: Mapping[str, RayFan | Combination]) -> Model:
        """A new model with more sensors by name, behind its own.

        Raises:
            ValueError: A name that nothing has, or directions that are none.
            ModelError: A sensor that the model cannot have.
        """
    def geoms_seen_from(self, site: int) -> list[int]:
        """Indices of the geoms that rays from a site can meet: all simple shapes but those of the site's own body."""
    def __getattr__(self, name: str, /) -> _Array: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class State:
    """Everything of a `Stepper` that survives a step. Compares by bits and pickles."""

    bytes: Final[builtins.bytes]
    """What `State(bytes, digest)` takes."""
    digest: Final[builtins.bytes]
    """SHA-256 of the model that it belongs to."""
    nbytes: Final[int]
    def __new__(cls, bytes: builtins.bytes, digest: builtins.bytes) -> State: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Stepper:
    """Environments of one model, stepped together. The GIL is released while stepping. Pickles with its state.

    Args:
        model: The scene.
        num_envs: Number of environments; None is a single one, without the leading axis.
        options: Settings of the step; None is `Options()`.
        precision: "f64" or "f32".
        threads: Threads that step; 0 is all that this process may use. The bits are the same for any number.
        seed: For what is random: the errors of sensors.
        sensors: What sensors make of the truth; None is ideal ones.
        actuators: What becomes of controls before they are forces; None is ideal actuators.

    Raises:
        ValueError: A setting out of its range.
        TypeError: A setting of the wrong type.
        MemoryError: More environments than there is memory for.
    """

    model: Final[Model]
    options: Final[Options]
    num_envs: Final[int | None]
    timestep: Final[float]
    precision: Final[str]
    threads: Final[int]
    seed: Final[int]
    qpos: Final[_Array]
    """Configuration, a copy: (num_envs, nq)."""
    qvel: Final[_Array]
    """Velocity, a copy: (num_envs, nv)."""
    act: Final[_Array]
    """Activations, a copy: (num_envs, na)."""
    ctrl: Final[_Array]
    """Controls of the last call of `step`, a copy: (num_envs, nu)."""
    time: Final[Any]
    """Simulated time in s: (num_envs,)."""
    status: Final[Any]
    """Flags of the last call of `step`, see `stepper.Status`: (num_envs,) uint32."""
    residual: Final[Any]
    """Natural-map residual of the last step in m/s: (num_envs,)."""
    iterations: Final[Any]
    """Sweeps and Newton steps of the solver in the last step, together: (num_envs,) uint32."""
    penetration: Final[Any]
    """Deepest overlap of the last step's contacts, beyond their margins, in m: (num_envs,)."""
    recorder: Any
    """Whom `step`, `reset` and `set_state` tell what they did (see `stepper.Recorder`); None is nobody."""
    sensors: Final[SensorModel | None]
    """What sensors make of the truth."""
    actuators: Final[ActuatorModel | None]
    """What becomes of controls before they are forces, as the stepper was made; what `randomize` drew since is in `randomized`."""
    observation: Final[_Array]
    """Sensor readings of the last step, the same however often they are read: (num_envs, nsensordata)."""
    sensor_truth: Final[_Array]
    """The readings of ideal sensors: (num_envs, nsensordata).

    Positions and velocities are those after the last step; accelerations are (v+ - v) / h of that step, impulses of contacts and limits
    included, and forces are impulses over h. Where no step was made since the state was set, accelerations and forces are those of the step
    that would be made from it.
    """
    sensor_faults: Final[_Array]
    """Of each sensor, readings that were clipped to its limits and samples that were lost in the last call of `step`:
    (num_envs, nsensor, 2) uint32."""
    actuator_saturation: Final[_Array]
    """Steps of the last call of `step` in which the effort of each actuator was cut to its bounds: its `forcerange`, its joint's
    `actuatorfrcrange`, or the limits and torque-speed curve of its drive: (num_envs, nu) uint32."""
    qfrc_applied: _Array
    """Writable, read by every step: forces on the joints in N or N m, (num_envs, nv)."""
    xfrc_applied: _Array
    """Writable, read by every step: force (N) and torque (N m) at every body's centre of mass, world axes, (num_envs, nbody, 6)."""
    mocap_pos: _Array
    """Writable, read by every step: positions of the mocap bodies in m, (num_envs, nmocap, 3)."""
    mocap_quat: _Array
    """Writable, read by every step: orientations of the mocap bodies, (num_envs, nmocap, 4)."""
    randomized: Final[dict[str, Any]]
    """What environments have of their own, as `randomize` takes it: arrays by field, and under "actuators" an `ActuatorModel`. Copies."""

    def __new__(
        cls,
        model: Model,
        num_envs: int | None = None,
        *,
        options: Options | None = None,
        precision: str = "f64",
        threads: int = 1,
        seed: int = 0,
        sensors: SensorModel | None = None,
        actuators: ActuatorModel | None = None,
    ) -> Stepper: ...
    def reset(
        self,
        mask: ArrayLike | None = None,
        *,
        qpos: ArrayLike | None = None,
        qvel: ArrayLike | None = None,
        seed: int | None = None,
        keyframe: str | None = None,
    ) -> None:
        """Starts a new episode in all environments, or in those of a boolean mask (num_envs,). Nothing of the old one remains.

        Args:
            mask: Which environments; None is all.
            qpos: Where they start, (num_envs, nq) or (nq,); None is the model's reference. Quaternions are normalised.
            qvel: How fast, (num_envs, nv) or (nv,); None is at rest.
            seed: A new seed; None keeps the old one.
            keyframe: Name of a keyframe to start from.

        Raises:
            ValueError: A wrong shape, a number that is not finite, a quaternion of zeros. Nothing is changed then.
            KeyError: No such keyframe.
        """
    def step(self, ctrl: ArrayLike | None = None, nstep: int = 1) -> None:
        """Makes `nstep` steps in every environment.

        Args:
            ctrl: Controls, (num_envs, nu) or (nu,) for all, held for all steps; None is zero.
            nstep: Number of steps.

        Raises:
            ValueError: A wrong shape; the message has both. A control that is NaN is no error: its environment keeps its state and
                says NON_FINITE in `status`.
        """
    def rollout(
        self, ctrl: ArrayLike, nstep: int = 1, *, fields: Sequence[str] | None = None, out: dict[str, _Array] | None = None
    ) -> dict[str, _Array]:
        """Makes `nstep` steps with each of T controls, without Python in between: the bits of T calls of `step`.

        A thread keeps its environments for all T controls. `qfrc_applied`, `xfrc_applied` and mocap poses stay as they are throughout.

        Args:
            ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
            nstep: Steps that each control is held.
            fields: What to write down after every control: "qpos" (T, num_envs, nq), "qvel" (T, num_envs, nv), "act" (T, num_envs, na),
                "observation" (T, num_envs, nsensordata). None is what `out` names, and without `out` all but "act".
            out: Arrays to write into, by field: of those shapes, C-contiguous, float64, or float32 with `precision="f32"`.

        Returns:
            The arrays by field; and always "status" (T, num_envs) uint32, the flags of all steps of a control, and "residual"
            (T, num_envs) float64, the largest residual among them in m/s. Both can be named in `out` too. Afterwards `status` has the
            flags of all steps of the call, `residual` and `iterations` are those of the last step.

        Raises:
            ValueError: A wrong shape, an unknown field, an array of `out` that cannot be written or is given twice.
            TypeError: An array of `out` of the wrong dtype.
        """
    def memory(self) -> dict[str, int]:
        """Memory that the environments take, in bytes, without NumPy arrays that were handed out.

        Returns:
            "per_env": of each environment; "per_thread": working room of each thread that steps, none of which is per environment;
            "state", "parameters" and "inputs": what all environments hold, what they have of their own by `randomize` and as numbers of
            drives, and what waits for the next step (controls, applied forces, mocap poses); "threads": how many have room; "total":
            "state" + "parameters" + "inputs" + "threads" x "per_thread".
        """
    def set_state(
        self,
        qpos: ArrayLike | State | None = None,
        qvel: ArrayLike | None = None,
        mask: ArrayLike | None = None,
        *,
        act: ArrayLike | None = None,
    ) -> None:
        """Sets configuration, velocity or activations; or, given a `State` alone, everything that survives a step.

        Warm starts are forgotten, so that what follows depends on the new state alone; continuing from a `State` repeats the same bits.

        Args:
            qpos: (num_envs, nq) or (nq,), or what `get_state` returned.
            qvel: (num_envs, nv) or (nv,).
            mask: Which environments; None is all.
            act: (num_envs, na) or (na,).

        Raises:
            ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a state of another model. Nothing is changed
                then.
        """
    def randomize(self, mask: ArrayLike | None = None, **fields: ArrayLike | ActuatorModel | None) -> None:
        """Gives environments parameters of their own, as `Model.replace` would give them to a model; what derives from them follows.

        Every environment then moves as one of a `Stepper` of its own model, bit for bit. Parameters are not part of the state: `reset` and
        `set_state` leave them, pickles and recordings have them. Other fields stay as they are, whether the model's or randomized before.
        What no environment has of its own costs neither time nor memory.

        Args:
            mask: (num_envs,) bool: the environments that change; None is all. Rows of the others are not read.
            **fields: Arrays with num_envs in front of the shape that the field has in the model; None gives the model's own numbers
                back, and so do all fields when none is named:
                gravity (num_envs, 3) m/s^2; body_mass (num_envs, nbody) kg, body_ipos (num_envs, nbody, 3) m, the centre of mass, and
                body_inertia (num_envs, nbody, 3) kg m^2, principal moments, each by itself: a body of twice the mass keeps its inertia
                unless it is given too; geom_friction (num_envs, ngeom, 3) sliding, torsional (m), rolling (m); geom_restitution
                (num_envs, ngeom); geom_size, geom_pos (num_envs, ngeom, 3) m, which leave masses alone; jnt_stiffness (num_envs, njnt) N/m
                or N m/rad; jnt_range (num_envs, njnt, 2) m or rad; dof_damping, dof_armature, dof_frictionloss (num_envs, nv);
                actuator_gain, actuator_bias (num_envs, nu, 3), whose force is gain . (1, length, velocity) times the input plus
                bias . (1, length, velocity).
                actuators, a `stepper.ActuatorModel`: its drives take the place of those of the actuators it fits, with all their numbers
                (what a `Drive` does not say is its default); other actuators keep theirs, and None gives back what the stepper was made
                with. Stages are compiled: a servo, motor, lag, limits or friction must have been given to `Stepper(..., actuators=)`, to
                one environment at least, and delays may be as long as the longest there. Delay lines, lags and integrals are state: they
                stay as they are until `reset`.

        Raises:
            ValueError: A wrong shape; both are named. A number that a drive may not have, or a stage or delay that it was not made for,
                with the actuator. Nothing is changed then.
            ModelError: A field that all environments share, numbers that no model may have, or that ask for something that the model has
                none of, such as dry friction where it has 0; with field, element and environment. Nothing is changed then.
        """
    def record(self, path: str | PathLike[str], **settings: Any) -> Recorder:
        """Writes everything that happens from now on into a new folder, until the `Recorder` is closed; `stepper.replay` repeats it.

        Args:
            path: A folder that does not exist yet, or is empty.
            **settings: See `stepper.Recorder`.
        """
    def observe(self, out: _Array | None = None) -> _Array:
        """`observation`, written into `out` if there is one: (num_envs, nsensordata), without an allocation if it is float64."""
    def get_state(self) -> State:
        """Everything that survives a step."""
    def contacts(self, env: int = 0) -> NDArray[np.void]:
        """Contacts of the last step of one environment: those that were given a row.

        That is every one that the motion can close within the step, also contacts that do not touch (distance > 0), mostly without force.
        Distances are measured from the margin, at which contacts begin to push. A gap, which in MuJoCo 4 reports contacts beyond the margin
        that do not push, has no effect here: what is farther than a step away is not listed.

        Returns:
            A structured array: geom (2,), body (2,), pos (3,) in m, normal (3,) from the first geom to the second, distance in m from
            the margin, force (3,) in N on the second geom along normal, t1, t2, torque (3,) in N m on it about the same directions, of
            torsional and rolling friction (condim 4 and 6), and frame (3, 3), whose rows are these directions. The second geom's torque
            acts at pos, and |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
        """
    def mass_matrix(self, env: int = 0) -> NDArray[np.float64]:
        """Mass matrix of the present configuration, (nv, nv), armature included, without terms that depend on the time step."""
    def bias_force(self, env: int = 0) -> NDArray[np.float64]:
        """Coriolis, centrifugal and gravitational forces of the present state, (nv,): MuJoCo's qfrc_bias."""
    def smooth_acceleration(self, env: int = 0, *, ctrl: ArrayLike | None = None) -> NDArray[np.float64]:
        """Acceleration without constraints in the present state, (nv,): MuJoCo's qacc_smooth.

        Args:
            env: The environment.
            ctrl: Controls, (nu,); None is those of the last call of `step`. With `actuators=`, what the drives hand on to the
                actuators' law (None is what they did last).
        """
    def energy(self, env: int = 0) -> tuple[float, float]:
        """Potential energy (gravity, joint springs) and kinetic energy (armature included), in J."""
    def momentum(self, env: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Linear momentum in kg m/s (3,), and angular momentum about the centre of mass in kg m^2/s (3,)."""
    def __getstate__(self) -> dict[str, Any]: ...
    def __setstate__(self, state: dict[str, Any]) -> None: ...

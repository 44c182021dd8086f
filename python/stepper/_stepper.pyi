"""The binary: models and steppers.

Arrays are C-contiguous NumPy arrays, float64 unless `precision="f32"`. With `num_envs=None` the leading axis is absent. SI units,
quaternions (w, x, y, z). What an attribute gives is a read-only copy, unless its documentation says that it is writable; what a method
returns belongs to whoever asked.
"""

import builtins
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._options import Options, Precision
from stepper.actuators import ActuatorModel
from stepper.derivatives import Linearization
from stepper.recording import Recorder
from stepper.sensors import Combination, RayFan, SensorModel, SensorSpec
from stepper.viewer import View

__all__ = [
    "Actuator",
    "Body",
    "Geom",
    "Joint",
    "Keyframe",
    "Model",
    "ModelError",
    "Pair",
    "Sensor",
    "Site",
    "State",
    "Stepper",
    "Tendon",
    "__version__",
    "cpu_levels",
    "fields",
    "selected",
]
__version__: Final[str]

_Array: TypeAlias = NDArray[Any]

def cpu_levels() -> list[str]:
    """CPU levels of this machine, slowest first."""

def fields() -> list[tuple[str, str, str, str, bool]]:
    """Fields that `Model.replace` takes: name, shape ("(ngeom, 3)"), quantity, unit, and whether `Stepper.randomize` takes it."""

def selected(envs: ArrayLike | None, num_envs: int) -> list[int]:
    """Environments that an argument `envs` selects, in its order: see `Stepper.reset`.

    Args:
        envs: A boolean mask (num_envs,), or integer indices; None is all.
        num_envs: Number of environments.

    Raises:
        TypeError: Numbers that are no integers, with the first of them.
        ValueError: A mask of another length, an index twice.
        IndexError: An index out of range.
    """

class ModelError(ValueError):
    """A model that cannot be simulated: what is wrong, where, and what to do."""

@final
class Body:
    """A body of a model."""

    id: Final[int]
    """Index; the world's is 0."""
    name: Final[str]
    """Name; may be empty."""
    parentid: Final[int]
    """Index of the parent; the world's is 0."""
    mass: Final[float]
    """Mass, kg."""
    inertia: Final[_Array]
    """Principal moments of inertia, kg m^2: (3,)."""
    pos: Final[_Array]
    """Position in the parent's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation in the parent's frame: (4,)."""
    ipos: Final[_Array]
    """Centre of mass in the body's frame, m: (3,)."""
    iquat: Final[_Array]
    """Orientation of the principal axes in the body's frame: (4,)."""
    mocapid: Final[int]
    """Row of `mocap_pos` and `mocap_quat` of a body that the user poses, else -1."""
    jntadr: Final[int]
    """Index of its first joint; -1 without one."""
    jntnum: Final[int]
    """Number of its joints."""
    dofadr: Final[int]
    """Address of its first degree of freedom in qvel; -1 without one."""
    dofnum: Final[int]
    """Number of its degrees of freedom."""
    geomadr: Final[int]
    """Index of its first geom; -1 without one."""
    geomnum: Final[int]
    """Number of its geoms."""

@final
class Joint:
    """A joint of a model."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    type: Final[str]
    """"free", "ball", "slide" or "hinge"."""
    bodyid: Final[int]
    """Index of the body that it moves."""
    qposadr: Final[int]
    """Address of its first coordinate in qpos."""
    dofadr: Final[int]
    """Address of its first degree of freedom in qvel."""
    nq: Final[int]
    """Number of its coordinates in qpos."""
    nv: Final[int]
    """Number of its degrees of freedom in qvel."""
    limited: Final[bool]
    """Whether its position has bounds."""
    range: Final[_Array]
    """Lowest and highest position, m or rad: (2,), infinite where there is no bound."""
    pos: Final[_Array]
    """Anchor in the body's frame, m: (3,)."""
    axis: Final[_Array]
    """Unit axis of a slide or hinge in the body's frame: (3,)."""
    stiffness: Final[float]
    """Spring stiffness, N/m or N m/rad."""
    damping: Final[float]
    """Viscous damping, N s/m or N m s/rad."""
    armature: Final[float]
    """Added inertia, kg or kg m^2."""
    frictionloss: Final[float]
    """Dry friction, N or N m."""
    velocity_limit: Final[float]
    """Highest speed that the source allows, rad/s or m/s, not enforced; infinite where there is none."""

@final
class Geom:
    """A geom of a model."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    bodyid: Final[int]
    """Index of the body that it is fixed to."""
    type: Final[str]
    """"plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield"."""
    size: Final[_Array]
    """Radius, half length; or half sizes; or semi-axes; 0 where the shape has no number; m: (3,)."""
    pos: Final[_Array]
    """Position in the body's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation in the body's frame: (4,)."""
    contype: Final[int]
    """Bit mask: two geoms may collide if one's contype meets the other's conaffinity."""
    conaffinity: Final[int]
    """Bit mask, see `contype`."""
    condim: Final[int]
    """Rows of a contact: 1, 3, 4 or 6."""
    priority: Final[int]
    """The pair takes the friction and condim of the geom with the higher priority."""
    friction: Final[_Array]
    """Sliding (1), torsional (m), rolling (m) friction: (3,)."""
    restitution: Final[float]
    """Newton's coefficient of restitution, 0 to 1."""
    margin: Final[float]
    """Distance at which a contact pushes, m."""
    gap: Final[float]
    """Distance beyond the margin that is reported, m."""

@final
class Pair:
    """An explicit pair of geoms of a model: they collide whatever filters say, with the pair's own numbers."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    geom1: Final[int]
    """Index of the first geom."""
    geom2: Final[int]
    """Index of the second geom."""
    dim: Final[int]
    """Rows of a contact: 1, 3, 4 or 6."""
    friction: Final[_Array]
    """Sliding (1), torsional (m), rolling (m) friction: (3,)."""
    restitution: Final[float]
    """Newton's coefficient of restitution, 0 to 1."""
    margin: Final[float]
    """Distance at which a contact pushes, m."""
    gap: Final[float]
    """Distance beyond the margin that is reported, m."""

@final
class Site:
    """A site of a model."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    bodyid: Final[int]
    """Index of the body that it is fixed to."""
    type: Final[str]
    """"sphere", "capsule", "cylinder", "ellipsoid" or "box"."""
    pos: Final[_Array]
    """Position in the body's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation in the body's frame: (4,)."""

@final
class Actuator:
    """An actuator of a model."""

    id: Final[int]
    """Index: its place in ctrl."""
    name: Final[str]
    """Name; may be empty."""
    trntype: Final[str]
    """What it pulls on: "joint", "tendon" or "site"."""
    trnid: Final[int]
    """Index of that."""
    actadr: Final[int]
    """Address of its activation in act; -1 without one."""
    ctrlrange: Final[_Array]
    """Bounds of the control: (2,), infinite where there is none."""
    forcerange: Final[_Array]
    """Bounds of the force, N or N m: (2,), infinite where there is none."""
    actrange: Final[_Array]
    """Bounds of the activation: (2,), infinite where there is none."""
    gear: Final[_Array]
    """Scale of length, velocity and force, in column 0; force and torque on a site: (6,)."""
    gaintype: Final[str]
    """Type of the gain: "fixed", "affine", "dcmotor" or "pid"."""
    gainprm: Final[_Array]
    """Parameters of the gain: constant, per length, per velocity; others are 0: (10,)."""
    biastype: Final[str]
    """Type of the bias: "none", "affine" or "dcmotor"."""
    biasprm: Final[_Array]
    """Parameters of the bias: constant, per length, per velocity; others are 0: (10,)."""

@final
class Sensor:
    """A sensor of a model."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    type: Final[str]
    """Kind, as MJCF calls it: "gyro"."""
    adr: Final[int]
    """Address of its first reading."""
    dim: Final[int]
    """Number of its readings."""
    noise: Final[float]
    """Noise that the source declares."""
    cutoff: Final[float]
    """Cutoff that the source declares."""

@final
class Tendon:
    """A fixed tendon of a model: its length is a linear combination of joint positions."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    jntid: Final[_Array]
    """Indices of its joints: (n,) int64."""
    coef: Final[_Array]
    """Their coefficients: (n,)."""
    limited: Final[bool]
    """Whether its length has bounds."""
    range: Final[_Array]
    """Lowest and highest length: (2,), infinite where there is no bound."""
    stiffness: Final[float]
    """Spring stiffness."""
    damping: Final[float]
    """Viscous damping."""
    armature: Final[float]
    """Added inertia."""
    frictionloss: Final[float]
    """Dry friction."""

@final
class Keyframe:
    """A keyframe of a model: a named state, which `Stepper.reset(keyframe=)` starts from."""

    id: Final[int]
    """Index."""
    name: Final[str]
    """Name; may be empty."""
    time: Final[float]
    """s"""
    qpos: Final[_Array]
    """Configuration: (nq,)."""
    qvel: Final[_Array]
    """Velocity: (nv,)."""
    act: Final[_Array]
    """Activations: (na,)."""
    ctrl: Final[_Array]
    """Controls: (nu,)."""

@final
class Model:
    """A scene, immutable: bodies, joints, geoms, actuators, sensors.

    Every field that `replace` takes is an attribute, a read-only copy, e.g. `model.geom_friction` (ngeom, 3). Models compare by
    value and pickle.
    """

    name: Final[str]
    """Name of the scene; may be empty."""
    nq: Final[int]
    """Coordinates of a configuration."""
    nv: Final[int]
    """Degrees of freedom."""
    nu: Final[int]
    """Controls."""
    na: Final[int]
    """Activations of actuators."""
    nbody: Final[int]
    """Bodies, the world included, which is body 0."""
    njnt: Final[int]
    """Joints."""
    nsite: Final[int]
    """Sites."""
    ngeom: Final[int]
    """Geoms."""
    npair: Final[int]
    """Explicit pairs of geoms."""
    nsensordata: Final[int]
    """Readings of all sensors together."""
    body_names: Final[list[str]]
    """Names of the bodies in their order; empty where one has none."""
    joint_names: Final[list[str]]
    """Names of the joints in their order; empty where one has none."""
    geom_names: Final[list[str]]
    """Names of the geoms in their order; empty where one has none."""
    pair_names: Final[list[str]]
    """Names of the explicit pairs of geoms in their order; empty where one has none."""
    actuator_names: Final[list[str]]
    """Names of the actuators in their order; empty where one has none."""
    sensor_names: Final[list[str]]
    """Names of the sensors in their order; empty where one has none."""
    site_names: Final[list[str]]
    """Names of the sites in their order; empty where one has none."""
    keyframe_names: Final[list[str]]
    """Names of the keyframes in their order; empty where one has none."""
    tendon_names: Final[list[str]]
    """Names of the fixed tendons in their order; empty where one has none."""
    sensors: Final[list[dict[str, Any]]]
    """name, type, adr (of the first reading), dim, datatype; and what the source declares: noise, cutoff, delay, interval."""
    omitted: Final[list[tuple[str, str, str]]]
    """(kind, name, reason) of everything in the source that this model leaves out."""
    requested: Final[dict[str, Any] | None]
    """What the source asks of a simulator that stepper does in its own way: integrator, solver, iterations, cone, constrained
    (whether it has constraints, which are soft there), soft (what has solref or solimp of its own). None where the model was made
    in code."""
    excluded_overlaps: Final[list[tuple[str, str, float]]]
    """Pairs of geoms that overlap at the reference pose and whose bodies do not collide for that reason (`exclude_overlaps`), in the
    format of `overlaps()`."""
    wide_hulls: Final[list[tuple[int, float]]]
    """Geoms whose convex hull, as which they collide, has at least twice the volume of their mesh, or 1.25 times for fixed geoms: (index
    of the geom, hull volume / mesh volume). The mesh volume is the space that other geoms cannot enter; the ratio is infinite if there
    is none, as for an open valley."""
    deviations: Final[list[str]]
    """What the source asks for expressly and default options do otherwise, in words: an integrator other than Euler's, softness."""
    digest: Final[str]
    """SHA-256 of the model, in hexadecimal."""
    @property
    def gravity(self) -> _Array:
        """Gravitational acceleration, m/s^2: (3,)."""
    @property
    def timestep(self) -> _Array:
        """Default time step, s."""
    @property
    def qpos0(self) -> _Array:
        """Configuration at reset, m or rad: (nq,)."""
    @property
    def qpos_spring(self) -> _Array:
        """Configuration in which springs rest, m or rad: (nq,)."""
    @property
    def density(self) -> _Array:
        """Density of the medium, kg/m^3."""
    @property
    def viscosity(self) -> _Array:
        """Viscosity of the medium, Pa s."""
    @property
    def wind(self) -> _Array:
        """Velocity of the medium, m/s: (3,)."""
    @property
    def body_gravcomp(self) -> _Array:
        """Share of its weight that is held up: (nbody,)."""
    @property
    def geom_surfacevel(self) -> _Array:
        """Velocity of the surface, m/s and rad/s: (ngeom, 6)."""
    @property
    def body_mass(self) -> _Array:
        """Mass, kg: (nbody,)."""
    @property
    def body_inertia(self) -> _Array:
        """Principal moments of inertia, kg m^2: (nbody, 3)."""
    @property
    def body_ipos(self) -> _Array:
        """Centre of mass in the body's frame, m: (nbody, 3)."""
    @property
    def body_iquat(self) -> _Array:
        """Orientation of the principal axes: (nbody, 4)."""
    @property
    def body_pos(self) -> _Array:
        """Position in the parent's frame, m: (nbody, 3)."""
    @property
    def body_quat(self) -> _Array:
        """Orientation in the parent's frame: (nbody, 4)."""
    @property
    def geom_friction(self) -> _Array:
        """Sliding (1), torsional (m), rolling (m) friction: (ngeom, 3)."""
    @property
    def geom_restitution(self) -> _Array:
        """Coefficient of restitution: (ngeom,)."""
    @property
    def geom_margin(self) -> _Array:
        """Distance at which a contact pushes, m: (ngeom,)."""
    @property
    def geom_gap(self) -> _Array:
        """Distance beyond the margin that is reported, m: (ngeom,)."""
    @property
    def geom_solref(self) -> _Array:
        """Reference acceleration of contacts by MuJoCo's law: (ngeom, 2)."""
    @property
    def geom_solimp(self) -> _Array:
        """Impedance of contacts by MuJoCo's law: (ngeom, 5)."""
    @property
    def geom_solmix(self) -> _Array:
        """Weight of a geom's softness in a pair: (ngeom,)."""
    @property
    def geom_stiffness(self) -> _Array:
        """Stiffness of the surface; infinity is rigid, N/m: (ngeom,)."""
    @property
    def geom_damping(self) -> _Array:
        """Damping of the surface, N s/m: (ngeom,)."""
    @property
    def pair_dim(self) -> _Array:
        """Rows of an explicit pair's contacts: (npair,)."""
    @property
    def pair_friction(self) -> _Array:
        """Sliding (1), torsional (m), rolling (m) friction of an explicit pair: (npair, 3)."""
    @property
    def pair_anisotropy(self) -> _Array:
        """Friction along the second tangent per that along the first, of sliding and rolling, by MuJoCo's law: (npair, 2)."""
    @property
    def pair_restitution(self) -> _Array:
        """Coefficient of restitution of an explicit pair: (npair,)."""
    @property
    def pair_margin(self) -> _Array:
        """Distance at which an explicit pair's contact pushes, m: (npair,)."""
    @property
    def pair_gap(self) -> _Array:
        """Distance beyond the margin of an explicit pair that is reported, m: (npair,)."""
    @property
    def pair_solref(self) -> _Array:
        """Reference acceleration of an explicit pair's contacts by MuJoCo's law: (npair, 2)."""
    @property
    def pair_solreffriction(self) -> _Array:
        """Stiffness and damping of an explicit pair's friction by MuJoCo's law; zeros where it is that of the normal: (npair, 2)."""
    @property
    def pair_solimp(self) -> _Array:
        """Impedance of an explicit pair's contacts by MuJoCo's law: (npair, 5)."""
    @property
    def pair_stiffness(self) -> _Array:
        """Stiffness of an explicit pair's contacts; infinity is rigid, N/m: (npair,)."""
    @property
    def pair_damping(self) -> _Array:
        """Damping of an explicit pair's contacts, N s/m: (npair,)."""
    @property
    def geom_size(self) -> _Array:
        """Radius, half length; or half sizes; or semi-axes; 0 where the shape has no number, m: (ngeom, 3)."""
    @property
    def geom_pos(self) -> _Array:
        """Position in the body's frame, m: (ngeom, 3)."""
    @property
    def geom_quat(self) -> _Array:
        """Orientation in the body's frame: (ngeom, 4)."""
    @property
    def geom_condim(self) -> _Array:
        """Rows of a contact: (ngeom,)."""
    @property
    def geom_concave(self) -> _Array:
        """Whether a mesh collides as its triangles (1) or as its convex hull (0): (ngeom,)."""
    @property
    def jnt_stiffness(self) -> _Array:
        """Spring stiffness, N/m or N m/rad: (njnt,)."""
    @property
    def jnt_range(self) -> _Array:
        """Lowest and highest position, m or rad: (njnt, 2)."""
    @property
    def jnt_actfrcrange(self) -> _Array:
        """Bounds of the sum of actuator forces, N or N m: (njnt, 2)."""
    @property
    def jnt_velocity_limit(self) -> _Array:
        """Highest speed that the source allows, not enforced; infinity is none, rad/s or m/s: (njnt,)."""
    @property
    def jnt_solref(self) -> _Array:
        """Reference acceleration of limits by MuJoCo's law: (njnt, 2)."""
    @property
    def jnt_solimp(self) -> _Array:
        """Impedance of limits by MuJoCo's law: (njnt, 5)."""
    @property
    def dof_damping(self) -> _Array:
        """Viscous damping, N s/m or N m s/rad: (nv,)."""
    @property
    def dof_armature(self) -> _Array:
        """Added inertia, kg or kg m^2: (nv,)."""
    @property
    def dof_frictionloss(self) -> _Array:
        """Dry friction, N or N m: (nv,)."""
    @property
    def dof_solref(self) -> _Array:
        """Reference acceleration of dry friction by MuJoCo's law: (nv, 2)."""
    @property
    def dof_solimp(self) -> _Array:
        """Impedance of dry friction by MuJoCo's law: (nv, 5)."""
    @property
    def tendon_range(self) -> _Array:
        """Lowest and highest length: (ntendon, 2)."""
    @property
    def tendon_stiffness(self) -> _Array:
        """Spring stiffness: (ntendon,)."""
    @property
    def tendon_lengthspring(self) -> _Array:
        """Lengths between which the spring is slack: (ntendon, 2)."""
    @property
    def tendon_damping(self) -> _Array:
        """Viscous damping: (ntendon,)."""
    @property
    def tendon_armature(self) -> _Array:
        """Added inertia: (ntendon,)."""
    @property
    def tendon_frictionloss(self) -> _Array:
        """Dry friction, N: (ntendon,)."""
    @property
    def eq_active0(self) -> _Array:
        """1 for an equality that acts, else 0: (neq,)."""
    @property
    def eq_data(self) -> _Array:
        """Anchors, pose and torquescale, or polynomial, as MuJoCo lays them out: (neq, 11)."""
    @property
    def eq_solref(self) -> _Array:
        """Reference acceleration of equalities by MuJoCo's law: (neq, 2)."""
    @property
    def eq_solimp(self) -> _Array:
        """Impedance of equalities by MuJoCo's law: (neq, 5)."""
    @property
    def eq_stiffness(self) -> _Array:
        """Infinity for a hard equality, else a spring's: (neq,)."""
    @property
    def eq_damping(self) -> _Array:
        """Damping beside the spring of a soft equality: (neq,)."""
    @property
    def impratio(self) -> _Array:
        """Ratio of the impedance of friction to that of normal forces by MuJoCo's law."""
    @property
    def noslip_iterations(self) -> _Array:
        """Sweeps at the most that take the slip out of friction by MuJoCo's law."""
    @property
    def noslip_tolerance(self) -> _Array:
        """Relative improvement at which the noslip sweeps stop."""
    @property
    def actuator_gear(self) -> _Array:
        """Scale of length, velocity and force, in column 0; force and torque on a site: (nu, 6)."""
    @property
    def actuator_gainprm(self) -> _Array:
        """Parameters of the gain: constant, per length, per velocity; others are 0: (nu, 10)."""
    @property
    def actuator_biasprm(self) -> _Array:
        """Parameters of the bias: constant, per length, per velocity; others are 0: (nu, 10)."""
    @property
    def actuator_ctrlrange(self) -> _Array:
        """Bounds of the control: (nu, 2)."""
    @property
    def actuator_forcerange(self) -> _Array:
        """Bounds of the force, N or N m: (nu, 2)."""
    @staticmethod
    def from_description(description: dict[str, Any], strict: bool) -> Model:
        """The model of a plain description (the fields of the Rust crate's `Description`), checked.

        Vertices and faces of meshes and elevations of height fields may be arrays.

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
        """A report on the model as text.

        Its sections: settings of the source that default options do not use; modelled elements; left-out elements, with reasons;
        absent elements, which cost nothing; limits of rigid-body models; excluded overlaps; convex hulls that are much larger than their
        mesh; overlaps and violated joint limits at the reference pose.
        """
    def replace(self, values: Mapping[str, ArrayLike] | None = None, /, **fields: ArrayLike) -> Model:
        """A new model with other values in some fields; what derives from a field follows.

            model.replace(geom_restitution=[0.2, 0.8])  # (ngeom,)
            model.replace({"geom_friction[floor,box][0]": 0.5})

        Args:
            values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md); other numbers of these
                fields stay as they are. The
                shape is that of the selected numbers: one name or index and one column have no axis. A single number is for all of them.
            **fields: Whole fields, in the shape that the model has them.

        Contacts of an explicit pair use the fields of the pair (pair_friction, pair_restitution, ...) and ignore those of its geoms. A new
        geom_friction, geom_restitution, geom_margin, geom_gap, geom_condim, geom_solref, geom_solimp, geom_solmix, geom_stiffness or
        geom_damping for a geom of a pair therefore needs the field of the pair in the same call, with new values or the model's: pair_dim
        for geom_condim, pair_solref for geom_solmix.

        Raises:
            ValueError: A wrong shape.
            ModelError: An unknown field, values that the model cannot have, or values of a geom that an explicit pair overrides, with the
                pair.
        """
    def exclude_overlaps(self) -> Model:
        """A new model without contact between bodies that overlap at the reference pose: `stepper.load(..., overlaps="exclude")`.

        `excluded_overlaps` lists the pairs, from a depth of 0.01 mm on. No geoms of the two bodies collide any more; world geoms are
        excluded one by one. Overlaps with the ground stay, and `overlaps()` lists them: those of planes and height fields, and those of
        fixed geoms with a body that has a free joint.
        """
    def overlaps(self) -> list[tuple[str, str, float]]:
        """Pairs of geoms that can collide and overlap by more than 0.01 mm at the reference pose, the deepest first.

        Returns:
            (name of one geom, name of the other, depth in m); "#3 of body arm" where a geom has no name.
        """
    def with_sensors(self, sensors: Mapping[str, RayFan | Combination | SensorSpec]) -> Model:
        """A new model with more sensors by name, behind its own.

        Raises:
            ValueError: A name that nothing has, or directions that are none.
            ModelError: A sensor that the model cannot have.
        """
    def equivalent_springs(self) -> dict[str, NDArray[Any]]:
        """What solref and solimp of the scene's contacts amount to under MuJoCo's law, in newtons and metres, at the model's time step.

        Returns:
            A dictionary of arrays with a row for every pair of geoms that can collide: `geoms` (npair, 2), `stiffness` (npair, 2), N/m at
            rest, at the first touch and where the impedance is largest, and `damping` (npair, 2), N s/m, at the same depths. Pairs of a
            crowd, which are too many to be listed, are left out.
        """
    def body(self, key: str | int) -> Body:
        """A body by its name or index (negative from the end).

        Raises:
            KeyError: No body of that name; the message has near ones.
            IndexError: No body of that index.
        """
    def joint(self, key: str | int) -> Joint:
        """A joint by its name or index (negative from the end): `model.joint("hip").qposadr`.

        Raises:
            KeyError: No joint of that name; the message has near ones.
            IndexError: No joint of that index.
        """
    def geom(self, key: str | int) -> Geom:
        """A geom by its name or index (negative from the end).

        Raises:
            KeyError: No geom of that name; the message has near ones.
            IndexError: No geom of that index.
        """
    def _requested_options(self) -> dict[str, Any]:
        """Settings that the source asks for, for `Options.from_model`: contact, integrator, iterations; empty where it asks for none."""
    def pair(self, key: str | int) -> Pair:
        """An explicit pair of geoms by its name or index (negative from the end).

        Raises:
            KeyError: No pair of that name; the message has near ones.
            IndexError: No pair of that index.
        """
    def site(self, key: str | int) -> Site:
        """A site by its name or index (negative from the end).

        Raises:
            KeyError: No site of that name; the message has near ones.
            IndexError: No site of that index.
        """
    def actuator(self, key: str | int) -> Actuator:
        """An actuator by its name or index (negative from the end).

        Raises:
            KeyError: No actuator of that name; the message has near ones.
            IndexError: No actuator of that index.
        """
    def sensor(self, key: str | int) -> Sensor:
        """A sensor by its name or index (negative from the end).

        Raises:
            KeyError: No sensor of that name; the message has near ones.
            IndexError: No sensor of that index.
        """
    def tendon(self, key: str | int) -> Tendon:
        """A fixed tendon by its name or index (negative from the end).

        Raises:
            KeyError: No tendon of that name; the message has near ones.
            IndexError: No tendon of that index.
        """
    def keyframe(self, key: str | int) -> Keyframe:
        """A keyframe by its name or index (negative from the end).

        Raises:
            KeyError: No keyframe of that name; the message has near ones.
            IndexError: No keyframe of that index.
        """
    def integrate_pos(self, q: ArrayLike, dv: ArrayLike) -> NDArray[np.float64]:
        """Configuration that a displacement leads to, with unit quaternions: MuJoCo's mj_integratePos over a time of 1.

        Args:
            q: Configurations, (..., nq).
            dv: Displacements in the coordinates of velocities, (..., nv): of a ball or free joint the rotation vector in the body's frame.
                The axes before the last are those of `q`, or those of either are absent.

        Returns:
            (..., nq) float64.

        Raises:
            ValueError: Shapes that do not fit, a number that is not finite, a quaternion of zeros.
        """
    def differentiate_pos(self, q1: ArrayLike, q2: ArrayLike) -> NDArray[np.float64]:
        """Displacement from one configuration to another, the shortest: MuJoCo's mj_differentiatePos over a time of 1.

        It is the inverse of `integrate_pos`.

        Args:
            q1: Where it begins, (..., nq).
            q2: Where it ends, (..., nq); the axes before the last are those of `q1`, or those of either are absent.

        Returns:
            (..., nv) float64.

        Raises:
            ValueError: Shapes that do not fit, a number that is not finite, a quaternion of zeros.
        """
    def geoms_seen_from(self, site: int) -> list[int]:
        """Indices of the geoms that rays from a site can meet: all that the model has the form of but those of the site's own body."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class State:
    """Everything that survives a step, of all environments of a `Stepper` or of one; see `Stepper.get_state`.

    Compares by bits and pickles.

    Args:
        bytes: What `State.bytes` gave.

    Raises:
        ValueError: The bytes are no state, cut off or damaged, or of another version.
    """

    bytes: Final[builtins.bytes]
    """What `State(bytes)` takes: the state with a checksum and the digest of its model."""
    digest: Final[builtins.bytes]
    """SHA-256 of the model that it belongs to."""
    nbytes: Final[int]
    """Length of `bytes`."""
    def __new__(cls, bytes: builtins.bytes) -> State: ...
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
    """The scene."""
    options: Final[Options]
    """Settings of the step, as they were given."""
    num_envs: Final[int | None]
    """Number of environments; None is a single one, without the leading axis."""
    timestep: Final[float]
    """Time step in force, s."""
    tolerance: Final[float]
    """Residual at which the solver stops, in force, m/s."""
    precision: Final[Precision]
    """Scalar type of the lanes: "f64" or "f32"."""
    threads: Final[int]
    """Threads that step; 0 is all that this process may use."""
    seed: Final[int]
    """Seed of the errors of sensors."""
    qpos: Final[_Array]
    """Configuration: (num_envs, nq), m and quaternions and rad. `set_state(qpos=...)` sets it."""
    qvel: Final[_Array]
    """Velocity: (num_envs, nv), m/s and rad/s. `set_state(qvel=...)` sets it."""
    act: Final[_Array]
    """Activations of actuators: (num_envs, na). `set_state(act=...)` sets them."""
    ctrl: Final[_Array]
    """Controls in force: (num_envs, nu). Those of the last step or the keyframe that an episode began with, zero after any other
    reset."""
    xpos: Final[_Array]
    """Positions of the bodies at the present `qpos`: (num_envs, nbody, 3) in m, of their frames' origins. Body 0 is the world.
    MuJoCo's `mj_step` leaves those before the step, `mj_forward` these. Like all that is derived from the state, they are computed
    when asked for, of all environments at once, and the array is the same one until something changes; what was asked for together
    after the last change is computed in one pass."""
    xquat: Final[_Array]
    """Orientations of the bodies at the present `qpos`: (num_envs, nbody, 4)."""
    body_linvel: Final[_Array]
    """Velocities of the bodies' frames at the present state in world axes: (num_envs, nbody, 3) in m/s. Bodies that the user poses
    stand still, as in MuJoCo."""
    body_angvel: Final[_Array]
    """Angular velocities of the bodies at the present state in world axes: (num_envs, nbody, 3) in rad/s."""
    site_xpos: Final[_Array]
    """Positions of the sites at the present `qpos`: (num_envs, nsite, 3) in m."""
    site_xquat: Final[_Array]
    """Orientations of the sites at the present `qpos`: (num_envs, nsite, 4)."""
    geom_xpos: Final[_Array]
    """Positions of the geoms at the present `qpos`: (num_envs, ngeom, 3) in m."""
    geom_xquat: Final[_Array]
    """Orientations of the geoms at the present `qpos`: (num_envs, ngeom, 4)."""
    subtree_com: Final[_Array]
    """Centres of mass of every body with all that hangs from it at the present `qpos`: (num_envs, nbody, 3) in m. Row 0 is that of the
    whole scene."""
    xipos: Final[_Array]
    """Centres of mass of the bodies at the present `qpos`: (num_envs, nbody, 3) in m."""
    cinert: Final[_Array]
    """Inertias of the bodies about the centre of mass of their tree, world axes: (num_envs, nbody, 10), the inertia's xx, yy, zz, xy, xz,
    yz in kg m^2, the mass times the place of the body's centre of mass in kg m, the mass in kg. The world's row is zero. A tree is a
    child of the world with all that hangs from it."""
    cvel: Final[_Array]
    """Velocities of the bodies at the present state, of the point of each that is at the centre of mass of its tree, world axes:
    (num_envs, nbody, 6), angular velocity (3) in rad/s, linear velocity (3) in m/s."""
    cfrc_ext: Final[_Array]
    """Torques (3) in N m and forces (3) in N on the bodies of the contacts that the last step left, about the centre of mass of their
    tree, world axes: (num_envs, nbody, 6). The world's row is zero, and where no step was made since the state was set all are.
    MuJoCo counts `xfrc_applied` and connect and weld equalities as well."""
    qacc: Final[_Array]
    """Acceleration (v+ - v) / h of the last step, impulses of contacts and limits included: (num_envs, nv).

    Where no step was made since the state was set, it is that of the step that would be made from it; so are `qfrc_constraint` and
    `body_contact_force`."""
    qfrc_bias: Final[_Array]
    """Coriolis, centrifugal and gravitational forces of the present state: (num_envs, nv) in N or N m. As `mj_forward` leaves them."""
    qacc_smooth: Final[_Array]
    """Acceleration without constraints at the present state with the controls in force: (num_envs, nv) in m/s^2 or rad/s^2. As
    `mj_forward` leaves it. With `actuators=`, drives contribute what they handed on in the last step."""
    actuator_force: Final[_Array]
    """Forces of the actuators at the present state with the controls in force, before their gears: (num_envs, nu) in N or N m. As
    `mj_forward` leaves them."""
    qfrc_actuator: Final[_Array]
    """Forces of the actuators on the joints, within the joints' `actuatorfrcrange`: (num_envs, nv) in N or N m."""
    qfrc_constraint: Final[_Array]
    """Force of all constraints of the last step on the joints, its impulse over h: contacts, limits, dry friction, equalities and
    tendons: (num_envs, nv) in N or N m."""
    body_contact_force: Final[_Array]
    """Force (3) in N and torque (3) in N m of all contacts of the last step on every body, world axes: (num_envs, nbody, 6). The torque
    is about the body's present centre of mass."""
    time: Final[Any]
    """Simulated time in s: (num_envs,). `set_state(time=...)` sets it."""
    status: Final[Any]
    """Flags of the last call of `step`, see `stepper.Status`: (num_envs,) uint32."""
    residual: Final[Any]
    """Natural-map residual of the last step in m/s, 0 where it was NON_FINITE: (num_envs,)."""
    iterations: Final[Any]
    """Iterations of the solver in the last step, Gauss-Seidel iterations and Newton steps together: (num_envs,) uint32."""
    newton_steps: Final[Any]
    """Newton steps of the solver in the last step, over all islands of bodies: (num_envs,) uint32. The rest of `iterations` are
    Gauss-Seidel iterations."""
    max_penetration: Final[Any]
    """Largest penetration of a contact beyond its margin in any step of the last call of `step`, in m: (num_envs,) float64. A step
    measures it where it detects contacts, "midpoint" and "rk4" in the middle of the step. Above 1 mm `status` has DEEP."""
    max_limit_violation: Final[Any]
    """Largest violation of the range of a joint or tendon after any step of the last call of `step`, in rad or m: (num_envs,)
    float64. Above 0.01 `status` has OVER_LIMIT."""
    max_equality_violation: Final[Any]
    """Largest position error of an equality (connect, weld, joint, tendon) after any step of the last call of `step`, in m or rad:
    (num_envs,) float64. Above 0.001 `status` has EQUALITY_VIOLATED. It is 0 without equalities. Equalities with a finite
    stiffness are springs and are not included. With contact="mujoco" all equalities are soft, and all are included."""
    recorder: Any
    """Whom `step`, `reset` and `set_state` tell what they did (see `stepper.Recorder`); None is nobody."""
    sensors: Final[SensorModel | None]
    """What sensors make of the truth."""
    actuators: Final[ActuatorModel | None]
    """What becomes of controls before they are forces, as the stepper was made; what `randomize` drew since is in `randomized`."""
    sensordata: Final[_Array]
    """Sensor readings of the last step, the same however often they are read: (num_envs, nsensordata). `observe()` gives an array to
    write to."""
    sensordata_ideal: Final[_Array]
    """Readings of ideal sensors: (num_envs, nsensordata).

    Positions and velocities are those after the last step; accelerations are (v+ - v) / h of that step, impulses of contacts and
    limits included, and forces are impulses over h. Where no step was made since the state was set, accelerations and forces are
    those of the step that would be made from it."""
    sensor_faults: Final[_Array]
    """Of each sensor, readings that were clipped to its limits and samples that were lost in the last call of `step`:
    (num_envs, nsensor, 2) uint32."""
    actuator_saturation: Final[_Array]
    """Steps of the last call of `step` in which the effort of each actuator was cut to its bounds: its `forcerange`, its joint's
    `actuatorfrcrange`, or the limits and torque-speed curve of its drive: (num_envs, nu) uint32."""
    qfrc_applied: _Array
    """Writable, read by every step until changed or reset: forces on the joints in N or N m, (num_envs, nv)."""
    xfrc_applied: _Array
    """Writable, read by every step until changed or reset: force (N) and torque (N m) at every body's centre of mass, world axes,
    (num_envs, nbody, 6)."""
    mocap_pos: _Array
    """Writable, read by every step until changed or reset: positions of the mocap bodies in m, (num_envs, nmocap, 3)."""
    mocap_quat: _Array
    """Writable, read by every step until changed or reset: orientations of the mocap bodies, (num_envs, nmocap, 4)."""
    eq_active: NDArray[np.bool_]
    """Whether each equality is active, (num_envs, neq) bool, as MuJoCo's `eq_active`: writable, and valid for every step until changed.
    `reset` restores the model's `eq_active0`; `get_state` and `set_state` do not include it.

    The step ignores inactive equalities. If one is activated with a large position error, position correction closes it at up to
    `Options.max_correction_speed`. A weld pulls the bodies to the relative pose in `eq_data`, not to the present one."""
    randomized: Final[dict[str, Any]]
    """What environments have of their own, as `randomize` takes it: arrays by field, and under "actuators" an `ActuatorModel`."""

    def __new__(
        cls,
        model: Model,
        num_envs: int | None = None,
        *,
        options: Options | None = None,
        precision: Precision = "f64",
        threads: int = 1,
        seed: int = 0,
        sensors: SensorModel | None = None,
        actuators: ActuatorModel | None = None,
    ) -> Stepper: ...
    def reset(
        self,
        envs: ArrayLike | None = None,
        *,
        qpos: ArrayLike | None = None,
        qvel: ArrayLike | None = None,
        seed: int | ArrayLike | None = None,
        keyframe: str | int | None = None,
    ) -> None:
        """Starts a new episode in all environments, or in those of `envs`. Nothing of the old one remains.

        Forces that are applied end, mocap bodies go back to where the model has them, and controls in force are zero, or the
        keyframe's, until `step` takes others. Parameters of `randomize` stay.

        Args:
            envs: Which environments: a boolean mask (num_envs,), or integer indices (k,), each once; None is all, and none of them does
                nothing. With a mask, arrays have rows of all environments, and those of the others are not read. With indices, arrays
                have a row for each index, in their order.
            qpos: Where they start, (num_envs, nq) or (nq,); None is the model's reference. Quaternions are normalised.
            qvel: How fast, (num_envs, nv) or (nv,); None is at rest.
            seed: A new seed of the errors of sensors, or (num_envs,) one for each environment; None keeps the old ones.
            keyframe: Name or index of a keyframe to start from: its qpos, qvel, act, ctrl and time.

        Raises:
            TypeError: A seed or an index that is no whole number.
            IndexError: No environment of that index.
            ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a negative seed. Nothing is changed then.
            KeyError: No such keyframe.
        """
    def step(self, ctrl: ArrayLike | None = None, nstep: int = 1, envs: ArrayLike | None = None) -> None:
        """Makes `nstep` steps in every environment, or in those of `envs`.

        Args:
            ctrl: Controls, (num_envs, nu) or (nu,) for all, held until others are given; None holds those in force (`Stepper.ctrl`),
                as MuJoCo does.
            nstep: Number of steps.
            envs: Which environments, as of `reset`. The others stay as they are, to the bit, with their controls, sensors and flags.
                Environments that are worked on together and none of which step cost nothing, unless sensors or actuators have delays or
                the stepper is recorded: then all step, and the others are put back.

        Raises:
            ValueError: A wrong shape; the message has both. A control that is NaN is no error: its environment keeps its state and says
                NON_FINITE in `status`.
            TypeError, IndexError: As of `reset`.
            KeyboardInterrupt: Ctrl-C in a long call, which looks for signals some twenty times a second. Every environment has then
                made the same number of steps, the exception's `steps`, and all is as a call with that `nstep` leaves it; but mocap
                bodies are where their way has brought them, and a recording in which they were under way replays up to this call
                only. What another signal's handler raises ends the call alike.
        """
    def rollout(
        self,
        ctrl: ArrayLike,
        nstep: int = 1,
        *,
        initial: State | Sequence[State] | None = None,
        fields: Sequence[str] | None = None,
        out: dict[str, _Array] | None = None,
    ) -> dict[str, _Array]:
        """Makes `nstep` steps with each of T controls, without Python in between: the bits of T calls of `step`.

        A thread keeps its environments for all T controls. `qfrc_applied`, `xfrc_applied` and mocap poses stay as they are
        throughout.

        Args:
            ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
            nstep: Steps that each control is held.
            initial: State that all environments begin with, as of `set_state`: of one environment, of all, or a list with one for each.
                None is the present one.
            fields: What to write down after every control: "qpos" (T, num_envs, nq), "qvel" (T, num_envs, nv), "act" (T, num_envs,
                na), "sensordata" (T, num_envs, nsensordata). None is what `out` names, and without `out` all but "act".
            out: Arrays to write into, by field: of those shapes, C-contiguous, float64, or float32 with `precision="f32"`.

        Returns:
            The arrays by field; and always "status" (T, num_envs) uint32, the flags of all steps of a control, and "residual"
            (T, num_envs) float64, the largest residual among them in m/s. Both can be named in `out` too. Afterwards `status` has the
            flags of all steps of the call, `residual` and `iterations` are those of the last step.

        Raises:
            ValueError: A wrong shape, an unknown field, an array of `out` that cannot be written or is given twice.
            TypeError: An array of `out` of the wrong dtype.
            KeyboardInterrupt: As in `step`; `steps` counts those of all controls. Rows of `out` have what followed each control, of
                the last one what followed the steps that were made; the rows beyond are as they were.
        """
    def memory(self) -> dict[str, int]:
        """Memory that the environments take, in bytes, without NumPy arrays that were handed out.

        Returns:
            "per_env": of each environment; "per_thread": working room of each thread that steps, none of which is per environment;
            "state", "parameters" and "inputs": what all environments hold, what they have of their own by `randomize` and as numbers
            of drives, and what waits for the next step (controls, applied forces, mocap poses); "threads": how many have room;
            "total": "state" + "parameters" + "inputs" + "threads" x "per_thread".
        """
    def set_state(
        self,
        qpos: ArrayLike | State | Sequence[State] | None = None,
        qvel: ArrayLike | None = None,
        envs: ArrayLike | None = None,
        *,
        act: ArrayLike | None = None,
        time: ArrayLike | None = None,
        keep_warmstart: bool = False,
    ) -> None:
        """Sets configuration, velocity, activations or time; or, given a `State`, everything that survives a step.

        The next state is a function of `qpos`, `qvel`, `act` and the controls; what the solver starts from moves it by some 1e-7 of a
        velocity (docs/development/decisions/visible_state.md). The other memory of an environment is that of its drives (delay lines, lags,
        integrals) and sensors (bias, drift, delay lines, samples held).

        Args:
            qpos: (num_envs, nq) or (nq,). Or what `get_state` returned: of a batch of the same size each environment takes its own
                part, of a single environment all take the same. Or a list of states of single environments, one for each of `envs`.
                Continuing from a `State` repeats the same bits; where a state of one is given to a batch, each environment's sensors
                draw random numbers of their own from then on.
            qvel: (num_envs, nv) or (nv,).
            envs: Which environments, as of `reset`. `set_state(get_state(env=3), envs=[5, 6])` copies environment 3 to others.
            act: (num_envs, na) or (na,).
            time: s, (num_envs,) or one for all.
            keep_warmstart: Whether to keep all memory where qpos, qvel or act are set, to correct the state of an environment that
                goes on, as an observer does: the solver's warm start, contacts, flags, drives (delay lines, lags, integrals) and
                sensors (bias, drift, delay lines, held samples). False clears all of these, and the next control and reading fill
                the delay lines: what follows depends on the new state alone.

        Raises:
            ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a state of another model. Nothing is
                changed then.
        """
    def randomize(
        self,
        values: Mapping[str, ArrayLike | None] | ArrayLike | None = None,
        /,
        envs: ArrayLike | None = None,
        **fields: ArrayLike | ActuatorModel | None,
    ) -> None:
        """Gives environments parameters of their own, as `Model.replace` would give them to a model; what derives from them follows.

        Every environment then moves as one of a `Stepper` of its own model, bit for bit. Parameters are not part of the state:
        `reset` and `set_state` leave them, pickles and recordings have them. Other fields stay as they are, whether the model's or
        randomized before. What no environment has of its own costs neither time nor memory.

        Contacts of an explicit pair use pair_friction and pair_restitution and ignore those of the geoms. A new geom_friction for a geom
        of a pair is therefore an error, unless pair_friction is given too, in this call or an earlier one: new values, or the model's to
        keep these contacts as they are. An earlier call counts for all environments, also for those that it did not select, whose pairs
        keep the model's values. Likewise geom_restitution and pair_restitution.

            sim.randomize(geom_friction=friction)  # (num_envs, ngeom, 3)
            sim.randomize({"geom_friction[floor,box][0]": sliding}, envs=[3, 5])  # (2, 2)

        Args:
            values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md); other numbers of these
                fields stay as they are.
                The shape is that of the selected numbers with num_envs in front: one name or index and one column have no axis of
                their own. (num_envs,) is one number for all selected, a single number is the same in all environments, and None
                gives the model's own numbers back. In place of values, `envs` may stand first.
            envs: The environments that change, as of `reset`.
            **fields: Arrays with num_envs in front of the shape that the field has in the model; None gives the model's own numbers
                back, and so do all fields when none is named: gravity (num_envs, 3) m/s^2; body_mass (num_envs, nbody) kg, body_ipos
                (num_envs, nbody, 3) m, the centre of mass, and body_inertia (num_envs, nbody, 3) kg m^2, principal moments, each by
                itself: a body of twice the mass keeps its inertia unless it is given too; geom_friction (num_envs, ngeom, 3) sliding,
                torsional (m), rolling (m); geom_restitution (num_envs, ngeom); pair_friction (num_envs, npair, 3) and pair_restitution
                (num_envs, npair), the same of explicit pairs, see below; geom_size, geom_pos (num_envs, ngeom, 3) m, which
                leave masses alone; jnt_stiffness (num_envs, njnt) N/m or N m/rad; jnt_range (num_envs, njnt, 2) m or rad;
                dof_damping, dof_armature, dof_frictionloss (num_envs, nv); actuator_gainprm, actuator_biasprm (num_envs, nu, 10) as
                MuJoCo has them: with their first three numbers the force is gain . (1, length, velocity) times the input plus
                bias . (1, length, velocity); numbers that the type of an actuator's gain or bias does not read are 0. actuators, a
                `stepper.ActuatorModel`: its drives take the place of those of the actuators it fits, with all their numbers (what a
                `Drive` does not say is its default); other actuators keep theirs, and None gives back what the stepper was made with.
                Stages are compiled: a servo, motor, lag, limits or friction must have been given to `Stepper(..., actuators=)`, to
                one environment at least, and delays may be as long as the longest there. Delay lines, lags and integrals are state:
                they stay as they are until `reset`.

        Raises:
            TypeError, IndexError: As of `reset`.
            ValueError: A wrong shape; both are named. A number that a drive may not have, or a stage or delay that it was not made
                for, with the actuator. Nothing is changed then.
            ModelError: A field that all environments share, numbers that no model may have, that ask for something that the model
                has none of, such as dry friction where it has 0, or that an explicit pair overrides; with field, element and
                environment. Nothing is changed then.
        """
    def record(self, path: str | PathLike[str], **settings: Any) -> Recorder:
        """Writes everything that happens from now on into a new folder, until the `Recorder` is closed; `stepper.replay` repeats it.

        Args:
            path: A folder that does not exist yet, or is empty.
            **settings: See `stepper.Recorder`.
        """
    def observe(self, out: _Array | None = None) -> _Array:
        """Copy of `sensordata`, in `out` if it is given: (num_envs, nsensordata)."""
    def get_state(self, env: int | None = None) -> State:
        """Everything that survives a step, the controls in force included.

        What is applied (`qfrc_applied` and the like) and parameters of `randomize` are not part of it.

        Args:
            env: An environment; None is all of them.
        """
    def contacts(self, envs: ArrayLike | None = None) -> NDArray[np.void]:
        """Contacts of the last step: those that were given a row.

        That is every one that the motion can close within the step, also contacts that do not touch (distance > 0), mostly without
        force. Distances are measured from the margin, at which contacts begin to push. A gap, which in MuJoCo 4 reports contacts
        beyond the margin that do not push, has no effect here: what is farther than a step away is not listed.

        Args:
            envs: Which environments, as of `reset`, one after the other.

        Returns:
            A structured array: env, geom (2,), body (2,), pos (3,) in m, normal (3,) from the first geom to the second, distance in m
            from the margin, force (3,) in N on the second geom along normal, t1, t2, torque (3,) in N m on it about the same
            directions, of torsional and rolling friction (condim 4 and 6), and frame (3, 3), whose rows are these directions. The
            second geom's torque acts at pos, and |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
        """
    def worst_row(self, env: int = 0) -> str | None:
        """The row that the last call of `step` could not solve.

        Where `status` says NOT_CONVERGED, it is the one with the largest residual in the last step that was not solved.

        Args:
            env: The environment.

        Returns:
            For example 'contact of geom "floor" and geom "foot"', 'limit of joint "knee"' or 'equality "loop"'; None where every step
            was solved, or no single row is to blame.
        """
    def save_problem(self, path: str | PathLike[str], env: int = 0, *, ctrl: ArrayLike | None = None) -> None:
        """Writes the constraint problem of the next step to a file.

        It has the impulses that the solve starts from, so that a hard problem becomes a test of the solver: in Rust,
        `stepper_solve::Problem::load(path)` reads it.

        The problem is that of a step from the present state, which does not change. For a step that was not solved (NOT_CONVERGED), go
        back to the state before it: `before = sim.get_state()` before the step, and then `sim.set_state(before)`.

        Args:
            path: The file; what is there is replaced.
            env: The environment.
            ctrl: Controls of the step, as `step` takes them; None is those in force.

        Raises:
            OSError: The file cannot be written.
        """
    def jacobian(self, body: str | int | None = None, site: str | int | None = None) -> _Array:
        """Jacobian of the origin of a body's frame, or of a site, at the present `qpos`: its velocity is `jacobian @ qvel`.

        Args:
            body: Name or index of a body.
            site: Name or index of a site, instead.

        Returns:
            (num_envs, 6, nv), world axes: three rows of the linear velocity, then three of the angular one.

        Raises:
            ValueError: Both were given, or neither.
            KeyError: No body or site of that name.
            IndexError: No body or site of that index.
        """
    def linearize(
        self,
        wrt: Sequence[str] | None = None,
        *,
        ctrl: ArrayLike | None = None,
        nstep: int = 1,
        method: Literal["fd", "implicit"] = "fd",
        step: float | None = None,
        tolerance: float | None = None,
        centered: bool = True,
        extrapolate: bool = False,
        sensors: bool = False,
    ) -> Linearization:
        """Derivatives of the state after `nstep` steps by the state, controls and parameters now, in all environments; advances nothing.

        Every column is a central difference between two perturbed copies of an environment, or a difference to one side. Copies of all
        environments and columns are stepped together, in lanes and on the stepper's threads, with its options and all that environments
        have of their own, but to a tighter tolerance; the stepper is only read, and keeps room for copies for the next call. With contact
        the step is smooth only between kinks: see `Linearization.near_kink`
        and docs/how-to/derivatives.md.

        Args:
            wrt: "qpos", "qvel", "act", "ctrl", and fields of `Stepper.randomize`, whole ("body_mass") or in part, by selector
                ("geom_friction[floor,box][0]", docs/reference/what_can_vary.md). Columns are zero where a mass, size, stiffness or
                frictionloss of 0 says that the model has none. None is ("qpos", "qvel", "act", "ctrl").
            ctrl: Controls held during the steps, (num_envs, nu) or (nu,); None is those in force.
            nstep: Number of steps.
            method: "fd", finite differences of whole steps, or "implicit": the step is solved once, and its derivative is that at the
                modes of the solution, which contacts push, stick and slip, by the implicit function theorem. That is for the midpoint rule,
                Euler's and the implicit one, and for `contact="mujoco"` with "euler", "implicitfast" or "implicit"; by the state and
                the controls. Environments that it says nothing of are taken by differences (`Linearization.implicit`).
            step: Half width of the differences, for coordinates in SI units and for parameters relative to their size; None is the one
                that the tolerance asks for (`stepper.derivatives.perturbations.step_of`), or `stepper.derivatives.implicit.STEP`.
            tolerance: Residual to which copies are solved, m/s; None is 1e-13, or the stepper's own if that is less.
            centered: Whether differences are central. Differences to one side cost half the copies; their error is of first order in the
                step instead of second, and slopes on both sides are not compared.
            extrapolate: Whether differences of twice the width are taken too, and Richardson's extrapolation of both, which costs twice
                the copies and estimates errors.
            sensors: Whether to give derivatives of the ideal sensors' readings too.

        Raises:
            ValueError: An unknown name, a wrong shape, a step or number of steps that is none; of `method="implicit"`, options or
                derivatives that only `method="fd"` takes.
            ModelError: A parameter that cannot be perturbed, with its element.
        """
    def _differentiate(self, ctrl: _Array, parts: list[str], offsets: _Array, tolerance: float) -> dict[str, NDArray[Any]]:
        """Derivatives of a step by the implicit function theorem, for `stepper.derivatives.implicit`, which says what the arguments are.

        Returns:
            Arrays by name, rows first an environment each: "slopes" (num_envs, 2 nv + na, columns), "causes" (num_envs, columns) uint32,
            "distance", "sound" (uint8), "residual" and "status" (num_envs,), and "qpos", "qvel" and "act" after the step.
        """
    def _find_kinks(
        self,
        *,
        count: int,
        sides: int,
        one_sided: NDArray[np.bool_],
        limited: list[list[int]],
        ranges: _Array,
        taken: _Array,
        rubbing: list[int],
        smooth_at_rest: bool,
        tolerance: float,
    ) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
        """Kinks between copies of environments after a step, for `stepper.derivatives.kinks`, which says what the arguments are.

        Returns:
            Flags of `Kink` by column, (environments, columns) uint32, and the distance to the nearest kink, (environments,).
        """
    def read(self, name: str, of: str | int | Sequence[str | int] | None = None) -> _Array:
        """Values of a quantity for all its elements, or for some by name or index.

            sim.read("xpos", "torso")  # (num_envs, 3)
            sim.read("qvel", ["left_knee", "right_knee"])  # (num_envs, 2)

        Args:
            name: An attribute of `Stepper`: "xpos", "qvel", "sensordata".
            of: A body, site, geom, joint, actuator or sensor, whichever the quantity is of, or several; None is all. One body, site or
                geom is without its axis: (num_envs, 3). Columns of joints and sensors stand one after the other: (num_envs, n).

        Returns:
            (num_envs, ...) in the stepper's scalar type, the caller's own.

        Raises:
            ValueError: An unknown quantity.
            KeyError, IndexError: No element of that name or index.
        """
    def inverse_dynamics(self, qacc: ArrayLike) -> _Array:
        """Forces on the joints that give the present states these accelerations: M qacc + bias - passive.

        This is MuJoCo's `mj_inverse` without constraints. Passive forces are those of springs, dampers, gravity compensation and the
        medium. Forces of actuators and applied forces are not subtracted, nor are those of contacts and other constraints, which
        `qfrc_constraint` has of the last step.

        Args:
            qacc: Accelerations, (num_envs, nv) or (nv,), m/s^2 or rad/s^2.

        Returns:
            (num_envs, nv) in the stepper's scalar type, N or N m.

        Raises:
            ValueError: Accelerations of another shape.
        """
    def copy_state(self, sources: ArrayLike, envs: ArrayLike | None = None) -> None:
        """Copies states between environments: environment `envs[k]` takes over the state of environment `sources[k]`, see `get_state`.

        All states are read before any is changed. Copies draw random numbers of their own for their sensors from then on.

        Args:
            sources: Indices of the environments whose states are taken, one for each of `envs`, or one for all; an index may repeat.
            envs: Which environments take them, as of `reset`.

        Raises:
            TypeError: Indices that are no integers.
            ValueError: Another number of sources than of environments.
            IndexError: No environment of that index.
        """
    def view(self, **settings: Any) -> View:
        """Opens a live view of the environments in the browser, and says where it is.

        Args:
            **settings: Those of `stepper.viewer.View`.

        Raises:
            ModuleNotFoundError: viser is not installed, with how to install it.
        """
    def mass_matrix(self) -> _Array:
        """Mass matrices of the present configurations, armature included, without terms that depend on the time step.

        Returns:
            (num_envs, nv, nv), in the stepper's scalar type.
        """
    def rays(
        self,
        points: ArrayLike,
        directions: ArrayLike,
        *,
        body: str | int | None = None,
        axes: Literal["body", "heading", "world"] = "body",
        geoms: Sequence[str | int] | None = None,
        exclude: str | int | None = None,
    ) -> tuple[_Array, NDArray[np.int32]]:
        """Distances and geoms that rays meet in the present states: MuJoCo's `mj_ray`, of many rays of all environments in one pass.

        A plane is met from its front, without end. Of a mesh its triangles are met, whether it collides as these or as its hull; of a
        height field also its sides and its base. What begins inside of something meets it where it leaves. What is drawn and touches
        nothing is met where it has a simple shape: a mesh that is only drawn is no part of the model.

        Args:
            points: Where the rays begin, (num_envs, n, 3) or (n, 3) for all environments, m: in the world, or from the origin of `body`.
            directions: Where they go, of any length above 0: (num_envs, n, 3) or (n, 3).
            body: Name or index of the body that the rays belong to, as those of its lidar do; its own geoms are not met. None is the
                world.
            axes: Axes of points and directions around a body: "body", its own; "heading", the world's turned by its heading; "world".
            geoms: Names or indices of the geoms that the rays can meet; None is all of them.
            exclude: Name or index of a body whose geoms are not met; None is `body`.

        Returns:
            Distances in m, (num_envs, n) in the stepper's scalar type, and the indices of the geoms that are met, (num_envs, n) int32. Both
            are -1 where nothing is.

        Raises:
            ValueError: An array of another shape, unknown axes, a point that is not finite, a direction of length 0, a mesh that is no part
                of the model.
            KeyError, IndexError: No geom or body of that name or index.
        """
    def _in_64_bits(self, env: int) -> list[_Array]:
        """Mass matrix, bias force, smooth acceleration, energies and momenta of an environment in 64 bits, for the golden trajectories.

        They are evaluated in 64 bits also where the stepper's scalar type has 32.
        """
    def energy(self) -> tuple[Any, Any]:
        """Potential energy (gravity, joint springs) and kinetic energy (armature included) of the present states.

        Returns:
            Two arrays (num_envs,) float64 in J.
        """
    def momentum(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Linear momentum, and angular momentum about the centre of mass, of the present states.

        Returns:
            Two arrays (num_envs, 3) float64, in kg m/s and kg m^2/s.
        """
    def __getstate__(self) -> dict[str, Any]: ...
    def __setstate__(self, state: dict[str, Any]) -> None: ...

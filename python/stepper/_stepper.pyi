"""The binary: models and steppers.

Arrays are C-contiguous NumPy arrays, float64 unless `precision="f32"`. With `num_envs=None` the leading axis is absent. SI units,
quaternions (w, x, y, z). Attributes are read-only copies, unless they are documented as writable. Returned arrays are copies unless stated
otherwise.
"""

import builtins
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from stepper._options import Options, Precision
from stepper.actuators import ActuatorModel
from stepper.derivatives import Linearization
from stepper.recording import Recorder
from stepper.sensors import Combination, RayFan, SensorModel, SensorSpec
from stepper.viewer import View

__all__ = [
    "Actuator",
    "Body",
    "Equality",
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
    "check_options",
    "cpu_levels",
    "fields",
    "selected",
]
__version__: Final[str]

_Array: TypeAlias = NDArray[Any]

def cpu_levels() -> list[str]:
    """CPU levels (instruction sets of the compiled kernels) that this machine supports, slowest first, such as "avx2"."""

def fields() -> list[tuple[str, str, str, str, bool]]:
    """Fields of `Model.replace`, as tuples (name, shape as text, quantity, unit, whether `Stepper.randomize` accepts the field)."""

def check_options(options: Options) -> None:
    """Raises an error unless all settings of a `stepper.Options` object are valid.

    Raises:
        TypeError: A setting has a wrong type.
        ValueError: A setting is out of its range, or the contact law does not have the integrator.
    """

def selected(envs: ArrayLike | None, num_envs: int) -> list[int]:
    """Indices of the environments that the argument `envs` of a method selects, in the order of the argument; see `Stepper.reset`.

    Args:
        envs: Boolean mask (num_envs,), or integer indices (k,). None selects all environments.
        num_envs: Number of environments.

    Raises:
        TypeError: An index is no integer; the message has the first one.
        ValueError: A mask has another length, or an index appears twice.
        IndexError: An index is out of range.
    """

class ModelError(ValueError):
    """Error of a model that cannot be simulated. The message says what is wrong, where, and what to do."""

@final
class Body:
    """Body of a model."""

    id: Final[int]
    """Index of the body; 0 is the world."""
    name: Final[str]
    """Name of the body; may be empty."""
    parentid: Final[int]
    """Index of the parent body; 0 for the world."""
    mass: Final[float]
    """Mass of the body, kg."""
    inertia: Final[_Array]
    """Principal moments of inertia, kg m^2: (3,)."""
    pos: Final[_Array]
    """Position of the body in the parent's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation of the body in the parent's frame, quaternion (w, x, y, z): (4,)."""
    ipos: Final[_Array]
    """Centre of mass in the body's frame, m: (3,)."""
    iquat: Final[_Array]
    """Orientation of the principal axes in the body's frame, quaternion (w, x, y, z): (4,)."""
    mocapid: Final[int]
    """Row in `mocap_pos` and `mocap_quat`; -1 for bodies that are not mocap bodies."""
    jntadr: Final[int]
    """Index of the body's first joint; -1 for a body without joints."""
    jntnum: Final[int]
    """Number of the body's joints."""
    dofadr: Final[int]
    """Address of the body's first degree of freedom in qvel; -1 for a body without degrees of freedom."""
    dofnum: Final[int]
    """Number of the body's degrees of freedom."""
    geomadr: Final[int]
    """Index of the body's first geom; -1 for a body without geoms."""
    geomnum: Final[int]
    """Number of the body's geoms."""

@final
class Joint:
    """Joint of a model, which `model.joint("hip")` returns."""

    id: Final[int]
    """Index of the joint."""
    name: Final[str]
    """Name of the joint; may be empty."""
    type: Final[str]
    """Type: "free", "ball", "slide" or "hinge"."""
    bodyid: Final[int]
    """Index of the body that the joint moves."""
    qposadr: Final[int]
    """Address of the joint's first coordinate in qpos."""
    dofadr: Final[int]
    """Address of the joint's first degree of freedom in qvel."""
    nq: Final[int]
    """Number of the joint's coordinates in qpos."""
    nv: Final[int]
    """Number of the joint's degrees of freedom in qvel."""
    limited: Final[bool]
    """Whether the joint position has bounds."""
    range: Final[_Array]
    """Lowest and highest joint position, m or rad: (2,). A missing bound is infinite."""
    pos: Final[_Array]
    """Anchor of the joint in the body's frame, m: (3,)."""
    axis: Final[_Array]
    """Unit axis of a slide or hinge in the body's frame: (3,)."""
    stiffness: Final[float]
    """Stiffness of the joint spring, N/m or N m/rad."""
    damping: Final[float]
    """Viscous damping of the joint, N s/m or N m s/rad."""
    armature: Final[float]
    """Armature of the joint (added inertia), kg or kg m^2."""
    frictionloss: Final[float]
    """Dry friction of the joint (frictionloss), N or N m."""
    velocity_limit: Final[float]
    """Speed limit of the joint in the source, rad/s or m/s; infinite if the source has no limit. The simulation does not enforce it."""

@final
class Geom:
    """Geom of a model."""

    id: Final[int]
    """Index of the geom."""
    name: Final[str]
    """Name of the geom; may be empty."""
    bodyid: Final[int]
    """Index of the body to which the geom belongs."""
    type: Final[str]
    """Type: "plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield"."""
    size: Final[_Array]
    """Sizes of the geom, m: (3,). They are radius and half length, half sizes, or semi-axes; unused entries are 0."""
    pos: Final[_Array]
    """Position of the geom in the body's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation of the geom in the body's frame, quaternion (w, x, y, z): (4,)."""
    contype: Final[int]
    """Bit mask: two geoms may collide if the contype of one has a common bit with the conaffinity of the other."""
    conaffinity: Final[int]
    """Bit mask: this geom may collide with geoms whose contype has a common bit with it."""
    condim: Final[int]
    """Dimension of the geom's contacts as in MuJoCo: 1 frictionless, 3 sliding, 4 also torsional, 6 also rolling friction."""
    priority: Final[int]
    """Priority of the geom: a contact uses the friction and condim of its geom with the higher priority."""
    friction: Final[_Array]
    """Sliding (1), torsional (m) and rolling (m) friction of the geom: (3,)."""
    restitution: Final[float]
    """Newton's coefficient of restitution, 0 to 1."""
    margin: Final[float]
    """Distance from the geom at which a contact begins to push, m. A contact has the sum of the margins of its two geoms."""
    gap: Final[float]
    """Distance beyond the margin up to which MuJoCo reports contacts without force, m."""

@final
class Pair:
    """Explicit pair of geoms of a model. The geoms collide independent of filters, with the parameters of the pair."""

    id: Final[int]
    """Index of the pair."""
    name: Final[str]
    """Name of the pair; may be empty."""
    geom1: Final[int]
    """Index of the first geom."""
    geom2: Final[int]
    """Index of the second geom."""
    dim: Final[int]
    """Dimension of the pair's contacts as in MuJoCo: 1 frictionless, 3 sliding, 4 also torsional, 6 also rolling friction."""
    friction: Final[_Array]
    """Sliding (1), torsional (m) and rolling (m) friction of the pair: (3,)."""
    restitution: Final[float]
    """Newton's coefficient of restitution, 0 to 1."""
    margin: Final[float]
    """Distance between the geoms at which a contact begins to push, m."""
    gap: Final[float]
    """Distance beyond the margin up to which MuJoCo reports contacts without force, m."""

@final
class Site:
    """Site of a model."""

    id: Final[int]
    """Index of the site."""
    name: Final[str]
    """Name of the site; may be empty."""
    bodyid: Final[int]
    """Index of the body to which the site belongs."""
    type: Final[str]
    """Type: "sphere", "capsule", "cylinder", "ellipsoid" or "box"."""
    pos: Final[_Array]
    """Position of the site in the body's frame, m: (3,)."""
    quat: Final[_Array]
    """Orientation of the site in the body's frame, quaternion (w, x, y, z): (4,)."""

@final
class Actuator:
    """Actuator of a model."""

    id: Final[int]
    """Index of the actuator, and of its control in ctrl."""
    name: Final[str]
    """Name of the actuator; may be empty."""
    trntype: Final[str]
    """Kind of element on which the actuator acts: "joint", "tendon", "site" or "slidercrank"."""
    trnid: Final[int]
    """Index of the joint, tendon or site on which the actuator acts. For a slider-crank it is the site of the crank."""
    actadr: Final[int]
    """Address of the actuator's activation in act; -1 if the actuator has no activation."""
    ctrlrange: Final[_Array]
    """Lowest and highest control: (2,). A missing bound is infinite."""
    forcerange: Final[_Array]
    """Lowest and highest force, N or N m: (2,). A missing bound is infinite."""
    actrange: Final[_Array]
    """Lowest and highest activation: (2,). A missing bound is infinite."""
    gear: Final[_Array]
    """Gear: (6,). For a site, the entries are force and torque per unit of actuator force. Otherwise entry 0 scales length, velocity
    and force."""
    gaintype: Final[str]
    """Type of the gain: "fixed", "affine", "dcmotor", "pid" or "muscle"."""
    gainprm: Final[_Array]
    """Parameters of the gain: (10,). For the types "fixed" and "affine" they begin with constant, factor of length and factor of
    velocity. Unused entries are 0."""
    biastype: Final[str]
    """Type of the bias: "none", "affine", "dcmotor" or "muscle"."""
    biasprm: Final[_Array]
    """Parameters of the bias: (10,). For the type "affine" they begin with constant, factor of length and factor of velocity. Unused
    entries are 0."""

@final
class Sensor:
    """Sensor of a model."""

    id: Final[int]
    """Index of the sensor."""
    name: Final[str]
    """Name of the sensor; may be empty."""
    type: Final[str]
    """Type of the sensor as in MJCF, such as "gyro"."""
    adr: Final[int]
    """Address of the sensor's first reading in sensordata."""
    dim: Final[int]
    """Number of readings of the sensor."""
    noise: Final[float]
    """Standard deviation of the sensor noise in the source file, `noise` in MJCF."""
    cutoff: Final[float]
    """Largest magnitude of a reading in the source file, `cutoff` in MJCF; 0 if readings have no limit."""

@final
class Tendon:
    """Tendon of a model: a linear combination of joint positions (fixed), or a path through sites and around geoms (spatial)."""

    id: Final[int]
    """Index of the tendon."""
    name: Final[str]
    """Name of the tendon; may be empty."""
    spatial: Final[bool]
    """Whether the tendon is spatial: a path through sites and around geoms."""
    jntid: Final[_Array]
    """Indices of the n joints of a fixed tendon: (n,) int64."""
    coef: Final[_Array]
    """Coefficients of the n joints in the tendon length: (n,)."""
    limited: Final[bool]
    """Whether the tendon length has bounds."""
    range: Final[_Array]
    """Lowest and highest tendon length, m or rad: (2,). A missing bound is infinite."""
    stiffness: Final[float]
    """Stiffness of the tendon spring, N per unit of tendon length (m or rad)."""
    damping: Final[float]
    """Viscous damping of the tendon, N s per unit of tendon length (m or rad)."""
    armature: Final[float]
    """Added inertia of the tendon, N s^2 per unit of tendon length (m or rad)."""
    frictionloss: Final[float]
    """Dry friction of the tendon, N."""

@final
class Equality:
    """Equality of a model: it connects or welds two bodies, or couples joints or tendons."""

    id: Final[int]
    """Index of the equality, and of its column in `eq_active` and `eq_data`."""
    name: Final[str]
    """Name of the equality; may be empty."""
    type: Final[str]
    """Type: "connect", "weld", "joint" or "tendon"."""
    obj1id: Final[int]
    """Index of the first body, joint or tendon."""
    obj2id: Final[int]
    """Index of the second body, joint or tendon; -1 for a coupling of one."""
    active0: Final[bool]
    """Whether the equality is active after a reset."""
    data: Final[_Array]
    """Anchors, relative pose and torquescale, or polynomial, in the layout of MuJoCo's `eq_data`: (11,)."""

@final
class Keyframe:
    """Keyframe of a model: a named state for `Stepper.reset(keyframe=)`."""

    id: Final[int]
    """Index of the keyframe."""
    name: Final[str]
    """Name of the keyframe; may be empty."""
    time: Final[float]
    """Time of the keyframe, s."""
    qpos: Final[_Array]
    """Configuration of the keyframe: (nq,)."""
    qvel: Final[_Array]
    """Velocity of the keyframe: (nv,)."""
    act: Final[_Array]
    """Activations of the keyframe: (na,)."""
    ctrl: Final[_Array]
    """Controls of the keyframe: (nu,)."""

@final
class Model:
    """Immutable model of a scene: bodies, joints, geoms, actuators, sensors.

    Each field of `replace` is also an attribute, a read-only copy: `model.geom_friction` has shape (ngeom, 3). Models compare by value and
    can be pickled.
    """

    name: Final[str]
    """Name of the scene; may be empty."""
    nq: Final[int]
    """Number of position coordinates, the length of qpos."""
    nv: Final[int]
    """Number of degrees of freedom, the length of qvel."""
    nu: Final[int]
    """Number of controls."""
    na: Final[int]
    """Number of actuator activations."""
    nbody: Final[int]
    """Number of bodies, including the world, which is body 0."""
    njnt: Final[int]
    """Number of joints."""
    nsite: Final[int]
    """Number of sites."""
    ngeom: Final[int]
    """Number of geoms."""
    npair: Final[int]
    """Number of explicit pairs of geoms."""
    nsensordata: Final[int]
    """Number of readings of all sensors."""
    body_names: Final[list[str]]
    """Names of the bodies in order. The name of an unnamed body is empty."""
    joint_names: Final[list[str]]
    """Names of the joints in order. The name of an unnamed joint is empty."""
    geom_names: Final[list[str]]
    """Names of the geoms in order. The name of an unnamed geom is empty."""
    pair_names: Final[list[str]]
    """Names of the pairs in order. The name of an unnamed pair is empty."""
    actuator_names: Final[list[str]]
    """Names of the actuators in order. The name of an unnamed actuator is empty."""
    sensor_names: Final[list[str]]
    """Names of the sensors in order. The name of an unnamed sensor is empty."""
    site_names: Final[list[str]]
    """Names of the sites in order. The name of an unnamed site is empty."""
    keyframe_names: Final[list[str]]
    """Names of the keyframes in order. The name of an unnamed keyframe is empty."""
    tendon_names: Final[list[str]]
    """Names of the tendons in order. The name of an unnamed tendon is empty."""
    equality_names: Final[list[str]]
    """Names of the equalities in order. The name of an unnamed equality is empty."""
    sensors: Final[list[dict[str, Any]]]
    """Sensors as dictionaries with the keys name, type, adr (index of the first reading), dim, datatype, noise, cutoff, delay and
    interval. The datatype is "real", "positive", "axis" or "quaternion". The last four are properties from the source file, and 0 if
    the file does not specify them."""
    omitted: Final[list[tuple[str, str, str]]]
    """Elements of the source file that this model omits, as tuples (kind of element, name, reason)."""
    requested: Final[dict[str, Any] | None]
    """Dictionary of the settings of the source file that default options replace: integrator, solver, iterations, cone, constrained
    (whether the model has constraints, which are soft in MuJoCo), and soft (elements with non-default solref or solimp). The attribute
    is None for models made in code."""
    excluded_overlaps: Final[list[tuple[str, str, float]]]
    """Pairs of geoms that overlap in the reference pose, whose contacts `exclude_overlaps` has disabled. The list has the format of
    `overlaps()`."""
    wide_hulls: Final[list[tuple[int, float]]]
    """Mesh geoms that collide as a much larger convex hull, as tuples (index of the geom, hull volume / mesh volume).

    The list has geoms with a ratio of 2 or more, and fixed geoms with a ratio of 1.25 or more. The mesh volume is the space that the
    mesh encloses. The ratio is infinite for a mesh that encloses no space, such as an open surface."""
    deviations: Final[list[str]]
    """Settings that the source file contains explicitly and that the default options replace, such as an integrator other than Euler's.
    Each is a line of text."""
    digest: Final[str]
    """SHA-256 of the model's description, in hexadecimal. Equal models have equal digests."""
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
        """Fraction of the body's weight that is compensated: (nbody,)."""
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
        """Distance below which a contact pushes, m: (ngeom,)."""
    @property
    def geom_gap(self) -> _Array:
        """Additional distance up to which contacts without force are listed, m: (ngeom,)."""
    @property
    def geom_solref(self) -> _Array:
        """Reference acceleration of contacts by MuJoCo's law: (ngeom, 2)."""
    @property
    def geom_solimp(self) -> _Array:
        """Impedance of contacts by MuJoCo's law: (ngeom, 5)."""
    @property
    def geom_solmix(self) -> _Array:
        """Weight of the geom's solref and solimp in a pair: (ngeom,)."""
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
        """Ratio of the friction along the second tangent to that along the first, for sliding and rolling, by MuJoCo's law: (npair, 2)."""
    @property
    def pair_restitution(self) -> _Array:
        """Coefficient of restitution of an explicit pair: (npair,)."""
    @property
    def pair_margin(self) -> _Array:
        """Distance below which a contact of an explicit pair pushes, m: (npair,)."""
    @property
    def pair_gap(self) -> _Array:
        """Additional distance up to which contacts of an explicit pair without force are listed, m: (npair,)."""
    @property
    def pair_solref(self) -> _Array:
        """Reference acceleration of an explicit pair's contacts by MuJoCo's law: (npair, 2)."""
    @property
    def pair_solreffriction(self) -> _Array:
        """Solreffriction of an explicit pair by MuJoCo's law; zeros use solref: (npair, 2)."""
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
        """Limits of the sum of actuator forces on a joint (actuatorfrcrange), N or N m: (njnt, 2)."""
    @property
    def jnt_velocity_limit(self) -> _Array:
        """Speed limit of the source, not enforced; infinity without a limit, rad/s or m/s: (njnt,)."""
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
        """1 for an active equality, 0 for an inactive one: (neq,)."""
    @property
    def eq_data(self) -> _Array:
        """Anchors, relative pose and torquescale, or polynomial, in the layout of MuJoCo's eq_data: (neq, 11)."""
    @property
    def eq_solref(self) -> _Array:
        """Reference acceleration of equalities by MuJoCo's law: (neq, 2)."""
    @property
    def eq_solimp(self) -> _Array:
        """Impedance of equalities by MuJoCo's law: (neq, 5)."""
    @property
    def eq_stiffness(self) -> _Array:
        """Stiffness of a soft equality; infinity for a hard one: (neq,)."""
    @property
    def eq_damping(self) -> _Array:
        """Damping of a soft equality: (neq,)."""
    @property
    def impratio(self) -> _Array:
        """Ratio of the impedance of friction to that of normal forces by MuJoCo's law."""
    @property
    def noslip_iterations(self) -> _Array:
        """Largest number of noslip iterations of MuJoCo's law, which reduce the slip of friction."""
    @property
    def noslip_tolerance(self) -> _Array:
        """Relative improvement at which the noslip iterations stop."""
    @property
    def actuator_gear(self) -> _Array:
        """Gear: scale of length, velocity and force in column 0; on a site, the direction of force and torque: (nu, 6)."""
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
        """Model from a description, a dictionary with the fields of the Rust crate's `Description`. The description is checked.

        Vertices and faces of meshes and elevations of height fields may be arrays.

        Raises:
            ModelError: The description is not valid, or `strict` is set and it has unsupported elements.
        """
    @staticmethod
    def from_bytes(bytes: bytes) -> Model:
        """Model from the bytes of `to_bytes`."""
    @staticmethod
    def from_file(path: str | PathLike[str]) -> Model:
        """Model from a file that `save` wrote."""
    def to_bytes(self) -> bytes:
        """Bytes of the file that `save` writes."""
    def save(self, path: str | PathLike[str]) -> None:
        """Writes the model to a file in stepper's own format. `stepper.load(path)` reads the same model, bit for bit, without MuJoCo.

        Raises:
            ValueError: The file has the ending of another format: .xml, .mjb or .urdf.
        """
    def explain(self) -> str:
        """Report on the model as text.

        Sections of the report:

        * settings of the source file that the default options replace
        * simulated elements; omitted elements, with reasons; features that the scene does not use, and that cost no time
        * phenomena that rigid-body simulation does not cover
        * overlapping geoms whose contacts are disabled; convex hulls much larger than their mesh
        * other overlaps, and violated joint limits, in the reference pose
        """
    def replace(self, values: Mapping[str, ArrayLike] | None = None, /, **fields: ArrayLike) -> Model:
        """New model with other values in some fields. Quantities that depend on these fields are recomputed.

            model.replace(geom_restitution=[0.2, 0.8])  # (ngeom,)
            model.replace({"geom_friction[floor,box][0]": 0.5})

        With a new `actuator_gear`, joints keep the armature and damping that MJCF's actuators gave them with the old gear.

        Args:
            values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md). Other entries of these fields keep their
                values. Each array has an axis for the selected elements and one for the selected columns, as in NumPy's indexing. A single
                name, index or column has no axis. A scalar sets all selected entries.
            **fields: Values of whole fields, in the shape of the model's attribute.

        Contacts of an explicit pair use the fields of the pair (pair_friction, pair_restitution, ...) and ignore the fields of its geoms.
        If you change a geom of a pair, also give the pair's field in the same call, even if its values stay the same. This holds for
        geom_friction, geom_restitution, geom_margin, geom_gap, geom_condim, geom_solref, geom_solimp, geom_solmix, geom_stiffness and
        geom_damping. The field of the pair for geom_condim is pair_dim, and for geom_solmix it is pair_solref.

        Raises:
            ValueError: A shape is wrong.
            ModelError: A field is unknown, a value is invalid, or an explicit pair, which the message names, overrides the value of a
                geom.
        """
    def exclude_overlaps(self) -> Model:
        """New model without contacts between bodies that overlap in the reference pose, as by `stepper.load(..., overlaps="exclude")`.

        Overlaps count if they are deeper than 0.01 mm; `excluded_overlaps` lists them. All contacts between the two bodies of an overlap
        are disabled. If a body is the world, only contacts between the two overlapping geoms are disabled. Overlaps with the ground are
        kept, and `overlaps()` lists them. Ground means planes, height fields and, for bodies with a free joint, all fixed geoms.
        """
    def overlaps(self) -> list[tuple[str, str, float]]:
        """Pairs of geoms that can collide and overlap by more than 0.01 mm in the reference pose, the deepest first.

        Returns:
            Tuples (name of the first geom, name of the second, depth in m). Geoms without a name are listed as "#3 of body arm".
        """
    def with_sensors(self, sensors: Mapping[str, RayFan | Combination | SensorSpec]) -> Model:
        """New model with additional sensors, after the existing ones.

        Args:
            sensors: Additional sensors by name: each is a `SensorSpec`, a `RayFan` or a `Combination` of `stepper.sensors`.

        Raises:
            ValueError: An element does not exist, or a direction has length 0.
            ModelError: The model cannot have a sensor.
        """
    def equivalent_springs(self) -> dict[str, NDArray[Any]]:
        """Stiffness and damping of the contacts under MuJoCo's contact law, from solref and solimp at the time step of the model.

        Returns:
            Dictionary of arrays with a row for each of the n pairs of geoms that can collide: "geoms" (n, 2), indices; "stiffness" (n, 2),
            N/m; and "damping" (n, 2), N s/m. Stiffness and damping are those of a contact whose geoms do not accelerate: in column 0 at
            first touch, in column 1 at the depth of the largest impedance. In large scenes, some pairs are found only during the
            simulation; these are not listed.
        """
    def body(self, key: str | int) -> Body:
        """Body by name or index (negative from the end).

        Raises:
            KeyError: The model has no body of that name; the message has similar names.
            IndexError: The model has no body of that index.
        """
    def joint(self, key: str | int) -> Joint:
        """Joint by name or index (negative from the end).

        Raises:
            KeyError: The model has no joint of that name; the message has similar names.
            IndexError: The model has no joint of that index.
        """
    def geom(self, key: str | int) -> Geom:
        """Geom by name or index (negative from the end).

        Raises:
            KeyError: The model has no geom of that name; the message has similar names.
            IndexError: The model has no geom of that index.
        """
    def _requested_options(self) -> dict[str, Any]:
        """Dictionary of the options `contact`, `integrator` and `iterations` that the source file implies.

        The dictionary is empty for models made in code. `Options.from_model` reads it.
        """
    def pair(self, key: str | int) -> Pair:
        """Pair by name or index (negative from the end).

        Raises:
            KeyError: The model has no pair of that name; the message has similar names.
            IndexError: The model has no pair of that index.
        """
    def site(self, key: str | int) -> Site:
        """Site by name or index (negative from the end).

        Raises:
            KeyError: The model has no site of that name; the message has similar names.
            IndexError: The model has no site of that index.
        """
    def actuator(self, key: str | int) -> Actuator:
        """Actuator by name or index (negative from the end).

        Raises:
            KeyError: The model has no actuator of that name; the message has similar names.
            IndexError: The model has no actuator of that index.
        """
    def sensor(self, key: str | int) -> Sensor:
        """Sensor by name or index (negative from the end).

        Raises:
            KeyError: The model has no sensor of that name; the message has similar names.
            IndexError: The model has no sensor of that index.
        """
    def tendon(self, key: str | int) -> Tendon:
        """Tendon by name or index (negative from the end).

        Raises:
            KeyError: The model has no tendon of that name; the message has similar names.
            IndexError: The model has no tendon of that index.
        """
    def equality(self, key: str | int) -> Equality:
        """Equality by name or index (negative from the end).

        Raises:
            KeyError: The model has no equality of that name; the message has similar names.
            IndexError: The model has no equality of that index.
        """
    def keyframe(self, key: str | int) -> Keyframe:
        """Keyframe by name or index (negative from the end).

        Raises:
            KeyError: The model has no keyframe of that name; the message has similar names.
            IndexError: The model has no keyframe of that index.
        """
    def integrate_pos(self, q: ArrayLike, dv: ArrayLike) -> NDArray[np.float64]:
        """Configurations after displacements, with unit quaternions, as MuJoCo's mj_integratePos with dt = 1.

        Args:
            q: Configurations, (..., nq).
            dv: Displacements on the tangent space, in the coordinates of qvel, (..., nv). Rotations of ball and free joints are rotation
                vectors in the body's frame. The leading axes equal the leading axes of `q`, or one of the arguments has no leading axes.

        Returns:
            Configurations, (..., nq) float64.

        Raises:
            ValueError: Shapes do not match, a number is not finite, or a quaternion is zero.
        """
    def differentiate_pos(self, q1: ArrayLike, q2: ArrayLike) -> NDArray[np.float64]:
        """Shortest displacements from one configuration to another, as MuJoCo's mj_differentiatePos with dt = 1.

        This is the inverse of `integrate_pos`.

        Args:
            q1: Initial configurations, (..., nq).
            q2: Final configurations, (..., nq). The leading axes equal the leading axes of `q1`, or one of the arguments has no leading
                axes.

        Returns:
            Displacements, (..., nv) float64.

        Raises:
            ValueError: Shapes do not match, a number is not finite, or a quaternion is zero.
        """
    def geoms_seen_from(self, site: int) -> list[int]:
        """Indices of the geoms that rays from the site with index `site` can hit: geoms of other bodies with a shape in the model."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class State:
    """Complete state of one or all environments of a `Stepper`; see `Stepper.get_state`.

    States compare bit for bit and can be pickled.

    Args:
        bytes: Bytes from `State.bytes`.

    Raises:
        ValueError: The bytes are not a state, are truncated or damaged, or have another version.
    """

    bytes: Final[builtins.bytes]
    """Bytes for `State(bytes)`: the state with a checksum and the digest of its model."""
    digest: Final[builtins.bytes]
    """SHA-256 digest of the model to which the state belongs."""
    nbytes: Final[int]
    """Length of `bytes`."""
    def __new__(cls, bytes: builtins.bytes) -> State: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Stepper:
    """Batch of environments of one model.

    Calls release the GIL while they step, unless they take only a few microseconds. A pickle includes the state.

    Args:
        model: Model of the scene.
        num_envs: Number of environments. None makes a single environment, whose arrays do not have the leading axis.
        options: Settings of the step. None uses `Options()`.
        precision: Floating-point precision: "f64", "f32", or a NumPy type such as `np.float32`.
        threads: Number of threads; 0 uses all processors of this process. Results do not depend on the number of threads.
        seed: Seed of the random sensor errors.
        sensors: Sensor model. None simulates ideal sensors.
        actuators: Actuator model between controls and forces. None simulates ideal actuators.

    Raises:
        ValueError: A setting is out of range.
        TypeError: A setting has the wrong type.
        MemoryError: The memory is too small for the environments.
    """

    model: Final[Model]
    """Model of the scene."""
    options: Final[Options]
    """Settings of the step, as given at construction."""
    num_envs: Final[int | None]
    """Number of environments. None means a single environment, whose arrays do not have the leading axis."""
    timestep: Final[float]
    """Current time step, s."""
    tolerance: Final[float]
    """Current tolerance of the solver: the largest residual at which it stops, m/s (see `Options.tolerance` and `Options.rtol`)."""
    precision: Final[Precision]
    """Floating-point precision: "f64" or "f32"."""
    threads: Final[int]
    """Number of threads; 0 uses all processors of this process."""
    seed: Final[int]
    """Seed of the random sensor errors."""
    qpos: Final[_Array]
    """Positions, (num_envs, nq), m, rad and quaternions. `set_state(qpos=...)` sets them."""
    qvel: Final[_Array]
    """Velocities, (num_envs, nv), m/s and rad/s. `set_state(qvel=...)` sets them."""
    act: Final[_Array]
    """Activations of actuators, (num_envs, na). `set_state(act=...)` sets them."""
    ctrl: Final[_Array]
    """Current controls, (num_envs, nu): the controls of the last step. After a reset, the controls are those of the keyframe, or zero
    without a keyframe."""
    xpos: Final[_Array]
    """Positions of the body frames at the current `qpos`, (num_envs, nbody, 3), m. Body 0 is the world. The positions belong to the state
    after the step, as after MuJoCo's `mj_forward`, and unlike after `mj_step`. The first read of a derived quantity computes it for all
    environments. The result is cached until the state, the parameters or an input changes. Quantities that are read together are
    computed in one pass."""
    xquat: Final[_Array]
    """Orientations of the body frames at the current `qpos`, quaternions (w, x, y, z), (num_envs, nbody, 4)."""
    body_linvel: Final[_Array]
    """Linear velocities of the body frames at the current state in world axes, (num_envs, nbody, 3), m/s. Mocap bodies have zero velocity,
    as in MuJoCo."""
    body_angvel: Final[_Array]
    """Angular velocities of the bodies at the current state in world axes, (num_envs, nbody, 3), rad/s."""
    site_xpos: Final[_Array]
    """Positions of the sites at the current `qpos`, (num_envs, nsite, 3), m."""
    site_xquat: Final[_Array]
    """Orientations of the sites at the current `qpos`, quaternions (w, x, y, z), (num_envs, nsite, 4)."""
    geom_xpos: Final[_Array]
    """Positions of the geoms at the current `qpos`, (num_envs, ngeom, 3), m."""
    geom_xquat: Final[_Array]
    """Orientations of the geoms at the current `qpos`, quaternions (w, x, y, z), (num_envs, ngeom, 4)."""
    subtree_com: Final[_Array]
    """Centre of mass of each body with its descendants at the current `qpos`, (num_envs, nbody, 3), m. Row 0, of the world, is the centre
    of mass of the whole scene."""
    xipos: Final[_Array]
    """Centres of mass of the bodies at the current `qpos`, (num_envs, nbody, 3), m."""
    cinert: Final[_Array]
    """Inertias of the bodies about the centre of mass of their tree in world axes, (num_envs, nbody, 10), as MuJoCo's `cinert`. The
    columns are the inertia xx, yy, zz, xy, xz, yz (kg m^2), mass times position of the centre of mass (3, kg m), and mass (kg). The row
    of the world is zero. A tree is a child of the world with its descendants."""
    cvel: Final[_Array]
    """Velocities of the bodies about the centre of mass of their kinematic tree in world axes, (num_envs, nbody, 6), as MuJoCo's `cvel`.
    The columns are angular velocity (3, rad/s), and linear velocity (3, m/s) of the body-fixed point at that centre of mass."""
    cfrc_ext: Final[_Array]
    """Torques (3, N m) and forces (3, N) of the contacts of the last step on the bodies, about the centre of mass of their kinematic tree
    in world axes, (num_envs, nbody, 6). The row of the world is zero, and all rows are zero before the first step after a reset or
    `set_state`. MuJoCo's `cfrc_ext` also includes `xfrc_applied` and connect and weld equalities."""
    qacc: Final[_Array]
    """Acceleration of the last step, including impulses of contacts and limits, (num_envs, nv), m/s^2 or rad/s^2. It is the change of
    velocity divided by the time step.

    Before the first step after a reset or `set_state`, it is the acceleration of a step from the current state. This also holds for
    `qfrc_constraint` and `body_contact_force`."""
    qfrc_bias: Final[_Array]
    """Coriolis, centrifugal and gravitational forces at the current state, (num_envs, nv), N or N m, as after `mj_forward`."""
    qacc_smooth: Final[_Array]
    """Acceleration without constraints at the current state and controls, (num_envs, nv), m/s^2 or rad/s^2, as after `mj_forward`. If the
    stepper has an actuator model, the forces of its drives are those of the last step."""
    actuator_force: Final[_Array]
    """Actuator forces before the gear at the current state and controls, (num_envs, nu), N or N m, as after `mj_forward`."""
    qfrc_actuator: Final[_Array]
    """Joint forces of the actuators, clipped to `actuatorfrcrange`, (num_envs, nv), N or N m."""
    qfrc_constraint: Final[_Array]
    """Joint forces of all constraints in the last step, (num_envs, nv), N or N m: impulses of contacts, limits, dry friction, equalities
    and tendons, divided by the time step."""
    body_contact_force: Final[_Array]
    """Force (3, N) and torque (3, N m) of all contacts of the last step on each body in world axes, (num_envs, nbody, 6). The torque is
    about the body's current centre of mass."""
    tendon_paths: Final[_Array]
    """Paths of the spatial tendons at the current `qpos` in the world frame, (num_envs, n, 10, 3), m, with one row for each of the n parts
    between two sites. The points are the first site, eight points on the sphere or cylinder between the sites, or on the straight line,
    and the second site."""
    closed_eq_data: Final[_Array]
    """Numbers of the equalities with which each has no position error at the current `qpos`, (num_envs, neq, 11), in the layout of
    `eq_data`. A weld that `randomize` gives these numbers holds the bodies in their current relative pose. A connect keeps its anchor
    in the first body and a weld its anchor in the second. A coupling keeps its polynomial except for the constant term."""
    time: Final[Any]
    """Simulated time, (num_envs,), s. `set_state(time=...)` sets it."""
    status: Final[NDArray[np.uint32] | int]
    """Status flags of the last call of `step`, (num_envs,) uint32; see `stepper.Status`."""
    residual: Final[NDArray[np.float64] | float]
    """Residual of the last step, (num_envs,), m/s. It is the size of the natural map, a function of impulses and velocities that is zero
    at the exact solution. With INFEASIBLE, the residual is at least the largest shortfall of a constraint velocity below its target,
    m/s or rad/s. With NON_FINITE it is infinite."""
    iterations: Final[Any]
    """Number of solver iterations in the last step, (num_envs,) uint32: Gauss-Seidel iterations and Newton steps."""
    newton_steps: Final[Any]
    """Number of Newton steps of the solver in the last step: the sum over all islands of bodies, (num_envs,) uint32. `iterations` also
    includes Gauss-Seidel iterations."""
    error_estimate: Final[Any]
    """Largest estimated error of the positions in a step of the last call of `step`, (num_envs,) float64, m or rad. The estimate of a step
    is a sum over its parts. NaN without `Options(error=...)`."""
    substeps: Final[Any]
    """Number of parts in the last call of `step` into which steps were divided, (num_envs,) uint32: by elastic impacts, or to keep
    `Options(error=...)`. Steps that are not divided do not count."""
    max_penetration: Final[Any]
    """Largest penetration of a contact beyond its margin in the last call of `step`, (num_envs,) float64, m. A step measures it at contact
    detection, which is in the middle of the step for "midpoint" and "rk4". Of a divided step it is the largest of its parts. Above
    1 mm `status` has DEEP."""
    max_limit_violation: Final[Any]
    """Largest violation of the range of a joint or tendon after the steps of the last call of `step`, (num_envs,) float64, rad or m. Above
    0.01 `status` has OVER_LIMIT."""
    max_equality_violation: Final[Any]
    """Largest position error of an equality (connect, weld, joint, tendon) after the steps of the last call of `step`, (num_envs,)
    float64, m or rad. Above 0.001 `status` has EQUALITY_VIOLATED. It is 0 without equalities. Equalities with a finite stiffness are
    springs and are not included. With contact="mujoco" all equalities are soft, and all are included."""
    recorder: Any
    """Recorder that is notified of `step`, `reset`, `set_state` and `randomize` (see `stepper.Recorder`). None means that no recorder is
    set."""
    sensors: Final[SensorModel | None]
    """Sensor model given at construction. None means ideal sensors."""
    actuators: Final[ActuatorModel | None]
    """Actuator model given at construction. None means ideal actuators. After changes by `randomize`, the attribute
    `randomized` has the current drives."""
    sensordata: Final[_Array]
    """Sensor readings of the last step, (num_envs, nsensordata). Repeated reads give the same values. `observe()` returns a
    writable copy."""
    sensordata_ideal: Final[_Array]
    """Readings of ideal sensors, (num_envs, nsensordata).

    Positions and velocities are those after the last step. Accelerations are the change of velocity in that step divided by the time
    step, including impulses of contacts and limits. Forces are impulses divided by the time step. Before the first step after a reset
    or `set_state`, accelerations and forces are those of a step from the current state."""
    sensor_faults: Final[_Array]
    """Numbers of faults of each sensor in the last call of `step`, (num_envs, nsensor, 2) uint32. Column 0 is the number of clipped
    readings, and column 1 the number of lost samples."""
    actuator_saturation: Final[_Array]
    """Number of steps in the last call of `step` in which each actuator force was clipped, (num_envs, nu) uint32. Bounds are the
    `forcerange` of the actuator, the `actuatorfrcrange` of the joint, and the limits and torque-speed curve of the drive."""
    qfrc_applied: _Array
    """Applied joint forces, (num_envs, nv), N or N m. Writable; each step applies them until they are changed or reset."""
    xfrc_applied: _Array
    """Applied force (N) and torque (N m) at the centre of mass of each body in world axes, (num_envs, nbody, 6). Writable; each step
    applies them until they are changed or reset."""
    mocap_pos: _Array
    """Positions of the mocap bodies, (num_envs, nmocap, 3), m. Writable; each step uses them until they are changed or reset."""
    mocap_quat: _Array
    """Orientations of the mocap bodies as quaternions, (num_envs, nmocap, 4). Writable; each step uses them until they are changed or
    reset."""
    eq_active: NDArray[np.bool_]
    """Whether each equality is active, (num_envs, neq) bool, as MuJoCo's `eq_active`. Writable; each step uses it until it is changed.
    Part of the state of `get_state`. `reset` restores the model's `eq_active0`. States do not contain `eq_data`: after `copy_state`,
    `randomize` gives the targets the same numbers.

    The step ignores inactive equalities. If one is activated with a large position error, position correction closes it at up to
    `Options.max_correction_speed`. A weld pulls the bodies to the relative pose in `eq_data`. To hold them in the current pose instead,
    set the environment's `eq_data` first:

        grasp = model.equality("grasp").id
        sim.randomize({"eq_data[grasp]": sim.closed_eq_data[grasped, grasp]}, envs=grasped)
        sim.eq_active[grasped, grasp] = True"""
    randomized: Final[dict[str, Any]]
    """Parameters per environment, as a dictionary of arguments of `randomize`: arrays by field, and an `ActuatorModel` as "actuators"."""

    def __new__(
        cls,
        model: Model,
        num_envs: int | None = None,
        *,
        options: Options | None = None,
        precision: Precision | DTypeLike = "f64",
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
        """Starts a new episode in all environments, or in the environments `envs`. The previous episode has no influence on the new one.

        Applied forces become zero, and mocap bodies return to the poses of the model. Controls become zero, or the controls of the
        keyframe, until the next `step` with controls. Parameters of `randomize` are kept.

        Args:
            envs: Environments: a boolean mask (num_envs,), or unique integer indices (k,). None selects all environments. With a mask,
                arrays have a row for each environment of the batch, and rows of unselected environments are ignored. With indices, arrays
                have a row for each index, in order.
            qpos: Initial positions, (num_envs, nq) or (nq,). None uses the reference configuration. Quaternions are normalised.
            qvel: Initial velocities, (num_envs, nv) or (nv,). None uses zero velocities.
            seed: New seed of the sensor errors, or seeds (num_envs,). None keeps the old seeds.
            keyframe: Name or index of a keyframe with the initial qpos, qvel, act, ctrl and time.

        Raises:
            TypeError: A seed or an index is no integer.
            IndexError: An index is out of range.
            ValueError: A shape is wrong, a number is not finite, a quaternion is zero, or a seed is negative. No environment changes.
            KeyError: The model has no such keyframe.
        """
    def step(self, ctrl: ArrayLike | None = None, nstep: int = 1, envs: ArrayLike | None = None) -> None:
        """Makes `nstep` steps in every environment, or in the environments `envs`.

        Args:
            ctrl: Controls, (num_envs, nu), or (nu,) for all environments. They also apply to later steps without controls. None keeps the
                current controls (`Stepper.ctrl`), as in MuJoCo.
            nstep: Number of steps. With 0, the call only sets the controls, for quantities that follow from them, such as `qacc_smooth`;
                `status` and other results are still those of the last step.
            envs: Environments, as in `reset`. The other environments keep their state, controls, sensor readings and flags. A SIMD group
                without a selected environment takes no time. But if sensors or actuators have delays, or if the stepper is recorded, all
                environments step, and then the states of the unselected environments are restored.

        Raises:
            ValueError: A shape is wrong; the message has the given and the required shape. Or `nstep` is negative, or `envs` has an index
                twice. A NaN control is no error: `status` has NON_FINITE for its environment, and the bodies concerned keep their state.
            TypeError: An index in `envs`, or `nstep`, is no integer.
            IndexError: An index in `envs` is out of range.
            KeyboardInterrupt: Ctrl-C interrupted a long call, which checks for signals about twenty times per second. All selected
                environments have made the same number of steps, which is the exception's attribute `steps`. The results equal those of a
                call with this number as `nstep`, except that moving mocap bodies have not reached their targets. A recording with moving
                mocap bodies can be replayed up to this call only. Exceptions of other signal handlers interrupt the call in the same way.
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
        """Makes `nstep` steps with each of T controls in one call.

        If no mocap body moves, the results equal those of T calls of `step`, bit for bit.

        Each thread steps its environments through all T controls. `qfrc_applied` and `xfrc_applied` are constant. Mocap bodies reach the
        poses `mocap_pos` and `mocap_quat` at the end of the call.

        Args:
            ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
            nstep: Number of steps per control.
            initial: Initial state, as in `set_state`: a state of one environment, a state of all environments, or a list with a state for
                each environment. None starts from the current state.
            fields: Quantities to store after each control: "qpos" (T, num_envs, nq), "qvel" (T, num_envs, nv), "act" (T, num_envs, na),
                "sensordata" (T, num_envs, nsensordata). None stores the quantities in `out`. Without `out`, None stores all of them except
                "act".
            out: Arrays for the results, by quantity, with the shapes of `fields`. The arrays must be C-contiguous and float64, or float32
                with `precision="f32"`. "status" and "residual" are also possible.

        Returns:
            Arrays by quantity. They always include "status" (T, num_envs) uint32, the flags of all steps of a control, and "residual"
            (T, num_envs) float64, the largest residual of these steps, m/s. After the call, the attribute `status` has the flags of all
            steps of the call; `residual` and `iterations` belong to the last step.

        Raises:
            ValueError: A shape is wrong, a quantity is unknown, or an array of `out` is read-only or given twice.
            TypeError: An array of `out` has the wrong dtype.
            KeyboardInterrupt: The call was interrupted, as in `step`. The exception's `steps` counts the steps of all controls. `out` has
                results for each control so far; for the interrupted control, these are the results after the last step before the
                interruption. Later rows of `out` are unchanged.
        """
    def memory(self) -> dict[str, int]:
        """Memory of the stepper in bytes, without NumPy arrays that it has returned.

        Returns:
            Dictionary of bytes, except for "threads". "state": states of all environments. "parameters": parameters of all environments,
            from `randomize` and drives. "inputs": controls, applied forces and mocap poses of all environments. "per_env": these three
            together, divided by the number of environments. "per_thread": workspace of each thread. "threads": number of threads with a
            workspace. "total": "state" + "parameters" + "inputs" + "threads" x "per_thread".
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
        """Sets positions, velocities, activations or time, or restores a complete `State`.

        The next state depends on `qpos`, `qvel`, `act` and the controls; the solver's warm start changes velocities by about 1e-7 m/s only
        (docs/development/decisions/visible_state.md). Drives (delay lines, lags, integrals) and sensors (bias, drift, delay lines, held
        samples) have further memory.

        Args:
            qpos: Positions, (num_envs, nq) or (nq,). A state from `get_state` is also possible: the state of a batch of the same size
                restores each environment, and the state of a single environment is copied to all. A list has one state of a single
                environment for each of `envs`. A simulation repeats its motion from a restored state, bit for bit. Copies of a single state
                have independent random sensor errors.
            qvel: Velocities, (num_envs, nv) or (nv,).
            envs: Environments, as in `reset`. `set_state(get_state(env=3), envs=[5, 6])` copies environment 3 to environments 5 and 6.
            act: Activations, (num_envs, na) or (na,).
            time: Times, (num_envs,) or one for all, s.
            keep_warmstart: Whether to keep the solver's warm start, contacts, flags, and the memory of drives and sensors. Use it in state
                estimators that correct a running environment. False clears all of these, and the next control and reading fill the delay
                lines, so that the motion depends on the new state alone.

        Raises:
            TypeError: `keep_warmstart` is not True or False.
            ValueError: A shape is wrong, a number is not finite, a quaternion is zero, or a state belongs to another model. No environment
                changes.
        """
    def randomize(
        self,
        values: Mapping[str, ArrayLike | None] | ArrayLike | None = None,
        /,
        envs: ArrayLike | None = None,
        **fields: ArrayLike | ActuatorModel | None,
    ) -> None:
        """Sets parameters of some or all environments, with the effect of `Model.replace`. Dependent quantities are recomputed.

        With hard contact, an environment then moves, bit for bit, as in a `Stepper` of the model that `Model.replace` returns. With
        MuJoCo's contact law, the inverse weights stay those of the stepper's model. Parameters are not part of the state: `reset` and
        `set_state` keep them, and pickles and recordings include them. Fields that a call does not name keep their values. Fields that are
        never randomized cost neither time nor memory.

        Contacts of an explicit pair use pair_friction and pair_restitution, and ignore geom_friction and geom_restitution. So a new
        geom_friction for a geom of an explicit pair is an error without pair_friction. Give pair_friction in this call or an earlier one,
        with new values or the values of the model. One earlier call suffices for all environments, also for environments that it did not
        select. The same holds for geom_restitution and pair_restitution.

            sim.randomize(geom_friction=friction)  # (num_envs, ngeom, 3)
            sim.randomize({"geom_friction[floor,box][0]": sliding}, envs=[3, 5])  # (2, 2)

        Args:
            values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md). Other entries of these fields keep their
                values. Each array has the axis of environments, then an axis for the selected elements and one for the selected columns, as
                in NumPy's indexing. A single name, index or column has no axis. If `envs` has indices, the axis of environments has one
                entry per index, otherwise num_envs. An array with this axis alone sets all selected entries of an environment to one
                value. A scalar sets the selected entries of all selected environments. None restores the values of the model. The first
                argument may also be `envs`, without values.
            envs: Environments to change, as in `reset`.
            **fields: Values of whole fields, (num_envs, ...) with the shape of the field in the model. None restores the values of
                the model. A call with neither values nor fields restores all fields and drives; an empty dict as `values` changes nothing.

                * gravity (num_envs, 3), m/s^2
                * body_mass (num_envs, nbody), kg; body_ipos (num_envs, nbody, 3), centre of mass, m; body_inertia (num_envs, nbody, 3),
                  principal moments, kg m^2. They are independent: a new mass does not change the inertia.
                * geom_friction (num_envs, ngeom, 3), sliding, torsional (m), rolling (m); geom_restitution (num_envs, ngeom)
                * pair_friction (num_envs, npair, 3) and pair_restitution (num_envs, npair) of explicit pairs
                * geom_size and geom_pos (num_envs, ngeom, 3), m. Masses do not change.
                * jnt_stiffness (num_envs, njnt), N/m or N m/rad; jnt_range (num_envs, njnt, 2), m or rad
                * dof_damping, dof_armature, dof_frictionloss (num_envs, nv)
                * eq_data (num_envs, neq, 11), anchors, relative pose and torquescale, or polynomial, as in MuJoCo; see `closed_eq_data`
                * actuator_gainprm, actuator_biasprm (num_envs, nu, 10), as in MuJoCo. With affine gain and bias, the force is
                  gain[:3] . (1, length, velocity) times the input plus bias[:3] . (1, length, velocity). Entries that the type of an
                  actuator does not use are 0.
                * actuators, a `stepper.ActuatorModel`: its drives replace the drives of the matching actuators completely. Arrays in drives
                  have num_envs entries, also if `envs` has indices. Other actuators keep their drives, and None restores the drives that
                  were given to the constructor. A new drive must have the structure of the constructor's drive: both or neither have a
                  servo, a sampling period, a motor and a torque-speed curve. Gear, rotor inertia and control of the motor are the same. A
                  new drive can have lag, limits or friction only if the constructor's drive has them in at least one environment. Delays
                  must not exceed the longest delay there. Delay lines, lags and integrals are state: they are kept until `reset`.

        Raises:
            TypeError, IndexError: An argument `envs` is invalid, as in `reset`, or `values` is no dict.
            ValueError: A selector or a shape is wrong, or two selectors set the same number. Or a drive has an invalid value, another
                structure or a longer delay. No parameter changes.
            ModelError: The field must be the same in all environments, a value is invalid, or an explicit pair overrides the value. Or the
                value needs a feature that the model lacks, such as dry friction in a joint without it. The message has field, element and
                environment. No parameter changes.
        """
    def record(self, path: str | PathLike[str], *, chunk: int = 64 << 20, note: str = "") -> Recorder:  # noqa: D417
        """Starts a recording of all further calls in a new folder, until the `Recorder` is closed.

        `stepper.recording.verify` repeats the recorded calls.

        Args:
            path: New or empty folder.
            **settings: Arguments of `stepper.Recorder`.
        """
    def observe(self, out: _Array | None = None) -> _Array:
        """Writable copy of `sensordata`, (num_envs, nsensordata). If an array `out` is given, the result is that array."""
    def get_state(self, env: int | None = None) -> State:
        """Complete state, including the current controls and the active equalities.

        Applied inputs (`qfrc_applied`, `xfrc_applied`, mocap poses) and parameters of `randomize` are not part of the state.

        Args:
            env: Index of an environment. None saves all environments.
        """
    def contacts(self, envs: ArrayLike | None = None) -> NDArray[np.void]:
        """Contacts of the last step: all that the solver considered. If the state was set since then, those of a trial step.

        They are the contacts that the motion can close within the step. Contacts that do not touch (distance > 0) mostly have no force.
        Distances are relative to the margin, at which contacts begin to push. The `gap` of a geom, with which MuJoCo 4 also reports
        contacts without force, has no effect: farther contacts are not listed.

        Args:
            envs: Environments, as in `reset`. Their contacts are concatenated.

        Returns:
            Structured array with these fields:

            * env, geom (2,) and body (2,), indices
            * pos (3,), m
            * normal (3,), from the first geom to the second
            * distance, m, relative to the margin
            * force (3,), N, on the second geom along the rows of frame
            * torque (3,), N m, of torsional and rolling friction (condim 4 and 6) on the second geom at pos, about the rows of frame
            * frame (3, 3), with the rows normal, t1 and t2

            Force and torque satisfy |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
        """
    def worst_row(self, env: int = 0) -> str | None:
        """Cause of the last unsolved step in the last call of `step`: a constraint, or an element that is not finite or too fast.

        With `status` NOT_CONVERGED it is the constraint with the largest residual, with INFEASIBLE the constraint that misses its target by
        most. With NON_FINITE it is the joint, body or actuator whose number is not finite. With UNRESOLVED alone it is the fastest joint,
        of the mechanisms that are too fast for the time step if these are known.

        Args:
            env: Index of the environment.

        Returns:
            Text such as 'contact of geom "floor" and geom "foot"', 'limit of joint "knee"', 'equality "loop"', 'number that is not finite:
            actuator "servo"' or 'fastest joint "elbow"'. None if all steps were solved, or if no single constraint is responsible.
        """
    def save_problem(self, path: str | PathLike[str], env: int = 0, *, ctrl: ArrayLike | None = None) -> None:
        """Writes the constraint problem of the next step to a file, for example as a test of the solver.

        The file includes the initial impulses of the solver. In Rust, `stepper_solve::Problem::load(path)` reads it.

        The problem belongs to a step from the current state. The state does not change. For a step that was not solved (NOT_CONVERGED),
        first restore the state before it: `before = sim.get_state()` before the step, then `sim.set_state(before)`.

        Args:
            path: File to write. An existing file is overwritten.
            env: Index of the environment.
            ctrl: Controls of the step, as in `step`. None keeps the current controls.

        Raises:
            OSError: The file cannot be written.
        """
    def jacobian(self, body: str | int | None = None, site: str | int | None = None) -> _Array:
        """Jacobian of a body frame or a site at the current `qpos`, with velocity = `jacobian @ qvel`.

        Args:
            body: Name or index of a body.
            site: Name or index of a site, instead of a body.

        Returns:
            Jacobian in world axes, (num_envs, 6, nv): three rows for the linear velocity, then three for the angular velocity.

        Raises:
            ValueError: Both or none of body and site are given.
            KeyError: The model has no body or site of that name.
            IndexError: The model has no body or site of that index.
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
        """Derivatives of the state after `nstep` steps with respect to the current state, controls and parameters, in all environments.

        The method does not change the stepper, and returns a `Linearization`. By default each column is a finite difference between
        perturbed copies of an environment. Copies of all environments and columns are stepped as one batch, with the options, parameters
        and threads of the stepper, but a tighter tolerance. The stepper keeps the memory of the copies for the next call. With contact,
        the step is smooth only between kinks: see `Linearization.near_kink` and docs/how-to/derivatives.md.

        Args:
            wrt: Names of the inputs: "qpos", "qvel", "act", "ctrl", and fields of `Stepper.randomize`, whole ("body_mass") or by selector
                ("geom_friction[floor,box][0]", docs/reference/what_can_vary.md). Columns are zero for a mass, size, stiffness or
                frictionloss of 0, which the model does not simulate. None selects ("qpos", "qvel", "act", "ctrl").
            ctrl: Constant controls during the steps, (num_envs, nu) or (nu,). None keeps the current controls.
            nstep: Number of steps.
            method: "fd" is finite differences of whole steps. "implicit" solves the step once and applies the implicit function theorem
                with fixed contact modes (which contacts push, stick and slip). It supports derivatives with respect to state and controls.
                The integrator must be "midpoint", "euler" or "implicit"; with `contact="mujoco"` it must be "euler", "implicitfast" or
                "implicit". Environments in which the theorem does not apply use finite differences (`Linearization.implicit`).
            step: Half width of the differences, in SI units for coordinates and relative for parameters. None chooses it from the tolerance
                (`stepper.derivatives.perturbations.step_of`), or for "implicit" uses `stepper.derivatives.implicit.STEP`.
            tolerance: Solver tolerance of the copies, m/s. None uses 1e-13, or the tolerance of the stepper if that is smaller.
            centered: Whether differences are central. One-sided differences need half the copies. Their error is of first order in `step`
                instead of second, and they cannot compare the slopes on both sides of a kink.
            extrapolate: Whether to apply Richardson extrapolation with differences of twice the width. It needs twice the copies and gives
                error estimates.
            sensors: Whether to compute derivatives of the ideal sensor readings too.

        Raises:
            TypeError: `nstep` is no integer, or `centered`, `extrapolate` or `sensors` is not True or False.
            ValueError: A name is unknown, a shape is wrong, or `step` or `nstep` is not positive. Or `method="implicit"` does not support
                the options or derivatives.
            ModelError: A parameter cannot be perturbed; the message has its element.
        """
    def _actuators_with_memory(self) -> list[str]:
        """Names of the actuators whose controls act on later steps too (delay, lag, sampled servo, integral), in any environment."""

    def _differentiate(self, ctrl: _Array, parts: list[str], offsets: _Array, tolerance: float) -> dict[str, NDArray[Any]]:
        """Derivatives of a step by the implicit function theorem. `stepper.derivatives.implicit` documents the arguments.

        Returns:
            Dictionary of arrays: derivatives "slopes" (num_envs, 2 nv + na, columns), with a column for each coordinate of `parts`; flags
            of kinks "causes" (num_envs, columns) uint32; "distance" to the nearest kink, "sound" (uint8, 1 for a valid derivative),
            "residual" and "status" (num_envs,); and "qpos", "qvel" and "act" after the step.
        """
    def _find_kinks(
        self,
        *,
        count: int,
        sides: int,
        one_sided: NDArray[np.bool_],
        limited: list[list[int]],
        ranges: _Array,
        limit_positions: _Array,
        rubbing: list[int],
        smooth_at_rest: bool,
        tolerance: float,
    ) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
        """Kinks between copies of environments after a step, such as a contact that pushes in one copy only.

        `stepper.derivatives.kinks` documents the arguments.

        Returns:
            Flags of `Kink` for each column of the derivative, (environments, columns) uint32, and the distance to the nearest kink as a
            multiple of the perturbation, (environments,).
        """
    def read(self, name: str, of: str | int | Sequence[str | int] | None = None) -> _Array:
        """Values of a quantity for all its elements, or for some elements given by name or index.

            sim.read("xpos", "torso")  # (num_envs, 3)
            sim.read("qvel", ["left_knee", "right_knee"])  # (num_envs, 2)

        Args:
            name: Name of an attribute of `Stepper`, such as "xpos", "qvel" or "sensordata".
            of: Name or index of an element, or a list of several. The quantity determines the kind of element: body, site, geom, joint,
                actuator or sensor. None selects all elements. A single body, site or geom has no axis of elements: (num_envs, 3). The
                columns of joints and sensors are concatenated: (num_envs, n) for n columns.

        Returns:
            New array (num_envs, ...) in the precision of the stepper.

        Raises:
            ValueError: The quantity is unknown.
            KeyError, IndexError: The model has no element of that name or index.
        """
    def inverse_dynamics(self, qacc: ArrayLike) -> _Array:
        """Joint forces that cause given accelerations at the current states: mass matrix times `qacc`, plus bias, minus passive forces.

        This is MuJoCo's `mj_inverse` without constraints. Passive forces are the forces of springs, dampers, gravity compensation and the
        fluid. Actuator forces, applied forces and constraint forces are not subtracted. `qfrc_constraint` has the constraint forces of the
        last step.

        Args:
            qacc: Accelerations, (num_envs, nv) or (nv,), m/s^2 or rad/s^2.

        Returns:
            Joint forces, (num_envs, nv), in the precision of the stepper, N or N m.

        Raises:
            ValueError: `qacc` has another shape, or a number that is not finite.
        """
    def copy_state(self, sources: ArrayLike, envs: ArrayLike | None = None) -> None:
        """Copies states between environments: environment `envs[k]` gets the state of environment `sources[k]`; see `get_state`.

        All states are read before any is changed. The copies have independent random sensor errors.

        Args:
            sources: Indices of the source environments: one for each environment in `envs`, or a single integer for all of them. Indices
                may repeat.
            envs: Target environments, as in `reset`.

        Raises:
            TypeError: An index is no integer.
            ValueError: The number of sources differs from the number of environments.
            IndexError: An index is out of range.
        """
    def view(  # noqa: D417
        self,
        *,
        envs: ArrayLike | None = None,
        source: Any = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        spacing: float | None = None,
        reset: Callable[[], Any] | None = None,
    ) -> View:
        """Opens a live view of the environments in the browser, and prints its address.

        Args:
            **settings: Arguments of `stepper.viewer.View`.

        Raises:
            ModuleNotFoundError: viser is not installed; the message has the command to install it.
        """
    def mass_matrix(self) -> _Array:
        """Mass matrices at the current configurations, including armature, without terms that depend on the time step.

        Returns:
            Mass matrices, (num_envs, nv, nv), in the precision of the stepper.
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
        """Distances and geoms that rays hit at the current states: MuJoCo's `mj_ray` for many rays of all environments in one pass.

        Rays hit planes from the front only; planes are infinite. Rays hit the triangles of meshes, also of those that collide as a hull,
        and the top, sides and base of height fields. A ray that starts inside a geom hits its surface from inside. Visual geoms with
        primitive shapes are hit; visual meshes are not part of the model.

        Args:
            points: Origins of n rays per environment, (num_envs, n, 3), or (n, 3) for all environments, m. With `body`, they are relative
                to the origin of the body's frame.
            directions: Directions of the n rays, of any positive length, (num_envs, n, 3) or (n, 3).
            body: Name or index of the body that carries the rays, such as a lidar. Its geoms are not hit. None fixes the rays to the world.
            axes: Axes of points and directions if `body` is given. "body" selects the axes of the body, "heading" the world axes rotated by
                the heading of the body, and "world" the world axes.
            geoms: Names or indices of the geoms that rays can hit. None selects all geoms.
            exclude: Name or index of a body whose geoms are not hit. None excludes the geoms of `body`.

        Returns:
            Distances, (num_envs, n), m, in the precision of the stepper, and indices of the hit geoms, (num_envs, n) int32. Both are -1 for
            rays without a hit.

        Raises:
            ValueError: A shape is wrong, `axes` is unknown, a point is not finite, a direction is zero, or a mesh is not part of the model.
            KeyError, IndexError: The model has no geom or body of that name or index.
        """
    def _in_64_bits(self, env: int) -> list[_Array]:
        """Mass matrix, bias force, smooth acceleration, energies and momenta of an environment, for the tests' reference trajectories.

        The list has these quantities in this order. They are computed in 64 bits, also for a stepper with precision "f32".
        """
    def energy(self) -> tuple[Any, Any]:
        """Potential energy (gravity, springs of joints and tendons) and kinetic energy (including armature) at the current states.

        Bodies that are fixed to the world do not count. MuJoCo's `energy` adds their constant potential energy.

        Returns:
            Potential and kinetic energies: two arrays (num_envs,) float64, J.
        """
    def momentum(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Linear momentum, and angular momentum about the centre of mass, at the current states.

        Returns:
            Linear and angular momenta in world axes: two arrays (num_envs, 3) float64, kg m/s and kg m^2/s.
        """
    def __getstate__(self) -> dict[str, Any]: ...
    def __setstate__(self, state: dict[str, Any]) -> None: ...

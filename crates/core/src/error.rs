//! Errors of calls with invalid arguments, in types and in words.

use stepper_real::LevelError;
use thiserror::Error;

use crate::math::precision::Precision;
use crate::model::{ActuatorError, ModelError, Parameter, SensorError};

/// Error of a call. The call changed nothing.
///
/// The text names the thing, the value found and the value that it must have. An unsolved step is no error: its environment gets a flag,
/// see [`Status`](crate::Status).
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// Setting of [`Options`](crate::Options) out of its range.
    #[error("option {name} is {found}, must be {must}")]
    Option {
        /// Name of the setting, which is that of the field.
        name: &'static str,
        /// Value of the option.
        found: String,
        /// Range of the option, in words.
        must: &'static str,
    },
    /// Integrator of the model's source that does not exist here.
    #[error("the source asks for {found}, which stepper does not have; choose ContactLaw::Mujoco and an integrator")]
    SourceIntegrator {
        /// Name of the integrator in the source.
        found: String,
    },
    /// Simulation of no environments.
    #[error("num_envs is 0, must be 1 or more, or None for a single environment")]
    NoEnvironments,
    /// Environment that does not exist.
    #[error("env is {env}, must be below {num_envs}")]
    Environment {
        /// Index that was given.
        env: usize,
        /// Number of environments.
        num_envs: usize,
    },
    /// File that cannot be written.
    #[error("{path} cannot be written ({reason}); choose a folder that exists and can be written")]
    File {
        /// Path that was given.
        path: String,
        /// Reason from the operating system.
        reason: String,
    },
    /// List of environments that is not ascending.
    #[error("environment {env} comes after {before} in the list; name every environment once, in ascending order")]
    Order {
        /// Environment that is out of order.
        env: usize,
        /// Previous environment of the list.
        before: usize,
    },
    /// Array of the wrong length.
    #[error("{name} has {found} numbers, must have {must}{detail}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Length of the array.
        found: usize,
        /// Required length.
        must: usize,
        /// Explanation of the required length, for the message; may be empty.
        detail: String,
    },
    /// List without one entry for every element of the model.
    #[error("there are {found} {name}, must be {must}, one for every {element}")]
    Count {
        /// Name of the list.
        name: &'static str,
        /// Length of the list.
        found: usize,
        /// Number of elements of the model.
        must: usize,
        /// Kind of element.
        element: &'static str,
    },
    /// Element of the model that does not exist.
    #[error("{element} is {found}, must be below {count}")]
    Element {
        /// Kind of element: "body", "site".
        element: &'static str,
        /// Index that was given.
        found: usize,
        /// Number of elements of that kind.
        count: usize,
    },
    /// Ray without a direction.
    #[error("directions[{ray}] of environment {env} is {found:?}, must be a direction: finite, and not zero")]
    Direction {
        /// Number of the ray.
        ray: usize,
        /// Environment.
        env: usize,
        /// Value that was given.
        found: [f64; 3],
    },
    /// Geom of a ray query whose mesh or height field the model does not have.
    #[error("geom {geom:?} is a {shape} whose form the model does not have, as nothing can touch it; leave it out of the geoms of rays")]
    NoForm {
        /// Name of the geom, or its index as "#3".
        geom: String,
        /// Name of the shape.
        shape: &'static str,
    },
    /// Number that is not finite.
    #[error("{place} of environment {env} is {value}, must be finite")]
    NotFinite {
        /// Place of the number: `qpos[3]`, `time`.
        place: String,
        /// Environment.
        env: usize,
        /// Value of the number: infinite or NaN.
        value: f64,
    },
    /// Number that 32 bits cannot hold, in a simulation of that precision.
    #[error("{place} of environment {env} is {value:e}, must be at most {:e} in 32 bits", f32::MAX)]
    TooLarge {
        /// Place of the number: `qpos[3]`.
        place: String,
        /// Environment.
        env: usize,
        /// Value of the number.
        value: f64,
    },
    /// Parameter that 32 bits cannot hold, in a simulation of that precision.
    #[error("{parameter} has {value:e}, which 32 bits cannot hold; give a smaller number")]
    ParameterTooLarge {
        /// Name of the parameter.
        parameter: Parameter,
        /// Value of the number.
        value: f64,
    },
    /// Quaternion of zeros, or one whose length overflows.
    #[error(
        "qpos[{address}..{}] of environment {env}, the orientation of joint \"{joint}\", is {found:?}: its length is {norm}, must be above 0; (1, 0, 0, 0) is no rotation",
        address + 4
    )]
    Quaternion {
        /// Environment.
        env: usize,
        /// Name of the joint, or its index as "#3".
        joint: String,
        /// Address of the quaternion in qpos.
        address: usize,
        /// Value of the quaternion.
        found: [f64; 4],
        /// Norm of the quaternion.
        norm: f64,
    },
    /// Positions of mocap bodies without orientations, or the reverse.
    #[error("mocap_pos and mocap_quat go together: give both or none")]
    MocapPoses,
    /// Array for a rollout in the other precision.
    #[error("the array for {name} is {found:?}, must be {must:?}")]
    ArrayPrecision {
        /// Name of the quantity.
        name: &'static str,
        /// Precision of the array.
        found: Precision,
        /// Precision of the simulation.
        must: Precision,
    },
    /// Bytes that are no saved state, of another format version, cut off or damaged.
    #[error("not a state: {0}")]
    NotAState(String),
    /// State of another model. Digests are those of [`Model::digest`](crate::Model::digest).
    #[error(
        "this state belongs to another model, {}; this one is \"{name}\", {}: give a state of the same model",
        abbreviated(state),
        abbreviated(model)
    )]
    OtherModel {
        /// Digest of the model that the state belongs to.
        state: [u8; 32],
        /// Digest of this simulation's model.
        model: [u8; 32],
        /// Name of this simulation's model.
        name: String,
    },
    /// State of the other precision.
    #[error("this state does not fit: it has numbers in {found:?}, this stepper in {must:?}")]
    StatePrecision {
        /// Precision of the state.
        found: Precision,
        /// Precision of the simulation.
        must: Precision,
    },
    /// State of the same model that does not fit: another number of environments, other sensors or drives, damaged contents.
    #[error("this state does not fit: {0}")]
    StateMisfit(StateMisfit),
    /// Error model that a sensor cannot have.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// Dynamics that an actuator cannot have.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// Actuator dynamics for environments with per-environment parameters.
    #[error("environments have parameters of their own: give drives first, or take the parameters back")]
    DrivesAfterParameters,
    /// More environments than there is memory for.
    #[error("{num_envs} environments of {bytes_per_env} bytes each are more than the memory here; make num_envs smaller")]
    Memory {
        /// Number of environments.
        num_envs: usize,
        /// Memory of each environment, bytes.
        bytes_per_env: usize,
    },
    /// Threads that the system refuses to start.
    #[error("{threads} threads cannot be started ({reason}); make threads smaller")]
    Threads {
        /// Number of requested threads, including the calling one.
        threads: usize,
        /// Reason from the operating system.
        reason: String,
    },
    /// CPU level in the environment variable `STEPPER_CPU_LEVEL` that does not exist.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// Invalid model, or parameters that make a model invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Checks the length of an array.
pub(crate) fn check_length(name: &'static str, found: usize, must: usize) -> Result<(), Error> {
    if found == must { Ok(()) } else { Err(Error::Length { name, found, must, detail: String::new() }) }
}

/// Mismatch between a saved state and a simulation of the same model and precision.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StateMisfit {
    /// Contents that this version does not read.
    #[error("not readable by this version, though undamaged: {0}")]
    Unreadable(String),
    /// Contents with that many surplus bytes.
    #[error("not readable by this version, though undamaged: {0} bytes too many")]
    TooManyBytes(usize),
    /// State of another number of environments.
    #[error("a state of {found} environments, this simulation has {must}; give one of as many, or of one for all")]
    NumEnvs {
        /// Number of environments of the state.
        found: usize,
        /// Number of environments of the simulation.
        must: usize,
    },
    /// Arrays of other lengths.
    #[error("a state with other sensors or actuators, or another max_contacts")]
    Shape,
    /// A position, velocity, activation or time that is infinite or NaN.
    #[error("a number of qpos, qvel, act or time is not finite: the bytes are damaged")]
    NotFinite,
    /// Contacts of geoms that do not collide in this model.
    #[error("its contacts belong to no pair of this model: the bytes are damaged")]
    Contacts,
    /// Delay lines that are longer than this model's.
    #[error("its delay lines have a sample that this model's do not: the bytes are damaged")]
    DelayLines,
}

/// First digits of a digest, which distinguish models.
fn abbreviated(digest: &[u8; 32]) -> String {
    digest[..6].iter().map(|byte| format!("{byte:02x}")).collect()
}

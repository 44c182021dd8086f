//! Calls that cannot be carried out: what was wrong, in types and in words.

use stepper_real::LevelError;
use thiserror::Error;

use crate::math::precision::Precision;
use crate::model::{ActuatorError, ModelError, Parameter, SensorError};

/// A call that cannot be carried out. Nothing was changed by it.
///
/// The text names the thing, the value found and the value that it must have. What a step could not do is no error but a flag of its
/// environment, see [`Status`](crate::Status).
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting of [`Options`](crate::Options) out of its range.
    #[error("option {name} is {found}, must be {must}")]
    Option {
        /// Name of the setting, as the field is called.
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
    /// A simulation of no environments.
    #[error("num_envs is 0, must be 1 or more, or None for a single environment")]
    NoEnvironments,
    /// An environment that does not exist.
    #[error("env is {env}, must be below {num_envs}")]
    Environment {
        /// Index that was given.
        env: usize,
        /// Number of environments.
        num_envs: usize,
    },
    /// A file that cannot be written.
    #[error("{path} cannot be written ({reason}); choose a folder that exists and can be written")]
    File {
        /// Path that was given.
        path: String,
        /// Reason from the operating system.
        reason: String,
    },
    /// A list of environments in which one does not come after the one before it.
    #[error("environment {env} comes after {before} in the list; name every environment once, in ascending order")]
    Order {
        /// The environment.
        env: usize,
        /// The one before it in the list.
        before: usize,
    },
    /// An array of the wrong length.
    #[error("{name} has {found} numbers, must have {must}{detail}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Numbers that it has.
        found: usize,
        /// Numbers that it must have.
        must: usize,
        /// Derivation of that number, for the text; may be empty.
        detail: String,
    },
    /// A list that does not have one entry for every element of the model.
    #[error("there are {found} {name}, must be {must}, one for every {element}")]
    Count {
        /// Name of the list.
        name: &'static str,
        /// Entries that it has.
        found: usize,
        /// Elements of the model.
        must: usize,
        /// Kind of element.
        element: &'static str,
    },
    /// An element of the model that does not exist.
    #[error("{element} is {found}, must be below {count}")]
    Element {
        /// Kind of element: "body", "site".
        element: &'static str,
        /// Index that was given.
        found: usize,
        /// Elements of that kind.
        count: usize,
    },
    /// A ray that goes nowhere.
    #[error("directions[{ray}] of environment {env} is {found:?}, must be a direction: finite, and not zero")]
    Direction {
        /// Number of the ray.
        ray: usize,
        /// Environment.
        env: usize,
        /// Value that was given.
        found: [f64; 3],
    },
    /// A geom for rays to meet whose mesh or height field the model does not have.
    #[error("geom {geom:?} is a {shape} whose form the model does not have, as nothing can touch it; leave it out of the geoms of rays")]
    NoForm {
        /// The geom's name, or its index as "#3".
        geom: String,
        /// Name of the shape.
        shape: &'static str,
    },
    /// A number that is not finite.
    #[error("{place} of environment {env} is {value}, must be finite")]
    NotFinite {
        /// The number: `qpos[3]`, `time`.
        place: String,
        /// Environment.
        env: usize,
        /// The value: infinite or NaN.
        value: f64,
    },
    /// A number that 32 bits cannot hold, in a simulation of that precision.
    #[error("{place} of environment {env} is {value:e}, must be at most {:e} in 32 bits", f32::MAX)]
    TooLarge {
        /// The number: `qpos[3]`.
        place: String,
        /// Environment.
        env: usize,
        /// Value of the number.
        value: f64,
    },
    /// A parameter that 32 bits cannot hold, in a simulation of that precision.
    #[error("{parameter} has {value:e}, which 32 bits cannot hold; give a smaller number")]
    ParameterTooLarge {
        /// The parameter.
        parameter: Parameter,
        /// Value of the number.
        value: f64,
    },
    /// A quaternion of zeros, or one whose length overflows.
    #[error(
        "qpos[{address}..{}] of environment {env}, the orientation of joint \"{joint}\", is {found:?}: its length is {norm}, must be above 0; (1, 0, 0, 0) is no rotation",
        address + 4
    )]
    Quaternion {
        /// Environment.
        env: usize,
        /// Name of the joint, or its index as "#3".
        joint: String,
        /// Place of the quaternion in qpos.
        address: usize,
        /// The quaternion.
        found: [f64; 4],
        /// Norm of the quaternion.
        norm: f64,
    },
    /// Positions of mocap bodies without orientations, or the reverse.
    #[error("mocap_pos and mocap_quat go together: give both or none")]
    MocapPoses,
    /// An array for a rollout in the other precision.
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
    /// A state of another model. Digests are those of [`Model::digest`](crate::Model::digest).
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
    /// A state of the other precision.
    #[error("this state does not fit: it has numbers in {found:?}, this stepper in {must:?}")]
    StatePrecision {
        /// Precision of the state.
        found: Precision,
        /// Precision of the simulation.
        must: Precision,
    },
    /// A state of the same model that does not fit: another number of environments, other sensors or drives, damaged contents.
    #[error("this state does not fit: {0}")]
    StateMisfit(StateMisfit),
    /// An error model that a sensor cannot have.
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
        /// Memory of each, bytes.
        bytes_per_env: usize,
    },
    /// Threads that the system refuses to start.
    #[error("{threads} threads cannot be started ({reason}); make threads smaller")]
    Threads {
        /// Threads that were asked for, the one that calls among them.
        threads: usize,
        /// Reason from the operating system.
        reason: String,
    },
    /// A CPU level, asked for by the environment variable `STEPPER_CPU_LEVEL`, that there is not.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// A model that cannot be used, or parameters that make no model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Refuses an array of the wrong length.
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
    /// A state of another number of environments.
    #[error("a state of {found} environments, this simulation has {must}; give one of as many, or of one for all")]
    NumEnvs {
        /// Environments of the state.
        found: usize,
        /// Environments of the simulation.
        must: usize,
    },
    /// Arrays of other lengths.
    #[error("a state with other sensors or actuators, or another max_contacts")]
    Shape,
    /// A position, velocity, activation or time that is infinite or NaN.
    #[error("a number of qpos, qvel, act or time is not finite: the bytes are damaged")]
    NotFinite,
    /// Contacts of geoms that do not meet in this model.
    #[error("its contacts belong to no pair of this model: the bytes are damaged")]
    Contacts,
    /// Delay lines that are longer than this model's.
    #[error("its delay lines have a sample that this model's do not: the bytes are damaged")]
    DelayLines,
}

/// The first digits of a digest, which tell models apart.
fn abbreviated(digest: &[u8; 32]) -> String {
    digest[..6].iter().map(|byte| format!("{byte:02x}")).collect()
}

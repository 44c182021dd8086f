//! Errors of calls with invalid arguments.

use stepper_real::LevelError;
use thiserror::Error;

use crate::math::precision::Precision;
use crate::model::{ActuatorError, ModelError, Parameter, SensorError};

/// Error of a call with invalid arguments. The call changed nothing.
///
/// The message names the argument, the value found and the value that it must have. An unsolved step is no error: its environment gets a
/// flag, see [`Status`](crate::Status).
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// Option that is out of its range.
    #[error("option {name} is {found}, must be {must}")]
    Option {
        /// Name of the option: the field of [`Options`](crate::Options).
        name: &'static str,
        /// Value that was given.
        found: String,
        /// Range of the option, in words.
        must: &'static str,
    },
    /// Integrator that a model file selects, and that stepper does not have.
    #[error("the source asks for {found}, which stepper does not have; choose ContactLaw::Mujoco and an integrator, or change the file")]
    SourceIntegrator {
        /// Name of the integrator in the file.
        found: String,
    },
    /// Simulation with zero environments.
    #[error("num_envs is 0, must be 1 or more, or None for a single environment")]
    NoEnvironments,
    /// Index of an environment that does not exist.
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
    /// List of environments that is not in ascending order.
    #[error("environment {env} comes after {before} in the list; name every environment once, in ascending order")]
    Order {
        /// Index of an environment that is not above the index before it.
        env: usize,
        /// Index of the environment before it in the list.
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
    /// List that does not have one entry for every element of the model.
    #[error("there are {found} {name}, must be {must}, one for every {element}")]
    Count {
        /// Name of the list.
        name: &'static str,
        /// Length of the list.
        found: usize,
        /// Number of elements of the model.
        must: usize,
        /// Kind of element, such as "actuator", for each of which the list must have one entry.
        element: &'static str,
    },
    /// Index of an element of the model that does not exist.
    #[error("{element} is {found}, must be below {count}")]
    Element {
        /// Kind of element, such as "body" or "site".
        element: &'static str,
        /// Index that was given.
        found: usize,
        /// Number of elements of that kind.
        count: usize,
    },
    /// Ray whose direction is zero or not finite.
    #[error("directions[{ray}] of environment {env} is {found:?}, must be a direction: finite, and not zero")]
    Direction {
        /// Index of the ray.
        ray: usize,
        /// Index of the environment.
        env: usize,
        /// Direction that was given.
        found: [f64; 3],
    },
    /// Geom of a ray query whose mesh or height field the model does not contain.
    #[error("geom {geom:?} is a {shape} whose form the model does not have, as nothing can touch it; leave it out of the geoms of rays")]
    NoForm {
        /// Name of the geom. A geom without a name has its index, such as "#3".
        geom: String,
        /// Name of the shape in MJCF.
        shape: &'static str,
    },
    /// Number that is not finite.
    #[error("{place} of environment {env} is {value}, must be finite")]
    NotFinite {
        /// Name of the array with the index, such as `qpos[3]`; or `time`.
        place: String,
        /// Index of the environment.
        env: usize,
        /// Value that was given: infinite or NaN.
        value: f64,
    },
    /// Number that is too large for a simulation with 32-bit numbers.
    #[error("{place} of environment {env} is {value:e}, must be at most {:e} in 32 bits", f32::MAX)]
    TooLarge {
        /// Name of the array with the index, such as `qpos[3]`.
        place: String,
        /// Index of the environment.
        env: usize,
        /// Value that was given.
        value: f64,
    },
    /// Parameter that is too large for a simulation with 32-bit numbers.
    #[error("{} has {value:e}, which 32 bits cannot hold; give a smaller number", parameter.name())]
    ParameterTooLarge {
        /// Name of the parameter.
        parameter: Parameter,
        /// Value that was given.
        value: f64,
    },
    /// Quaternion of zeros, or one whose length overflows.
    #[error(
        "qpos[{address}..{}] of environment {env}, the orientation of joint \"{joint}\", is {found:?}: its length is {norm}, must be above 0; (1, 0, 0, 0) is no rotation",
        address + 4
    )]
    Quaternion {
        /// Index of the environment.
        env: usize,
        /// Name of the joint. A joint without a name has its index, such as "#3".
        joint: String,
        /// Address of the quaternion in qpos.
        address: usize,
        /// Invalid quaternion (w, x, y, z).
        found: [f64; 4],
        /// Norm of the quaternion.
        norm: f64,
    },
    /// Positions of mocap bodies without orientations, or orientations without positions.
    #[error("mocap_pos and mocap_quat go together: give both or none")]
    MocapPoses,
    /// Array of a rollout or ray query in another precision than the simulation.
    #[error("the array for {name} is {found:?}, must be {must:?}")]
    ArrayPrecision {
        /// Name of the quantity.
        name: &'static str,
        /// Precision of the array.
        found: Precision,
        /// Precision of the simulation.
        must: Precision,
    },
    /// Bytes that are not a saved state, or are of another format version, cut off or damaged.
    #[error("not a state: {0}")]
    NotAState(String),
    /// Saved state of another model. The digests are from [`Model::digest`](crate::Model::digest).
    #[error(
        "this state belongs to another model, {}; this one is \"{name}\", {}: give a state of the same model",
        abbreviated(state),
        abbreviated(model)
    )]
    OtherModel {
        /// Digest of the model to which the state belongs.
        state: [u8; 32],
        /// Digest of this simulation's model.
        model: [u8; 32],
        /// Name of this simulation's model.
        name: String,
    },
    /// Saved state whose precision differs from the precision of the simulation.
    #[error("this state does not fit: it has numbers in {found:?}, this stepper in {must:?}")]
    StatePrecision {
        /// Precision of the state.
        found: Precision,
        /// Precision of the simulation.
        must: Precision,
    },
    /// Saved state of the same model that does not fit this simulation: another number of environments, other sensors or actuators, or
    /// damaged contents.
    #[error("this state does not fit: {0}")]
    StateMisfit(StateMisfit),
    /// Invalid error model of a sensor.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// Invalid actuator model.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// Actuator models, set while environments have per-environment parameters.
    #[error("environments have parameters of their own: give drives first, or take the parameters back")]
    DrivesAfterParameters,
    /// More environments than the memory can hold.
    #[error("{num_envs} environments of {bytes_per_env} bytes each are more than the memory here; make num_envs smaller")]
    Memory {
        /// Number of environments.
        num_envs: usize,
        /// Memory of each environment, bytes.
        bytes_per_env: usize,
    },
    /// Threads that the operating system refuses to start.
    #[error("{threads} threads cannot be started ({reason}); make threads smaller")]
    Threads {
        /// Number of requested threads, including the calling one.
        threads: usize,
        /// Reason from the operating system.
        reason: String,
    },
    /// Invalid CPU level in the environment variable `STEPPER_CPU_LEVEL`.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// Invalid model, or parameters that make a model invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Checks that the array `name` has the required length.
///
/// # Errors
/// [`Error::Length`] when it has another length.
pub fn check_length(name: &'static str, found: usize, must: usize) -> Result<(), Error> {
    if found == must { Ok(()) } else { Err(Error::Length { name, found, must, detail: String::new() }) }
}

/// Checks that the list `name` has one entry for every `element` of the model.
pub(crate) fn check_count(name: &'static str, found: usize, must: usize, element: &'static str) -> Result<(), Error> {
    if found == must { Ok(()) } else { Err(Error::Count { name, found, must, element }) }
}

/// Reason why a saved state does not fit a simulation of the same model and precision.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StateMisfit {
    /// Saved state that this version cannot read. The field is the reason from the decoder.
    #[error("not readable by this version of stepper, although its SHA-256 is right: {0}")]
    Unreadable(String),
    /// Saved state with surplus bytes at its end. The field is the number of these bytes.
    #[error("not readable by this version of stepper, although its SHA-256 is right: {0} bytes too many")]
    TooManyBytes(usize),
    /// Saved state with a number of environments that does not fit the simulation.
    #[error("a state of {found} environments, this simulation has {must}; give one of as many, or of one for all")]
    NumEnvs {
        /// Number of environments of the state.
        found: usize,
        /// Number of environments of the simulation.
        must: usize,
    },
    /// Saved state with arrays of other lengths: other sensors or actuators, or another contact capacity.
    #[error("a state with other sensors or actuators, or another max_contacts")]
    Shape,
    /// Saved state with a position, velocity, activation or time that is infinite or NaN.
    #[error("a number of qpos, qvel, act or time is not finite: the bytes are damaged")]
    NotFinite,
    /// Saved state with contacts of geoms that do not collide in this model.
    #[error("its contacts belong to no pair of this model: the bytes are damaged")]
    Contacts,
    /// Saved state with delay lines that are longer than those of this model.
    #[error("its delay lines have a sample that this model's do not: the bytes are damaged")]
    DelayLines,
}

/// Abbreviation of a digest: its first digits.
fn abbreviated(digest: &[u8; 32]) -> String {
    digest[..6].iter().map(|byte| format!("{byte:02x}")).collect()
}

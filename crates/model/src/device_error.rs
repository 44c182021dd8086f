//! What a sensor's error model or an actuator's dynamics cannot be.

use thiserror::Error;

/// An error model that a sensor cannot have.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("transfer of sensor {sensor:?}: {error}")]
pub struct SensorError {
    /// Name of the sensor.
    pub sensor: String,
    /// What is wrong with it.
    pub error: DeviceError,
}

/// Dynamics that an actuator cannot have.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("drive of actuator {actuator:?}: {error}")]
pub struct ActuatorError {
    /// Name of the actuator.
    pub actuator: String,
    /// What is wrong with them.
    pub error: DeviceError,
}

/// What is wrong with the transfer function of a sensor or the dynamics of an actuator. Names are those of the fields.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// A number out of its range.
    #[error("{name} is {found}, must be {must}")]
    Range {
        /// Name of the field.
        name: &'static str,
        /// The number.
        found: f64,
        /// Its range, in words.
        must: &'static str,
    },
    /// A list that has neither one number for all environments nor one for each.
    #[error("{name} has {found} numbers, must have 1, or {num_envs}, one for each environment")]
    Count {
        /// Name of the field.
        name: &'static str,
        /// Numbers of the list.
        found: usize,
        /// Number of environments.
        num_envs: usize,
    },
    /// Limits of which the lower is above the upper.
    #[error("limits are ({low}, {high}), must be (low, high)")]
    Limits {
        /// The lower one.
        low: f64,
        /// The upper one.
        high: f64,
    },
    /// A delay of more steps than a delay line may have samples.
    #[error("{name} {} {steps:.0} steps of {timestep} s, must be at most {longest} steps", if *.name == "delay" { "is" } else { "are" })]
    TooLong {
        /// Name of the field, or of both that add up.
        name: &'static str,
        /// The delay in steps.
        steps: f64,
        /// Time step, s.
        timestep: f64,
        /// Steps at the most.
        longest: f64,
    },
    /// A matrix of another shape than the reading's, or with a number that is none.
    #[error("scale is a matrix of {found} numbers, must be ({dim}, {dim}) and finite")]
    Matrix {
        /// Numbers that were given.
        found: usize,
        /// Numbers of the reading.
        dim: usize,
    },
    /// A scale of a reading that has a length of its own.
    #[error("scale and misalignment of a unit vector or quaternion mean nothing; give it bias, drift and noise, in rad")]
    ScaledDirection,
    /// A motor that is driven by its voltage, without the curve that says what a voltage does.
    #[error("a motor whose control is its voltage needs stall_torque and no_load_speed")]
    VoltageWithoutCurve,
    /// A servo on an actuator with activation dynamics.
    #[error("a servo cannot take the place of a law with activation dynamics of its own; leave the servo out")]
    ServoWithActivation,
    /// A servo on an actuator that has no length.
    #[error("a servo needs a length of its own to measure: that of a joint or a tendon, not of a site")]
    ServoOnSite,
    /// Losses of an actuator that does not drive a joint.
    #[error("friction and efficiency act on an actuator's joint, and this one is on a tendon or site; leave them out")]
    LossesWithoutJoint,
    /// A rotor whose inertia behind the gears is beyond every number.
    #[error("rotor_inertia {inertia} behind gears {gear:e} and {motor_gear:e} is not finite")]
    InfiniteInertia {
        /// Inertia of the rotor, kg m^2.
        inertia: f64,
        /// Gear of the actuator.
        gear: f64,
        /// Gear of the motor.
        motor_gear: f64,
    },
    /// A rotor of an actuator on a site.
    #[error("rotor_inertia cannot be reflected to a site; leave it out")]
    RotorOnSite,
    /// Dynamics for an actuator that was made without.
    #[error(
        "the simulation was made without one; stages are compiled: give it to Simulation::set_actuator_models, if only to one environment"
    )]
    MadeWithoutDynamics,
    /// A stage that an actuator was made without.
    #[error(
        "{name} is given, and it was made without; stages are compiled: give it to Simulation::set_actuator_models, if only to one environment"
    )]
    MadeWithout {
        /// Name of the field.
        name: &'static str,
    },
    /// A stage that an actuator was made with and that is missing here.
    #[error("{name} is not given, and it was made with one; give it here too")]
    MadeWith {
        /// Name of the field.
        name: &'static str,
    },
    /// A property that all environments share, with another value.
    #[error("{name} is {found}, must be {must}, which all environments share; make a simulation with it")]
    Shared {
        /// Name of the field.
        name: &'static str,
        /// The value that was given.
        found: String,
        /// The value that the simulation was made with.
        must: String,
    },
    /// A delay that is longer than the line that the simulation was made with.
    #[error(
        "delay is up to {longest} steps of {timestep} s, and its line has room for {room}; give Simulation::set_actuator_models the longest delay \
         there will be, if only to one environment"
    )]
    LineTooShort {
        /// Longest delay in steps.
        longest: usize,
        /// Steps that the line has room for.
        room: usize,
        /// Time step, s.
        timestep: f64,
    },
}

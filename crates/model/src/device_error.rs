//! Errors in the error model of a sensor or the dynamics of an actuator.

use thiserror::Error;

/// Invalid error model of a sensor.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("transfer of sensor {sensor:?}: {error}")]
pub struct SensorError {
    /// Name of the sensor.
    pub sensor: String,
    /// Reason.
    pub error: DeviceError,
}

/// Invalid dynamics of an actuator.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("drive of actuator {actuator:?}: {error}")]
pub struct ActuatorError {
    /// Name of the actuator.
    pub actuator: String,
    /// Reason.
    pub error: DeviceError,
}

/// Reason why the transfer function of a sensor or the dynamics of an actuator is invalid. Names are those of the fields.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// Number out of range.
    #[error("{name} is {found}, must be {must}")]
    Range {
        /// Name of the field.
        name: &'static str,
        /// Value of the number.
        found: f64,
        /// Allowed range, in words.
        must: &'static str,
    },
    /// List that has neither one number for all environments nor one for each.
    #[error("{name} has {found} numbers, must have 1, or {num_envs}, one for each environment")]
    Count {
        /// Name of the field.
        name: &'static str,
        /// Length of the list.
        found: usize,
        /// Number of environments.
        num_envs: usize,
    },
    /// Limits whose lower value is above the upper one.
    #[error("limits are ({low}, {high}), must be (low, high)")]
    Limits {
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// Delay that is longer than the largest delay line.
    #[error("{name} {} {steps:.0} steps of {timestep} s, must be at most {longest} steps", if *.name == "delay" { "is" } else { "are" })]
    TooLong {
        /// Name of the field, or of both fields whose sum is the delay.
        name: &'static str,
        /// Delay in steps.
        steps: f64,
        /// Time step, s.
        timestep: f64,
        /// Largest number of steps.
        longest: f64,
    },
    /// Matrix with another shape than that of the reading, or with a number that is not finite.
    #[error("scale is a matrix of {found} numbers, must be ({dim}, {dim}) and finite")]
    Matrix {
        /// Number of given numbers.
        found: usize,
        /// Dimension of the reading.
        dim: usize,
    },
    /// Scale of a reading whose norm is 1.
    #[error("scale and misalignment of a unit vector or quaternion mean nothing; give it bias, drift and noise, in rad")]
    ScaledDirection,
    /// Motor with the voltage as control, but without a torque-speed curve.
    #[error("a motor whose control is its voltage needs stall_torque and no_load_speed")]
    VoltageWithoutCurve,
    /// Servo on an actuator with activation dynamics.
    #[error("a servo cannot take the place of a law with activation dynamics of its own; leave the servo out")]
    ServoWithActivation,
    /// Servo on an actuator without a length.
    #[error("a servo needs a length of its own to measure: that of a joint or a tendon, not of a site")]
    ServoOnSite,
    /// Losses of an actuator that does not act on a joint.
    #[error("friction and efficiency act on an actuator's joint, and this one is on a tendon or site; leave them out")]
    LossesWithoutJoint,
    /// Rotor whose inertia behind the gears is not finite.
    #[error("rotor_inertia {inertia} behind gears {gear:e} and {motor_gear:e} is not finite")]
    InfiniteInertia {
        /// Inertia of the rotor, kg m^2.
        inertia: f64,
        /// Gear of the actuator.
        gear: f64,
        /// Gear of the motor.
        motor_gear: f64,
    },
    /// Rotor of an actuator on a site.
    #[error("rotor_inertia cannot be reflected to a site; leave it out")]
    RotorOnSite,
    /// Dynamics for an actuator that was created without dynamics.
    #[error(
        "the simulation was made without one; stages are compiled: give it to Simulation::set_actuator_models, if only to one environment"
    )]
    MadeWithoutDynamics,
    /// Stage for an actuator that was created without this stage.
    #[error(
        "{name} is given, and it was made without; stages are compiled: give it to Simulation::set_actuator_models, if only to one environment"
    )]
    MadeWithout {
        /// Name of the field.
        name: &'static str,
    },
    /// Missing stage of an actuator that was created with this stage.
    #[error("{name} is not given, and it was made with one; give it here too")]
    MadeWith {
        /// Name of the field.
        name: &'static str,
    },
    /// Property that all environments share, with another value.
    #[error("{name} is {found}, must be {must}, which all environments share; make a simulation with it")]
    Shared {
        /// Name of the field.
        name: &'static str,
        /// Given value.
        found: String,
        /// Value with which the simulation was created.
        must: String,
    },
    /// Delay that is longer than the delay line of the simulation.
    #[error(
        "delay is up to {longest} steps of {timestep} s, and its line has room for {room}; give Simulation::set_actuator_models the longest delay \
         there will be, if only to one environment"
    )]
    LineTooShort {
        /// Longest delay in steps.
        longest: usize,
        /// Length of the delay line in steps.
        room: usize,
        /// Time step, s.
        timestep: f64,
    },
}

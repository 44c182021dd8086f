//! Errors for invalid error models of sensors, and for invalid actuator models.

use thiserror::Error;

/// Error for an invalid error model of a sensor.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("transfer of sensor {sensor:?}: {error}")]
pub struct SensorError {
    /// Name of the sensor.
    pub sensor: String,
    /// Reason why the error model is invalid.
    pub error: DeviceError,
}

/// Error for an invalid actuator model: the delay, servo, lag, motor, limits and friction of an actuator.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("drive of actuator {actuator:?}: {error}")]
pub struct ActuatorError {
    /// Name of the actuator.
    pub actuator: String,
    /// Reason why the actuator model is invalid.
    pub error: DeviceError,
}

/// Reason why the error model of a sensor or an actuator model is invalid. The `name` in a variant is the name of the invalid field.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// Value out of its range.
    #[error("{name} is {found}, must be {must}")]
    Range {
        /// Name of the invalid field, such as "delay".
        name: &'static str,
        /// Value that was given.
        found: f64,
        /// Allowed range, in words.
        must: &'static str,
    },
    /// List whose length is neither 1, for a value that all environments share, nor the number of environments.
    #[error("{name} has {found} numbers, must have 1, or {num_envs}, one for each environment")]
    Count {
        /// Name of the invalid field, such as "delay".
        name: &'static str,
        /// Length of the list.
        found: usize,
        /// Number of environments.
        num_envs: usize,
    },
    /// Limits whose lower value is above their upper value.
    #[error("limits are ({low}, {high}), must be (low, high) with low at most high")]
    Limits {
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// Delay that is longer than allowed.
    #[error("{name} {} {steps:.0} steps of {timestep} s, must be at most {longest} steps", if *.name == "delay" { "is" } else { "are" })]
    TooLong {
        /// Name of the field, "delay", or of two fields whose sum is the delay: "delay and jitter".
        name: &'static str,
        /// Delay in steps.
        steps: f64,
        /// Time step, s.
        timestep: f64,
        /// Largest number of steps that is allowed.
        longest: f64,
    },
    /// Scale matrix of another shape than (dim, dim), or with a value that is not finite.
    #[error("scale is a matrix of {found} numbers, must be ({dim}, {dim}) and finite")]
    Matrix {
        /// Number of values that were given.
        found: usize,
        /// Number of values in the sensor's reading.
        dim: usize,
    },
    /// Error model with a scale or misalignment for a sensor that reads a unit vector or quaternion, whose norm must remain 1.
    #[error(
        "scale and misalignment are set, but the sensor reads a unit vector or quaternion, whose length is 1; use bias, drift and noise, in rad"
    )]
    ScaledDirection,
    /// Motor whose control is its voltage, but without a torque-speed curve.
    #[error("the motor has control=\"voltage\", which needs stall_torque and no_load_speed; give both, or control=\"torque\"")]
    VoltageWithoutCurve,
    /// Servo on an actuator with activation dynamics.
    #[error("servo is set, but the actuator has activation dynamics (dyntype), which a servo cannot replace; leave the servo out")]
    ServoWithActivation,
    /// Servo of an actuator on a site, which has no length that the servo could measure.
    #[error("servo is set, but the actuator acts on a site, which has no length to measure; use an actuator on a joint or tendon")]
    ServoOnSite,
    /// Dry friction or gear losses of an actuator that does not act on a joint.
    #[error(
        "friction, stribeck_friction or efficiency is set, but the actuator acts on a tendon or site, and they need a joint; leave them out"
    )]
    LossesWithoutJoint,
    /// Friction that decreases with the speed, without the speed at which it does.
    #[error("stribeck_velocity is {found}, must be at least 1e-9 with stribeck_friction: the speed at which that has decreased to 1/e")]
    StribeckVelocity {
        /// Given speed.
        found: f64,
    },
    /// Rotor inertia that is not finite after multiplication by the squared gears.
    #[error("rotor_inertia {inertia} times the squared gears {gear:e} and {motor_gear:e} is not finite; give smaller gears")]
    InfiniteInertia {
        /// Inertia of the rotor, kg m^2.
        inertia: f64,
        /// Gear of the actuator.
        gear: f64,
        /// Gear of the motor.
        motor_gear: f64,
    },
    /// Rotor inertia of an actuator on a site.
    #[error("rotor_inertia is set, but the actuator acts on a site, which has no inertia of a joint; leave rotor_inertia out")]
    RotorOnSite,
    /// Actuator model for an actuator that had no actuator model when the simulation was created.
    #[error(
        "the simulation was created without a drive for this actuator; give one to Simulation::set_actuator_models, at least in one environment"
    )]
    MadeWithoutDynamics,
    /// Actuator model with a component, such as a lag, that the actuator did not have when the simulation was created.
    #[error(
        "{name} is given, but the simulation was created without {name}; give {name} to Simulation::set_actuator_models, at least in one environment"
    )]
    MadeWithout {
        /// Name of the component's field, such as "lag".
        name: &'static str,
    },
    /// Actuator model without a component, such as a lag, that the actuator had when the simulation was created.
    #[error("{name} is missing, but the simulation was created with {name}; give {name} here too")]
    MadeWith {
        /// Name of the component's field, such as "lag".
        name: &'static str,
    },
    /// Changed value of a property that must be equal in all environments.
    #[error("{name} is {found}, must be {must}, because all environments share it; create a simulation with the new value")]
    Shared {
        /// Name of the invalid field, such as "delay".
        name: &'static str,
        /// Value that was given.
        found: String,
        /// Value with which the simulation was created.
        must: String,
    },
    /// Delay that is longer than the simulation's delay line, the buffer of past values. Its length is fixed when the simulation is
    /// created.
    #[error(
        "delay is up to {longest} steps of {timestep} s, and its delay line holds {capacity} steps; give Simulation::set_actuator_models the longest delay \
         there will be, if only to one environment"
    )]
    LineTooShort {
        /// Longest delay that was given, in steps.
        longest: usize,
        /// Length of the simulation's delay line, the buffer of past values, in steps.
        capacity: usize,
        /// Time step, s.
        timestep: f64,
    },
}

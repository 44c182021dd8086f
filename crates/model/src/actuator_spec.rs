//! Actuator models: delay, lag, servo, motor, force limits and friction. Also checks of actuator models, and their effects on the model.

use serde::{Deserialize, Serialize};

use crate::{Activation, Actuator, ActuatorError, Description, DeviceError, ForceModel, Model, Transmission};

/// Model of an actuator between its control and its force. Each list has one value for all environments, or one for each environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSpec {
    /// Delay of the control, s.
    pub delay: Vec<f64>,
    /// Additional delay of the control, in steps.
    pub delay_steps: Vec<f64>,
    /// Time constant of the first-order lag between control and force, s; 0 means no lag.
    pub lag: Vec<f64>,
    /// Lowest force of the actuator, N or N m; -infinity for no limit.
    pub low: Vec<f64>,
    /// Highest force of the actuator, N or N m; infinity for no limit.
    pub high: Vec<f64>,
    /// Dry friction, N or N m. The friction at the joint is this value times the absolute value of the actuator's gear.
    pub friction: Vec<f64>,
    /// Additional dry friction at rest, N or N m. It decreases with the speed.
    pub stribeck_friction: Vec<f64>,
    /// Speed on the actuator's side of its gear at which the additional dry friction has decreased to 1/e, m/s or rad/s.
    pub stribeck_velocity: Vec<f64>,
    /// Servo that replaces the actuator's affine force; `None` keeps the affine force.
    pub servo: Option<Servo>,
    /// Motor with its gear; `None` for an ideal motor.
    pub motor: Option<Motor>,
}

/// PID servo. The control is the target of the actuator's length: joint position or tendon length, times the actuator's `gear`.
///
/// For a motor with voltage control, the output of the servo is a fraction of the nominal voltage. Gains then have 1 in place of N or N m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// Proportional gain, N or N m per unit of length.
    pub kp: Vec<f64>,
    /// Integral gain, N or N m per unit of length and per second.
    pub ki: Vec<f64>,
    /// Derivative gain, N or N m per unit of velocity.
    pub kd: Vec<f64>,
    /// Largest force of the integral term, N or N m; may be infinite.
    pub integral_limit: Vec<f64>,
    /// Sampling period of the servo, s. The list is empty for a continuous servo.
    pub period: Vec<f64>,
}

/// DC motor that drives the actuator through a gear. Torques, speed and inertia are those of the motor shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Stall torque at nominal voltage, N m. The list is empty for a motor without a torque-speed curve.
    pub stall_torque: Vec<f64>,
    /// No-load speed at nominal voltage, rad/s.
    pub no_load_speed: Vec<f64>,
    /// Inertia of the rotor, kg m^2.
    pub rotor_inertia: f64,
    /// Gear ratio: rotation of the shaft per unit of the actuator's length, rad per unit.
    pub gear: f64,
    /// Efficiency of the gear: fraction of the power that it transmits.
    pub efficiency: Vec<f64>,
    /// Whether the input of the motor is a fraction of the nominal voltage, from -1 to 1. Otherwise the input is the actuator's force.
    pub voltage: bool,
}

/// Smallest allowed speed at which additional friction has decreased to 1/e. Numbers of 32 bits can divide by its square.
const LEAST_STRIBECK_VELOCITY: f64 = 1e-9;

/// Longest allowed delay of an actuator, in steps.
const LONGEST: f64 = 100_000.0;

/// Whether any of the numbers is nonzero.
pub fn any_nonzero(numbers: &[f64]) -> bool {
    numbers.iter().any(|&x| x != 0.0)
}

impl Actuator {
    /// Delay of the control in steps of `h` seconds.
    fn delay_in_steps(&self, h: f64) -> f64 {
        let steps = self.delay / h;
        let near = steps.round();
        // A delay that is an integer number of steps within rounding becomes that integer.
        if (steps - near).abs() < 1e-9 * (1.0 + near) {
            near
        } else if self.delay_holds {
            steps.ceil()
        } else {
            steps
        }
    }
}

impl ActuatorSpec {
    /// Spec of an ideal actuator: the control passes unchanged.
    pub fn ideal() -> Self {
        let [none, low, high] = [0.0, f64::NEG_INFINITY, f64::INFINITY].map(|x| vec![x]);
        let (delay, delay_steps, lag, friction) = (none.clone(), none.clone(), none.clone(), none.clone());
        let (stribeck_friction, stribeck_velocity) = (none.clone(), none);
        Self { delay, delay_steps, lag, low, high, friction, stribeck_friction, stribeck_velocity, servo: None, motor: None }
    }

    /// Delay of the control in environment `env`, in steps of `h` seconds.
    pub fn steps(&self, env: usize, h: f64) -> f64 {
        let of = |x: &[f64]| x[env % x.len()];
        of(&self.delay) / h + of(&self.delay_steps)
    }

    /// Longest delay of all environments, rounded up to whole steps of `h` seconds.
    pub fn longest(&self, num_envs: usize, h: f64) -> usize {
        (0..num_envs).map(|env| self.steps(env, h)).fold(0.0, f64::max).ceil() as usize
    }

    /// Whether the actuator has a continuous servo: one without a sampling period.
    pub fn is_continuous_servo(&self) -> bool {
        self.servo.as_ref().is_some_and(|s| s.period.is_empty())
    }

    /// For a motor with a torque-speed curve: whether the motor's input is a voltage ([`Motor::voltage`]). The result is `None` for
    /// actuators without such a motor.
    pub fn curve(&self) -> Option<bool> {
        self.motor.as_ref().filter(|m| !m.stall_torque.is_empty()).map(|m| m.voltage)
    }

    /// Whether the actuator's force has limits, in any environment.
    pub fn is_limited(&self) -> bool {
        self.low.iter().chain(&self.high).any(|x| x.is_finite())
    }

    /// Whether the control acts on later steps too: through a delay, a lag, a sampled servo, or the integral of a servo.
    pub fn has_memory(&self) -> bool {
        let servo_has_memory = self.servo.as_ref().is_some_and(|s| !s.period.is_empty() || any_nonzero(&s.ki));
        servo_has_memory || [&self.delay, &self.delay_steps, &self.lag].into_iter().any(|numbers| any_nonzero(numbers))
    }

    /// Whether dry friction or the gear's efficiency causes losses.
    pub fn loses(&self) -> bool {
        let is_dry = any_nonzero(&self.friction) || any_nonzero(&self.stribeck_friction);
        is_dry || self.motor.as_ref().is_some_and(|m| m.efficiency.iter().any(|&e| e != 1.0))
    }

    /// Combines a model with the specs of its actuators. `specs` has one entry for each actuator, where `None` means an ideal actuator.
    /// Returns the changed model and the changed specs.
    ///
    /// Rotor inertia is added to the armature in the model, and servos replace affine forces of the model. Delays of the model are added to
    /// the delays of the specs; they stay in the changed model too. Force limits of the model's actuator move to a spec that has a
    /// servo, a torque-speed curve or force limits. `num_envs` is the number of environments, `h` the time step, s.
    ///
    /// # Errors
    /// For the first value out of range, and for the first part of a spec that the actuator cannot have, such as a servo on a site. The
    /// error has the actuator's name.
    pub fn combine(model: &Model, specs: &[Option<Self>], num_envs: usize, h: f64) -> Result<(Model, Vec<Option<Self>>), ActuatorError> {
        let (mut combined, mut specs) = (model.clone(), specs.to_vec());
        let model = &mut combined.description;
        for (i, spec) in specs.iter_mut().enumerate() {
            *spec = spec.take().filter(|t| *t != Self::ideal());
            let steps = model.actuators[i].delay_in_steps(h);
            if steps > 0.0 {
                spec.get_or_insert_with(Self::ideal).delay_steps.iter_mut().for_each(|x| *x += steps);
            }
            let Some(spec) = spec else { continue };
            let actuator = model.actuator_label(i);
            spec.check(num_envs, h).and_then(|()| spec.apply_to(model, i)).map_err(|error| ActuatorError { actuator, error })?;
        }
        Ok((combined, specs))
    }

    /// Applies the spec to actuator `i` of the model. If the spec has a servo, a torque-speed curve or force limits, the force limits of
    /// the model's actuator move to the spec.
    fn apply_to(&mut self, model: &mut Description, i: usize) -> Result<(), DeviceError> {
        let actuator = &mut model.actuators[i];
        if self.servo.is_some() {
            if actuator.activation != Activation::None {
                return Err(DeviceError::ServoWithActivation);
            }
            if !matches!(actuator.transmission, Transmission::Joint(_) | Transmission::Tendon(_)) {
                return Err(DeviceError::ServoOnSite);
            }
            (actuator.gain, actuator.bias, actuator.ctrl_range) = ([1.0, 0.0, 0.0], [0.0; 3], None);
            actuator.force_model = ForceModel::default();
        }
        let bounded = self.servo.is_some() || self.curve().is_some() || self.is_limited();
        if let Some([low, high]) = actuator.force_range.filter(|_| bounded) {
            self.narrow([low, high]);
            actuator.force_range = None;
        }
        if self.loses() && !matches!(actuator.transmission, Transmission::Joint(_)) {
            return Err(DeviceError::LossesWithoutJoint);
        }
        let Some(motor) = self.motor.as_ref().filter(|m| m.rotor_inertia > 0.0) else { return Ok(()) };
        let reflected = (actuator.gear * motor.gear).powi(2) * motor.rotor_inertia;
        if !reflected.is_finite() {
            return Err(DeviceError::InfiniteInertia { inertia: motor.rotor_inertia, gear: actuator.gear, motor_gear: motor.gear });
        }
        match actuator.transmission {
            Transmission::Joint(j) => model.joints[j].armature += reflected,
            Transmission::Tendon(t) => model.tendons[t].armature += reflected,
            _ => return Err(DeviceError::RotorOnSite),
        }
        Ok(())
    }

    /// Narrows the force limits `low` and `high` of all environments to the given range.
    pub fn narrow(&mut self, [low, high]: [f64; 2]) {
        self.low.iter_mut().for_each(|x| *x = x.max(low));
        self.high.iter_mut().for_each(|x| *x = x.min(high));
    }

    fn check(&self, num_envs: usize, h: f64) -> Result<(), DeviceError> {
        use Range::*;
        let mut lists: Vec<(&'static str, &[f64], Range)> = vec![
            ("delay", &self.delay, FiniteAtLeastZero),
            ("delay_steps", &self.delay_steps, FiniteAtLeastZero),
            ("lag", &self.lag, FiniteAtLeastZero),
            ("limits", &self.low, Any),
            ("limits", &self.high, Any),
            ("friction", &self.friction, FiniteAtLeastZero),
            ("stribeck_friction", &self.stribeck_friction, FiniteAtLeastZero),
            ("stribeck_velocity", &self.stribeck_velocity, FiniteAtLeastZero),
        ];
        if let Some(s) = &self.servo {
            lists.extend([("kp", &s.kp[..], FiniteAtLeastZero), ("ki", &s.ki, FiniteAtLeastZero), ("kd", &s.kd, FiniteAtLeastZero)]);
            lists.push(("integral_limit", &s.integral_limit, AtLeastZero));
            lists.extend((!s.period.is_empty()).then_some(("period", &s.period[..], Positive)));
        }
        if let Some(m) = &self.motor {
            lists.push(("efficiency", &m.efficiency, Share));
            if !m.stall_torque.is_empty() {
                lists.extend([("stall_torque", &m.stall_torque[..], Positive), ("no_load_speed", &m.no_load_speed, Positive)]);
            } else if m.voltage {
                return Err(DeviceError::VoltageWithoutCurve);
            }
            FiniteAtLeastZero.check("rotor_inertia", &[m.rotor_inertia])?;
            Positive.check("gear", &[m.gear])?;
        }
        for (name, x, range) in lists {
            if x.len() != 1 && x.len() != num_envs {
                return Err(DeviceError::Count { name, found: x.len(), num_envs });
            }
            range.check(name, x)?;
        }
        let each = |x: &[f64], env: usize| x[env % x.len()];
        for env in 0..num_envs {
            let (low, high) = (each(&self.low, env), each(&self.high, env));
            if low > high {
                return Err(DeviceError::Limits { low, high });
            }
            let found = each(&self.stribeck_velocity, env);
            if each(&self.stribeck_friction, env) > 0.0 && found < LEAST_STRIBECK_VELOCITY {
                return Err(DeviceError::StribeckVelocity { found });
            }
            let steps = self.steps(env, h);
            if steps > LONGEST {
                return Err(DeviceError::TooLong { name: "delay", steps, timestep: h, longest: LONGEST });
            }
        }
        Ok(())
    }
}

/// Allowed range of a value.
#[derive(Clone, Copy)]
enum Range {
    Any,
    /// At least 0, or infinite.
    AtLeastZero,
    FiniteAtLeastZero,
    Positive,
    /// Above 0, and at most 1.
    Share,
}

impl Range {
    fn check(self, name: &'static str, x: &[f64]) -> Result<(), DeviceError> {
        let (fits, must): (fn(f64) -> bool, _) = match self {
            Self::Any => (|x| !x.is_nan(), "a number"),
            Self::AtLeastZero => (|x| x >= 0.0, "a number of at least 0"),
            Self::FiniteAtLeastZero => (|x| x >= 0.0 && x.is_finite(), "a finite number of at least 0"),
            Self::Positive => (|x| x > 0.0 && x.is_finite(), "a finite number above 0"),
            Self::Share => (|x| x > 0.0 && x <= 1.0, "a number above 0 and at most 1"),
        };
        x.iter().find(|&&x| !fits(x)).map_or(Ok(()), |x| Err(DeviceError::Range { name, found: *x, must }))
    }
}

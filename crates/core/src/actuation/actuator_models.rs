//! Actuator models of a simulation, whose parameters can differ between environments and can be changed.
//!
//! A spec ([`ActuatorSpec`]) describes the components of one actuator, such as servo, lag and limits. Most parameters of the components can
//! change after compilation, but not the gear, the rotor inertia and the control of a motor. Components cannot be added, and delay lines
//! cannot become longer (`check_fit`).

use crate::model::actuator_spec::{ActuatorSpec, any_nonzero};
use crate::model::{ActuatorError, DeviceError, Model};

/// Actuator models of a simulation: specs as the user gave them, and per-environment specs.
#[derive(Clone, Debug)]
pub struct ActuatorModels {
    /// Model with the effects of the actuator models: armature of rotors, and forces of servos. Force limits that moved to
    /// `specs` are absent.
    pub model: Model,
    /// Actuator specs in the form that the simulation compiles, with the delays and force limits of the model's actuators.
    pub specs: Vec<Option<ActuatorSpec>>,
    /// Actuator specs as the user gave them, and ideal specs for actuators that have only a delay in the model. `None` for actuators
    /// without an actuator model.
    originals: Vec<Option<ActuatorSpec>>,
    /// Specs with the parameters of all environments. `None` until parameters change, and after a call that restores all environments.
    pub per_env: Option<Vec<Option<ActuatorSpec>>>,
}

/// Checked new parameters of actuator models for some environments.
#[derive(Clone, Debug)]
pub struct ActuatorUpdate {
    /// Environments that get the parameters.
    pub envs: Vec<usize>,
    /// Actuator specs of these environments alone, with the delays and force limits of the model's actuators. `None` leaves an actuator
    /// unchanged.
    pub specs: Vec<Option<ActuatorSpec>>,
    /// New value of [`ActuatorModels::per_env`].
    pub per_env: Option<Vec<Option<ActuatorSpec>>>,
}

impl ActuatorModels {
    /// Creates the actuator models of a simulation; see [`ActuatorSpec::combine`].
    ///
    /// `given` has the spec of each actuator, or `None` for an actuator without an actuator model. `h` is the time step, s.
    ///
    /// # Errors
    /// As [`ActuatorSpec::combine`].
    pub fn new(model: &Model, given: &[Option<ActuatorSpec>], num_envs: usize, h: f64) -> Result<Self, ActuatorError> {
        let (combined, specs) = ActuatorSpec::combine(model, given, num_envs, h)?;
        let made =
            specs.iter().zip(given).map(|(spec, given)| Some(given.clone().unwrap_or_else(ActuatorSpec::ideal)).filter(|_| spec.is_some()));
        Ok(Self { model: combined, originals: made.collect(), specs, per_env: None })
    }

    /// Memory of the specs, bytes.
    pub fn bytes(&self) -> usize {
        let mut per_env = self.per_env.clone();
        per_env.iter_mut().flatten().flatten().flat_map(numbers).map(|x| size_of_val(&x[..])).sum()
    }

    /// Computes new parameters of actuator models for the environments `envs`, and checks them. This object does not change.
    ///
    /// `given` has one entry for every actuator; each list has one value, or one for each of `envs`. `None` as an entry leaves an
    /// actuator unchanged. `None` for `given` restores the original parameters.
    ///
    /// # Errors
    /// A number out of its range or an unsupported setting, with the actuator's name.
    pub fn prepare_update(
        &self,
        model: &Model,
        given: Option<&[Option<ActuatorSpec>]>,
        envs: &[usize],
        num_envs: usize,
        h: f64,
    ) -> Result<ActuatorUpdate, ActuatorError> {
        if envs.is_empty() || (given.is_none() && self.per_env.is_none()) {
            return Ok(ActuatorUpdate { envs: vec![], specs: vec![None; self.originals.len()], per_env: self.per_env.clone() });
        }
        let originals_of_envs = || self.originals.iter().map(|spec| spec.as_ref().map(|spec| of_environments(spec, envs))).collect();
        let mut specs = given.map_or_else(originals_of_envs, <[_]>::to_vec);
        let wrong = |i: usize, error| ActuatorError { actuator: model.actuator_label(i), error };
        let mut per_env = self.per_env.as_ref().unwrap_or(&self.originals).clone();
        let (combined, mut new) = ActuatorSpec::combine(model, &specs, envs.len(), h)?;
        for (i, (spec, given)) in new.iter_mut().zip(&mut specs).enumerate() {
            let Some(given) = given else {
                *spec = None;
                continue;
            };
            match (&self.specs[i], &mut per_env[i]) {
                (Some(compiled), Some(own)) => {
                    let spec = spec.get_or_insert_with(ActuatorSpec::ideal);
                    // The compiled actuator has no force range, because the compiled spec contains it. For a new spec without limits,
                    // `combine` leaves the range in the model, so that the spec gets it here.
                    if let (Some(range), None) = (combined.actuators[i].force_range, self.model.actuators[i].force_range) {
                        spec.narrow(range);
                    }
                    check_fit(spec, compiled, envs.len(), num_envs, h).map_err(|error| wrong(i, error))?;
                    assign(own, given, envs, num_envs);
                }
                _ if spec.is_none() => {}
                _ => return Err(wrong(i, DeviceError::MadeWithoutDynamics)),
            }
        }
        Ok(ActuatorUpdate { envs: envs.to_vec(), specs: new, per_env: Some(per_env).filter(|_| given.is_some() || envs.len() < num_envs) })
    }
}

/// All parameter lists of the spec, in an order that depends only on its components.
fn numbers(spec: &mut ActuatorSpec) -> Vec<&mut Vec<f64>> {
    let mut all = vec![&mut spec.delay, &mut spec.delay_steps, &mut spec.lag, &mut spec.low, &mut spec.high];
    all.extend([&mut spec.friction, &mut spec.stribeck_friction, &mut spec.stribeck_velocity]);
    if let Some(s) = &mut spec.servo {
        all.extend([&mut s.kp, &mut s.ki, &mut s.kd, &mut s.integral_limit, &mut s.period]);
    }
    if let Some(m) = &mut spec.motor {
        all.extend([&mut m.stall_torque, &mut m.no_load_speed, &mut m.efficiency]);
    }
    all
}

/// Spec with the parameters of only the environments `envs`.
fn of_environments(spec: &ActuatorSpec, envs: &[usize]) -> ActuatorSpec {
    let mut own = spec.clone();
    for x in numbers(&mut own).into_iter().filter(|x| x.len() > 1) {
        *x = envs.iter().map(|&env| x[env]).collect();
    }
    own
}

/// Copies the parameters of `given`, a spec with the same components, to the environments `envs`. Each list of `given` has one value for
/// all these environments, or one value for each.
fn assign(spec: &mut ActuatorSpec, given: &mut ActuatorSpec, envs: &[usize], num_envs: usize) {
    for (own, given) in numbers(spec).into_iter().zip(numbers(given)) {
        if given.is_empty() || (given.len() == 1 && *own == *given) {
            continue;
        }
        if given.len() == 1 && envs.len() == num_envs {
            own.clone_from(given);
            continue;
        }
        if own.len() == 1 {
            *own = own.repeat(num_envs);
        }
        envs.iter().enumerate().for_each(|(k, &env)| own[env] = given[k % given.len()]);
    }
}

/// Checks that an actuator which was compiled with the spec `compiled` can have the new parameters `spec` in `n` of the `num_envs`
/// environments. `h` is the time step, s.
///
/// Servo, sampling period, motor and torque-speed curve must exist in both specs or in neither. Gear, rotor inertia and control of the
/// motor must be equal. Lag, limits and losses of the new spec must exist in the compiled one, and the new delays must not be longer.
fn check_fit(spec: &ActuatorSpec, compiled: &ActuatorSpec, n: usize, num_envs: usize, h: f64) -> Result<(), DeviceError> {
    let sampled = |t: &ActuatorSpec| t.servo.as_ref().is_some_and(|s| !s.period.is_empty());
    for (name, here, there) in [
        ("servo", spec.servo.is_some(), compiled.servo.is_some()),
        ("motor", spec.motor.is_some(), compiled.motor.is_some()),
        ("period", sampled(spec), sampled(compiled)),
        ("stall_torque", spec.curve().is_some(), compiled.curve().is_some()),
    ] {
        match (here, there) {
            (true, false) => return Err(DeviceError::MadeWithout { name }),
            (false, true) => return Err(DeviceError::MadeWith { name }),
            _ => {}
        }
    }
    if let (Some(own), Some(compiled)) = (&spec.motor, &compiled.motor) {
        let control = |voltage: bool| if voltage { "\"voltage\"" } else { "\"torque\"" }.to_owned();
        for (name, here, there) in [
            ("control", control(own.voltage), control(compiled.voltage)),
            ("gear", own.gear.to_string(), compiled.gear.to_string()),
            ("rotor_inertia", own.rotor_inertia.to_string(), compiled.rotor_inertia.to_string()),
        ] {
            if here != there {
                return Err(DeviceError::Shared { name, found: here, must: there });
            }
        }
    }
    let friction = match (any_nonzero(&spec.friction), any_nonzero(&spec.stribeck_friction)) {
        (true, _) => "friction",
        (false, true) => "stribeck_friction",
        (false, false) => "efficiency",
    };
    for (name, here, there) in [
        ("lag", any_nonzero(&spec.lag), any_nonzero(&compiled.lag)),
        ("limits", spec.is_limited(), compiled.is_limited()),
        (friction, spec.loses(), compiled.loses()),
    ] {
        if here && !there {
            return Err(DeviceError::MadeWithout { name });
        }
    }
    let (longest, capacity) = (spec.longest(n, h), compiled.longest(num_envs, h));
    if longest > capacity {
        return Err(DeviceError::LineTooShort { longest, capacity, timestep: h });
    }
    Ok(())
}

//! An actuator.

use super::super::{Activation, Actuator, Model, ModelError, Transmission};
use super::{find, find_joint};

/// An actuator on a joint or tendon, by name.
#[derive(Clone, Debug)]
pub struct ActuatorBuilder {
    pub(super) actuator: Actuator,
    target: String,
    on_tendon: bool,
}

impl ActuatorBuilder {
    fn new(name: &str, target: &str, gain: [f64; 3], bias: [f64; 3]) -> Self {
        let actuator = Actuator {
            name: name.into(),
            transmission: Transmission::Joint(0),
            gear: 1.0,
            ctrl_range: None,
            force_range: None,
            act_range: None,
            activation: Activation::None,
            gain,
            bias,
        };
        Self { actuator, target: target.into(), on_tendon: false }
    }

    /// The control is the force (N, N m) on a joint, by name.
    pub fn motor(name: &str, joint: &str) -> Self {
        Self::new(name, joint, [1.0, 0.0, 0.0], [0.0; 3])
    }

    /// The control is a position that a spring (N/m, N m/rad) and a damper (N s/m, N m s/rad) pull a joint to.
    pub fn position(name: &str, joint: &str, kp: f64, kv: f64) -> Self {
        Self::new(name, joint, [kp, 0.0, 0.0], [0.0, -kp, -kv])
    }

    /// The control is a velocity that a damper (N s/m, N m s/rad) pulls a joint to.
    pub fn velocity(name: &str, joint: &str, kv: f64) -> Self {
        Self::new(name, joint, [kv, 0.0, 0.0], [0.0, 0.0, -kv])
    }

    /// The name that was given is a tendon's, not a joint's.
    pub fn on_tendon(mut self) -> Self {
        self.on_tendon = true;
        self
    }

    /// Scales length, velocity and force.
    pub fn gear(mut self, gear: f64) -> Self {
        self.actuator.gear = gear;
        self
    }

    /// Clamps the control.
    pub fn ctrl_range(mut self, low: f64, high: f64) -> Self {
        self.actuator.ctrl_range = Some([low, high]);
        self
    }

    /// Clamps the force, N or N m.
    pub fn force_range(mut self, low: f64, high: f64) -> Self {
        self.actuator.force_range = Some([low, high]);
        self
    }

    /// Puts dynamics between control and force.
    pub fn activation(mut self, activation: Activation) -> Self {
        self.actuator.activation = activation;
        self
    }

    pub(super) fn resolve(&self, model: &Model) -> Result<Actuator, ModelError> {
        let place = format!("actuator {:?}", self.actuator.name);
        let transmission = if self.on_tendon {
            Transmission::Tendon(find(model.tendons.iter().map(|t| &t.name), &self.target, "tendon", &place)?)
        } else {
            Transmission::Joint(find_joint(model, &self.target, &place)?)
        };
        Ok(Actuator { transmission, ..self.actuator.clone() })
    }
}

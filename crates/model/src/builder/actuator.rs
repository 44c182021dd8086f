//! Builder of an actuator.

use crate::builder::{find, find_joint};
use crate::{Activation, Actuator, Description, ForceModel, ModelError, Transmission};

/// Kind of element on which the actuator acts.
#[derive(Clone, Debug)]
enum Target {
    Joint,
    Tendon,
    Site { reference: Option<String>, wrench: [f64; 6] },
}

/// Builder of an actuator on a joint, tendon or site, which is given by name.
#[derive(Clone, Debug)]
pub struct ActuatorBuilder {
    pub(super) actuator: Actuator,
    name: String,
    target: Target,
}

impl ActuatorBuilder {
    fn new(name: &str, target: &str, gain: [f64; 3], bias: [f64; 3]) -> Self {
        let force_model = ForceModel::of_parameters(&gain, &bias);
        let actuator = Actuator { name: name.into(), gear: 1.0, gain, bias, force_model, ..Actuator::default() };
        Self { actuator, name: target.into(), target: Target::Joint }
    }

    /// Creates a builder of a motor: the control is the force (N or N m) on the joint with the name `joint`.
    pub fn motor(name: &str, joint: &str) -> Self {
        Self::new(name, joint, [1.0, 0.0, 0.0], [0.0; 3])
    }

    /// Creates a builder of a position servo: the control is the target position of the joint. `kp` is the stiffness of the servo (N/m, N
    /// m/rad), and `kv` its damping (N s/m, N m s/rad).
    pub fn position(name: &str, joint: &str, kp: f64, kv: f64) -> Self {
        Self::new(name, joint, [kp, 0.0, 0.0], [0.0, -kp, -kv])
    }

    /// Creates a builder of a velocity servo: the control is the target velocity of the joint. `kv` is the damping of the servo (N s/m, N m
    /// s/rad).
    pub fn velocity(name: &str, joint: &str, kv: f64) -> Self {
        Self::new(name, joint, [kv, 0.0, 0.0], [0.0, 0.0, -kv])
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Actuator, ModelError> {
        let place = format!("actuator {:?}", self.actuator.name);
        let site = |name: &str| find(model.sites.iter().map(|s| &s.name), name, "site", &place);
        let transmission = match &self.target {
            Target::Joint => Transmission::Joint(find_joint(model, &self.name, &place)?),
            Target::Tendon => Transmission::Tendon(find(model.tendons.iter().map(|t| &t.name), &self.name, "tendon", &place)?),
            Target::Site { reference, wrench } => {
                let reference = reference.as_deref().map(site).transpose()?;
                Transmission::Site { site: site(&self.name)?, reference, wrench: *wrench }
            }
        };
        Ok(Actuator { transmission, ..self.actuator.clone() })
    }
}

setters! { ActuatorBuilder
    /// Makes the actuator act on a site instead of a joint. The joint name that was given before is then the name of the site.
    ///
    /// `wrench` is force and torque per unit of actuator force, in the frame of the site. If `reference` names a second site, the wrench is
    /// in the frame of that site, and the body of that site receives the reaction.
    on_site(wrench: [f64; 6], reference: Option<&str>) { target = Target::Site { reference: reference.map(Into::into), wrench } }
    /// Sets the gear, which scales the actuator's length, velocity and force.
    gear(gear: f64) { actuator.gear = gear }
    /// Sets the delay of the control, s.
    delay(delay: f64) { actuator.delay = delay }
    /// Sets the range to which the control is clamped.
    ctrl_range(low: f64, high: f64) { actuator.ctrl_range = Some([low, high]) }
    /// Sets the range to which the force is clamped, N or N m.
    force_range(low: f64, high: f64) { actuator.force_range = Some([low, high]) }
    /// Sets the activation dynamics between control and force.
    activation(activation: Activation) { actuator.activation = activation }
    /// Makes the actuator act on a tendon instead of a joint. The joint name that was given before is then the name of the tendon.
    on_tendon() { target = Target::Tendon }
}

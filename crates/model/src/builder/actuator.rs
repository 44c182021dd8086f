//! Builder of an actuator.

use crate::builder::find;
use crate::{Activation, Actuator, Description, ElementKind, ForceModel, ModelError, Transmission};

/// Builder of an actuator on a joint, tendon or site, which is given by name.
#[derive(Clone, Debug)]
pub struct ActuatorBuilder {
    /// Actuator. The indices in its transmission are set at the end, from the names `target` and `reference`.
    pub(super) actuator: Actuator,
    target: String,
    reference: Option<String>,
}

impl ActuatorBuilder {
    fn new(name: &str, target: &str, gain: [f64; 3], bias: [f64; 3]) -> Self {
        let force_model = ForceModel::of_parameters(&gain, &bias);
        let actuator = Actuator { name: name.into(), gear: 1.0, gain, bias, force_model, ..Actuator::default() };
        Self { actuator, target: target.into(), reference: None }
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Actuator, ModelError> {
        let mut actuator = self.actuator.clone();
        let place = format!("actuator {:?}", actuator.name);
        let index = |kind, name: &String| find(model, kind, name, &place);
        match &mut actuator.transmission {
            Transmission::Tendon(tendon) => *tendon = index(ElementKind::Tendon, &self.target)?,
            Transmission::Site { site, reference, .. } => {
                *reference = self.reference.as_ref().map(|name| index(ElementKind::Site, name)).transpose()?;
                *site = index(ElementKind::Site, &self.target)?;
            }
            transmission => *transmission = Transmission::Joint(index(ElementKind::Joint, &self.target)?),
        }
        Ok(actuator)
    }
}

constructors! { ActuatorBuilder
    /// Creates a builder of a motor: the control is the force (N or N m) on the joint with the name `joint`.
    motor(joint: &str) { joint, [1.0, 0.0, 0.0], [0.0; 3] }
    /// Creates a builder of a position servo: the control is the target position of the joint. `kp` is the stiffness of the servo (N/m, N
    /// m/rad), and `kv` its damping (N s/m, N m s/rad).
    position(joint: &str, kp: f64, kv: f64) { joint, [kp, 0.0, 0.0], [0.0, -kp, -kv] }
    /// Creates a builder of a velocity servo: the control is the target velocity of the joint. `kv` is the damping of the servo (N s/m, N m
    /// s/rad).
    velocity(joint: &str, kv: f64) { joint, [kv, 0.0, 0.0], [0.0, 0.0, -kv] }
}

setters! { ActuatorBuilder
    /// Makes the actuator act on a site instead of a joint. The joint name that was given before is then the name of the site.
    ///
    /// `wrench` is force and torque per unit of actuator force, in the frame of the site. If `reference` names a second site, the wrench is
    /// in the frame of that site, and the body of that site receives the reaction.
    on_site(wrench: [f64; 6], reference: Option<&str>) {
        actuator.transmission = Transmission::Site { site: 0, reference: None, wrench }; reference = reference.map(Into::into)
    }
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
    on_tendon() { actuator.transmission = Transmission::Tendon(0) }
}

//! Builder of a fixed tendon.

use crate::builder::find;
use crate::{Description, ElementKind, ModelError, Tendon};

/// Builder of a fixed tendon, whose length is a linear combination of hinge and slide positions. Joints are given by name.
#[derive(Clone, Debug)]
pub struct TendonBuilder {
    pub(super) tendon: Tendon,
    joints: Vec<(String, f64)>,
    rest: Option<[f64; 2]>,
}

impl TendonBuilder {
    /// Creates a builder of a tendon from pairs of joint name and coefficient. The tendon has no limit, spring, damping, inertia or
    /// friction.
    pub fn new(name: &str, joints: &[(&str, f64)]) -> Self {
        let joints = joints.iter().map(|&(j, c)| (j.into(), c)).collect();
        Self { tendon: Tendon { name: name.into(), ..Tendon::default() }, joints, rest: None }
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Tendon, ModelError> {
        let place = format!("tendon {:?}", self.tendon.name);
        let mut tendon = self.tendon.clone();
        tendon.joints =
            self.joints.iter().map(|(j, c)| Ok((find(model, ElementKind::Joint, j, &place)?, *c))).collect::<Result<_, ModelError>>()?;
        let addresses = model.joint_addresses();
        let rest: f64 = tendon.joints.iter().map(|&(j, c)| c * model.qpos_spring[addresses[j].0]).sum();
        tendon.spring_length = self.rest.unwrap_or([rest; 2]);
        Ok(tendon)
    }
}

setters! { TendonBuilder
    /// Sets the lowest and highest length, m or rad.
    range(low: f64, high: f64) { tendon.range = Some([low, high]) }
    /// Sets the stiffness of the tendon's spring, N per unit of length (m or rad). By default, the rest length of the spring is the tendon
    /// length at `qpos_spring`, the rest pose of joint springs.
    stiffness(stiffness: f64) { tendon.stiffness = stiffness }
    /// Sets the lowest and highest length at which the spring is slack, m or rad.
    spring_length(low: f64, high: f64) { rest = Some([low, high]) }
    /// Sets the viscous damping, N s per unit of length (m or rad).
    damping(damping: f64) { tendon.damping = damping }
    /// Sets the armature, an inertia that resists changes of the tendon's length, N s^2 per unit of length (m or rad).
    armature(armature: f64) { tendon.armature = armature }
    /// Sets the dry friction, N.
    frictionloss(loss: f64) { tendon.frictionloss = loss }
}

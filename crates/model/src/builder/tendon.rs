//! Builder of a fixed tendon.

use crate::builder::find_joint;
use crate::{Description, ModelError, Tendon};

/// Fixed tendon: a linear combination of the positions of hinges and slides, by name.
#[derive(Clone, Debug)]
pub struct TendonBuilder {
    pub(super) tendon: Tendon,
    joints: Vec<(String, f64)>,
    rest: Option<[f64; 2]>,
}

impl TendonBuilder {
    /// Tendon without limits, springs, damping, inertia and friction.
    pub fn new(name: &str, joints: &[(&str, f64)]) -> Self {
        let joints = joints.iter().map(|&(j, c)| (j.into(), c)).collect();
        Self { tendon: Tendon { name: name.into(), ..Tendon::default() }, joints, rest: None }
    }

    /// Limits its length.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.tendon.range = Some([low, high]);
        self
    }

    /// Adds a spring whose rest length is that in the rest pose of joint springs.
    pub fn stiffness(mut self, stiffness: f64) -> Self {
        self.tendon.stiffness = stiffness;
        self
    }

    /// Sets the range of lengths in which the spring is slack.
    pub fn spring_length(mut self, low: f64, high: f64) -> Self {
        self.rest = Some([low, high]);
        self
    }

    /// Adds viscous damping.
    pub fn damping(mut self, damping: f64) -> Self {
        self.tendon.damping = damping;
        self
    }

    /// Adds an inertia that moves with the tendon's length.
    pub fn armature(mut self, armature: f64) -> Self {
        self.tendon.armature = armature;
        self
    }

    /// Adds dry friction.
    pub fn frictionloss(mut self, loss: f64) -> Self {
        self.tendon.frictionloss = loss;
        self
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Tendon, ModelError> {
        let place = format!("tendon {:?}", self.tendon.name);
        let mut tendon = self.tendon.clone();
        tendon.joints = self.joints.iter().map(|(j, c)| Ok((find_joint(model, j, &place)?, *c))).collect::<Result<_, ModelError>>()?;
        tendon.spring_length = self.rest.unwrap_or_else(|| [tendon.length(model, &model.qpos_spring); 2]);
        Ok(tendon)
    }
}

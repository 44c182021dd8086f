//! Cause of a step with a flag: the constraint row with the largest residual, or the element that is not finite or too fast.

use std::fmt;

use stepper_real::Scalar;

use crate::compile::CompiledModel;
use crate::constraints::worst_row::{CodedConstraint, ConstraintCode};
use crate::model::Model;

/// Cause of a flag. In an unsolved step it is the constraint row with the largest residual, in a rejected step the element that is not
/// finite. In a step that is too long for the motion it is the fastest joint. The indices refer to the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WorstRow {
    /// Contact between two geoms.
    Contact {
        /// Indices of the two geoms.
        geoms: [usize; 2],
    },
    /// Limit (range) of a joint.
    Limit {
        /// Index of the joint.
        joint: usize,
    },
    /// Dry friction of a joint.
    DryFriction {
        /// Index of the joint.
        joint: usize,
    },
    /// Equality constraint. Hard equalities that share a degree of freedom are solved as combinations of their rows. The index then selects
    /// the last equality in the combination.
    Equality {
        /// Index of the equality.
        equality: usize,
    },
    /// Limit, dry friction or spring of a tendon.
    Tendon {
        /// Index of the tendon.
        tendon: usize,
    },
    /// Position, velocity or applied force of a joint that is not finite.
    NotFiniteJoint {
        /// Index of the joint.
        joint: usize,
    },
    /// Pose of a mocap body, or force applied to a body, that is not finite.
    NotFiniteBody {
        /// Index of the body.
        body: usize,
    },
    /// Control or activation of an actuator that is not finite.
    NotFiniteActuator {
        /// Index of the actuator.
        actuator: usize,
    },
    /// Joint that is the fastest one in a step that is too long for the motion.
    TooFast {
        /// Index of the joint.
        joint: usize,
    },
}

impl WorstRow {
    /// Decodes a [`ConstraintCode`](crate::constraints::worst_row::ConstraintCode); `None` if no row is stored.
    pub(super) fn of_code<S: Scalar>(code: u64, model: &Model, compiled: &CompiledModel<S>) -> Option<Self> {
        let joint_with = |dof: usize| model.joint_addresses().iter().rposition(|&(_, first)| first <= dof);
        let impulse_index = match ConstraintCode(code).constraint()? {
            CodedConstraint::Contact(pair) => {
                let geoms = compiled.pair_geoms(pair)?.map(|g| compiled.geoms[g].index);
                return Some(Self::Contact { geoms });
            }
            CodedConstraint::NotFiniteActuator(actuator) => return Some(Self::NotFiniteActuator { actuator }),
            CodedConstraint::NotFiniteForce(body) => return Some(Self::NotFiniteBody { body }),
            CodedConstraint::NotFiniteMocap(i) => return compiled.merged.mocap.get(i).map(|&body| Self::NotFiniteBody { body }),
            CodedConstraint::NotFiniteDof(dof) => return joint_with(dof).map(|joint| Self::NotFiniteJoint { joint }),
            CodedConstraint::TooFast(dof) => return joint_with(dof).map(|joint| Self::TooFast { joint }),
            CodedConstraint::Scalar(impulse_index) => impulse_index,
        };
        if let Some(limit) = compiled.limits.iter().chain(&compiled.ball_limits).find(|limit| limit.impulse_index == impulse_index) {
            return Some(Self::Limit { joint: limit.joint });
        }
        if let Some(friction) = compiled.frictions.get(impulse_index - compiled.limits.len()) {
            return Some(Self::DryFriction { joint: friction.joint });
        }
        if let Some(tendon) =
            compiled.tendons.iter().find(|tendon| (tendon.impulse_index..tendon.impulse_index + 3).contains(&impulse_index))
        {
            return Some(Self::Tendon { tendon: tendon.index });
        }
        let mut equalities = compiled.equalities.iter().flat_map(|block| &block.equalities).collect::<Vec<_>>();
        equalities.sort_unstable_by_key(|equality| equality.impulse_index);
        let last = equalities.iter().rfind(|equality| equality.impulse_index <= impulse_index)?;
        Some(Self::Equality { equality: last.index })
    }

    /// Description with names of the model, for example `contact of geoms "floor" and "foot"`.
    pub fn describe<'a>(&self, model: &'a Model) -> impl fmt::Display + 'a {
        let name = |kind: &str, i: usize, name: &str| if name.is_empty() { format!("{kind} {i}") } else { format!("{kind} {name:?}") };
        match *self {
            Self::Contact { geoms: [a, b] } => {
                format!("contact of {} and {}", name("geom", a, &model.geoms[a].name), name("geom", b, &model.geoms[b].name))
            }
            Self::Limit { joint } => format!("limit of {}", name("joint", joint, &model.joints[joint].name)),
            Self::DryFriction { joint } => format!("dry friction of {}", name("joint", joint, &model.joints[joint].name)),
            Self::Equality { equality } => name("equality", equality, &model.equalities[equality].name),
            Self::Tendon { tendon } => format!("row of {}", name("tendon", tendon, &model.tendons[tendon].name)),
            Self::NotFiniteJoint { joint } => format!("number that is not finite: {}", name("joint", joint, &model.joints[joint].name)),
            Self::NotFiniteBody { body } => format!("number that is not finite: {}", name("body", body, &model.bodies[body].name)),
            Self::TooFast { joint } => format!("fastest {}", name("joint", joint, &model.joints[joint].name)),
            Self::NotFiniteActuator { actuator } => {
                format!("number that is not finite: {}", name("actuator", actuator, &model.actuators[actuator].name))
            }
        }
    }
}

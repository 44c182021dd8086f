//! Worst row of an unsolved step, in the words of the model.

use std::fmt;

use stepper_real::Scalar;

use crate::compile::CompiledModel;
use crate::constraints::worst_row::{CodedConstraint, ConstraintCode};
use crate::model::Model;

/// Constraint with the largest residual of an unsolved step. Indices are those of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WorstRow {
    /// Contact of two geoms.
    Contact {
        /// Geoms of the contact.
        geoms: [usize; 2],
    },
    /// Range of a joint.
    Limit {
        /// Joint with the range.
        joint: usize,
    },
    /// Dry friction of a joint.
    DryFriction {
        /// Joint with the friction.
        joint: usize,
    },
    /// Equality. Hard equalities that share a degree of freedom are solved as combinations of their rows. Their index is that of the last
    /// one in the combination.
    Equality {
        /// Equality of the row.
        equality: usize,
    },
    /// Range, dry friction or spring of a tendon.
    Tendon {
        /// Tendon of the row.
        tendon: usize,
    },
}

impl WorstRow {
    /// Row of a code, if any.
    pub(super) fn of_code<S: Scalar>(code: u64, model: &Model, compiled: &CompiledModel<S>) -> Option<Self> {
        let owner = match ConstraintCode(code).constraint()? {
            CodedConstraint::Contact(pair) => {
                let geoms = compiled.pair_geoms(pair)?.map(|g| compiled.geoms[g].index);
                return Some(Self::Contact { geoms });
            }
            CodedConstraint::Scalar(owner) => owner,
        };
        let joint_of = |dof: usize| model.joint_addresses().iter().position(|&(_, first)| first == dof);
        if let Some(limit) = compiled.limits.get(owner) {
            return joint_of(limit.dof).map(|joint| Self::Limit { joint });
        }
        if let Some(friction) = compiled.frictions.get(owner - compiled.limits.len()) {
            return Some(Self::DryFriction { joint: friction.joint });
        }
        if let Some(limit) = compiled.ball_limits.iter().find(|limit| limit.owner == owner) {
            return joint_of(limit.dof).map(|joint| Self::Limit { joint });
        }
        if let Some(tendon) = compiled.tendons.iter().find(|tendon| (tendon.owner..tendon.owner + 3).contains(&owner)) {
            return Some(Self::Tendon { tendon: tendon.index });
        }
        let mut equalities = compiled.equalities.iter().flat_map(|block| &block.equalities).collect::<Vec<_>>();
        equalities.sort_unstable_by_key(|equality| equality.owner);
        let last = equalities.iter().rfind(|equality| equality.owner <= owner)?;
        Some(Self::Equality { equality: last.index })
    }

    /// Description with names of the model: `contact of geoms "floor" and "foot"`.
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
        }
    }
}

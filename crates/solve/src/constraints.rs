//! Kinds of constraints: scalar rows and contacts. Each kind is a list ([`ConstraintList`](constraint_set::ConstraintList)) in a
//! [`ConstraintSet`](constraint_set::ConstraintSet).

pub(crate) mod constraint_set;
pub(crate) mod friction;
pub(crate) mod local_solver;
pub(crate) mod orthogonalisation;
pub(crate) mod rolling;
pub(crate) mod scalar;
pub(crate) mod sliding;

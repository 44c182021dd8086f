//! Lanes with impacts within the step, and the link velocities from which impacts are predicted.

use stepper_real::{Mask, Real};

use crate::compile::ModelStructure;
use crate::math::spatial::*;

/// Lanes with impacts within the step, and the link velocities from which impacts are predicted.
#[derive(Clone, Debug)]
pub(crate) struct Impacts<R: Real> {
    /// Lanes whose evaluation point (the time at which forces and contacts are computed) was set by the search for impacts. This point is
    /// the time of an impact, or another time that is not the middle of the step.
    pub(crate) lanes: R::Mask,
    /// Spatial velocities of the links: before the step, and after the step if there were no constraints.
    pub(super) velocities: [Vec<V6<R>>; 2],
}

impl<R: Real> Impacts<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        Self { lanes: R::Mask::splat(false), velocities: std::array::from_fn(|_| vec![zero(); compiled.links.len()]) }
    }
}

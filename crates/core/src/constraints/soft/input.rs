//! Inputs from which soft rows are assembled.

use stepper_real::Real;

use crate::compile::CompiledSoftness;
use crate::constraints::equality::RowInput;
use crate::constraints::soft::effective_mass::EffectiveMass;

/// Inputs from which soft rows are assembled.
#[derive(Clone, Copy)]
pub struct SoftInput<'a, R: Real> {
    pub(crate) row: RowInput<'a, R>,
    pub(crate) softness: &'a CompiledSoftness<R::Scalar>,
    /// Matrix of a discrete step, at whose end constraints are taken then.
    pub(crate) effective: Option<&'a EffectiveMass<R>>,
}

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
    /// Matrix of a discrete step, which evaluates constraints at its end.
    pub(crate) effective: Option<&'a EffectiveMass<R>>,
}

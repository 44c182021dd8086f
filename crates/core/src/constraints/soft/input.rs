//! Inputs of the assembly of rows with MuJoCo's contact law.

use stepper_real::Real;

use crate::compile::CompiledSoftness;
use crate::constraints::assembler::RowInput;
use crate::constraints::soft::effective_mass::EffectiveMass;

/// Inputs of the assembly of rows with MuJoCo's contact law.
#[derive(Clone, Copy)]
pub struct SoftInput<'a, R: Real> {
    pub(crate) row: &'a RowInput<'a, R>,
    pub(crate) softness: &'a CompiledSoftness<R::Scalar>,
    /// Effective mass matrix of a discrete step, which evaluates constraints at its end; `None` for continuous integrators.
    pub(crate) effective: Option<&'a EffectiveMass<R>>,
}

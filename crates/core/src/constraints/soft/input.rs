//! What soft rows are made from.

use stepper_real::Real;

use crate::compile::CompiledSoftness;
use crate::constraints::equality::RowInput;

/// What soft rows are made from.
#[derive(Clone, Copy)]
pub struct SoftInput<'a, R: Real> {
    pub(crate) row: RowInput<'a, R>,
    pub(crate) softness: &'a CompiledSoftness<R::Scalar>,
}

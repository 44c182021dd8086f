//! Quantities that people ask for outside a step: matrices, energies, overlaps at the reference pose.

pub mod inverse_weights;
pub mod overlaps;
pub(crate) mod quantities;

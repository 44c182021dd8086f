//! Quantities outside a step: derived quantities of a batch, matrices and energies of one environment, displacements of configurations, and
//! overlaps at the reference pose.

pub mod configurations;
pub mod contact_stiffness;
pub(crate) mod derived;
pub mod inverse_weights;
pub mod overlaps;
pub(crate) mod quantities;
mod smooth_dynamics;

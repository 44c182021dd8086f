//! Input from which every kind of element (contact, limit, equality ...) builds its constraint rows.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::assembler::AssemblyInput;
use crate::dynamics::inertia::MassMatrix;
use crate::dynamics::kinematics::Kinematics;
use crate::options::StepSettings;

/// Input of the assembly of rows: model, settings, poses, mass matrix, and velocities.
#[derive(Clone, Copy)]
pub(crate) struct RowInput<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) options: &'a StepSettings,
    pub(crate) kinematics: &'a Kinematics<R>,
    pub(crate) mass: &'a MassMatrix<R>,
    pub(crate) assembly: &'a AssemblyInput<'a, R>,
}

//! Assembly of all rows of MuJoCo's contact law in a step, and storage of their forces.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::soft::ContactVisit;

use crate::collision::contact_set::{Contacts, Slot};
use crate::compile::CompiledSoftness;
use crate::constraints::assembler::RowState;
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::soft::frames::align_tangents;
use crate::constraints::soft::system::SoftSystem;
use crate::math::spatial::*;

/// Inputs of the assembly of rows with MuJoCo's contact law.
#[derive(Clone, Copy)]
pub(crate) struct SoftInput<'a, R: Real> {
    pub(crate) state: RowState<'a, R>,
    pub(crate) softness: &'a CompiledSoftness<R::Scalar>,
}

/// Assembler of the rows of a step with MuJoCo's contact law. The methods for each kind of element are in other files of this folder.
pub(crate) struct SoftAssembler<'a, R: Real> {
    pub(crate) input: SoftInput<'a, R>,
    /// Workspace with the row under construction.
    pub(crate) builder: &'a mut RowBuilder<R>,
    /// System to which the assembler adds rows.
    pub(crate) system: &'a mut SoftSystem<R>,
}

impl<R: Real> SoftAssembler<'_, R> {
    /// Adds the rows of all constraints.
    #[inline(always)]
    pub(crate) fn assemble(&mut self, contacts: &mut Contacts<R>) {
        let state = self.input.state;
        align_tangents(state.compiled, state.kinematics, contacts);
        kernel!(R, || {
            self.system.clear();
            self.add_equalities();
            self.add_frictions();
            self.add_limits();
        });
        self.add_contacts(contacts);
        kernel!(R, || self.system.limit_weights(state.compiled, state.mass));
    }
}

impl<R: Real> SoftSystem<R> {
    /// Stores the impulses of the solution, which are its forces times `h`, the time step in s.
    ///
    /// Impulses of contacts go to `contacts`, those of scalar rows to `scalar_impulse`, and their sum on the joints to `impulse`. The next
    /// step starts from them.
    pub fn store_impulses(&self, h: R, contacts: &mut Contacts<R>, scalar_impulse: &mut [R], impulse: &mut [R]) {
        let Self { problem, solver, constrained, .. } = self;
        kernel!(R, || {
            scalar_impulse.fill(R::zero());
            impulse.fill(R::zero());
            // Without constrained lanes there is no solution. Rows may still exist: those of equalities that are active only in lanes
            // without an environment, or in lanes that are not evaluated.
            if constrained.none() {
                return;
            }
            for (impulse, &force) in impulse.iter_mut().zip(solver.forces()) {
                *impulse = R::select(*constrained, force * h, R::zero());
            }
            for (i, &impulse_index) in self.impulse_indices.iter().enumerate() {
                scalar_impulse[impulse_index] = solver.row_force(problem, i) * h;
            }
            for &(k, ContactVisit { rolling, index, lanes }) in &self.contacts {
                let slot = &mut contacts.data[k];
                let force = if rolling {
                    let [n, a, b, spin, roll, other] = solver.rolling_contact_force(problem, index);
                    let torque = in_standard_frame(slot, scale([spin, roll, other], h));
                    contacts.torque[k] = select(lanes, torque, contacts.torque[k]);
                    [n, a, b]
                } else {
                    solver.contact_force(problem, index)
                };
                slot.impulse = select(lanes, in_standard_frame(slot, scale(force, h)), slot.impulse);
            }
        })
    }
}

/// Converts a vector from the axes of a slot to the standard axes, in which contacts are stored. The standard axes are the normal, and
/// tangents that depend only on the normal.
#[inline(always)]
fn in_standard_frame<R: Real>(slot: &Slot<R>, [x, a, b]: V3<R>) -> V3<R> {
    let [n, t1, t2] = contact_frame(slot.point.normal);
    let along = add_scaled(scale(slot.tangent, a), cross(n, slot.tangent), b);
    [x, dot(t1, along), dot(t2, along)]
}

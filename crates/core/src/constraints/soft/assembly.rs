//! Assembly of all rows of MuJoCo's contact law in a step, and storage of their forces.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::{Contacts, Slot};
use crate::constraints::assembler::Assembler;
use crate::constraints::constraint_problem::{ConstraintProblem, ContactSlot};
use crate::constraints::soft::effective_mass::SoftInput;
use crate::constraints::soft::frames::align_tangents;
use crate::math::spatial::*;

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of all constraints with MuJoCo's contact law. The velocities of the rows follow from `input.row.v_free`,
    /// which is here the velocity before the step.
    #[inline(always)]
    pub(crate) fn assemble_soft(&mut self, input: SoftInput<'_, R>, contacts: &mut Contacts<R>) {
        let Some(mut system) = self.problem.soft.take() else { return };
        align_tangents(input.row.compiled, input.row.kinematics, contacts);
        kernel!(R, || {
            system.problem.clear();
            self.problem.impulse_indices.clear();
            self.problem.contact_slots.clear();
            self.problem.rotation_scales.clear();
            self.problem.constrained = R::Mask::splat(false);
            self.add_soft_equalities(input, &mut system);
            self.add_soft_frictions(input, &mut system);
            self.add_soft_limits(input, &mut system);
        });
        self.add_soft_contacts(input, contacts, &mut system);
        kernel!(R, || system.limit_weights(input.row.compiled, input.row.mass));
        if let Some(effective) = input.effective {
            let lanes = input.row.alive;
            if effective.couple(&mut system, lanes) {
                self.problem.constrained = lanes;
            }
        }
        self.problem.soft = Some(system);
    }
}

impl<R: Real> ConstraintProblem<R> {
    /// Stores the impulses of the solution, which are its forces times `h`, the time step in s.
    ///
    /// Impulses of contacts go to `contacts`, those of scalar rows to `scalar_impulse`, and their sum on the joints to `impulse`. The next
    /// step starts from them.
    pub fn store_soft_impulses(&self, h: R, contacts: &mut Contacts<R>, scalar_impulse: &mut [R], impulse: &mut [R]) {
        let Some(system) = &self.soft else { return };
        kernel!(R, || {
            scalar_impulse.fill(R::zero());
            impulse.fill(R::zero());
            // Without constrained lanes there is no solution. Rows may still exist: those of equalities that are active only in lanes
            // without an environment, or in lanes that are not evaluated.
            if self.constrained.none() {
                return;
            }
            for (impulse, &force) in impulse.iter_mut().zip(system.solver.forces()) {
                *impulse = R::select(self.constrained, force * h, R::zero());
            }
            // The rows after the constraints are couplings of the effective mass matrix.
            for i in self.impulse_indices.len()..system.problem.rows.len() {
                let (dofs, arms) = system.problem.row(i);
                let force = R::select(self.constrained, system.solver.row_force(&system.problem, i), R::zero()) * h;
                for (&d, &arm) in dofs.iter().zip(arms) {
                    impulse[d as usize] -= arm * force;
                }
            }
            for (i, &impulse_index) in self.impulse_indices.iter().enumerate() {
                scalar_impulse[impulse_index] = system.solver.row_force(&system.problem, i) * h;
            }
            for &ContactSlot { slot: k, lanes, rolls, index } in &self.contact_slots {
                let slot = &mut contacts.data[k];
                let force = if rolls {
                    let [n, a, b, spin, roll, other] = system.solver.rolling_contact_force(&system.problem, index);
                    let torque = in_standard_frame(slot, scale([spin, roll, other], h));
                    contacts.torque[k] = select(lanes, torque, contacts.torque[k]);
                    [n, a, b]
                } else {
                    system.solver.contact_force(&system.problem, index)
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

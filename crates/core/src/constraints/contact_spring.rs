//! Contacts whose surfaces give way: a spring and a damper along the normal, implicit in the step as those of equalities are.
//!
//! The law stays one of complementarity: 0 <= lambda, complementary to v+ + R lambda + P R >= 0, with the compliance R and the demand P R
//! of [`spring_law`], so that a spring pushes and never pulls. What is still apart closes as rigid surfaces do, and only what overlaps at
//! the end of the step is pressed. Friction holds or slides by the force that the spring bears.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::constraints::equality::{RowInput, RowLaw, SpringRow, spring_law};
use crate::constraints::row_builder::RowBuilder;

/// The normal row of a contact that gives way.
pub(crate) struct GivingRow<R: Real> {
    /// Lanes in which it does.
    pub(crate) lanes: R::Mask,
    /// What is added to the free velocity, m/s.
    pub(crate) bias: R,
    /// Compliance, 1/kg; 0 in the other lanes.
    pub(crate) compliance: R,
}

impl<R: Real> RowBuilder<R> {
    /// The contacts in slot `k` that are springs, whose normal velocities without constraints and before the step are `free` and `before`;
    /// the normal's row is the first of `column`, half solved.
    pub(crate) fn comply(
        &self,
        input: RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: u32,
        [free, before]: [R; 2],
    ) -> GivingRow<R> {
        let RowInput { compiled, assembly, .. } = input;
        let mut row = GivingRow { lanes: R::Mask::splat(false), bias: R::zero(), compliance: R::zero() };
        let error = contacts.data[k].point.distance;
        let (apart, gram) = (error.ge(R::zero()), self.gram(input.mass, 0));
        for (pair, lanes) in contacts.pairs(k, lanes) {
            let Some(spring) = compiled.pair(pair).spring else { continue };
            let there = R::Mask::from_bits(lanes);
            let RowLaw { g, compliance, active, .. } = spring_law(assembly, &spring, SpringRow { error, before, free, gram, taut: there });
            let bias = R::select(apart, assembly.gap(error) / assembly.h, g[0] - free);
            let there = there.and(active);
            row.lanes = row.lanes.or(there);
            row.bias = R::select(there, bias, row.bias);
            row.compliance = R::select(there, compliance, row.compliance);
        }
        row
    }
}

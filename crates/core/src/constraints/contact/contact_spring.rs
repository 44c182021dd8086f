//! Contacts with soft surfaces: a spring and a damper along the normal, implicit in the step like the springs and dampers of equalities.
//!
//! The contact remains a complementarity problem: 0 <= lambda, complementary to v+ + R lambda + b >= 0. The law of the spring
//! (`spring_law` in `equality.rs`) defines the compliance R and the bias b. The spring therefore pushes and never pulls. A gap closes as
//! between rigid surfaces. Only an overlap at the end of the step loads the spring. The spring's force limits friction.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::constraints::assembler::RowInput;
use crate::constraints::equality::{SpringRow, spring_law};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::rows::RowLaw;

/// Terms of the normal row of a contact with soft surfaces (spring and damper).
pub(crate) struct CompliantRow<R: Real> {
    /// Lanes in which the contact has soft surfaces.
    pub(crate) lanes: R::Mask,
    /// Bias to add to the free velocity of the row, m/s.
    pub(crate) bias: R,
    /// Compliance of the row, 1/kg; 0 outside `lanes`.
    pub(crate) compliance: R,
}

impl<R: Real> RowBuilder<R> {
    /// Computes bias and compliance of the normal row of the contacts in slot `k` (one per lane). The result covers those of the lanes
    /// `lanes` (bits) in which the surfaces are soft.
    ///
    /// `free` is the normal velocity after the step without constraints, and `before` that before the step, m/s. The first component of
    /// `column` must have the half-solved normal row, L^-T J^T.
    #[inline(always)]
    pub(crate) fn comply(
        &self,
        input: &RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: u32,
        [free, before]: [R; 2],
    ) -> CompliantRow<R> {
        let compiled = input.compiled;
        let mut row = CompliantRow { lanes: R::Mask::splat(false), bias: R::zero(), compliance: R::zero() };
        let error = contacts.data[k].point.distance;
        let (apart, gram) = (error.ge(R::zero()), self.gram(input.mass, 0));
        let closing_part = input.times_of_slot(contacts, k, lanes).closing_part(error);
        for (pair, lanes) in contacts.pairs(k, lanes) {
            let Some(spring) = compiled.pair(pair).spring else { continue };
            let there = R::Mask::from_bits(lanes);
            let RowLaw { g, compliance, exists, .. } = spring_law(input, &spring, SpringRow { error, before, free, gram, acts: there });
            let bias = R::select(apart, closing_part / input.h, g[0] - free);
            let there = there.and(exists);
            row.lanes = row.lanes.or(there);
            row.bias = R::select(there, bias, row.bias);
            if let Some(compliance) = compliance {
                row.compliance = R::select(there, compliance, row.compliance);
            }
        }
        row
    }
}

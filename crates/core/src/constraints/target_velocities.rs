//! Target velocities of rows, computed from their distance or overlap.
//!
//! A row of a contact, limit or equality is y . w + g >= 0 (for equalities = 0), where w is the velocity change by the impulses in scaled
//! coordinates. Its offset g is its free velocity (without impulses) plus its bias. The bias is minus the target velocity at the end of the
//! step.

use stepper_real::{Mask, Real};

use crate::constraints::assembler::{Assembler, RowInput};
use crate::options::Stabilization;

impl<R: Real> Assembler<'_, R> {
    /// Biases of the row of a contact or limit, m/s or rad/s: first in the velocity solve, then in the position solve. A bias is minus
    /// the target velocity.
    ///
    /// `closing_gap` is the part of the gap that may close in the step, m or rad. If it is negative, it is an overlap.
    ///
    /// `fastest` bounds the speed that corrects an overlap, m/s or rad/s. If the step is evaluated at a displaced state for a derivative,
    /// `solved` is the distance in the solution; otherwise it is `None`. The row exists in the lanes `exists`.
    #[inline(always)]
    pub(crate) fn biases(&mut self, input: &RowInput<'_, R>, fastest: f64, closing_gap: R, solved: Option<R>, exists: R::Mask) -> [R; 2] {
        let RowInput { options, h, .. } = *input;
        let apart = solved.unwrap_or(closing_gap).ge(R::zero());
        let beyond = -closing_gap - R::of(options.slop);
        let overlap = match solved {
            None => beyond.max(R::zero()),
            Some(solved) => R::select(solved.lt(-R::of(options.slop)), beyond, R::zero()),
        };
        // Baumgarte's correction keeps its velocity, whatever the length of a part of the step.
        let time = if options.stabilization == Stabilization::Baumgarte { R::of(options.timestep) } else { h };
        let (wanted, fastest) = (overlap * R::of(options.baumgarte) / time, R::of(fastest));
        let mut correction = wanted.min(fastest);
        if options.stabilization == Stabilization::Split && overlap.gt(R::zero()).any() {
            // With `min`, two large corrections would become equal. With this smooth bound, the larger of two contradicting corrections
            // stays larger.
            let size = (wanted * wanted + fastest * fastest).sqrt();
            correction = wanted * fastest / size.max(R::of(f64::from(f32::MIN_POSITIVE)));
        }
        let uncorrected = R::select(apart, closing_gap / h, R::zero());
        let corrected = R::select(apart, closing_gap / h, -correction);
        self.note_corrections(input, exists.and(overlap.gt(R::zero())));
        stabilized(input, uncorrected, corrected)
    }

    /// Marks the lanes `lanes` as lanes in which a row corrects its position error. With split stabilisation they need the position solve;
    /// with Baumgarte's method their velocities are biased.
    #[inline(always)]
    pub(crate) fn note_corrections(&mut self, input: &RowInput<'_, R>, lanes: R::Mask) {
        match input.options.stabilization {
            Stabilization::Split => self.problem.needs_position_solve = self.problem.needs_position_solve.or(lanes),
            Stabilization::Baumgarte => self.problem.biased = self.problem.biased.or(lanes),
            Stabilization::None => {}
        }
    }
}

/// Biases of a row in the velocity solve and in the position solve. `corrected` is the bias that corrects the position error, and
/// `uncorrected` the bias that does not. The option `stabilization` selects the solve that uses `corrected`.
#[inline(always)]
pub(crate) fn stabilized<R: Real>(input: &RowInput<'_, R>, uncorrected: R, corrected: R) -> [R; 2] {
    match input.options.stabilization {
        // Impacts correct nothing.
        Stabilization::Baumgarte => [R::select(input.is_impact, uncorrected, corrected), uncorrected],
        Stabilization::Split => [uncorrected, corrected],
        Stabilization::None => [uncorrected; 2],
    }
}

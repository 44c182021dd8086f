//! Target velocities of rows, computed from their distance or overlap.
//!
//! A row is Y^T w + g >= 0 (for equalities = 0), where w is the velocity change by the impulses in scaled coordinates. Its offset g is its
//! free velocity (without impulses) plus its bias. The bias is minus the target velocity at the end of the step.

use stepper_real::{Mask, Real};

use crate::constraints::assembler::Assembler;
use crate::options::{Stabilization, StepSettings};
use crate::tuning::LIMIT_RETURN;

impl<R: Real> Assembler<'_, R> {
    /// Biases of a contact's normal row at the distance `phi` (m): first in the velocity solve, then in the position solve, m/s. A bias is
    /// minus the target velocity.
    ///
    /// `solved` is the distance in the solution if the step is being differentiated.
    #[inline(always)]
    pub(crate) fn biases(&mut self, options: &StepSettings, phi: R, solved: Option<R>, h: R, active: R::Mask) -> (R, R) {
        self.biases_up_to(options, options.max_correction_speed, phi, solved, h, active)
    }

    /// Biases of the row of a limit at the distance `phi`, in the velocity solve and in the position solve, m/s or rad/s. A bias is minus
    /// the target velocity.
    ///
    /// With split stabilisation (positions are corrected in a separate solve), a limit is corrected faster than a contact overlap, because
    /// position corrections add no energy.
    #[inline(always)]
    pub(crate) fn limit_biases(&mut self, options: &StepSettings, phi: R, solved: Option<R>, h: R, active: R::Mask) -> (R, R) {
        let split = options.stabilization == Stabilization::Split;
        let fastest = options.max_correction_speed * if split { LIMIT_RETURN } else { 1.0 };
        self.biases_up_to(options, fastest, phi, solved, h, active)
    }

    #[inline(always)]
    fn biases_up_to(&mut self, options: &StepSettings, fastest: f64, phi: R, solved: Option<R>, h: R, active: R::Mask) -> (R, R) {
        let apart = solved.unwrap_or(phi).ge(R::zero());
        let beyond = -phi - R::of(options.slop);
        let overlap = match solved {
            None => beyond.max(R::zero()),
            Some(solved) => R::select(solved.lt(-R::of(options.slop)), beyond, R::zero()),
        };
        let (wanted, fastest) = (overlap * R::of(options.baumgarte) / h, R::of(fastest));
        let mut correction = wanted.min(fastest);
        if options.stabilization == Stabilization::Split && overlap.gt(R::zero()).any() {
            // A smooth bound instead of `min` keeps the larger of two contradicting corrections larger.
            let most = (wanted * wanted + fastest * fastest).sqrt();
            correction = wanted * fastest / most.max(R::of(f64::from(f32::MIN_POSITIVE)));
        }
        let uncorrected = R::select(apart, phi / h, R::zero());
        let corrected = R::select(apart, phi / h, -correction);
        match options.stabilization {
            Stabilization::Baumgarte => {
                self.problem.biased = self.problem.biased.or(active.and(overlap.gt(R::zero())));
                (corrected, uncorrected)
            }
            Stabilization::Split => {
                self.problem.needs_position_solve = self.problem.needs_position_solve.or(active.and(overlap.gt(R::zero())));
                (uncorrected, corrected)
            }
            Stabilization::None => (uncorrected, uncorrected),
        }
    }
}

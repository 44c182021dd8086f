//! Lanes whose residual may change the kinetic energy noticeably: they are solved further.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::Outcome;
use stepper_solve::newton::Search;

use crate::constraints::VelocitySolution;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::stages::s05_solve::solve_to;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::tuning::{MAX_TRUSTED_RESIDUAL, TARGET_RATIO};

impl<R: Real> VelocityLoop<'_, R> {
    /// Lanes in which the solver's residual may change the kinetic energy noticeably, so that the energy after the step is ambiguous.
    ///
    /// Either the residual is above [`MAX_TRUSTED_RESIDUAL`] and ten times the tolerance, or enormous impulses nearly cancel. The error of
    /// their work is the residual times the impulse, which can exceed the kinetic energy even at a small residual
    /// ([`stepper_solve::energy_is_ambiguous`]).
    pub(crate) fn ambiguous(&self, residual: R) -> R::Mask {
        let StepInput { options, alive, .. } = self.context.input;
        kernel!(R, || {
            let unsolved = alive.and(residual.gt(R::of(MAX_TRUSTED_RESIDUAL.max(10.0 * options.tolerance))));
            let negligible = self.free.smooth.mass.energy_at(R::of(options.tolerance));
            let ambiguous = stepper_solve::energy_is_ambiguous(&self.problem.rows, &self.velocity.impulses, residual, negligible);
            unsolved.or(alive.and(self.problem.constrained).and(ambiguous))
        })
    }

    /// Solves lanes with an ambiguous kinetic energy once more, with a smaller tolerance: lanes that meet the tolerance, but whose residual
    /// could still change the energy ([`VelocityLoop::ambiguous`]).
    ///
    /// Where contacts press a body from several sides (a jam), impulses can be a million times the load and nearly cancel. The residual
    /// must then be a million times smaller than without a jam.
    #[inline(always)]
    pub(crate) fn resolve_ambiguous(&mut self, outcome: &mut Outcome<R>) {
        let lanes = self.ambiguous(outcome.residual).and(outcome.residual.le(R::of(self.context.input.options.tolerance)));
        if lanes.any() {
            self.solve_further(lanes, outcome);
        }
    }

    /// Solves the lanes `lanes` to a residual that changes the kinetic energy only a little, as far as rounding permits.
    ///
    /// Different impulses may give the same motion: two walls can press on a wedge with any pair of equal forces. The function therefore
    /// first computes the impulses of least norm. Lanes whose energy is still ambiguous are then solved again, to a smaller residual.
    #[cold]
    #[inline(never)]
    fn solve_further(&mut self, lanes: R::Mask, outcome: &mut Outcome<R>) {
        let StepContext { input: StepInput { compiled, options, .. }, evaluation } = self.context;
        let goal = self.residual_for_energy();
        let ([_, steps], Outcome { residual, newton_steps, .. }) = (options.iteration_limits(), &mut *outcome);
        let VelocitySolution { impulses, newton, .. } = &mut *self.velocity;
        let search = Search { steps, tolerance: goal, least_norm: true };
        newton.solve(&self.problem.rows, impulses, search, lanes, [residual, newton_steps]);
        let left = lanes.and(self.ambiguous(outcome.residual));
        if left.any() {
            let tolerance = self.residual_for_energy();
            let repeated = solve_to(options, tolerance, left, self.problem, self.velocity, &evaluation.contacts);
            outcome.replace(&repeated, left);
        }
        integrate_velocity(compiled, &self.free.smooth.mass, &self.free.v, &self.velocity.impulses, &mut self.velocity.v);
    }

    /// Residual at which the solver's error changes the kinetic energy only a little, m/s. It is at least ten times the rounding error of a
    /// velocity of 1 m/s, but at most the tolerance.
    fn residual_for_energy(&self) -> R {
        let tolerance = R::of(self.context.input.options.tolerance);
        kernel!(R, || {
            let negligible = self.free.smooth.mass.energy_at(tolerance);
            let least = R::of(10.0 * <R::Scalar as Scalar>::EPSILON.to_f64());
            let most = stepper_solve::max_residual_for_energy(&self.problem.rows, &self.velocity.impulses, negligible);
            (most * R::of(TARGET_RATIO)).max(least).min(tolerance)
        })
    }
}

//! Rows of the limits of joints, and laws of the rows of limits.

use stepper_real::{Mask, Real, kernel};

use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::rows::RowLaw;
use crate::dynamics::kinematics::quat_at;
use crate::math::spatial::*;
use crate::options::Stabilization;
use crate::tuning::{LIMIT_LOOK_AHEAD, LIMIT_RETURN};

/// Direction from the nearer end of a range into the range (1 or -1), and signed distance of `x` from this end. The distance is negative
/// outside the range.
#[inline(always)]
pub(crate) fn nearer_end<R: Real>(x: R, [lowest, highest]: [R; 2]) -> (R, R) {
    let (below, above) = (x - lowest, highest - x);
    let low = below.le(above);
    (R::select(low, R::one(), -R::one()), R::select(low, below, above))
}

/// Axis of the rotation that leads away from limit `i` of a ball joint, and distance of the joint to the limit, rad. At the reference
/// orientation the axis is zero.
///
/// The limit keeps the length of the rotation vector below the range (MuJoCo's `mj_instantiateLimit`).
#[inline(always)]
pub(crate) fn ball_limit<R: Real>(compiled: &LaneModel<R>, i: usize, q: &[R]) -> (V3<R>, R) {
    let turn = quat_log(quat_at(q, compiled.ball_limits[i].q));
    let angle = norm(turn);
    let turned = angle.gt(R::zero());
    let axis = scale(turn, -(R::one() / R::select(turned, angle, R::one())));
    (axis, compiled.params.ball_limit(i) - angle)
}

impl<R: Real> Assembler<'_, R> {
    /// Law of the row of a limit, in the lanes in which the joint is near the limit or can reach it within two steps. If there are no such
    /// lanes, the function clears the stored impulse and returns `None`.
    ///
    /// `phi` is the distance to the limit, m or rad, and `free` its time derivative without constraints. If the step is evaluated at a
    /// displaced state for a derivative, `solved` is the distance in the solution; otherwise it is `None`. With split stabilisation
    /// (positions are corrected in a separate solve), a limit is corrected faster than a contact overlap, because position corrections add
    /// no energy.
    #[inline(always)]
    pub(crate) fn limit_law(
        &mut self,
        input: &RowInput<'_, R>,
        impulse_index: usize,
        phi: R,
        free: R,
        solved: Option<R>,
    ) -> Option<RowLaw<R>> {
        let RowInput { options, h, .. } = *input;
        let closing = (-free).max(R::zero()) * (h + h);
        let exists = input.alive.and(phi.le(closing + R::of(LIMIT_LOOK_AHEAD)));
        if exists.none() {
            self.velocity.scalar_impulse[impulse_index] = R::zero();
            return None;
        }
        let split = options.stabilization == Stabilization::Split;
        let fastest = options.max_correction_speed * if split { LIMIT_RETURN } else { 1.0 };
        let [velocity, position] = self.biases(input, fastest, phi, solved, exists);
        Some(RowLaw { g: [free + velocity, free + position], compliance: None, exists, bounds: [R::zero(), R::of(f64::INFINITY)] })
    }

    /// Adds the rows of the limits of hinge and slide joints: one row for the nearer end of each range.
    #[inline(always)]
    pub(crate) fn add_limits(&mut self, input: &RowInput<'_, R>) {
        for (i, limit) in input.compiled.limits.iter().enumerate() {
            let (sign, phi) = nearer_end(input.q[limit.q], input.compiled.params.limit(i));
            let solved = input.solved_overlaps.map(|solved| solved.limits[i]);
            if let Some(law) = self.limit_law(input, i, phi, input.v_free[limit.dof] * sign, solved) {
                self.add_dof_row(input, limit.dof, i, sign, law);
            }
        }
    }

    /// Adds the rows of the limits of ball joints.
    pub(crate) fn add_ball_limits(&mut self, input: &RowInput<'_, R>) {
        kernel!(R, || {
            for (i, limit) in input.compiled.ball_limits.iter().enumerate() {
                let (axis, phi) = ball_limit(input.compiled, i, input.q);
                let v = input.v_free;
                let free = dot(axis, [v[limit.dof], v[limit.dof + 1], v[limit.dof + 2]]);
                let Some(law) = self.limit_law(input, limit.impulse_index, phi, free, None) else { continue };
                self.builder.dofs.clear();
                self.builder.dofs.extend(input.compiled.chain_of(limit.dof + 2).iter().rev());
                self.builder.couple(input);
                for &d in &self.builder.dofs {
                    self.builder.column[d as usize] = zero();
                }
                for k in 0..3 {
                    self.builder.column[limit.dof + k][0] = axis[k];
                }
                self.builder.half_solve::<1>(input.compiled, input.mass);
                self.add_row(input.mass, limit.impulse_index, R::one(), law);
            }
        })
    }
}

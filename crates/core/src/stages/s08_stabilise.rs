//! Stage 8: positions are corrected where the velocity of the solution is not the one they should have moved with.
//!
//! A second solve of the same rows, without restitution, finds the velocity that closes every gap just so and removes a part of every overlap.
//! It is used once, for the positions, and thrown away: no kinetic energy comes of it.

use stepper_real::{Mask, Real};
use stepper_solve::Settings;

use crate::constraints::Constraints;
use crate::inertia::MassMatrix;
use crate::kinematics::displace;
use crate::options::{Options, Solver};
use crate::plan::LanePlan;

/// Residual that is enough for a correction, m/s: a fraction of a micrometre a step, and the next step sees what is left of the overlap.
const CLOSE: f64 = 1e-4;

/// Residual above which Newton's method goes on where sweeps stop, m/s: they can leave a hundredth of a radian a step where two limbs are jammed. Below
/// it, it would cost more than the correction is worth (humanoids under random control: 4 % of the step).
const ROUGH: f64 = 1e-2;

/// Sweeps from the impulses of stage 5, which differ by the correction alone.
const SWEEPS: u32 = 10;

/// Corrects `q_next`, which has moved with `v_next` for `way` seconds, in the lanes that need it.
#[expect(clippy::too_many_arguments, reason = "the state before, the state after, and what joins them")]
pub fn stabilise<R: Real>(
    plan: &LanePlan<R>,
    options: &Options,
    mass: &MassMatrix<R>,
    constraints: &mut Constraints<R>,
    v_free: &[R],
    v_next: &[R],
    h: R,
    [work, corrected]: [&mut [R]; 2],
    q_next: &mut [R],
) {
    let lanes = constraints.needs_position_solve;
    if lanes.none() {
        return;
    }
    demand_positions(constraints);
    let [sweeps, newton] = options.effort();
    let tolerance = options.tolerance.max(CLOSE);
    let rough = if options.solver == Solver::Newton { tolerance } else { tolerance.max(ROUGH) };
    let settings = Settings { sweeps: sweeps.min(SWEEPS), newton, tolerance: R::of(tolerance), rough: R::of(rough) };
    let Constraints { problem, iterate, newton, .. } = constraints;
    stepper_solve::solve(problem, iterate, settings, lanes, newton);
    R::vectorize(
        #[inline(always)]
        || {
            let w = &mut constraints.iterate.w;
            mass.unscale(plan, w);
            for i in 0..plan.nv {
                work[i] = (v_free[i] + w[i]) - v_next[i];
            }
            displace(plan, q_next, work, h, corrected);
            for i in 0..plan.nq {
                q_next[i] = R::select(lanes, corrected[i], q_next[i]);
            }
        },
    )
}

/// Makes the rows demand what the positions need; the impulses of stage 5 and what they do to the velocity are the start.
fn demand_positions<R: Real>(constraints: &mut Constraints<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let scalars = constraints.problem.scalars.len();
            for (row, &g) in constraints.problem.scalars.iter_mut().zip(&constraints.position_bias) {
                row.g = g;
            }
            let (contacts, wide) = constraints.position_bias[scalars..].split_at(3 * constraints.problem.contacts.len());
            for (block, demands) in constraints.problem.contacts.iter_mut().zip(contacts.as_chunks().0) {
                demand(&mut block.g, demands);
            }
            for (block, demands) in constraints.problem.wide.iter_mut().zip(wide.as_chunks().0) {
                demand(&mut block.g, demands);
            }
        },
    )
}

/// Of a contact's rows, the normal one first.
#[inline(always)]
fn demand<R: Real, const N: usize>(g: &mut [R; N], demands: &[R; N]) {
    g[0] = demands[0];
    for k in 1..N {
        g[k] += demands[k];
    }
}

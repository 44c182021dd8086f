//! Derivative of the step of a group, by differences of evaluations at displaced states.

use std::sync::MutexGuard;

use stepper_core::ContactLaw;
use stepper_core::group_step::{Gap, GroupStep, Recomputed, StatePart};
use stepper_real::{Mask, Real, Scalar};
use stepper_solve::newton::{Switch, SwitchDistance};

use crate::kink::*;
use crate::response::{HardResponse, is_solved};
use crate::rows::{DerivativeQuery, DerivativeRows};

/// Change of a slope per unit of the coordinate up to which a function counts as smooth, relative to the slope. `LARGEST_BEND` is the
/// largest such relative change for any displacement.
const CURVATURE: f64 = 1e4;
const LARGEST_BEND: f64 = 0.1;

/// Lower bound of the slopes with which differences are compared, SI units. Bodies at rest have columns that are 0 except for terms of
/// second order.
const LEAST_SLOPE: f64 = 0.1;

/// Difference between the response at the solution and the solution, relative to the velocities, up to which it counts as rounding. A
/// larger one means that the step has a part that the response does not model.
const FAITHFUL: f64 = 1e-8;

/// Workspace for the derivatives of the step of a group.
#[derive(Clone, Debug)]
pub(crate) struct StepDerivative<R: Real> {
    /// First-order response of the impulses with hard contact.
    response: HardResponse<R>,
    /// Whether contact is hard. With MuJoCo's contact law the solver itself computes the response.
    is_hard: bool,
    /// Changes of the state after the step, for each of the two displaced states of a column.
    changes: [Vec<R>; 2],
}

impl<R: Real> StepDerivative<R> {
    /// Workspace for the steps of a simulation.
    pub(crate) fn new(step: &GroupStep<R>) -> Self {
        let [nv, na] = [StatePart::Qvel, StatePart::Act].map(|part| step.width(part));
        Self {
            response: HardResponse::new(step.settings()),
            is_hard: step.settings().contact == ContactLaw::Hard,
            changes: [2 * nv + na; 2].map(|n| vec![R::zero(); n]),
        }
    }

    /// Computes the derivatives of the step, with one row of results for every lane that has an environment.
    ///
    /// The query's `offsets` begin with those of the first lane.
    pub(crate) fn differentiate(
        &mut self,
        step: &mut GroupStep<R>,
        query: &DerivativeQuery<'_>,
        rows: &mut [MutexGuard<'_, DerivativeRows<'_>>],
    ) {
        let solved = self.solve(step, rows);
        let mut sound = self.settle(step, solved);
        let columns: Vec<(StatePart, usize)> = query.parts.iter().flat_map(|&part| (0..step.width(part)).map(move |i| (part, i))).collect();
        // Coordinates that only change forces come first, because they need no new rows. Coordinates that do not change the configuration
        // follow.
        for recomputed in [Recomputed::Forces, Recomputed::Velocity, Recomputed::Configuration] {
            for (c, &(part, i)) in columns.iter().enumerate().filter(|(_, (part, _))| part.recomputed() == recomputed) {
                let offsets = offsets(query, rows.len(), c, columns.len());
                for (point, &offset) in offsets[..query.points].iter().enumerate() {
                    step.displace(part, i, offset);
                    sound = self.evaluate(step, recomputed, sound, &mut |near| rows[near.lane].note(near, c));
                    step.change(&mut self.changes[point]);
                }
                self.write_slopes(step, &offsets[..query.points], rows, (c, columns.len()));
            }
        }
        step.finish();
        for (l, rows) in rows.iter_mut().enumerate() {
            rows.sound[0] = u8::from(sound >> l & 1 == 1);
            if solved >> l & 1 == 0 {
                rows.causes.iter_mut().for_each(|cause| *cause |= UNSOLVED);
            }
        }
    }

    /// Makes the step at the present state. Returns the lanes (bits) in which it is solved.
    fn solve(&mut self, step: &mut GroupStep<R>, rows: &mut [MutexGuard<'_, DerivativeRows<'_>>]) -> u32 {
        let solved = step.solve();
        let outcome = step.outcome();
        for (l, rows) in rows.iter_mut().enumerate() {
            rows.residual[0] = solved.residual.lane(l).to_f64();
            rows.status[0] = solved.statuses[l];
            rows.distance[0] = f64::INFINITY;
            for (out, after) in rows.state.iter_mut().zip(outcome) {
                for (out, x) in out.iter_mut().zip(after) {
                    *out = x.lane(l).to_f64();
                }
            }
        }
        is_solved(step.settings(), solved.residual).bits() & solved.complete
    }

    /// Computes the response of the solution in the lanes `solved` (bits). Returns the lanes in which the response reproduces the solution
    /// at the same state.
    fn settle(&mut self, step: &mut GroupStep<R>, solved: u32) -> u32 {
        let sound = if self.is_hard { self.response.settle(step, solved) } else { solved };
        let sound = self.evaluate(step, Recomputed::Configuration, sound, &mut |_| {});
        step.change(&mut self.changes[0]);
        let [_, v, _] = step.outcome();
        R::vectorize(
            #[inline(always)]
            || {
                let (mut apart, mut speed) = (R::zero(), R::one());
                for &change in &self.changes[0] {
                    // Unlike `max`, this propagates a NaN.
                    apart = R::select(change.abs().le(apart), apart, change.abs());
                }
                for &v in v {
                    speed = speed.max(v.abs());
                }
                sound & apart.le(speed * R::of(FAITHFUL)).bits()
            },
        )
    }

    /// Evaluates the step at the displaced state. Returns the lanes of `lanes` (bits) in which all constraints still exist.
    ///
    /// The function calls `near` with each constraint that has come closer to another mode (open, sticking, slipping) in these lanes.
    fn evaluate(&mut self, step: &mut GroupStep<R>, recomputed: Recomputed, lanes: u32, near: &mut dyn FnMut(SwitchDistance)) -> u32 {
        if self.is_hard {
            return self.response.follow(step, recomputed, lanes, near);
        }
        let settings = *step.settings();
        if !step.evaluate(recomputed, &mut self.response.rule(&settings, lanes, near)) {
            return lanes;
        }
        step.gaps(lanes, &mut |Gap { lane, is_limit, nominal, displaced }| {
            if (nominal < 0.0) != (displaced < 0.0) {
                let distance = if nominal.is_finite() { nominal / (nominal - displaced) } else { 1.0 };
                near(SwitchDistance { lane, switch: if is_limit { Switch::Limit } else { Switch::Contact }, distance });
            }
        })
    }

    /// Computes the derivatives of column `c` from the changes at its displaced states. Flags derivatives that differ between the two
    /// sides.
    fn write_slopes(
        &mut self,
        step: &GroupStep<R>,
        offsets: &[R],
        rows: &mut [MutexGuard<'_, DerivativeRows<'_>>],
        (c, columns): (usize, usize),
    ) {
        let (n, nv, noise) = (self.changes[0].len(), step.width(StatePart::Qvel), step.settings().tolerance);
        let [first, second] = &mut self.changes;
        let kinked = R::vectorize(
            #[inline(always)]
            || {
                let a = offsets[0];
                let Some(&b) = offsets.get(1) else {
                    first.iter_mut().for_each(|change| *change /= a);
                    return 0;
                };
                // Weights of a parabola through both displaced states and the nominal one.
                let weights = [b / (a * (b - a)), a / (b * (a - b))];
                let floor = R::of(4.0 * noise) / a.abs();
                let limit = (R::of(CURVATURE) * a.abs()).min(R::of(LARGEST_BEND));
                let mut kinked = 0;
                for group in [0..nv, nv..2 * nv, 2 * nv..n] {
                    let (mut size, mut bend) = (R::of(LEAST_SLOPE), R::zero());
                    for (x, &y) in first[group.clone()].iter_mut().zip(&second[group]) {
                        bend = bend.max((*x / a - y / b).abs());
                        *x = weights[0] * *x + weights[1] * y;
                        size = size.max(x.abs());
                    }
                    kinked |= bend.gt(limit * size + floor).bits();
                }
                kinked
            },
        );
        for (l, rows) in rows.iter_mut().enumerate() {
            for (i, slope) in first.iter().enumerate() {
                rows.slopes[i * columns + c] = slope.lane(l).to_f64();
            }
            if kinked >> l & 1 == 1 {
                rows.causes[c] |= SLOPE;
            }
        }
    }
}

/// Displacements of the coordinate of a column at its two displaced states, in the first `lanes` lanes.
fn offsets<R: Real>(query: &DerivativeQuery<'_>, lanes: usize, column: usize, columns: usize) -> [R; 2] {
    let mut offsets = [R::one(); 2];
    for (point, offset) in offsets.iter_mut().enumerate().take(query.points) {
        for l in 0..lanes {
            offset.set_lane(l, Scalar::from_f64(query.offsets[(l * query.points + point) * columns + column]));
        }
    }
    offsets
}

//! Derivative of the step of a SIMD group of environments, by differences of evaluations at displaced states.

use std::sync::MutexGuard;

use stepper_core::ContactLaw;
use stepper_core::group_step::{Gap, GroupStep, Recomputed, StatePart};
use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::newton::{Switch, SwitchDistance};

use crate::kink::*;
use crate::response::{HardResponse, is_solved};
use crate::rows::{Derivative, DerivativeQuery};

/// Largest relative difference of two slopes, per unit of displacement, that counts as curvature. A larger difference is a kink. The slopes
/// are difference quotients from the nominal state to two displaced states of a coordinate.
const CURVATURE: f64 = 1e4;
/// Largest relative difference of the two slopes that counts as curvature, however large the displacement. For large displacements
/// [`CURVATURE`] alone would allow more.
const LARGEST_BEND: f64 = 0.1;

/// Lower bound of the divisor of a relative difference of slopes, SI units. The divisor is the largest slope of the positions, of the
/// velocities, or of the activations.
///
/// Bodies at rest need this bound. Their slopes are 0 except for terms of second order, so that a division by the slopes would show kinks
/// where there are none.
const LEAST_SLOPE: f64 = 0.1;

/// Largest difference between two results of a step at the same state that counts as rounding, relative to the largest velocity. One result
/// is that of the solver, the other that of an evaluation with impulses from the first-order response. A larger difference means that the
/// response does not model a part of the step.
const FAITHFUL: f64 = 1e-8;

/// Workspace for the derivatives of the step of a SIMD group of environments.
#[derive(Clone, Debug)]
pub(crate) struct StepDerivative<R: Real> {
    /// First-order response of the impulses with hard contact.
    response: HardResponse<R>,
    /// Whether contact is hard. With MuJoCo's contact law the solver itself computes the response.
    is_hard: bool,
    /// Numbers that change where tendons and adhesion have kinks ([`GroupStep::switches`]), at the undisplaced state.
    switches: [Vec<R>; 2],
    /// Changes of the state after the step that are caused by the first and by the second displacement of a coordinate.
    changes: [Vec<R>; 2],
}

impl<R: Real> StepDerivative<R> {
    /// Workspace for the derivatives of steps of the same model as `step`.
    pub(crate) fn new(step: &GroupStep<R>) -> Self {
        let [nv, na] = [StatePart::Qvel, StatePart::Act].map(|part| step.width(part));
        Self {
            response: HardResponse::new(step.settings()),
            is_hard: step.settings().contact == ContactLaw::Hard,
            switches: step.switches().map(<[R]>::to_vec),
            changes: [2 * nv + na; 2].map(|n| vec![R::zero(); n]),
        }
    }

    /// Computes the derivatives of the step in all lanes that have an environment. `lanes` has the derivatives of these lanes.
    ///
    /// The array `query.offsets` starts with the displacements of the first lane.
    pub(crate) fn differentiate(&mut self, step: &mut GroupStep<R>, query: &DerivativeQuery<'_>, lanes: &mut [MutexGuard<'_, Derivative>]) {
        let solved = self.solve(step, lanes);
        let mut sound = self.prepare_response(step, solved);
        let columns: Vec<(StatePart, usize)> = query.parts.iter().flat_map(|&part| (0..step.width(part)).map(move |i| (part, i))).collect();
        // Coordinates that only change forces come first, because they need no new rows. Coordinates that do not change the configuration
        // follow.
        for recomputed in [Recomputed::Forces, Recomputed::Velocity, Recomputed::Configuration] {
            for (c, &(part, i)) in columns.iter().enumerate().filter(|(_, (part, _))| part.recomputed() == recomputed) {
                let offsets = offsets(query, lanes.len(), c, columns.len());
                for (point, &offset) in offsets[..query.points].iter().enumerate() {
                    step.displace(part, i, offset);
                    sound = self.evaluate(step, recomputed, sound, &mut |near| lanes[near.lane].note(near, c));
                    step.change(&mut self.changes[point]);
                    self.note_switches(step, lanes, c);
                }
                self.write_slopes(step, &offsets[..query.points], lanes, (c, columns.len()));
            }
        }
        step.finish();
        for (l, derivative) in lanes.iter_mut().enumerate() {
            derivative.sound = sound >> l & 1 == 1;
            if solved >> l & 1 == 0 {
                derivative.causes.iter_mut().for_each(|cause| *cause |= UNSOLVED);
            }
        }
    }

    /// Computes the step from the current state, and writes residual, status and resulting state to `lanes`. Returns the lanes (bits)
    /// in which the step is solved.
    fn solve(&mut self, step: &mut GroupStep<R>, lanes: &mut [MutexGuard<'_, Derivative>]) -> u32 {
        let solved = step.solve();
        let outcome = step.outcome();
        for (l, derivative) in lanes.iter_mut().enumerate() {
            derivative.residual = solved.residual.lane(l).to_f64();
            derivative.status = solved.statuses[l];
            for (out, after) in derivative.state.iter_mut().zip(outcome) {
                for (out, x) in out.iter_mut().zip(after) {
                    *out = x.lane(l).to_f64();
                }
            }
        }
        is_solved(step.settings(), solved.residual).bits() & solved.complete
    }

    /// Computes the first derivatives of the impulses with respect to displacements of the state, in the lanes `solved` (bits).
    ///
    /// As a check, the function evaluates the step with these impulses at the undisplaced state. It returns the lanes in which the result
    /// equals the result of the solved step within rounding.
    fn prepare_response(&mut self, step: &mut GroupStep<R>, solved: u32) -> u32 {
        let sound = if self.is_hard { self.response.prepare(step, solved) } else { solved };
        let sound = self.evaluate(step, Recomputed::Configuration, sound, &mut |_| {});
        step.change(&mut self.changes[0]);
        for (nominal, switches) in self.switches.iter_mut().zip(step.switches()) {
            nominal.copy_from_slice(switches);
        }
        let [_, v, _] = step.outcome();
        kernel!(R, || {
            let (mut apart, mut speed) = (R::zero(), R::one());
            for &change in &self.changes[0] {
                apart = apart.max_or_nan(change.abs());
            }
            for &v in v {
                speed = speed.max(v.abs());
            }
            sound & apart.le(speed * R::of(FAITHFUL)).bits()
        })
    }

    /// Flags column `c` where a tendon touches another geom, or adhesion pulls another number of contacts, than at the undisplaced state.
    fn note_switches(&self, step: &GroupStep<R>, lanes: &mut [MutexGuard<'_, Derivative>], c: usize) {
        for ((nominal, switches), flag) in self.switches.iter().zip(step.switches()).zip([WRAP, ADHESION]) {
            for (nominal, switch) in nominal.iter().zip(switches) {
                for (_, derivative) in lanes.iter_mut().enumerate().filter(|(l, _)| nominal.lane(*l) != switch.lane(*l)) {
                    derivative.causes[c] |= flag;
                    derivative.distance = derivative.distance.min(1.0);
                }
            }
        }
    }

    /// Evaluates the step at the displaced state in the lanes `lanes` (bits).
    ///
    /// Returns the lanes in which all constraints that act in the solved step also exist at the displaced state. The function calls `near`
    /// with each constraint that has come closer to another mode (open, sticking, slipping).
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

    /// Computes column `c` of the derivative from `self.changes`, the changes of the step's result at one or two displaced states.
    ///
    /// Flags the column with [`SLOPE`] if the slopes at the two displaced states differ.
    fn write_slopes(&mut self, step: &GroupStep<R>, offsets: &[R], lanes: &mut [MutexGuard<'_, Derivative>], (c, columns): (usize, usize)) {
        let (n, nv, noise) = (self.changes[0].len(), step.width(StatePart::Qvel), step.settings().tolerance);
        let [first, second] = &mut self.changes;
        let kinked = kernel!(R, || {
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
        });
        for (l, derivative) in lanes.iter_mut().enumerate() {
            for (i, slope) in first.iter().enumerate() {
                derivative.slopes[i * columns + c] = slope.lane(l).to_f64();
            }
            if kinked >> l & 1 == 1 {
                derivative.causes[c] |= SLOPE;
            }
        }
    }
}

/// First and second displacement of the coordinate with the index `column` among `columns` coordinates, in the first `lanes` lanes; 1 in
/// the other lanes.
fn offsets<R: Real>(query: &DerivativeQuery<'_>, lanes: usize, column: usize, columns: usize) -> [R; 2] {
    let mut offsets = [R::one(); 2];
    for (point, offset) in offsets.iter_mut().enumerate().take(query.points) {
        for l in 0..lanes {
            offset.set_lane(l, Scalar::from_f64(query.offsets[(l * query.points + point) * columns + column]));
        }
    }
    offsets
}

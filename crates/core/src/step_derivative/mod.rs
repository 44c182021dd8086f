//! Derivative of a step at the modes of its solution, by the implicit function theorem.
//!
//! The step is solved once, in all lanes. Then each coordinate is displaced in turn; every lane displaces that of its environment. Stages 1
//! to 8 run there with the linear response of the solution in place of solves. The contacts that push, stick and slip stay the same.
//! Differences of these evaluations differentiate geometry, forces and inertia without kinks. If the configuration does not change, poses,
//! mass matrix and rows are reused.

mod held_overlaps;
pub(crate) mod kink;
mod response;

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::newton::{Followed, Switch};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::{displace, quat_at};
use crate::integrators::devices::Devices;
use crate::integrators::mujoco;
use crate::integrators::recomputed::Recomputed;
use crate::integrators::step_values::State;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::{ContactLaw, StepSettings};
use crate::probe::NoProbe;
use crate::step::step;
use crate::step_derivative::held_overlaps::{HeldOverlaps, compare_overlaps};
use crate::step_derivative::kink::*;
use crate::step_derivative::response::{HardResponse, is_solved};

/// Change of a slope that smooth motion may have, per unit of a coordinate and relative to the slope, and the largest for any width.
const CURVATURE: f64 = 1e4;
const LARGEST_BEND: f64 = 0.1;

/// Slope with which smaller ones are replaced in a comparison, SI units. Bodies at rest have columns that are 0 except for terms of second
/// order.
const LEAST_SLOPE: f64 = 0.1;

/// Difference of the response at the solution from the solution, relative to its velocities, that counts as rounding and residual. A larger
/// one means that the step has a part that the response does not model.
const FAITHFUL: f64 = 1e-8;

/// Part of a state, or the controls, whose coordinates are columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatePart {
    /// Displacements of the configuration, nv.
    Qpos,
    /// Velocities, nv.
    Qvel,
    /// Activations, na.
    Act,
    /// Controls, nu.
    Ctrl,
}

impl StatePart {
    /// Parts of a step that change when a coordinate of this kind is displaced.
    fn recomputed(self) -> Recomputed {
        match self {
            Self::Qpos => Recomputed::Configuration,
            Self::Qvel => Recomputed::Velocity,
            Self::Act | Self::Ctrl => Recomputed::Forces,
        }
    }
}

/// Arguments of a derivative; arrays are environment-major.
#[derive(Clone, Copy, Debug)]
pub struct DerivativeQuery<'a> {
    /// Parts in the order of their columns.
    pub parts: &'a [StatePart],
    /// Displacements of every column, (num_envs, points, columns) with one point or two.
    pub offsets: &'a [f64],
    /// Number of points of a column.
    pub points: usize,
    /// Residual to which the step is solved, m/s.
    pub tolerance: f64,
}

/// Results for some environments, environment-major.
#[derive(Debug)]
pub struct DerivativeRows<'a> {
    /// Derivatives of displacements of qpos, qvel and act after the step, (environments, 2 nv + na, columns).
    pub slopes: &'a mut [f64],
    /// Flags of every column, (environments, columns), as Python's `stepper.derivatives.Kink` has them.
    pub causes: &'a mut [u32],
    /// Distance to the nearest kink in widths of the displacements, to first order; infinite without any.
    pub distance: &'a mut [f64],
    /// Whether the derivative is that of the step: 0 where the implicit function theorem does not apply.
    pub sound: &'a mut [u8],
    /// Residual of the step, m/s.
    pub residual: &'a mut [f64],
    /// Flags of the environments.
    pub status: &'a mut [u32],
    /// State after the step: nq, nv and na numbers.
    pub state: [&'a mut [f64]; 3],
}

impl<'a> DerivativeRows<'a> {
    /// Rows of `num_envs` environments in chunks of `size` environments.
    pub(crate) fn chunks(self, num_envs: usize, size: usize) -> impl Iterator<Item = DerivativeRows<'a>> + Send {
        let Self { slopes, causes, distance, sound, residual, status, state } = self;
        let [mut slopes, mut distance, mut residual] = [slopes, distance, residual].map(|all| rows(all, num_envs, size));
        let [mut causes, mut status] = [causes, status].map(|all| rows(all, num_envs, size));
        let (mut sound, mut state) = (rows(sound, num_envs, size), state.map(|all| rows(all, num_envs, size)));
        std::iter::from_fn(move || {
            Some(DerivativeRows {
                slopes: slopes.next()?,
                causes: causes.next()?,
                distance: distance.next()?,
                sound: sound.next()?,
                residual: residual.next()?,
                status: status.next()?,
                state: state.each_mut().map(|rows| rows.next().unwrap_or_default()),
            })
        })
        .take(num_envs.div_ceil(size))
    }

    /// Records the constraint that the displacement of column `c` of `columns` brings closer to another mode.
    fn note(&mut self, near: Followed, (c, columns): (usize, usize)) {
        self.distance[near.lane] = self.distance[near.lane].min(near.distance);
        if near.distance <= 1.0 {
            self.causes[near.lane * columns + c] |= match near.switch {
                Switch::Contact => CONTACT,
                Switch::Slip => SLIP,
                Switch::Limit => LIMIT,
                Switch::DryFriction => DRY_FRICTION,
                Switch::Gap => GAP,
            };
        }
    }
}

/// Rows of `num_envs` environments in chunks of `size` environments. Empty rows give that many empty chunks.
fn rows<T: Send>(all: &mut [T], num_envs: usize, size: usize) -> impl Iterator<Item = &mut [T]> + Send {
    all.chunks_mut((all.len() / num_envs * size).max(1)).chain(std::iter::repeat_with(Default::default))
}

/// Workspace for the derivatives of a group of lanes.
#[derive(Clone, Debug)]
pub(crate) struct StepDerivative<R: Real> {
    law: LawResponse<R>,
    overlaps: HeldOverlaps<R>,
    /// Configuration, velocity, activations and controls before the step.
    before: [Vec<R>; 4],
    /// Configuration, velocity and activations after the step.
    after: [Vec<R>; 3],
    /// Changes of the state at the points of a column.
    changes: [Vec<R>; 2],
    direction: Vec<R>,
}

/// Response of the solution to the state, by contact law.
#[derive(Clone, Debug)]
enum LawResponse<R: Real> {
    Hard(Box<HardResponse<R>>),
    /// MuJoCo's law, with the acceleration of the solution.
    Mujoco(Vec<R>),
}

impl<R: Real> StepDerivative<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let [nq, nv, na] = [compiled.nq, compiled.nv, compiled.na];
        Self {
            law: match options.contact {
                ContactLaw::Hard => LawResponse::Hard(Box::new(HardResponse::new(compiled, options, max_contacts))),
                ContactLaw::Mujoco => LawResponse::Mujoco(zeros(nv)),
            },
            overlaps: HeldOverlaps::new(compiled, max_contacts),
            before: [nq, nv, na, compiled.actuators.len()].map(zeros),
            after: [nq, nv, na].map(zeros),
            changes: [2 * nv + na; 2].map(zeros),
            direction: zeros(nv),
        }
    }

    /// Differentiates the step from the state in `s`, which is overwritten, in all lanes that are environments. `rows` and the query's
    /// `offsets` are those of these environments.
    pub(crate) fn differentiate(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        query: &DerivativeQuery<'_>,
        rows: &mut DerivativeRows<'_>,
    ) {
        let alive = s.alive.bits();
        let solved = self.solve(compiled, options, s, rows);
        let mut sound = self.settle(compiled, options, s, solved);
        let columns: Vec<(StatePart, usize)> = query.parts.iter().flat_map(|&part| (0..self.width(part)).map(move |i| (part, i))).collect();
        // Coordinates that change forces alone come first, with the rows of the solution. Those that keep the configuration follow.
        for recomputed in [Recomputed::Forces, Recomputed::Velocity, Recomputed::Configuration] {
            for (c, &(part, i)) in columns.iter().enumerate().filter(|(_, (part, _))| part.recomputed() == recomputed) {
                let offsets = self.offsets(query, alive, c, columns.len());
                for (point, &offset) in offsets[..query.points].iter().enumerate() {
                    sound = self.evaluate(compiled, options, s, (part, i, offset), sound, &mut |near| rows.note(near, (c, columns.len())));
                    self.find_changes(compiled, s, point);
                }
                self.write_slopes(&offsets[..query.points], options.tolerance, alive, rows, (c, columns.len()));
            }
        }
        self.overlaps.release(s);
        for l in each_of(alive) {
            rows.sound[l] = u8::from(sound >> l & 1 == 1);
            if solved >> l & 1 == 0 {
                rows.causes[l * columns.len()..(l + 1) * columns.len()].iter_mut().for_each(|cause| *cause |= UNSOLVED);
            }
        }
    }

    fn width(&self, part: StatePart) -> usize {
        let [_, v, act, ctrl] = &self.before;
        match part {
            StatePart::Qpos | StatePart::Qvel => v.len(),
            StatePart::Act => act.len(),
            StatePart::Ctrl => ctrl.len(),
        }
    }

    /// Makes the step and stores its solution. Returns the lanes in which the step is solved.
    fn solve(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, rows: &mut DerivativeRows<'_>) -> u32 {
        for (kept, now) in self.before.iter_mut().zip([&s.state.q, &s.state.v, &s.state.act, &s.inputs.ctrl]) {
            kept.copy_from_slice(now);
        }
        let elapsed = s.state.elapsed;
        let mut devices = Devices { group: 0, actuators: None, sensors: None };
        let record = step(compiled, options, s, &mut devices, NoProbe);
        s.state.elapsed = elapsed;
        for (kept, now) in self.after.iter_mut().zip([&s.state.q, &s.state.v, &s.state.act]) {
            kept.copy_from_slice(now);
        }
        let mut flags = [0; MAX_LANES];
        record.add_flags(&mut flags);
        for l in each_of(s.alive.bits()) {
            rows.residual[l] = record.residual.lane(l).to_f64();
            rows.status[l] = flags[l];
            rows.distance[l] = f64::INFINITY;
            for (out, after) in rows.state.iter_mut().zip(&self.after) {
                let n = after.len();
                for (out, x) in out[l * n..(l + 1) * n].iter_mut().zip(after) {
                    *out = x.lane(l).to_f64();
                }
            }
        }
        let solved = is_solved(options, record.residual);
        let broken = record.non_finite.or(record.infeasible).or(record.unresolved).bits() | record.contacts_full;
        s.alive.and(solved).bits() & !broken
    }

    /// Computes the response of the solution to the state in the lanes `solved`. Returns the lanes in which the response at the solution
    /// reproduces the solution.
    fn settle(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, solved: u32) -> u32 {
        let mut sound = solved;
        match &mut self.law {
            LawResponse::Hard(response) => response.keep(compiled, s),
            LawResponse::Mujoco(solution) => {
                if let Some(system) = &mut s.problem.soft {
                    solution.copy_from_slice(&system.acceleration);
                    system.settle(compiled, &s.free_motion.smooth.mass, &s.free_motion.smooth.acc);
                }
            }
        }
        self.return_to_beginning(s);
        self.overlaps.hold(compiled, s);
        if let LawResponse::Hard(response) = &mut self.law {
            sound = response.settle(compiled, options, s, sound);
        }
        sound = self.respond(compiled, options, s, Recomputed::Configuration, sound, &mut |_| {});
        self.find_changes(compiled, s, 0);
        R::vectorize(
            #[inline(always)]
            || {
                let (mut apart, mut speed) = (R::zero(), R::one());
                for &change in &self.changes[0] {
                    // This form propagates a NaN.
                    apart = R::select(change.abs().le(apart), apart, change.abs());
                }
                for &v in &self.after[1] {
                    speed = speed.max(v.abs());
                }
                sound & apart.le(speed * R::of(FAITHFUL)).bits()
            },
        )
    }

    /// Restores the state and the controls before the step.
    fn return_to_beginning(&self, s: &mut Workspace<R>) {
        let State { q, v, act, .. } = &mut s.state;
        for (to, kept) in [q, v, act, &mut s.inputs.ctrl].into_iter().zip(&self.before) {
            to.copy_from_slice(kept);
        }
    }

    /// Displacements of a column at its points.
    fn offsets(&self, query: &DerivativeQuery<'_>, alive: u32, column: usize, columns: usize) -> [R; 2] {
        let mut offsets = [R::one(); 2];
        for (point, offset) in offsets.iter_mut().enumerate().take(query.points) {
            for l in each_of(alive) {
                offset.set_lane(l, Scalar::from_f64(query.offsets[(l * query.points + point) * columns + column]));
            }
        }
        offsets
    }

    /// Evaluates the step with one coordinate displaced. Returns the lanes of `lanes` in which all constraints still exist.
    ///
    /// Calls `near` with the constraints that have come closer to another mode in these lanes.
    fn evaluate(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        (part, i, offset): (StatePart, usize, R),
        lanes: u32,
        near: &mut dyn FnMut(Followed),
    ) -> u32 {
        match part {
            StatePart::Qpos => {
                self.direction[i] = R::one();
                displace(compiled, &self.before[0], &self.direction, offset, &mut s.state.q);
                self.direction[i] = R::zero();
            }
            StatePart::Qvel => s.state.v[i] = self.before[1][i] + offset,
            StatePart::Act => s.state.act[i] = self.before[2][i] + offset,
            StatePart::Ctrl => s.inputs.ctrl[i] = self.before[3][i] + offset,
        }
        let lanes = self.respond(compiled, options, s, part.recomputed(), lanes, near);
        self.return_to_beginning(s);
        lanes
    }

    fn respond(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        recomputed: Recomputed,
        lanes: u32,
        near: &mut dyn FnMut(Followed),
    ) -> u32 {
        match &mut self.law {
            LawResponse::Hard(response) => response.follow(compiled, options, s, recomputed, lanes, near),
            LawResponse::Mujoco(solution) => {
                if recomputed == Recomputed::Configuration {
                    s.evaluation.poses.begin();
                }
                mujoco::respond_step(compiled, options, s, solution, recomputed);
                if recomputed == Recomputed::Configuration { compare_overlaps(compiled, s, lanes, near) } else { lanes }
            }
        }
    }

    /// Computes the displacement from the state after the step to the displaced one.
    fn find_changes(&mut self, compiled: &LaneModel<R>, s: &Workspace<R>, point: usize) {
        let Self { after, changes, .. } = self;
        R::vectorize(
            #[inline(always)]
            || {
                let (moved, rates) = changes[point].split_at_mut(compiled.nv);
                for joint in &compiled.joints {
                    let turn = match joint.kind {
                        JointKind::Free => Some(3),
                        JointKind::Ball => Some(0),
                        JointKind::Slide | JointKind::Hinge => None,
                    };
                    for k in 0..turn.unwrap_or(1) {
                        moved[joint.v + k] = s.position.q[joint.q + k] - after[0][joint.q + k];
                    }
                    if let Some(k) = turn {
                        let [w, x, y, z] = quat_at(&after[0], joint.q + k);
                        let turned = quat_log(quat_mul([w, -x, -y, -z], quat_at(&s.position.q, joint.q + k)));
                        moved[joint.v + k..joint.v + k + 3].copy_from_slice(&turned);
                    }
                }
                let pairs = s.velocity.v.iter().chain(&s.position.act).zip(after[1].iter().chain(&after[2]));
                for (rate, (&next, &after)) in rates.iter_mut().zip(pairs) {
                    *rate = next - after;
                }
            },
        )
    }

    /// Writes the derivatives of a column from the changes at its points, and flags slopes that differ between the sides.
    fn write_slopes(&mut self, offsets: &[R], noise: f64, alive: u32, rows: &mut DerivativeRows<'_>, (c, columns): (usize, usize)) {
        let n = self.changes[0].len();
        let nv = self.before[1].len();
        let [first, second] = &mut self.changes;
        let kinked = R::vectorize(
            #[inline(always)]
            || {
                let a = offsets[0];
                let Some(&b) = offsets.get(1) else {
                    first.iter_mut().for_each(|change| *change /= a);
                    return 0;
                };
                // Weights of the parabola through both points and the nominal one.
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
        for l in each_of(alive) {
            for (i, slope) in first.iter().enumerate() {
                rows.slopes[(l * n + i) * columns + c] = slope.lane(l).to_f64();
            }
            if kinked >> l & 1 == 1 {
                rows.causes[l * columns + c] |= SLOPE;
            }
        }
    }
}

//! Guard against motion that is too fast for the time step.
//!
//! Inertial forces are quadratic in the velocity. The step evaluates them explicitly, with one corrector iteration. If a joint rotates by a
//! large part of a radian per step, the corrector may diverge. The forces of a wrong velocity then produce a larger one, until the numbers
//! overflow.
//!
//! Such a step omits the inertial forces and sets status UNRESOLVED. In addition, the velocity is scaled down so that two bounds hold.
//! The kinetic energy is at most the kinetic energy before the step plus the work of the forces that the step keeps. Positive work of
//! contacts does not count. No joint except a slide leaves the step with more than one radian per step.
//!
//! A step that passes this test may still gain energy, because its inertial forces use an estimated velocity. The energy of a whipping
//! chain may grow by a tenth within 0.1 s. If the corrector changes the velocity by a twentieth, the step computes its energy balance
//! (`StepResolution::find_energy_gain`). A gain sets status UNRESOLVED and leaves the motion unchanged.
//!
//! The two bounds also hold where impulses rotate a joint by half a turn or more within the step, for example levers in a jam. The rows are
//! linearised at one pose and are invalid that far away. Such a step keeps its inertial forces.

use stepper_real::{Mask, Real, kernel};

use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::VelocitySolution;
use crate::dynamics::inertia::{NewtonEuler, link_forces};
use crate::dynamics::kinematics::{Kinematics, blend, displace, kinetic_energy};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::tuning::{
    BALANCE_RELATIVE_CHANGE, BALANCE_ROTATION, FAST_ROTATION, IMPACT_RELATIVE_CHANGE, MAX_GROWTH, MAX_GROWTH_RATE, MAX_IMPULSE_ROTATION,
    MAX_RELATIVE_CHANGE, MAX_ROTATION,
};

/// Two masks: lanes in which the corrector has not converged, and lanes that need an energy balance. The corrector computes the free
/// velocity again, with inertial forces at the predicted velocity.
///
/// `v` is the velocity before the step, and `v_free` the velocity after it without constraints. `change` is the change of `v_free` by the
/// corrector. All are generalized velocities.
pub fn assess_corrector<R: Real>(compiled: &LaneModel<R>, v: &[R], v_free: &[R], change: &[R], h: R) -> [R::Mask; 2] {
    kernel!(R, || {
        let turn = max_joint_rate(compiled, v).max(max_joint_rate(compiled, v_free)) * h;
        let active = turn.gt(R::of(BALANCE_ROTATION));
        if active.none() {
            return [active; 2];
        }
        let (mut speed, mut largest_change) = (R::zero(), R::zero());
        for i in 0..compiled.nv {
            speed = speed.max(v[i].abs()).max(v_free[i].abs());
            largest_change = largest_change.max_or_nan(change[i].abs());
        }
        let fast = turn.gt(R::of(FAST_ROTATION));
        [
            fast.and_not(largest_change.le(speed * R::of(MAX_RELATIVE_CHANGE))),
            active.and_not(largest_change.le(speed * R::of(BALANCE_RELATIVE_CHANGE))),
        ]
    })
}

/// Lanes in which constraint impulses rotate a hinge or ball joint by more than half a turn per step. `v_next` is the velocity after the
/// step.
///
/// In addition, the joint must be faster than every joint in `v`, the velocity before the step, and in `v_free`, the velocity without
/// constraints.
pub fn diverging<R: Real>(compiled: &LaneModel<R>, [v, v_free]: [&[R]; 2], v_next: &[R], h: R) -> R::Mask {
    kernel!(R, || {
        let mut turn = R::zero();
        for joint in compiled.joints.iter().filter(|j| matches!(j.kind, JointKind::Hinge | JointKind::Ball)) {
            for &v in &v_next[joint.v..joint.v + joint.kind.nv()] {
                turn = turn.max(v.abs());
            }
        }
        let far = (turn * h).gt(R::of(MAX_IMPULSE_ROTATION));
        if far.none() {
            return far;
        }
        far.and(turn.gt(max_joint_rate(compiled, v).max(max_joint_rate(compiled, v_free))))
    })
}

/// Largest angular velocity of any joint, rad/s.
#[inline(always)]
fn max_joint_rate<R: Real>(compiled: &LaneModel<R>, v: &[R]) -> R {
    let mut turn = R::zero();
    for joint in compiled.joints.iter().filter(|j| j.kind != JointKind::Slide) {
        let first = if joint.kind == JointKind::Free { 3 } else { 0 };
        for d in joint.v + first..joint.v + joint.kind.nv() {
            turn = turn.max(v[d].abs());
        }
    }
    turn
}

/// Scales `v` down in the lanes `lanes`, so that the fastest joint rotates by at most one radian per step.
pub fn limit_joint_rates<R: Real>(compiled: &LaneModel<R>, lanes: R::Mask, h: R, v: &mut [R]) {
    kernel!(R, || {
        let turn = max_joint_rate(compiled, v) * h;
        let fast = lanes.and(turn.gt(R::of(MAX_ROTATION)));
        let factor = R::select(fast, R::of(MAX_ROTATION) / R::select(fast, turn, R::one()), R::one());
        for v in v {
            *v *= factor;
        }
    })
}

/// Kinetic energy of bodies and armatures at the configuration of `kinematics`, J.
fn kinetic_energy_with_rotors<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], velocity: &mut [V6<R>]) -> R {
    kernel!(R, || {
        kinematics.velocities(compiled, v, velocity);
        let mut sum = kinetic_energy(kinematics, velocity);
        for (d, &v) in v.iter().enumerate() {
            sum += compiled.params.dof(d).armature * v.square() * R::of(0.5);
        }
        sum
    })
}

/// Workspace of the checks for motion that is too fast for the time step: energy balance, and energy limit.
#[derive(Clone, Debug)]
pub struct StepResolution<R: Real> {
    /// Configuration after the step before position corrections, nq.
    q_end: Vec<R>,
    /// Limited velocity after the step, nv.
    v_limited: Vec<R>,
    /// Velocity at which inertial forces are evaluated, nv.
    force_velocity: Vec<R>,
    kinematics: Kinematics<R>,
    /// Buffer for the spatial velocity of every link.
    velocity: Vec<V6<R>>,
    /// Change of the spatial velocity of every link by the step.
    change: Vec<V6<R>>,
    /// Mean velocity of the step, and change of the velocity by the step, nv each.
    mean: [Vec<R>; 2],
    newton_euler: NewtonEuler<R>,
    /// Whether each link is alone in its tree, on a free or ball joint.
    single_link: Vec<bool>,
}

impl<R: Real> StepResolution<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let mut single_link = vec![false; compiled.links.len()];
        compiled.spinners.iter().for_each(|spinner| single_link[spinner.link] = true);
        Self {
            q_end: vec![R::zero(); compiled.nq],
            v_limited: vec![R::zero(); compiled.nv],
            force_velocity: vec![R::zero(); compiled.nv],
            kinematics: Kinematics::new(compiled),
            velocity: vec![zero(); compiled.links.len()],
            change: vec![zero(); compiled.links.len()],
            mean: std::array::from_fn(|_| vec![R::zero(); compiled.nv]),
            newton_euler: NewtonEuler::new(compiled),
            single_link,
        }
    }

    /// Lanes in which the error of the midpoint rule adds so much kinetic energy that the step counts as unresolved. The test comes
    /// before the correction of positions. The lanes `excluded` are not tested, because the Runge-Kutta scheme replaces their step.
    ///
    /// The work of forces and impulses f is f . (v + v+) / 2, and f = M (v+ - v) + h c. M is the mass matrix and c the inertial force, both
    /// in the middle of the step and at the velocity `force_velocity`. The energy gained by the error of the step is therefore
    ///
    /// ```text
    /// K(q+, v+) - K(q, v) - (v + v+) / 2 . (M (v+ - v) + h c),
    /// ```
    ///
    /// for all kinds of forces: of actuators, damping, friction and contacts. The error in the work of gravity and springs is neglected: in
    /// chains that gain 98 J, it is 0.01 J. Links alone in their tree do not count, because the midpoint rule conserves their energy. A
    /// gain below the kinetic energy at the speed of the solver's tolerance does not count either. It may be the rounding error of
    /// constraints that hold bodies, if these would move fast without constraints.
    #[inline(always)]
    pub(crate) fn find_energy_gain(
        &mut self,
        context: StepContext<'_, R>,
        free: &FreeMotion<R>,
        velocity: &VelocitySolution<R>,
        excluded: R::Mask,
    ) -> R::Mask {
        let StepContext { input: StepInput { compiled, options, state, .. }, evaluation } = context;
        let Evaluation { scheme, q, kinematics: middle, .. } = evaluation;
        if !scheme.predicts() || !scheme.in_the_middle {
            return R::Mask::splat(false);
        }
        // A step that is evaluated at another time than its middle has an energy error of first order in its rotation, which this test
        // would report.
        let lanes = free.may_gain.and_not(free.unresolved).and_not(excluded).and(scheme.time_before.eq(scheme.time_after));
        if lanes.none() {
            return lanes;
        }
        let (before, v_next) = ([&state.q[..], &state.v[..]], &velocity.v);
        displace(compiled, q, v_next, scheme.time_after, &mut self.q_end);
        let negligible = free.smooth.mass.energy_at(R::of(options.tolerance));
        self.place_mocap(compiled, middle);
        blend(before[1], &free.v_expected, scheme.velocity_weight, &mut self.force_velocity);
        let (h, v_free) = (scheme.h, &free.v);
        let gains = kernel!(R, || {
            let [mean, change] = &mut self.mean;
            let mut work = R::zero();
            for d in 0..compiled.nv {
                mean[d] = (before[1][d] + v_next[d]) * R::of(0.5);
                change[d] = v_next[d] - before[1][d];
                work += compiled.params.dof(d).armature * mean[d] * change[d];
            }
            middle.velocities(compiled, mean, &mut self.velocity);
            middle.velocities(compiled, change, &mut self.change);
            link_forces(compiled, middle, &self.force_velocity, &mut self.newton_euler);
            let ground = spatial(zero(), scale(compiled.params.gravity(), -R::one()));
            for l in 0..compiled.links.len() {
                if !self.single_link[l] {
                    let momentum = apply_inertia(&middle.inertia[l], &self.change[l]);
                    let weight = apply_inertia(&middle.inertia[l], &ground);
                    work += dot6(self.velocity[l], momentum) + dot6(self.velocity[l], self.newton_euler.force[l]) * h;
                    work -= dot6(self.velocity[l], weight) * h;
                }
            }
            let start = self.kinetic_energy_of_chains(compiled, before);
            let q_end = std::mem::take(&mut self.q_end);
            let end = self.kinetic_energy_of_chains(compiled, [&q_end, v_next]);
            self.q_end = q_end;
            let (mut pushed, mut fastest) = (R::zero(), R::zero());
            for d in 0..compiled.nv {
                pushed = pushed.max((v_next[d] - v_free[d]).abs());
                fastest = fastest.max(v_next[d].abs()).max(before[1][d].abs());
            }
            let max_gain = (h * R::of(MAX_GROWTH_RATE)).min(R::of(MAX_GROWTH)) * start.max(end);
            let is_impact = pushed.gt(fastest * R::of(IMPACT_RELATIVE_CHANGE));
            ((end - start) - work).gt(R::select(is_impact, max_gain + max_gain, max_gain) + negligible)
        });
        lanes.and(gains)
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
        [&mut self.q_end, &mut self.v_limited, &mut self.force_velocity].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }

    /// Sets the poses of mocap bodies to their poses in `middle`, in the middle of the step.
    fn place_mocap(&mut self, compiled: &LaneModel<R>, middle: &Kinematics<R>) {
        for mocap in &compiled.mocap {
            self.kinematics.pos[mocap.frame] = middle.pos[mocap.frame];
            self.kinematics.mat[mocap.frame] = middle.mat[mocap.frame];
        }
    }

    /// Kinetic energy of armatures, and of the links that are not alone in their tree, J.
    #[inline(always)]
    fn kinetic_energy_of_chains(&mut self, compiled: &LaneModel<R>, [q, v]: [&[R]; 2]) -> R {
        self.kinematics.update(compiled, q);
        self.kinematics.velocities(compiled, v, &mut self.velocity);
        let mut twice = R::zero();
        for l in 0..compiled.links.len() {
            if !self.single_link[l] {
                twice += dot6(apply_inertia(&self.kinematics.inertia[l], &self.velocity[l]), self.velocity[l]);
            }
        }
        for (d, &v) in v.iter().enumerate() {
            twice += compiled.params.dof(d).armature * v.square();
        }
        twice * R::of(0.5)
    }

    /// Scales the velocity after the step down, in the lanes `lanes`, until the energy bound holds. `q` is the configuration after the
    /// step.
    ///
    /// The allowed kinetic energy is that before the step plus the work of forces in the step. Constraints changed the velocity from
    /// `v_free`; their work counts only if it is negative. The work is computed with the mass matrix in the middle of the step.
    #[inline(always)]
    pub(crate) fn limit_energy(
        &mut self,
        context: StepContext<'_, R>,
        v_free: &[R],
        velocity: &mut VelocitySolution<R>,
        q: &[R],
        lanes: R::Mask,
    ) {
        if lanes.none() {
            return;
        }
        let StepContext { input: StepInput { compiled, state, .. }, evaluation: Evaluation { kinematics: middle, .. } } = context;
        let (before, v) = ([&state.q[..], &state.v[..]], &velocity.v);
        self.place_mocap(compiled, middle);
        kernel!(R, || {
            let mut energy_with = |v: &[R]| kinetic_energy_with_rotors(compiled, middle, v, &mut self.velocity);
            let work = energy_with(v).min(energy_with(v_free)) - energy_with(before[1]);
            self.kinematics.update(compiled, before[0]);
            let start = kinetic_energy_with_rotors(compiled, &self.kinematics, before[1], &mut self.velocity);
            self.kinematics.update(compiled, q);
            let end = kinetic_energy_with_rotors(compiled, &self.kinematics, v, &mut self.velocity);
            let allowed = (start + work).max(R::zero());
            let slower = lanes.and(end.gt(allowed));
            let factor = R::select(slower, (allowed / R::select(slower, end, R::one())).sqrt(), R::one());
            for (out, &v) in self.v_limited.iter_mut().zip(v) {
                *out = v * factor;
            }
        });
        std::mem::swap(&mut velocity.v, &mut self.v_limited);
    }
}

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

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::System;

use crate::compile::{CompiledJoint, LaneModel, MechanismPart, ModelStructure};
use crate::constraints::islands::IslandLoad;
use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::dynamics::inertia::{MassMatrix, NewtonEuler, bias_force, link_forces};
use crate::dynamics::kinematics::{Kinematics, blend, displace};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::evaluate::mechanism_motion::MechanismMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::tuning::{
    BALANCE_RELATIVE_CHANGE, BALANCE_ROTATION, FAST_ROTATION, IMPACT_RELATIVE_CHANGE, MAX_GROWTH, MAX_GROWTH_RATE, MAX_IMPULSE_ROTATION,
    MAX_RATE_GROWTH, MAX_RELATIVE_CHANGE, MAX_ROTATION,
};

/// Lanes of `alive` that need an energy balance. Also adds to `unresolved` the lanes in which the corrector of each mechanism has not
/// converged. The corrector computes the free velocity again, with inertial forces at the predicted velocity.
///
/// `v` is the velocity before the step, and `v_free` the velocity after it without constraints. `change` is the change of `v_free` by the
/// corrector. All are generalized velocities. Overwrites `motions`.
pub(crate) fn assess_corrector<R: Real>(
    compiled: &LaneModel<R>,
    alive: R::Mask,
    [v, v_free, change]: [&[R]; 3],
    h: R,
    (motions, unresolved): (&mut [MechanismMotion<R>], &mut [R::Mask]),
) -> R::Mask {
    kernel!(R, || {
        let mut may_gain = R::Mask::splat(false);
        if find_turns(compiled, [v, v_free], h, motions).gt(R::of(BALANCE_ROTATION)).none() {
            return may_gain;
        }
        for part in &compiled.mechanisms.parts {
            let MechanismMotion { mut speed, change: mut largest, .. } = motions[part.mechanism];
            for ((v, v_free), change) in v[part.dofs.clone()].iter().zip(&v_free[part.dofs.clone()]).zip(&change[part.dofs.clone()]) {
                speed = speed.max(v.abs()).max(v_free.abs());
                largest = largest.max_or_nan(change.abs());
            }
            motions[part.mechanism] = MechanismMotion { speed, change: largest, ..motions[part.mechanism] };
        }
        for (motion, unresolved) in motions.iter().zip(unresolved) {
            let exceeds = |ratio: f64| alive.and_not(motion.change.le(motion.speed * R::of(ratio)));
            *unresolved = unresolved.or(motion.turn.gt(R::of(FAST_ROTATION)).and(exceeds(MAX_RELATIVE_CHANGE)));
            may_gain = may_gain.or(motion.turn.gt(R::of(BALANCE_ROTATION)).and(exceeds(BALANCE_RELATIVE_CHANGE)));
        }
        may_gain
    })
}

/// Adds to `unresolved` the lanes of `alive` in which constraint impulses rotate a hinge or ball joint of a mechanism by more than half a
/// turn per step. `v_next` is the velocity after the step.
///
/// In addition, the joint must be faster than every joint of the mechanism in `v`, the velocity before the step, and in `v_free`, the
/// velocity without constraints. Overwrites `motions`.
pub(crate) fn find_diverging<R: Real>(
    compiled: &LaneModel<R>,
    alive: R::Mask,
    [v, v_free, v_next]: [&[R]; 3],
    h: R,
    (motions, unresolved): (&mut [MechanismMotion<R>], &mut [R::Mask]),
) {
    let turns = |joint: &&CompiledJoint<R::Scalar>| matches!(joint.kind, JointKind::Hinge | JointKind::Ball);
    kernel!(R, || {
        if (max_joint_rate(compiled, v_next) * h).gt(R::of(MAX_IMPULSE_ROTATION)).none() {
            return;
        }
        find_turns(compiled, [v, v_free], h, motions);
        for joint in compiled.joints.iter().filter(turns) {
            let mechanism = compiled.mechanism_of(joint.v);
            for &v in &v_next[joint.v..joint.v + joint.kind.nv()] {
                let turn = v.abs() * h;
                let diverges = turn.gt(R::of(MAX_IMPULSE_ROTATION)).and(turn.gt(motions[mechanism].turn));
                unresolved[mechanism] = unresolved[mechanism].or(alive.and(diverges));
            }
        }
    });
}

/// Computes the largest joint rotation of each mechanism in `h` seconds, at either of two velocities. Returns the largest of all, rad.
/// Overwrites `motions`.
#[inline(always)]
fn find_turns<R: Real>(compiled: &LaneModel<R>, [a, b]: [&[R]; 2], h: R, motions: &mut [MechanismMotion<R>]) -> R {
    let mut largest = R::zero();
    motions.fill(MechanismMotion::default());
    for part in &compiled.mechanisms.parts {
        let turn = rate_of_part(part, a).max(rate_of_part(part, b)) * h;
        motions[part.mechanism].turn = motions[part.mechanism].turn.max(turn);
        largest = largest.max(turn);
    }
    largest
}

/// Lanes in which a step without a corrector turns a joint by more than half a turn and makes the fastest joint faster by more than a
/// tenth. Explicit forces have diverged there: those of stiff servos, springs and contacts, and inertial forces.
///
/// `v` is the velocity before the step, and `v_next` the velocity after it.
pub(crate) fn runs_away<R: Real>(compiled: &LaneModel<R>, v: &[R], v_next: &[R], h: R) -> R::Mask {
    kernel!(R, || {
        let rate = max_joint_rate(compiled, v_next);
        let faster = rate.gt(max_joint_rate(compiled, v) * R::of(1.0 + MAX_RATE_GROWTH));
        faster.and((rate * h).gt(R::of(MAX_IMPULSE_ROTATION)))
    })
}

/// Largest component of the angular velocity of any joint, rad/s.
#[inline(always)]
fn max_joint_rate<R: Real>(compiled: &LaneModel<R>, v: &[R]) -> R {
    let mut rate = R::zero();
    for part in &compiled.mechanisms.parts {
        rate = rate.max(rate_of_part(part, v));
    }
    rate
}

/// Largest component of the angular velocity of the joints in a part of a mechanism, rad/s.
#[inline(always)]
fn rate_of_part<R: Real>(part: &MechanismPart, v: &[R]) -> R {
    let mut rate = R::zero();
    for rotations in &part.rotations {
        for v in &v[rotations.clone()] {
            rate = rate.max(v.abs());
        }
    }
    rate
}

/// Computes the kinetic energy of each kinematic tree, armatures included, at the configuration of `kinematics`, J.
#[inline(always)]
fn kinetic_energies<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], velocity: &mut [V6<R>], out: &mut [R]) {
    kinematics.velocities(compiled, v, velocity);
    out.fill(R::zero());
    for (l, link) in compiled.links.iter().enumerate() {
        out[link.tree] += dot6(apply_inertia(&kinematics.inertia[l], &velocity[l]), velocity[l]) * R::of(0.5);
    }
    for (d, &v) in v.iter().enumerate() {
        out[compiled.dofs[d].tree] += compiled.params.dof(d).armature * v.square() * R::of(0.5);
    }
}

/// Workspace of the checks for motion that is too fast for the time step: energy balance, and energy limit.
#[derive(Clone, Debug)]
pub struct StepResolution<R: Real> {
    /// Configuration after the step before position corrections, nq.
    q_end: Vec<R>,
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
    is_single_body: Vec<bool>,
    /// Lanes (bits) in which the motion of each kinematic tree is limited.
    limited: Vec<u32>,
    /// Factor of the velocity of each kinematic tree.
    factors: Vec<R>,
    /// Kinetic energies of each kinematic tree, J: with the inertias at the evaluation point at three velocities (after the step, after it
    /// without constraints, before it), before the step, and after it.
    energies: [Vec<R>; 5],
}

impl<R: Real> StepResolution<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let mut is_single_body = vec![false; compiled.links.len()];
        compiled.single_bodies.iter().for_each(|single| is_single_body[single.link] = true);
        Self {
            q_end: vec![R::zero(); compiled.nq],
            force_velocity: vec![R::zero(); compiled.nv],
            kinematics: Kinematics::new(compiled),
            velocity: vec![zero(); compiled.links.len()],
            change: vec![zero(); compiled.links.len()],
            mean: std::array::from_fn(|_| vec![R::zero(); compiled.nv]),
            newton_euler: NewtonEuler::new(compiled),
            is_single_body,
            limited: vec![0; compiled.ntree],
            factors: vec![R::one(); compiled.ntree],
            energies: std::array::from_fn(|_| vec![R::zero(); compiled.ntree]),
        }
    }

    /// Lanes in which the error of the midpoint or implicit rule adds so much kinetic energy that the step counts as unresolved. The test
    /// comes before the correction of positions. `replaced` returns the lanes of a mechanism that are not tested, because the Runge-Kutta
    /// scheme replaces their step. With Euler's rule, the function returns the lanes in which a joint [runs away](runs_away).
    ///
    /// The work of forces and impulses f is f . (v + v+) / 2, and f = M (v+ - v) + h c. M is the mass matrix and c the inertial force, both
    /// at the evaluation point of the step and at the velocity `force_velocity`. The energy gained by the error of the step is therefore
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
        replaced: impl Fn(usize) -> R::Mask,
    ) -> R::Mask {
        let StepContext { input: StepInput { compiled, options, state, alive, .. }, evaluation } = context;
        let Evaluation { scheme, times, q, kinematics: middle, .. } = evaluation;
        if !scheme.implicit_forces {
            return alive.and(runs_away(compiled, &state.v, &velocity.v, scheme.h));
        }
        let lanes = free.may_gain.and_not(free.unresolved_lanes());
        if lanes.none() {
            return lanes;
        }
        let (before, v_next) = ([&state.q[..], &state.v[..]], &velocity.v);
        // Constraints may stop a fast free motion. The balance of a slow motion would be rounding error of large impulses.
        let lanes = kernel!(R, || {
            let turn = max_joint_rate(compiled, before[1]).max(max_joint_rate(compiled, v_next)) * scheme.h;
            lanes.and(turn.gt(R::of(BALANCE_ROTATION)))
        });
        if lanes.none() {
            return lanes;
        }
        displace(compiled, q, v_next, scheme.h - scheme.time_before, &mut self.q_end);
        let negligible = free.smooth.mass.energy_at(R::of(options.tolerance));
        self.kinematics.copy_mocap_poses(compiled, middle);
        blend(before[1], &free.v_expected, scheme.velocity_weight, &mut self.force_velocity);
        let (h, v_free) = (scheme.h, &free.v);
        // A mechanism that is evaluated at another time than the middle of the step has an energy error of first order in its rotation,
        // which this test would report.
        let counts_of = |mechanism: usize| times.moved_lanes(mechanism).or(replaced(mechanism)).not();
        let gains = kernel!(R, || {
            let [mean, change] = &mut self.mean;
            let mut work = R::zero();
            for d in 0..compiled.nv {
                let counts = counts_of(compiled.mechanism_of(d));
                mean[d] = (before[1][d] + v_next[d]) * R::of(0.5);
                change[d] = v_next[d] - before[1][d];
                work += R::select(counts, compiled.params.dof(d).armature * mean[d] * change[d], R::zero());
            }
            middle.velocities(compiled, mean, &mut self.velocity);
            middle.velocities(compiled, change, &mut self.change);
            link_forces(compiled, middle, &self.force_velocity, &mut self.newton_euler);
            let ground = spatial(zero(), scale(compiled.params.gravity(), -R::one()));
            for l in 0..compiled.links.len() {
                if !self.is_single_body[l] {
                    let momentum = apply_inertia(&middle.inertia[l], &self.change[l]);
                    let weight = apply_inertia(&middle.inertia[l], &ground);
                    let counts = counts_of(compiled.mechanisms.of_tree[compiled.links[l].tree]);
                    let inertial = dot6(self.velocity[l], momentum) + dot6(self.velocity[l], self.newton_euler.force[l]) * h;
                    work = R::select(counts, work + inertial - dot6(self.velocity[l], weight) * h, work);
                }
            }
            let start = self.kinetic_energy_of_chains(compiled, &counts_of, before);
            let q_end = std::mem::take(&mut self.q_end);
            let end = self.kinetic_energy_of_chains(compiled, &counts_of, [&q_end, v_next]);
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

    /// Finds the lanes of `alive` in which inertial forces of each mechanism change too much, into `unresolved`, with MuJoCo's contact law.
    /// Lanes in which a joint [runs away](runs_away) count too. MuJoCo's rules evaluate inertial forces at the velocity before the step.
    ///
    /// The bound is that of [`assess_corrector`], for the change of the velocity by inertial forces at the velocity after the step instead.
    /// This bound applies if a joint turns by more than `rotation`, rad. `v` is the velocity before the step, and `v_next` the velocity
    /// after it. Overwrites `motions`.
    #[inline(always)]
    pub(crate) fn assess_explicit_step(
        &mut self,
        compiled: &LaneModel<R>,
        alive: R::Mask,
        (kinematics, mass): (&Kinematics<R>, &MassMatrix<R>),
        [v, v_next]: [&[R]; 2],
        (rotation, h): (f64, R),
        (motions, unresolved): (&mut [MechanismMotion<R>], &mut [R::Mask]),
    ) {
        let runs_away = alive.and(runs_away(compiled, v, v_next, h));
        unresolved.fill(runs_away);
        let fast = kernel!(R, || (max_joint_rate(compiled, v).max(max_joint_rate(compiled, v_next)) * h).gt(R::of(rotation)));
        if fast.none() {
            return;
        }
        let [change, after] = &mut self.mean;
        kernel!(R, || {
            for (v, force) in [(v, &mut *change), (v_next, &mut *after)] {
                bias_force(compiled, kinematics, v, &mut self.newton_euler, force);
            }
            for (change, &after) in change.iter_mut().zip(&*after) {
                *change = (*change - after) * h;
            }
            mass.solve(compiled, change);
        });
        assess_corrector(compiled, alive, [v, v_next, change], h, (motions, &mut *unresolved));
        for lanes in unresolved {
            *lanes = runs_away.or(fast.and(*lanes));
        }
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
        [&mut self.q_end, &mut self.force_velocity].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }

    /// Kinetic energy of armatures, and of the links that are not alone in their tree, J. `counts_of` returns the lanes in which a
    /// mechanism counts.
    #[inline(always)]
    fn kinetic_energy_of_chains(&mut self, compiled: &LaneModel<R>, counts_of: &impl Fn(usize) -> R::Mask, [q, v]: [&[R]; 2]) -> R {
        let counts_in = |tree: usize| counts_of(compiled.mechanisms.of_tree[tree]);
        self.kinematics.update(compiled, q);
        self.kinematics.velocities(compiled, v, &mut self.velocity);
        let mut twice = R::zero();
        for l in 0..compiled.links.len() {
            if !self.is_single_body[l] {
                let energy = dot6(apply_inertia(&self.kinematics.inertia[l], &self.velocity[l]), self.velocity[l]);
                twice += R::select(counts_in(compiled.links[l].tree), energy, R::zero());
            }
        }
        for (d, &v) in v.iter().enumerate() {
            let energy = compiled.params.dof(d).armature * v.square();
            twice += R::select(counts_in(compiled.dofs[d].tree), energy, R::zero());
        }
        twice * R::of(0.5)
    }

    /// Finds the kinematic trees whose motion is limited: those of islands with an unresolved mechanism or an ambiguous energy. `lanes` has
    /// the lanes with such an island, `ambiguous` those with an ambiguous energy (one that the solver's residual may change noticeably).
    ///
    /// An ambiguous energy belongs to the islands that are ambiguous by themselves. If there are none, it belongs to all trees with
    /// constraints.
    #[cold]
    #[inline(never)]
    pub(crate) fn find_limited(
        &mut self,
        compiled: &LaneModel<R>,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        unresolved: &[R::Mask],
        [lanes, ambiguous]: [R::Mask; 2],
        is_ambiguous: impl Fn(usize, IslandLoad) -> bool,
    ) {
        let VelocitySolution { impulses, islands, .. } = velocity;
        let limited = &mut self.limited;
        limited.fill(0);
        for lane in each_of(lanes.bits()) {
            islands.find(compiled, System::from(&problem.rows), lane);
            if ambiguous.bits() >> lane & 1 == 1 {
                islands.add_loads(compiled, System::from(&problem.rows), impulses, lane);
                let any = (0..compiled.ntree).any(|tree| is_ambiguous(lane, islands.of_tree(tree).load));
                for tree in 0..compiled.ntree {
                    let load = islands.of_tree(tree).load;
                    if if any { is_ambiguous(lane, load) } else { load.is_constrained } {
                        islands.raise_max(tree, 1.0);
                    }
                }
            }
            for (tree, &mechanism) in compiled.mechanisms.of_tree.iter().enumerate() {
                islands.raise_max(tree, f64::from(unresolved[mechanism].bits() >> lane & 1));
            }
            for (tree, limited) in limited.iter_mut().enumerate() {
                *limited |= u32::from(islands.of_tree(tree).most > 0.0) << lane;
            }
        }
    }

    /// Scales the velocity after the step down in limited islands ([`StepResolution::find_limited`]), so that their fastest joint rotates
    /// by at most one radian per step. `lanes` has the lanes with such an island.
    pub(crate) fn limit_joint_rates(
        &mut self,
        compiled: &LaneModel<R>,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        lanes: R::Mask,
        h: R,
    ) {
        let VelocitySolution { v, islands, .. } = velocity;
        let Self { limited, factors, .. } = self;
        factors.fill(R::one());
        for lane in each_of(lanes.bits()) {
            islands.find(compiled, System::from(&problem.rows), lane);
            for dof in compiled.rotations() {
                islands.raise_max(compiled.dofs[dof].tree, (v[dof].abs() * h).lane(lane).to_f64());
            }
            for (tree, factor) in factors.iter_mut().enumerate().filter(|(tree, _)| limited[*tree] >> lane & 1 == 1) {
                let turn = islands.of_tree(tree).most;
                if turn > MAX_ROTATION {
                    factor.set_lane(lane, R::of(MAX_ROTATION / turn).lane(lane));
                }
            }
        }
        scale_trees(compiled, factors, v);
    }

    /// Scales the velocity after the step down, in limited islands ([`StepResolution::find_limited`]), until the energy bound holds. `q` is
    /// the configuration after the step. `lanes` has the lanes with such an island.
    ///
    /// The allowed kinetic energy is that before the step plus the work of forces in the step. Constraints changed the velocity from
    /// `v_free`; their work counts only if it is negative. The work is computed with the mass matrix at the evaluation point.
    #[inline(always)]
    pub(crate) fn limit_energy(
        &mut self,
        context: StepContext<'_, R>,
        problem: &ConstraintProblem<R>,
        v_free: &[R],
        velocity: &mut VelocitySolution<R>,
        q: &[R],
        lanes: R::Mask,
    ) {
        if lanes.none() {
            return;
        }
        let StepContext { input: StepInput { compiled, state, .. }, evaluation: Evaluation { kinematics: middle, .. } } = context;
        self.kinematics.copy_mocap_poses(compiled, middle);
        let Self { kinematics, velocity: buffer, limited, factors, energies, .. } = self;
        let VelocitySolution { v, islands, .. } = velocity;
        kernel!(R, || {
            let [with_impulses, without_impulses, before, start, end] = energies;
            kinetic_energies(compiled, middle, v, buffer, with_impulses);
            kinetic_energies(compiled, middle, v_free, buffer, without_impulses);
            kinetic_energies(compiled, middle, &state.v, buffer, before);
            kinematics.update(compiled, &state.q);
            kinetic_energies(compiled, kinematics, &state.v, buffer, start);
            kinematics.update(compiled, q);
            kinetic_energies(compiled, kinematics, v, buffer, end);
        });
        factors.fill(R::one());
        for lane in each_of(lanes.bits()) {
            islands.find(compiled, System::from(&problem.rows), lane);
            for tree in 0..compiled.ntree {
                for (sum, energy) in islands.of_tree(tree).energies.iter_mut().zip(&*energies) {
                    *sum += energy[tree].lane(lane).to_f64();
                }
            }
            for (tree, factor) in factors.iter_mut().enumerate().filter(|(tree, _)| limited[*tree] >> lane & 1 == 1) {
                let [with_impulses, without_impulses, before, start, end] = islands.of_tree(tree).energies;
                let allowed = (start + with_impulses.min(without_impulses) - before).max(0.0);
                if end > allowed {
                    factor.set_lane(lane, R::of((allowed / end).sqrt()).lane(lane));
                }
            }
        }
        scale_trees(compiled, factors, v);
    }
}

/// Multiplies the velocity `v` of each kinematic tree by its factor.
fn scale_trees<R: Real>(compiled: &LaneModel<R>, factors: &[R], v: &mut [R]) {
    kernel!(R, || {
        for (d, v) in v.iter_mut().enumerate() {
            *v *= factors[compiled.dofs[d].tree];
        }
    });
}

//! Acceptance of a step: lanes whose next state is not finite keep their state.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::System;

use crate::compile::LaneModel;
use crate::constraints::worst_row::CodedConstraint;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::{Kinematics, all_finite, select_into};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::inputs::Inputs;
use crate::integrators::state::State;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::tuning::MAX_STATE;

/// Lanes whose step was accepted, and lanes that have left the range of plausible numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accepted<R: Real> {
    /// Lanes in which the whole next state is finite.
    pub(crate) finite: R::Mask,
    /// Lanes in which a number of the state exceeds [`MAX_STATE`].
    pub(crate) beyond: R::Mask,
    /// Lanes (bits) that keep their whole state and their time, because no island has a finite next state.
    pub(crate) kept: u32,
}

/// Accepts the step: the state of the workspace `s` becomes the next state, and its time advances by `h`, s.
///
/// In lanes whose next state is not finite, islands (sets of trees that constraint rows connect) with such a number keep positions,
/// velocities and activations, and discard contacts and impulses. If a mocap body has a pose that is not finite, or no island has a finite
/// state, the whole lane keeps its state and its time. For these lanes, the cause is stored in `s.velocity.worst`. After the call,
/// `s.velocity.v`, `s.position.q` and `s.position.act` have the state before the step.
#[inline(always)]
pub(crate) fn accept<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>, h: f64) -> Accepted<R> {
    let Workspace { state, inputs, evaluation, problem, velocity, position, alive, .. } = s;
    let alive = *alive;
    let (finite, beyond, poses_are_finite) = kernel!(R, || {
        let (mut finite, mut largest) = (R::Mask::splat(true), R::zero());
        for x in [&position.q, &velocity.v, &position.act] {
            finite = finite.and(all_finite(x));
            for &x in x {
                largest = largest.max(x.abs());
            }
        }
        // A mocap body with a NaN pose would have no contacts. Such a step is rejected.
        let (Kinematics { pos, mat, .. }, mut poses) = (&evaluation.kinematics, R::Mask::splat(true));
        for m in &compiled.mocap {
            poses = poses.and(all_finite(&pos[m.frame])).and(all_finite(&mat[m.frame]));
        }
        let finite = finite.and(poses);
        (finite, alive.and(finite).and(largest.gt(R::of(MAX_STATE))), poses)
    });
    let mut kept = 0;
    if !finite.and(alive).all() {
        for (next, old) in [(&mut position.q, &state.q), (&mut velocity.v, &state.v), (&mut position.act, &state.act)] {
            select_into(next, old, alive.not());
        }
        for lane in each_of(alive.and_not(finite).bits()) {
            let cause = find_not_finite(compiled, inputs, evaluation, (velocity, position), lane);
            velocity.worst.store(lane, cause);
            let keeps_all = poses_are_finite.bits() >> lane & 1 == 0;
            mark_non_finite(compiled, problem, velocity, position, lane, keeps_all);
            kept |= u32::from(keep_marked(compiled, state, evaluation, problem, velocity, position, lane)) << lane;
        }
    }
    for (_, time) in state.time.iter_mut().enumerate().filter(|(l, _)| kept >> l & 1 == 0) {
        *time += h;
    }
    // Mocap bodies move on in rejected lanes too, so that one number is enough for all lanes.
    state.elapsed += h;
    std::mem::swap(&mut state.q, &mut position.q);
    std::mem::swap(&mut state.v, &mut velocity.v);
    std::mem::swap(&mut state.act, &mut position.act);
    std::mem::swap(&mut state.contacts, &mut evaluation.contacts);
    Accepted { finite, beyond, kept }
}

/// Number of lane `lane` that is not finite in a rejected step. Inputs come before the state, which they make NaN.
#[cold]
fn find_not_finite<R: Real>(
    compiled: &LaneModel<R>,
    inputs: &Inputs<R>,
    evaluation: &Evaluation<R>,
    (velocity, position): (&VelocitySolution<R>, &PositionSolution<R>),
    lane: usize,
) -> Option<CodedConstraint> {
    let first = |x: &[R]| x.iter().position(|x| !x.lane(lane).to_f64().is_finite());
    let Kinematics { pos, mat, .. } = &evaluation.kinematics;
    let mocap = || compiled.mocap.iter().position(|m| first(&pos[m.frame]).or_else(|| first(&mat[m.frame])).is_some());
    let activation = || compiled.actuators.iter().position(|a| a.act.is_some_and(|act| first(&position.act[act..=act]).is_some()));
    let coordinate = || compiled.joints.iter().find(|j| first(&position.q[j.q..j.q + j.kind.nq()]).is_some()).map(|j| j.v);
    let dof = || first(&inputs.qfrc).or_else(|| first(&velocity.v)).or_else(coordinate);
    (first(&inputs.ctrl).map(CodedConstraint::NotFiniteActuator))
        .or_else(|| first(&inputs.xfrc).map(|i| CodedConstraint::NotFiniteForce(i / 6)))
        .or_else(|| mocap().map(CodedConstraint::NotFiniteMocap))
        .or_else(|| activation().map(CodedConstraint::NotFiniteActuator))
        .or_else(|| dof().map(CodedConstraint::NotFiniteDof))
}

/// Marks the islands of lane `lane` whose next state is not finite, with a maximum above 0; all islands if `keeps_all` is true.
#[cold]
fn mark_non_finite<R: Real>(
    compiled: &LaneModel<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &PositionSolution<R>,
    lane: usize,
    keeps_all: bool,
) {
    let VelocitySolution { v, islands, .. } = velocity;
    islands.find(compiled, System::from(&problem.rows), lane);
    let mark = |x: R| f64::from(keeps_all || !x.lane(lane).to_f64().is_finite());
    for joint in &compiled.joints {
        let tree = compiled.dofs[joint.v].tree;
        position.q[joint.q..joint.q + joint.kind.nq()].iter().for_each(|&q| islands.raise_max(tree, mark(q)));
        v[joint.v..joint.v + joint.kind.nv()].iter().for_each(|&v| islands.raise_max(tree, mark(v)));
    }
    for (&act, tree) in position.act.iter().zip(&compiled.tree_of_act) {
        tree.iter().for_each(|&tree| islands.raise_max(tree, mark(act)));
    }
}

/// Restores positions, velocities and activations of the islands of lane `lane` that [`mark_non_finite`] marked, and discards their
/// contacts and impulses. Contacts that are still deferred are discarded too. Returns whether all islands are marked. Activations that are
/// not finite, and act on no tree, are restored too.
#[cold]
fn keep_marked<R: Real>(
    compiled: &LaneModel<R>,
    state: &mut State<R>,
    evaluation: &mut Evaluation<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    lane: usize,
) -> bool {
    let VelocitySolution { v, scalar_impulse, islands, .. } = velocity;
    let mut is_marked = |tree: usize| islands.of_tree(tree).most > 0.0;
    let restore = |next: &mut R, old: R| next.set_lane(lane, old.lane(lane));
    for joint in compiled.joints.iter().filter(|joint| is_marked(compiled.dofs[joint.v].tree)) {
        (joint.q..joint.q + joint.kind.nq()).for_each(|i| restore(&mut position.q[i], state.q[i]));
        for d in joint.v..joint.v + joint.kind.nv() {
            restore(&mut v[d], state.v[d]);
            restore(&mut state.impulse[d], R::zero());
        }
    }
    for ((act, &old), tree) in position.act.iter_mut().zip(&state.act).zip(&compiled.tree_of_act) {
        if tree.map_or_else(|| !act.lane(lane).to_f64().is_finite(), &mut is_marked) {
            restore(act, old);
        }
    }
    for (impulse, tree) in scalar_impulse.iter_mut().zip(&compiled.tree_of_scalar_impulse) {
        if tree.is_none_or(&mut is_marked) {
            restore(impulse, R::zero());
        }
    }
    evaluation.contacts.retain(lane, |_, slot, id| {
        let geoms = compiled.pair_geoms(id.pair()).expect("a pair index of this compiled model");
        let mut trees = geoms.into_iter().filter_map(|geom| compiled.tree_of(compiled.geoms[geom].frame));
        !trees.any(&mut is_marked) && !problem.is_deferred(slot, lane)
    });
    (0..compiled.ntree).all(is_marked)
}

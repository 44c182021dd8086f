//! Mechanisms that no impact touches. Where impacts divide the step of a lane, these mechanisms keep their whole step: their accuracy does
//! not depend on impacts of others.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::{ContactId, Contacts};
use crate::compile::LaneModel;
use crate::constraints::ConstraintProblem;
use crate::constraints::evaluation_times::{merge_connected, union};
use crate::dynamics::kinematics::select_into;
use crate::integrators::evaluate::evaluation::Substep;
use crate::integrators::step_outcome::StepOutcome;
use crate::integrators::substeps::buffers::Buffers;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::options::StepSettings;
use crate::stages::s10_record::{Record, Status};

/// Adds mechanisms with a bouncing contact to `touched`, which has the lanes of each mechanism, in the lanes `lanes`. Contacts that would
/// collide in a flight that ignores impacts count too. `contacts` are those of the last part.
pub(super) fn note_impacts<R: Real>(
    compiled: &LaneModel<R>,
    problem: &ConstraintProblem<R>,
    contacts: &Contacts<R>,
    lanes: R::Mask,
    touched: &mut [R::Mask],
) {
    for (i, impact) in problem.impacts.iter().enumerate() {
        let impact_lanes = lanes.and(impact.lanes.or(impact.ignored));
        for (pair, lanes) in contacts.pairs(problem.contact_slots[i].slot, impact_lanes.bits()) {
            let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
            compiled.mechanisms_of(geoms).for_each(|m| touched[m] = touched[m].or(R::Mask::from_bits(lanes)));
        }
    }
}

/// Makes the whole step in lanes that impacts have divided, without division. Its result replaces that of `buffers` in mechanisms that no
/// impact touches, not even through the contact forces of others. `make` is that of [`super::step_in_parts`]. The lanes `kept`
/// (bits) keep their state, and `record` is that of the step.
pub(super) fn step_untouched<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    buffers: &mut Buffers<R>,
    (kept, record): (u32, &mut Record<R>),
    make: impl Fn(&mut Workspace<R>, Option<StepOutcome<R>>) -> (Record<R>, u32),
) {
    let Buffers { touched, total, before, .. } = buffers;
    spread(compiled, &total.state.contacts, touched);
    let all_touched = compiled.mechanisms.parts.iter().fold(R::Mask::splat(true), |lanes, part| lanes.and(touched[part.mechanism]));
    let lanes = s.evaluation.divided.and_not(R::Mask::from_bits(kept)).and_not(all_touched);
    if lanes.none() {
        return;
    }
    for (now, before) in [&mut s.state.v, &mut s.state.q, &mut s.state.act].into_iter().zip(before) {
        now.copy_from_slice(before);
    }
    // The impulses of the parts are a start for the solver.
    total.restore_impulses((&mut s.state, &mut s.velocity.scalar_impulse), R::Mask::splat(true));
    s.alive = lanes;
    s.evaluation.substep = Substep { ignores_impacts: R::Mask::splat(true), ..Substep::whole(options) };
    s.evaluation.collision.forget_planes();
    let (undivided, keeping) = make(s, None);
    let Buffers { touched, .. } = buffers;
    note_impacts(compiled, &s.problem, &s.state.contacts, lanes, touched);
    // Very fast mechanisms are evaluated at the beginning of a long step, of first order. Their parts are more accurate.
    for (mechanism, touched) in touched.iter_mut().enumerate() {
        *touched = touched.or(s.evaluation.times.moved_lanes(mechanism));
    }
    spread(compiled, &s.state.contacts, touched);
    // A lane that is not finite in the undivided step alone keeps its parts.
    let broken = undivided.lanes(Status::NON_FINITE) & !record.lanes(Status::NON_FINITE);
    let lanes = lanes.and_not(R::Mask::from_bits(keeping | broken));
    buffers.note_worst(&s.velocity.worst, undivided.residual, lanes);
    let Buffers { touched, total, end, .. } = buffers;
    record.residual = kernel!(R, || R::select(lanes, record.residual.max(undivided.residual), record.residual));
    for flag in [Status::NOT_CONVERGED, Status::CONTACTS_FULL] {
        record.add_flag(flag, undivided.lanes(flag) & lanes.bits());
    }
    let keeps_step = |mechanism: usize| lanes.and_not(touched[mechanism]);
    let of_tree = |tree: &Option<usize>| tree.map_or_else(|| R::Mask::splat(false), |tree| keeps_step(compiled.mechanisms.of_tree[tree]));
    let [v, q, act] = end;
    for joint in &compiled.joints {
        let lanes = keeps_step(compiled.mechanism_of(joint.v));
        let (coordinates, dofs) = (joint.q..joint.q + joint.kind.nq(), joint.v..joint.v + joint.kind.nv());
        select_into(&mut q[coordinates.clone()], &s.state.q[coordinates], lanes);
        select_into(&mut v[dofs.clone()], &s.state.v[dofs.clone()], lanes);
        select_into(&mut total.state.impulse[dofs.clone()], &s.state.impulse[dofs], lanes);
    }
    kernel!(R, || {
        for ((to, &from), tree) in act.iter_mut().zip(&s.state.act).zip(&compiled.tree_of_act) {
            *to = R::select(of_tree(tree), from, *to);
        }
        let impulses = total.scalar_impulse.iter_mut().zip(&s.velocity.scalar_impulse);
        for ((to, &from), tree) in impulses.zip(&compiled.tree_of_scalar_impulse) {
            *to = R::select(of_tree(tree), from, *to);
        }
    });
    let is_untouched = |id: ContactId, lane: usize| {
        let geoms = compiled.pair_geoms(id.pair()).expect("a pair index of this compiled model");
        compiled.mechanisms_of(geoms).all(|m| keeps_step(m).bits() >> lane & 1 == 1)
    };
    for lane in each_of(lanes.bits()) {
        total.state.contacts.retain(lane, |_, _, id| !is_untouched(id, lane));
    }
    let there = &s.state.contacts;
    total.state.contacts.add_missing(there, lanes.bits(), |k, lane| is_untouched(there.ids[k][lane], lane));
}

/// Extends the mechanisms that impacts touch by those on which contact forces of `contacts` connect with them.
pub(super) fn spread<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, touched: &mut [R::Mask]) {
    kernel!(R, || merge_connected(
        compiled,
        contacts,
        |k| contacts.bearing(k),
        #[inline(always)]
        |[a, b], lanes| {
            // Mocap bodies pass no forces on.
            if [a, b].iter().any(|m| compiled.mechanisms.of_mocap.contains(m) && !compiled.mechanisms.of_tree.contains(m)) {
                return R::Mask::splat(false);
            }
            union(touched, [a, b], lanes)
        },
    ));
}

//! Evaluation point of a step: its configuration, forces, contacts and rows.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::constraints::constraint_set::AssemblyInput;
use crate::integrators::corrected_forces::{correct_forces, reconsider_servos};
use crate::integrators::free_motion::{find_contacts, free_motion, place_bodies};
use crate::integrators::impact;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::probe::{Counter, Probe, Span};
use crate::stages::s04_assemble::assemble;
use crate::stages::s05_solve::Estimate;

/// Stages 1 to 3: the free velocity and the contacts. The midpoint rule evaluates forces and contacts in the middle of the step, Euler's
/// rule at its beginning.
///
/// Returns the lanes that are evaluated at the start of the step in spite of the midpoint rule.
#[inline(always)]
pub(crate) fn evaluate<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &mut Scheme<R>,
    s: &mut Workspace<R>,
    probe: impl Probe,
) -> R::Mask {
    place_bodies(compiled, scheme, s, probe);
    free_motion(compiled, scheme, s, probe);
    let evaluated_at_start = find_contacts(compiled, scheme, s, probe);
    if evaluated_at_start.any() {
        // Fast bodies may pass through a thin geom before the middle of the step. Their lanes are evaluated at its start.
        scheme.time_before = R::select(evaluated_at_start, R::zero(), scheme.time_before);
        scheme.time_after = R::select(evaluated_at_start, scheme.h, scheme.time_after);
        place_bodies(compiled, scheme, s, probe);
        free_motion(compiled, scheme, s, probe);
        find_contacts(compiled, scheme, s, probe);
    }
    if scheme.in_the_middle {
        impact::place_at_impacts(compiled, options, scheme, s, probe);
    }
    s.evaluation.contacts.close_rounded_gaps(norm(compiled.params.gravity()) * scheme.h * scheme.h);
    probe.span(Span::WarmStart, || s.evaluation.contacts.prepare(&mut s.state.contacts));
    probe.count(Counter::Contacts, || s.evaluation.contacts.count[..R::LANES].iter().sum::<usize>() as f64);
    evaluated_at_start
}

/// Stage 4, and stages 1 and 2 again for forces that depend on the velocity at the end of the step, of which stage 5 makes an estimate.
#[inline(always)]
pub(crate) fn assemble_rows<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    evaluated_at_start: R::Mask,
    probe: impl Probe,
) {
    probe.span(Span::Assemble, || assemble_here(compiled, options, scheme, s, evaluated_at_start));
    let bounded = compiled.servos_are_bounded && (scheme.corrects || compiled.actuator_dynamics > 0);
    let reconsider = |s: &mut Workspace<R>| probe.span(Span::EstimateImpulses, || reconsider_servos(compiled, options, scheme, s));
    if bounded && s.constraints.constrained.any() && reconsider(s) {
        // Servos reach their bounds, or leave them, by impulses of this step.
        free_motion(compiled, scheme, s, probe);
        probe.span(Span::Assemble, || assemble_here(compiled, options, scheme, s, evaluated_at_start));
        // In lanes without a misjudged servo the repeated estimate has equal bits.
        probe.span(Span::EstimateImpulses, || {
            let (estimate, lanes) = (Estimate::new(compiled, options, &s.state.v, scheme.h, &s.constraints), s.constraints.constrained);
            estimate.make(options, lanes, &mut s.constraints);
            estimate.choose_start(lanes, &mut s.constraints);
        });
    }
    if scheme.corrects {
        probe.span(Span::CorrectForces, || correct_forces(compiled, options, scheme, s, probe));
    }
    probe.count(Counter::ScalarRows, || s.constraints.owners.len() as f64);
    probe.count(Counter::ContactSlots, || (s.constraints.slots.len() + s.constraints.rolling_slots.len()) as f64);
}

/// Stage 4 at the configuration of the scheme.
#[inline(always)]
pub(crate) fn assemble_here<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    evaluated_at_start: R::Mask,
) {
    let assembly = AssemblyInput {
        q: &s.evaluation.q,
        v: &s.state.v,
        motion: &s.free_motion.smooth.newton_euler,
        v_free: &s.free_motion.v,
        losses: &s.free_motion.actuator_forces.losses,
        h: scheme.h,
        time_before: scheme.time_before,
        in_the_middle: scheme.in_the_middle,
        closing_fraction: scheme.closing_fraction(evaluated_at_start, s.impacts.lanes),
        alive: s.alive,
    };
    assemble(
        compiled,
        options,
        &s.evaluation.kinematics,
        &s.free_motion.smooth.mass,
        &assembly,
        &mut s.evaluation.contacts,
        &mut s.constraints,
    );
}

//! Where a scheme takes the step, and the rows of the constraint problem there.

use stepper_real::{Mask, Real};

use crate::compile::LanePlan;
use crate::constraints::constraint_set::Moment;
use crate::integrators::corrected_forces::{correct_forces, reconsider_servos};
use crate::integrators::free_motion::{find_contacts, free_motion, place};
use crate::integrators::impact;
use crate::integrators::scheme::Rule;
use crate::integrators::workspace::Scratch;
use crate::options::StepSettings;
use crate::stages::s04_assemble::assemble;
use crate::stages::s05_solve::{estimate, forget_estimate};

/// Stages 1 to 3: the velocity at the end of the step if nothing were in the way, and the contacts. Moreau's rule takes everything in the middle of
/// the step, Euler's at its beginning.
///
/// Returns the lanes that the midpoint rule takes at the beginning.
pub(crate) fn evaluate<R: Real>(plan: &LanePlan<R>, options: &StepSettings, rule: &mut Rule<R>, s: &mut Scratch<R>) -> R::Mask {
    place(plan, rule, s);
    free_motion(plan, rule, s);
    let too_far = find_contacts(plan, rule, s);
    if too_far.any() {
        // What is so fast that it may be through something thin in the middle of the step is taken at its beginning.
        rule.lead = R::select(too_far, R::zero(), rule.lead);
        rule.rest = R::select(too_far, rule.h, rule.rest);
        place(plan, rule, s);
        free_motion(plan, rule, s);
        find_contacts(plan, rule, s);
    }
    if rule.integrator.in_the_middle() {
        impact::place_at_impacts(plan, options, rule, s);
    }
    s.new_contacts.prepare(&mut s.contacts);
    too_far
}

/// Stage 4, and stages 1 and 2 again for forces that depend on the velocity at the end of the step, of which stage 5 makes an estimate.
pub(crate) fn assemble_rows<R: Real>(
    plan: &LanePlan<R>,
    options: &StepSettings,
    rule: &Rule<R>,
    s: &mut Scratch<R>,
    at_beginning: R::Mask,
) {
    assemble_here(plan, options, rule, s, at_beginning);
    let bounded = plan.servos_are_bounded && (rule.corrects || plan.trains > 0);
    if bounded && s.constraints.constrained.any() && reconsider_servos(plan, rule, s) {
        // Servos reach their bounds, or leave them, by impulses of this step.
        free_motion(plan, rule, s);
        assemble_here(plan, options, rule, s, at_beginning);
        // Where nothing was wrong, this repeats the bits of the estimate before.
        estimate(&s.v, rule.h, s.constraints.constrained, &mut s.constraints);
        forget_estimate(s.constraints.constrained, &mut s.constraints);
    }
    if rule.corrects {
        correct_forces(plan, rule, s);
    }
}

/// Stage 4 at the configuration of the scheme.
fn assemble_here<R: Real>(plan: &LanePlan<R>, options: &StepSettings, rule: &Rule<R>, s: &mut Scratch<R>, too_far: R::Mask) {
    let moment = Moment {
        q: &s.q_eval,
        v: &s.v,
        motion: &s.smooth.work,
        v_free: &s.v_free,
        losses: &s.drive.losses,
        h: rule.h,
        lead: rule.lead,
        closing: rule.closing(too_far, s.impacts.lanes),
        alive: s.alive,
    };
    assemble(plan, options, &s.kinematics, &s.smooth.mass, &moment, &mut s.new_contacts, &mut s.constraints);
}

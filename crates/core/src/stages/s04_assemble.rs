//! Stage 4: assembles the constraint problem, with rows of contacts, limits, dry friction, equalities and tendons.
//!
//! With the mass matrix M = L^T D L, each row of the Jacobian J is scaled to y = D^-1/2 L^-T J^T. A scaled row has entries only for the
//! degrees of freedom that move its bodies. The Delassus matrix is Y^T Y. The bias of a row sets its target velocity at the end of the
//! step, which for contacts is the normal velocity v_n+:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -c phi / h           at most c of the gap closes (c: `SlotTimes::closing_fraction`)
//! touching, or overlapping:       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! bouncing, e > 0:                v_n+ >= -e v_n-              Newton's law (Moreau 1988), and no other bias
//! ```
//!
//! Here phi is the gap, h the time step, v_n- the normal velocity before the impact, and e the coefficient of restitution. The options set
//! beta (`baumgarte`), the slop, and the cap (`max_correction_speed`). With split stabilisation, the position solve of stage 8 has the
//! target of the third line, with a smooth bound instead of the minimum.
//!
//! For v_n-, Euler's rule and the implicit rule take the velocity after the step without constraints, the midpoint rule that at the time
//! of the impact (`constraints/contact/restitution.rs`). A contact with e > 0 that neither bounces nor rests in this step has no row. A row
//! would stop the bodies at the surface and remove the energy of their later bounce.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::contact::approaching::turning_lanes;
use crate::constraints::contact::least_mobility;
use crate::constraints::contact::restitution::any_elastic;
use crate::constraints::contact::torsional_rolling::rotating_lanes;

/// Assembles all rows of contacts, limits, dry friction, equalities and tendons, with their initial impulses.
pub(crate) fn assemble<R: Real>(input: &RowInput<'_, R>, contacts: &Contacts<R>, mut assembler: Assembler<'_, R>) {
    kernel!(R, || {
        let compiled = input.compiled;
        assembler.clear(input);
        // Eliminated equalities come first, because every later row is projected on the motions that they allow.
        if !compiled.equalities.is_empty() {
            assembler.add_equalities(input, true);
            let Assembler { problem, builder, .. } = &mut assembler;
            builder.store_eliminated(&mut problem.rows, input);
        }
        assembler.add_frictions(input);
        assembler.add_limits(input);
        if !compiled.ball_limits.is_empty() {
            assembler.add_ball_limits(input);
        }
        if !compiled.tendons.is_empty() {
            assembler.add_tendons(input);
        }
        if !compiled.equalities.is_empty() {
            assembler.add_equalities(input, false);
        }
        assembler.problem.elastic = any_elastic(contacts);
        for k in 0..contacts.slots() {
            let lanes = contacts.lanes_of(k);
            let [torsional, rolling] = rotating_lanes(compiled, contacts, k, lanes);
            let sliding = lanes & !(torsional | rolling);
            if sliding != 0 {
                assembler.add_contact(input, contacts, k, sliding);
            }
            if torsional != 0 {
                assembler.add_rotating_contact::<4>(input, contacts, k, torsional);
            }
            if rolling != 0 {
                assembler.add_rotating_contact::<6>(input, contacts, k, rolling);
            }
        }
        assembler.finish(compiled, contacts);
    })
}

impl<R: Real> Assembler<'_, R> {
    /// Resets the problem: removes the rows of the last assembly, and sets the numbers that do not depend on rows.
    #[inline(always)]
    fn clear(&mut self, input: &RowInput<'_, R>) {
        let (compiled, none) = (input.compiled, R::Mask::splat(false));
        let Self { problem, velocity, builder } = self;
        problem.rows.clear();
        velocity.impulses.clear();
        problem.impulse_indices.clear();
        builder.velocity_scales.clear();
        problem.contact_slots.clear();
        problem.rotation_scales.clear();
        problem.curvature_terms.clear();
        problem.deferred.clear();
        problem.impacts.clear();
        problem.turning = turning_lanes(&input.motion.velocity, input.times.longest_closing());
        [problem.constrained, problem.needs_position_solve, problem.biased] = [none; 3];
        problem.may_have_immovable_rows = !compiled.equalities.is_empty() || !compiled.tendons.is_empty();
        problem.rows.least_mobility = R::of(least_mobility::<R>()) / compiled.moving_mass();
    }

    /// Completes the problem. It activates deferred contacts of two faces that already rest on each other. Then it finds the contact
    /// groups (redundant supports), and the lanes in which a group takes up load for the first time.
    #[inline(always)]
    fn finish(&mut self, compiled: &LaneModel<R>, contacts: &Contacts<R>) {
        let Self { problem, velocity, .. } = self;
        if !problem.deferred.is_empty() {
            problem.activate_coplanar(velocity, contacts);
        }
        velocity.contact_groups.find(compiled, contacts, problem, problem.constrained.bits());
        velocity.impulses.compute_w(&problem.rows);
        problem.rows.newly_loaded = velocity.contact_groups.newly_loaded_lanes(contacts, problem, &velocity.impulses);
    }
}

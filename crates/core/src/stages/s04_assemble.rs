//! Stage 4: contacts, equalities, limits, springs of tendons and dry friction become the constraint problem.
//!
//! Every row is carried through half a solve, y = D^-1/2 L^-T J^T, which touches only the ancestors of the bodies it joins; the Delassus
//! matrix is then Y^T Y. The bias of a row says what velocity it demands at the end of the step:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -c phi / h           it may just close (c = 1)
//! touching:                       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! closing and fast, e > 0:        v_n+ >= -e v_n-              Newton's law (Moreau 1988), and no other bias
//! ```
//!
//! The last line is taken at the time of the impact by the midpoint rule (`constraints/restitution.rs`). A contact with e > 0 that neither
//! strikes nor is about to rest has no row: to stop it at the surface would take the energy that it is to bounce with.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::constraint_set::{AssemblyInput, Constraints};
use crate::constraints::contact::least_mobility;
use crate::constraints::equality::RowInput;
use crate::constraints::restitution::any_elastic;
use crate::constraints::torsional_rolling::rolling_lanes;
use crate::dynamics::inertia::MassMatrix;
use crate::dynamics::kinematics::Kinematics;
use crate::options::StepSettings;

/// Makes all rows of the contacts, limits, dry friction, equalities and tendons, and the impulses that they start from.
pub fn assemble<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    kinematics: &Kinematics<R>,
    mass: &MassMatrix<R>,
    assembly: &AssemblyInput<'_, R>,
    contacts: &mut Contacts<R>,
    constraints: &mut Constraints<R>,
) {
    R::vectorize(
        #[inline(always)]
        || {
            constraints.problem.clear();
            constraints.iterate.clear();
            constraints.owners.clear();
            constraints.velocity_scales.clear();
            constraints.slots.clear();
            constraints.rolling_slots.clear();
            constraints.deferred.clear();
            constraints.closing_time = assembly.h / assembly.closing_fraction;
            constraints.constrained = R::Mask::splat(false);
            constraints.needs_position_solve = R::Mask::splat(false);
            constraints.biased = R::Mask::splat(false);
            constraints.may_be_held = !compiled.equalities.is_empty() || !compiled.tendons.is_empty();
            constraints.rebounding = R::Mask::splat(false);
            constraints.problem.least_mobility = R::of(least_mobility::<R>()) / compiled.moving_mass();
            let input = RowInput { compiled, options, kinematics, mass, assembly };
            if !compiled.equalities.is_empty() {
                constraints.add_equalities(input, true);
                constraints.store_eliminated(compiled, mass);
            }
            constraints.add_frictions(compiled, mass, assembly);
            constraints.add_limits(compiled, options, mass, assembly);
            if !compiled.ball_limits.is_empty() {
                constraints.add_ball_limits(input);
            }
            if !compiled.tendons.is_empty() {
                constraints.add_tendons(input);
            }
            if !compiled.equalities.is_empty() {
                constraints.add_equalities(input, false);
            }
            constraints.impacts.clear();
            constraints.has_impacts = assembly.in_the_middle && any_elastic(contacts);
            for k in 0..contacts.slots() {
                let lanes = contacts.lanes_of(k);
                let narrow = lanes & !rolling_lanes(compiled, contacts, k, lanes);
                if narrow != 0 {
                    constraints.gather_support(compiled, contacts, k, narrow);
                    constraints.add_contact(input, contacts, k, narrow);
                }
            }
            if compiled.has_rolling_friction {
                for k in 0..contacts.slots() {
                    let rolling = rolling_lanes(compiled, contacts, k, contacts.lanes_of(k));
                    if rolling != 0 {
                        constraints.add_rolling_contact(input, contacts, k, rolling);
                    }
                }
            }
            if !constraints.deferred.is_empty() {
                constraints.activate_coplanar(contacts);
            }
            constraints.patches.find(compiled, contacts, constraints.constrained.bits());
            constraints.iterate.compute_w(&constraints.problem);
            let new = constraints.patches.new_lanes(contacts, &constraints.slots, &constraints.problem, &constraints.iterate);
            constraints.problem.hyperstatic = new;
        },
    )
}

/// Stage 4 again for another free velocity of the lanes `lanes`: rows and impulses stay, what the rows demand changes by `change` of it.
/// `before_impacts` is the change of the velocity that impacts meet, where any contact bounces within the step. Both are used up.
pub fn assemble_demands<R: Real>(
    compiled: &LaneModel<R>,
    mass: &MassMatrix<R>,
    constraints: &mut Constraints<R>,
    change: &mut [R],
    before_impacts: Option<&mut [R]>,
    lanes: R::Mask,
) {
    constraints.shift(compiled, mass, change, lanes);
    if let Some(change) = before_impacts {
        constraints.shift_before_impacts(compiled, mass, change, lanes);
    }
}

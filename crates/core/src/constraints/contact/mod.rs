//! Rows of contacts with sliding friction: one along the normal and two along the tangents. Contacts with more rows
//! (`torsional_rolling.rs`) use [`Assembler::sliding_rows`] and [`Assembler::push_contact_rows`] too.
//!
//! This file calls methods of `Assembler` and of the row builder that are defined in other files of this folder:
//!
//! | file | methods |
//! |---|---|
//! | `jacobian.rs` | `gather_dofs`: degrees of freedom that move the contact; `half_solve`: L^-T J^T |
//! | `jacobian.rs` | `contact_columns`: Jacobian and velocities along the three axes |
//! | `target_velocities.rs` | `biases`: target velocity for a gap or an overlap |
//! | `contact_spring.rs` | `comply`: bias and compliance of a soft surface |
//! | `restitution.rs` | `change_by_free_motion`: velocity change of the rows. `bounce...`: target velocity of a rebound |
//! | `elimination.rs` | `eliminate` and `add_removed_scales`: remove hard equalities from the rows |
//! | `approaching.rs` | `approaching_lanes`: lanes in which the rows are deferred |
//! | `curvature.rs`, `curvature_terms.rs` | `add_curvature`: velocity changes by the motion of the contact point; `remove_curvature` |
//! | `equality.rs` | `propagate_scales`: sizes below which entries of the rows count as rounding errors |
//!
//! `RowInput` (`assembler.rs`) has the numbers that all rows share. [`Assembler::push_contact_rows`] makes the rows a part of the solver's
//! problem (`crates/solve/src/problem.rs`).

pub(crate) mod approaching;
pub mod contact_spring;
pub mod curvature;
pub(crate) mod curvature_terms;
pub mod impact_time;
pub mod redundant_supports;
pub mod restitution;
pub mod torsional_rolling;

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{MAX_CONTACT_ROWS, RowCount, velocity_rounding};

use crate::collision::contact_set::Contacts;
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::constraint_problem::{ContactSlot, CurvatureTerms, DeferredContact};
use crate::constraints::contact::approaching::resting_speed;
use crate::constraints::equality::elimination::mobility_ratio;
use crate::constraints::row_builder::RowBuilder;
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::tuning::{MAX_FRICTION, MIN_UNMET_TARGET};

/// Smallest inverse inertia along a contact's normal with which the contact counts as movable. The number is a fraction of 1 / (total mass
/// of all moving bodies).
///
/// The inverse inertia is proportional to the square of a lever arm, the displacement of the contact point along the normal per rotation of
/// a hinge. The fraction corresponds to a lever arm of 1e-7 (3e-5 in 32 bits) of the distance between hinge and contact. Smaller ones are
/// rounding errors of poses. A large inertia of the hinge also makes the inverse inertia small; [`Assembler::find_movable`] finds such
/// contacts, so that the solver can move them.
pub(crate) fn least_mobility<R: Real>() -> f64 {
    1e-14_f64.max((256.0 * <R::Scalar as Scalar>::EPSILON.to_f64()).powi(2))
}

/// Smallest lever arm of a degree of freedom along a contact's normal that counts as nonzero. The lever arm is a sum of terms, and this
/// number is a fraction of their size.
///
/// A force along the normal acts on the joint through this lever arm. Where the terms nearly cancel, enormous forces would be needed for
/// a small torque. In 32 bits, such a lever arm is rounding error.
fn least_lever<R: Real>() -> f64 {
    f64::max(1e-5, 1e3 * <R::Scalar as Scalar>::EPSILON.to_f64())
}

/// Approach speed up to which an immovable contact adds nothing to the residual, m/s. `velocity` and `position` are the offsets g of its
/// normal row in the velocity and position solves, m/s.
///
/// No degree of freedom moves an immovable contact along its normal, as on a face that is normal to a hinge axis or parallel to a slide.
/// The solver leaves the contact out, and its approach speed counts as residual. Rounding in the model file gives such a contact a small
/// approach speed, so that speeds up to the resting speed are ignored.
///
/// Nothing can correct an overlap of the contact either. The difference of `position` and `velocity` is the speed that would correct the
/// overlap. If this speed exceeds [`MIN_UNMET_TARGET`], stage 8 reports the overlap. If the speed is between the resting speed and this
/// number, the overlap must not grow unnoticed. The function then returns 0, so that any approach speed counts as residual.
#[inline(always)]
fn negligible_approach<R: Real>(options: &StepSettings, [velocity, position]: [R; 2]) -> R {
    let (resting, correction) = (R::of(resting_speed(options)), (velocity - position).abs());
    let stage_8_reports = correction.gt(R::of(MIN_UNMET_TARGET));
    R::select(correction.gt(resting).and_not(stage_8_reports), R::zero(), resting)
}

/// Friction coefficient with which the solver computes a contact whose coefficient is `mu`, see [`MAX_FRICTION`]. For torsional and rolling
/// friction, both are in m.
#[inline(always)]
pub(crate) fn effective_friction<R: Real>(mu: R) -> R {
    mu.min(R::of(MAX_FRICTION))
}

/// Three rows of the contact in one slot, along the normal and the tangents. Their entries are in `column` of the row builder.
pub(crate) struct SlidingRows<R: Real> {
    /// Offset g of each row in the velocity solve and in the position solve, m/s: its velocity without impulses, plus its bias.
    pub(crate) offsets: [[R; 2]; 3],
    /// Curvature terms that the offsets of the tangents contain, m/s; `None` if they were not computed.
    pub(crate) curvature: Option<[R; 2]>,
    /// Squared lengths of the rows before and after equalities were eliminated from them; `None` without elimination.
    pub(crate) lengths: Option<[[R; 3]; 2]>,
    /// Numbers that do not depend on the number of rows.
    pub(crate) common: CommonRows<R>,
}

/// Numbers of the contact in one slot that do not depend on its number of rows.
pub(crate) struct CommonRows<R: Real> {
    /// Lanes in which the contact has rows, including lanes in which the solver leaves them out.
    exists: R::Mask,
    /// Deferred contact, with the lanes in which the solver leaves out the rows. [`Assembler::push_contact_rows`] sets the fields `contact`
    /// and `impulse`, and removes lanes in which the contact is immovable.
    deferred: DeferredContact<R>,
    /// Compliance of the normal row, 1/kg; `None` if no surface of the model is soft (has a contact spring).
    compliance: Option<R>,
}

/// Contact with `N` rows, of which the normal row is the first, as input of [`Assembler::push_contact_rows`].
pub(crate) struct ContactRows<R: Real, const N: usize> {
    /// Numbers that do not depend on the number of rows.
    pub(crate) common: CommonRows<R>,
    /// Friction coefficient of the scaled rows.
    pub(crate) mu: R,
    /// Offset g of each row in the velocity solve and in the position solve, m/s.
    pub(crate) offsets: [[R; 2]; N],
    /// Curvature terms that the offsets of the tangents contain, m/s; `None` if they were not computed.
    pub(crate) curvature: Option<[R; 2]>,
    /// Mobility of the contact before the elimination of equalities, divided by that after it; `None` without elimination.
    pub(crate) mobility_ratio: Option<R>,
    /// Impulse of each row from which the solve starts, N s.
    pub(crate) impulse: [R; N],
    /// Lengths that scale the three rotation rows, m; `None` without such rows.
    pub(crate) rotation_scale: Option<V3<R>>,
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the three rows of the contact in slot `k`, in the lanes `lanes` (bits). There the contact has only sliding friction, or no
    /// friction.
    #[inline(always)]
    pub(crate) fn add_contact(&mut self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let (slot, mass) = (&contacts.data[k], input.mass);
        let SlidingRows { offsets, curvature, lengths, common } = self.sliding_rows(input, contacts, k, lanes);
        let rows = ContactRows {
            common,
            mu: effective_friction(slot.mu),
            offsets,
            curvature,
            // The residual of a contact is scaled by its mobility. Mobilities are those before equalities were eliminated.
            mobility_ratio: lengths.map(
                #[inline(always)]
                |[before, after]| mobility_ratio(&before, &after),
            ),
            impulse: slot.impulse,
            rotation_scale: None,
        };
        self.push_contact_rows(
            input,
            contacts,
            (k, lanes),
            &rows,
            #[inline(always)]
            |builder, d| scale(builder.column[d], mass.sqrt_inv_d[d]),
        );
    }

    /// Makes the rows of the contact in slot `k` a part of the solver's problem, in the lanes `lanes` (bits), with the impulse from which
    /// the solve starts.
    ///
    /// `entries` returns the entries of the rows at a coordinate.
    #[inline(always)]
    pub(crate) fn push_contact_rows<const N: usize>(
        &mut self,
        input: &RowInput<'_, R>,
        contacts: &Contacts<R>,
        (k, lanes): (usize, u32),
        rows: &ContactRows<R, N>,
        entries: impl Fn(&RowBuilder<R>, usize) -> [R; N],
    ) where
        [R; N]: RowCount<R, N>,
    {
        let ContactRows { common: CommonRows { exists, deferred, compliance }, mu, offsets: g, curvature, mobility_ratio, impulse, .. } =
            *rows;
        let contact = self.problem.rows.contacts.len();
        let (builder, least) = (&self.builder, self.problem.rows.least_mobility);
        let mut offsets = [R::zero(); N];
        for i in 0..N {
            offsets[i] = g[i][0];
        }
        self.problem.rows.contacts.push(
            &builder.dofs,
            #[inline(always)]
            |d| entries(builder, d),
            exists,
            mu,
            offsets,
            least,
        );
        if self.problem.rows.contacts[contact].immovable.any() {
            let (movable, negligible) = self.find_movable(input, contacts, k, lanes, g[0]);
            self.problem.rows.contacts.make_movable(movable);
            self.problem.rows.contacts.clear_negligible_approach(contact, negligible);
        }
        if let Some(terms) = curvature {
            self.problem.curvature_terms.push(CurvatureTerms { contact, terms });
            // A self-locking contact, such as a wedge, carries any load by friction. Curvature terms could prescribe velocities that the
            // joints do not allow, and no impulses would be a solution.
            let is_self_locking = self.problem.rows.contacts.is_self_locking();
            if is_self_locking.any() {
                self.problem.remove_curvature(self.problem.curvature_terms.len() - 1, is_self_locking);
            }
        }
        let set = &mut self.problem.rows.contacts;
        if let Some(ratio) = mobility_ratio {
            set.set_mobility_ratio(ratio);
        }
        if let Some(compliance) = compliance {
            set.set_compliance(compliance);
        }
        // The position solve has another g of the normal row. For the other rows, the difference of g in the two solves is stored, so that
        // a later change of g applies in both.
        let mut position = [g[0][1]; N];
        for i in 1..N {
            position[i] = g[i][1] - g[i][0];
        }
        set.set_position_offset(&position);
        // The solver has no rows for an immovable contact, and could not activate them.
        let immovable = set[contact].immovable;
        let deferred_lanes = deferred.lanes.and_not(immovable);
        let not_deferred = exists.and_not(deferred_lanes);
        if deferred_lanes.any() {
            set.defer(contact, deferred_lanes);
            let mut initial = [R::zero(); MAX_CONTACT_ROWS];
            initial[..N].copy_from_slice(&impulse);
            self.problem.deferred.push(DeferredContact { contact, slot: k, lanes: deferred_lanes, impulse: initial, ..deferred });
        }
        // An immovable contact starts with zero impulse, because the solver could not remove the impulse of the last step.
        let acts = not_deferred.and_not(immovable);
        let mut initial = [R::zero(); N];
        for i in 0..N {
            initial[i] = R::select(acts, impulse[i], R::zero());
        }
        self.velocity.impulses.contacts.extend_from_slice(&initial);
        self.problem.contact_slots.push(ContactSlot { slot: k, lanes: R::Mask::from_bits(lanes) });
        self.problem.rotation_scales.extend(rows.rotation_scale);
        self.problem.constrained = self.problem.constrained.or(not_deferred);
    }

    /// Finds the lanes in which the contact in slot `k` can move along its normal, although the solver counts it as immovable. The second
    /// result is the approach speed that is negligible in the other lanes, m/s.
    ///
    /// The solver counts a contact as immovable if its inverse inertia along the normal is tiny compared with those along the tangents, or
    /// compared with 1 / (total moving mass). Such a contact can still move if some degree of freedom has a lever arm above
    /// [`least_lever`]. `offsets` are the offsets g of the normal row in the two solves. Overwrites `column`.
    #[cold]
    #[inline(never)]
    pub(crate) fn find_movable(
        &mut self,
        input: &RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: u32,
        offsets: [R; 2],
    ) -> (R::Mask, R) {
        let RowInput { state: RowState { compiled, kinematics, mass, .. }, options, .. } = *input;
        self.problem.may_have_immovable_rows = true;
        kernel!(R, || {
            let mut squared_speed = R::zero();
            // A lever arm counts as rounding error below the fraction `least_lever` of the size of its terms. For terms of the size
            // `least_size`, this bound is the rounding error of the contact point.
            let least_size = contacts.data[k].point.rounding() * R::of(least_lever::<R>().recip());
            self.builder.contact_columns(input, contacts, k, lanes);
            for i in 0..self.builder.dofs.len() {
                let d = self.builder.dofs[i] as usize;
                let (axis, sign) = (&kinematics.axes[d], self.builder.sign_of(d));
                let arm = sub(contacts.data[k].point.pos, kinematics.origin[compiled.dofs[d].tree]);
                // A lever arm is a sum of terms. `square` is the squared size of these terms.
                let (motion, squared_rotation) = (velocity_at(axis, arm), dot(angular(axis), angular(axis)));
                let square = (dot(motion, motion) + squared_rotation * dot(arm, arm)) * sign.square();
                // If the contact is at the joint itself, the whole lever arm is rounding error. The added term makes such a contact
                // immovable.
                self.builder.scales[d] = [square + squared_rotation * (least_size * sign).square(); 3];
                squared_speed += square * input.v_free[d].square();
            }
            // As in `sliding_rows`: from the Jacobian to the rows, without their factor D^-1/2.
            self.builder.half_solve::<3>(compiled, mass);
            self.builder.propagate_scales(compiled, mass);
            if self.builder.eliminate(&self.problem.rows, mass, &mut [[R::zero(); 2]; 3]).is_some() {
                self.builder.add_removed_scales(&self.problem.rows, mass);
            }
            let (least, mut movable) = (R::of(least_lever::<R>().powi(2)), R::Mask::splat(false));
            for &d in &self.builder.dofs {
                let (x, scale) = (self.builder.column[d as usize][0], self.builder.scales[d as usize][0]);
                movable = movable.or(x.square().gt(scale * least));
            }
            let rounding = squared_speed.sqrt() * R::of(velocity_rounding::<R>());
            (movable, rounding.max(negligible_approach(options, offsets)))
        })
    }

    /// Builds the rows of the contact in slot `k` along its normal and its tangents, in the lanes `lanes` (bits).
    #[inline(always)]
    pub(crate) fn sliding_rows(&mut self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlidingRows<R> {
        let RowState { compiled, mass, .. } = input.state;
        let mut exists = R::Mask::from_bits(lanes);
        self.builder.gather_dofs(input, contacts, k, lanes);
        let [free, before] = self.builder.contact_columns(input, contacts, k, lanes);
        let has_curvature = input.in_the_middle && self.builder.both_move != 0;
        let change = if has_curvature { self.builder.change_by_free_motion(input) } else { zero() };
        // Half of a solve with the mass matrix L^T D L: `column` becomes L^-T J^T. The callers multiply by D^-1/2.
        self.builder.half_solve::<3>(compiled, mass);
        // Normal rows of contacts with soft surfaces, which have a spring and a damper.
        let springs = compiled.has_contact_springs.then(|| self.builder.comply(input, contacts, k, lanes, [free[0], before[0]]));
        let rigid = springs.as_ref().map_or(exists, |row| exists.and_not(row.lanes));
        let solved = input.solved_overlaps.map(|solved| solved.distance(contacts, k));
        let closing_part = input.closing_part_of_slot(contacts, k, lanes);
        let [mut bias, mut position] = self.biases(input, input.options.max_correction_speed, closing_part, solved, rigid);
        if let Some(row) = &springs {
            // The spring determines the position, so that no position correction is added.
            [bias, position] = [bias, position].map(|x| R::select(row.lanes, row.bias, x));
        }
        let mut offsets = [[free[0] + bias, free[0] + position], [free[1]; 2], [free[2]; 2]];
        let lengths = self.builder.eliminate(&self.problem.rows, mass, &mut offsets);
        let free_eliminated = [offsets[0][0] - bias, offsets[1][0], offsets[2][0]];
        let mut bounces = R::Mask::splat(false);
        if self.problem.elastic {
            exists = self.bounce(input, (contacts, k), exists, [before[0], bias], &mut offsets[0][0]);
            bounces = self.problem.impacts.last().map_or(bounces, |impact| impact.lanes);
        }
        let lanes = self.approaching_lanes(input, contacts, k, exists.and(rigid), before[0], free_eliminated);
        let impulse = [R::zero(); 6];
        let doubtful = R::Mask::splat(false);
        let deferred = DeferredContact { contact: 0, slot: k, lanes, doubtful, bounces, bias: offsets[0][0] - free_eliminated[0], impulse };
        // Curvature terms are added last. The code above needs offsets without them to decide whether the contact is deferred.
        let curvature = has_curvature.then(|| self.add_curvature(input, contacts, k, exists, [free, change], &mut offsets));
        SlidingRows { offsets, curvature, lengths, common: CommonRows { exists, deferred, compliance: springs.map(|row| row.compliance) } }
    }
}

//! Rows of contacts with torsional or rolling friction: in addition to the three sliding rows, three for the rotation about the contact's
//! axes.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::constraint_problem::{CurvatureTerms, DeferredContact};
use crate::constraints::contact::SlidingRows;
use crate::constraints::elimination::mobility_ratio;
use crate::constraints::row_builder::RowBuilder;
use crate::math::spatial::*;

impl<R: Real> RowBuilder<R> {
    /// Copies the entries of the sliding rows in `column` to `linear`, because the rotation rows use `column` too.
    #[inline(always)]
    pub(crate) fn keep_sliding_rows(&mut self) {
        for &d in &self.dofs {
            self.linear[d as usize] = self.column[d as usize];
        }
    }

    /// Computes the Jacobian of the relative rotation about the contact's axes, times `weight` (m), into `column`. Returns the velocity
    /// of the rows without impulses, m/s. `free` is the part of this velocity that conveyors and mocap bodies cause.
    #[inline(always)]
    pub(crate) fn rotation_columns(&mut self, input: &RowInput<'_, R>, axes: &[V3<R>; 3], weight: V3<R>, mut free: V3<R>) -> V3<R> {
        for &d in &self.dofs {
            let d = d as usize;
            let sign = self.sign_of(d);
            let axis = angular(&input.kinematics.axes[d]);
            let mut j = zero();
            for i in 0..3 {
                // Degrees of freedom that move the contact only in other lanes have the sign 0 here, and their entries could be -0.
                // Adding zero makes them 0, so that the bits of a lane do not depend on other lanes.
                j[i] = dot(axes[i], axis) * sign * weight[i] + R::zero();
            }
            free = add_scaled(free, j, input.v_free[d]);
            self.column[d] = j;
        }
        free
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the six rows of the contact in slot `k`, in the lanes `lanes` (bits) in which it has torsional or rolling friction.
    pub(crate) fn add_rolling_contact(&mut self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        kernel!(R, || {
            self.builder.gather_dofs(self.problem, input.compiled, contacts, k, lanes);
            let RowInput { compiled, mass, .. } = *input;
            let slot = &contacts.data[k];
            let friction = Friction::of(compiled, contacts, k, lanes);
            let SlidingRows { offsets: mut sliding_offsets, curvature, lengths: sliding, exists, deferred, compliance } =
                self.sliding_rows(input, contacts, k, lanes);
            self.builder.keep_sliding_rows();
            let n = slot.point.normal;
            let axes = [n, slot.tangent, cross(n, slot.tangent)];
            let surface_rotation = angular(&surface_velocity::motion(compiled, input.kinematics, contacts, k, lanes));
            let surface: V3<R> = array_of(
                #[inline(always)]
                |i| dot(axes[i], surface_rotation) * friction.scale[i],
            );
            let free_rotation = self.builder.rotation_columns(input, &axes, friction.scale, surface);
            let change = if self.problem.resolves_impacts { self.builder.change_by_free_motion(input) } else { zero() };
            self.builder.half_solve::<3>(compiled, mass);
            let mut rotation_offsets = [[free_rotation[0]; 2], [free_rotation[1]; 2], [free_rotation[2]; 2]];
            let rotation_lengths = self.builder.eliminate(&self.problem.rows, mass, &mut rotation_offsets);
            self.shift_rotation_to_impact(change, &mut rotation_offsets);
            let contact = self.problem.rows.contacts.len() + self.problem.rows.rolling_contacts.len();
            let (linear, column, sliding_factor) = (&self.builder.linear, &self.builder.column, friction.sliding_factor);
            sliding_offsets[1] = scale(sliding_offsets[1], sliding_factor);
            sliding_offsets[2] = scale(sliding_offsets[2], sliding_factor);
            self.problem.rows.push_rolling_contact(
                &self.builder.dofs,
                #[inline(always)]
                |d| {
                    let (a, b, s) = (linear[d], column[d], mass.sqrt_inv_d[d]);
                    let t = s * sliding_factor;
                    [a[0] * s, a[1] * t, a[2] * t, b[0] * s, b[1] * s, b[2] * s]
                },
                exists,
                friction.mu,
                [
                    sliding_offsets[0][0],
                    sliding_offsets[1][0],
                    sliding_offsets[2][0],
                    rotation_offsets[0][0],
                    rotation_offsets[1][0],
                    rotation_offsets[2][0],
                ],
            );
            if self.problem.rows.rolling_contacts.last_is_immovable().any() {
                let (movable, negligible) = self.find_movable(input, contacts, k, lanes, sliding_offsets[0]);
                self.problem.rows.rolling_contacts.make_movable(movable);
                self.problem.rows.rolling_contacts.clear_negligible_approach(negligible);
            }
            if let Some(curvature) = curvature {
                self.problem.curvature_terms.push(CurvatureTerms { contact, terms: scale(curvature, sliding_factor) });
            }
            if let (Some(sliding), Some(rotation)) = (sliding, rotation_lengths) {
                let before = [scale_tangents(sliding[0], sliding_factor), rotation[0]];
                let after = [scale_tangents(sliding[1], sliding_factor), rotation[1]];
                self.problem.rows.rolling_contacts.set_mobility_ratio(mobility_ratio(before.as_flattened(), after.as_flattened()));
            }
            if let Some(compliance) = compliance {
                self.problem.rows.rolling_contacts.set_compliance(compliance);
            }
            // As in `add_contact`: the position solve replaces g of the normal row, and adds to g of the other rows.
            let change = |[velocity, position]: [R; 2]| position - velocity;
            let [spin, roll_a, roll_b] = rotation_offsets.map(change);
            self.problem.rows.rolling_contacts.set_position_offset([
                sliding_offsets[0][1],
                change(sliding_offsets[1]),
                change(sliding_offsets[2]),
                spin,
                roll_a,
                roll_b,
            ]);
            let (push, torque) = (slot.impulse, friction.row_impulses(contacts.torque[k]));
            let initial_impulse = [push[0], push[1] * sliding_factor, push[2] * sliding_factor, torque[0], torque[1], torque[2]];
            // The solver has no rows for an immovable contact, and could not activate them.
            let immovable = self.problem.rows.rolling_contacts.last_is_immovable();
            let deferred_lanes = deferred.lanes.and_not(immovable);
            let not_deferred = exists.and_not(deferred_lanes);
            if deferred_lanes.any() {
                self.problem.rows.rolling_contacts.defer(deferred_lanes);
                self.problem.deferred.push(DeferredContact {
                    contact,
                    slot: k,
                    lanes: deferred_lanes,
                    impulse: initial_impulse,
                    ..deferred
                });
            }
            // An immovable contact starts with zero impulse, because the solver could not remove the impulse of the last step.
            self.velocity.impulses.rolling_contacts.push(select(not_deferred.and_not(immovable), initial_impulse, zero()));
            self.problem.rolling_slots.push((k, R::Mask::from_bits(lanes), friction.scale));
            self.problem.constrained = self.problem.constrained.or(not_deferred);
        })
    }
}

/// Friction coefficients of the contacts in one slot, per lane.
struct Friction<R: Real> {
    /// Friction coefficient of the scaled rows: the sliding coefficient, or 1 for contacts without sliding friction.
    mu: R,
    /// Factor that is 1 for contacts with sliding friction, otherwise 0.
    sliding_factor: R,
    /// Factors of the torsional and rolling rows, m. They scale these rows so that their friction coefficient is `mu` too.
    scale: V3<R>,
}

impl<R: Real> Friction<R> {
    /// Friction of the contacts in slot `k`, in the lanes `lanes` (bits): `mu` of the slot, and the torsional and rolling coefficients of
    /// the lanes' pairs.
    #[inline(always)]
    fn of(compiled: &LaneModel<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> Self {
        let [mut spin, mut roll] = [R::zero(); 2];
        for (pair, lanes) in contacts.pairs(k, lanes) {
            let (params, pair_lanes) = (compiled.contact(pair), R::Mask::from_bits(lanes));
            (spin, roll) = (R::select(pair_lanes, params.torsion, spin), R::select(pair_lanes, params.rolling, roll));
        }
        let mu = contacts.data[k].mu;
        let slides = mu.gt(R::zero());
        let mu = R::select(slides, mu, R::one());
        Self { mu, sliding_factor: R::select(slides, R::one(), R::zero()), scale: [spin / mu, roll / mu, roll / mu] }
    }

    /// Converts angular impulses (N m s) to the impulses of the scaled rotation rows (N s).
    #[inline(always)]
    fn row_impulses(&self, torque: V3<R>) -> V3<R> {
        let mut out = torque;
        for i in 0..3 {
            let exists = self.scale[i].gt(R::zero());
            out[i] = R::select(exists, torque[i] / R::select(exists, self.scale[i], R::one()), R::zero());
        }
        out
    }
}

/// Lanes (bits) of `lanes` in which the contact in slot `k` has torsional or rolling friction.
#[inline(always)]
pub(crate) fn rolling_lanes<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> u32 {
    let mut rolling = 0;
    for (pair, lanes) in contacts.pairs(k, if compiled.has_rolling_friction { lanes } else { 0 }) {
        let params = compiled.contact(pair);
        rolling |= params.torsion.max(params.rolling).gt(R::zero()).bits() & lanes;
    }
    rolling
}

/// Multiplies the numbers of a contact's two tangential rows by `sliding_factor`, and leaves that of the normal row unchanged.
#[inline(always)]
fn scale_tangents<R: Real>([n, a, b]: V3<R>, sliding_factor: R) -> V3<R> {
    [n, a * sliding_factor, b * sliding_factor]
}

//! Rows of contacts with torsional or rolling friction. In addition to the three sliding rows, they have one for the rotation about the
//! normal. With rolling friction, they also have two for the rotations about the tangents.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::RowCount;

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::contact::{ContactRows, SlidingRows, effective_friction};
use crate::constraints::equality::elimination::mobility_ratio;
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
    pub(crate) fn rotation_columns(&mut self, input: &RowState<'_, R>, axes: &[V3<R>; 3], weight: V3<R>, mut free: V3<R>) -> V3<R> {
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
    /// Adds the `N` rows of the contact in slot `k`, in the lanes `lanes` (bits). `N` is 6 with rolling friction, and 4 with torsional
    /// friction alone.
    pub(crate) fn add_rotating_contact<const N: usize>(&mut self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32)
    where
        [R; N]: RowCount<R, N>,
    {
        kernel!(R, || {
            let RowState { compiled, mass, .. } = input.state;
            let slot = &contacts.data[k];
            let friction = Friction::of(compiled, contacts, k, lanes);
            let SlidingRows { offsets: [normal, a, b], curvature, lengths, common } = self.sliding_rows(input, contacts, k, lanes);
            self.builder.keep_sliding_rows();
            let n = slot.point.normal;
            let axes = [n, slot.tangent, cross(n, slot.tangent)];
            let surface_rotation = angular(&surface_velocity::motion(compiled, input.kinematics, contacts, k, lanes));
            let surface: V3<R> = array_of(
                #[inline(always)]
                |i| dot(axes[i], surface_rotation) * friction.scale[i],
            );
            let free_rotation = self.builder.rotation_columns(input, &axes, friction.scale, surface);
            self.builder.half_solve::<3>(compiled, mass);
            let mut rotation = [[free_rotation[0]; 2], [free_rotation[1]; 2], [free_rotation[2]; 2]];
            let rotation_lengths = self.builder.eliminate(&self.problem.rows, mass, &mut rotation);
            let factor = friction.sliding_factor;
            let (push, torque) = (slot.impulse, friction.row_impulses(contacts.torque[k]));
            let rows = ContactRows {
                common,
                mu: friction.mu,
                offsets: first_of([normal, scale(a, factor), scale(b, factor), rotation[0], rotation[1], rotation[2]]),
                curvature: curvature.map(
                    #[inline(always)]
                    |terms| scale(terms, factor),
                ),
                mobility_ratio: match (lengths, rotation_lengths) {
                    (Some(sliding), Some(rotation)) => {
                        let before = [scale_tangents(sliding[0], factor), rotation[0]];
                        let after = [scale_tangents(sliding[1], factor), rotation[1]];
                        Some(mobility_ratio(before.as_flattened(), after.as_flattened()))
                    }
                    _ => None,
                },
                impulse: first_of([push[0], push[1] * factor, push[2] * factor, torque[0], torque[1], torque[2]]),
                rotation_scale: Some(friction.scale),
            };
            self.push_contact_rows(
                input,
                contacts,
                (k, lanes),
                &rows,
                #[inline(always)]
                |builder, d| {
                    let (a, b, s) = (builder.linear[d], builder.column[d], mass.sqrt_inv_d[d]);
                    let t = s * factor;
                    first_of([a[0] * s, a[1] * t, a[2] * t, b[0] * s, b[1] * s, b[2] * s])
                },
            );
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
        let (mu, spin, roll) = (effective_friction(contacts.data[k].mu), effective_friction(spin), effective_friction(roll));
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

/// Lanes (bits) of `lanes` in which the contact in slot `k` has torsional friction alone, and lanes in which it has rolling friction.
#[inline(always)]
pub(crate) fn rotating_lanes<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> [u32; 2] {
    let [mut torsional, mut rolling] = [0; 2];
    for (pair, lanes) in contacts.pairs(k, if compiled.has_rolling_friction { lanes } else { 0 }) {
        let params = compiled.contact(pair);
        torsional |= params.torsion.gt(R::zero()).bits() & lanes;
        rolling |= params.rolling.gt(R::zero()).bits() & lanes;
    }
    [torsional & !rolling, rolling]
}

/// First `N` of the numbers of six rows.
#[inline(always)]
fn first_of<T: Copy, const N: usize>(rows: [T; 6]) -> [T; N] {
    *rows.first_chunk().expect("at most six rows")
}

/// Multiplies the numbers of a contact's two tangential rows by `sliding_factor`, and leaves that of the normal row unchanged.
#[inline(always)]
fn scale_tangents<R: Real>([n, a, b]: V3<R>, sliding_factor: R) -> V3<R> {
    [n, a * sliding_factor, b * sliding_factor]
}

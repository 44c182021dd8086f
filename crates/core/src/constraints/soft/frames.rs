//! Contact tangents that MuJoCo does not derive from the normal alone.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Rotates the first tangent of contacts between a plane and a capsule into the direction of the capsule's axis (`mjc_PlaneCapsule`). A
/// pyramidal friction cone depends on the tangents.
pub(super) fn align_tangents<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, contacts: &mut Contacts<R>) {
    kernel!(R, || {
        for k in 0..contacts.slots() {
            let (mut axis, mut aligned) = (zero(), R::Mask::splat(false));
            for (pair, lanes) in contacts.pairs(k, contacts.lanes_of(k)) {
                let pair = compiled.pair(pair);
                if pair.is_plane_and_capsule() {
                    let (there, geom) = (R::Mask::from_bits(lanes), &compiled.geoms[pair.geoms[1]]);
                    let own = rotate(&kinematics.mat[geom.frame], column(&splat(geom.mat), 2));
                    axis = select(there, own, axis);
                    aligned = aligned.or(there);
                }
            }
            if aligned.any() {
                let slot = &mut contacts.data[k];
                let n = slot.point.normal;
                let across = add_scaled(axis, n, -dot(n, axis));
                let length = norm(across);
                let defined = aligned.and(length.gt(R::of(1e-15)));
                let unit = scale(across, R::one() / R::select(defined, length, R::one()));
                slot.tangent = select(defined, unit, slot.tangent);
            }
        }
    })
}

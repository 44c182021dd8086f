//! Velocities of surfaces that do not come from degrees of freedom: conveyors (MuJoCo's `surfacevel`), and mocap bodies.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Velocity of the second surface relative to the first at contact `k`, in the lanes `lanes` (bits). The part from degrees of freedom is
/// not included.
///
/// The result has the angular velocity, rad/s, and the linear velocity at the contact point, m/s. The velocity of a conveyor acts in the
/// tangent plane and about the normal (MuJoCo's documentation of `surfacevel`).
#[inline(always)]
pub fn motion<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> V6<R> {
    let (mut sum, point) = (zero(), &contacts.data[k].point);
    for surface in &compiled.surfaces {
        let (mut plus, mut minus) = (0u32, 0u32);
        for (pair, lanes) in contacts.pairs(k, lanes) {
            let [a, b] = compiled.pair_geoms(pair).expect("a contact belongs to a pair");
            plus |= if b == surface.geom { lanes } else { 0 };
            minus |= if a == surface.geom { lanes } else { 0 };
        }
        if plus | minus == 0 {
            continue;
        }
        let frame = compiled.geoms[surface.geom].frame;
        let mut m = zero();
        if let Some(k) = surface.mocap {
            let motion = &kinematics.mocap_velocities[k];
            m = spatial(angular(motion), velocity_at(motion, sub(point.pos, kinematics.pos[frame])));
        }
        if let Some(own) = surface.own {
            let mat = &kinematics.mat[frame];
            let (along, spin) = (rotate(mat, splat(own[0])), rotate(mat, splat(own[1])));
            let arm = sub(point.pos, kinematics.point(frame, compiled.params.geom(surface.geom).pos));
            let own = add(along, cross(spin, arm));
            let n = point.normal;
            m = add(m, spatial(scale(n, dot(spin, n)), add_scaled(own, n, -dot(own, n))));
        }
        let (plus, minus) = (R::Mask::from_bits(plus), R::Mask::from_bits(minus));
        sum = select(plus, add(sum, m), select(minus, sub(sum, m), sum));
    }
    sum
}

/// Angular velocity of the conveyor of geom `b` relative to that of geom `a`, world axes, rad/s.
#[inline(always)]
pub fn spin<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, [a, b]: [usize; 2]) -> V3<R> {
    let mut sum = zero();
    for surface in &compiled.surfaces {
        let (plus, minus) = (surface.geom == b, surface.geom == a);
        if let (Some([_, spin]), true) = (surface.own, plus || minus) {
            let spin = rotate(&kinematics.mat[compiled.geoms[surface.geom].frame], splat(spin));
            sum = if plus { add(sum, spin) } else { sub(sum, spin) };
        }
    }
    sum
}

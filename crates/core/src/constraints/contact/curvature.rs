//! Curvature terms: change of a contact's velocity by the motion of the contact point within the step.
//!
//! The midpoint rule evaluates its rows in the middle of the step, but their target is a velocity at the end, `time_after` seconds later.
//! There
//!
//! ```text
//! J(end) v+ = J v+ + time_after kappa,    kappa = A_b - A_a + (omega_b - omega_a) x c'
//! ```
//!
//! to second order. A are the accelerations of the two bodies' velocity fields at the contact while no joint accelerates. c' is the
//! velocity of the contact point. Example: a ball rolls on a turntable. At the end of the step it touches another point of the turntable,
//! which has another velocity. Without kappa the ball would get the velocity of the point in the middle of the step. It would lag by half a
//! step and gain energy, as with Euler's explicit rule.
//!
//! The velocity c' of the contact point depends on the shapes. A round geom (sphere, capsule end) touches at the point one radius from its
//! centre, along the normal. This point moves with the centre, and rotates about it as the normal does. Between two round geoms, the normal
//! rotates with the line between their centres. Between a round geom and another geom, it rotates with the other geom, as on a flat face.
//! Between two geoms that are not round, a corner of the second body touches, and the point moves with that body.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::row_builder::RowBuilder;
use crate::math::spatial::*;
use crate::tuning::MAX_CURVED_OVERLAP;

/// Velocity field of a body near a contact.
#[derive(Clone, Copy)]
struct Field<R> {
    /// Angular velocity, rad/s.
    angular_velocity: V3<R>,
    /// Linear velocity of the body at the contact, m/s.
    velocity: V3<R>,
    /// Time derivative of the velocity field at a fixed point in space, m/s^2.
    rate: V3<R>,
}

impl<R: Real> RowBuilder<R> {
    /// Change of the velocities of the three rows in `column` by the free motion: free velocity after the step minus velocity before the
    /// step, m/s.
    #[inline(always)]
    pub(crate) fn change_by_free_motion(&self, input: &RowInput<'_, R>) -> V3<R> {
        let mut change = zero();
        for &d in &self.dofs {
            let d = d as usize;
            change = add_scaled(change, self.column[d], input.v_free[d] - input.v[d]);
        }
        change
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the curvature terms to the offsets of a contact's friction rows, in the lanes `lanes`. Returns the terms, m/s; 0 where none was
    /// added. Impacts, deep overlaps, and contacts of which only one surface can move get no terms.
    ///
    /// `free` are the velocities of the rows without constraints, and `change` is the change of these velocities by the free motion, m/s.
    /// A term t gives its row the target velocity -t. Let J v be the velocity of the row before the step, and G the row's diagonal entry of
    /// the Delassus matrix. The impulse of the row changes the velocity from J v to -t, with the work (t^2 - (J v)^2) / (2 G). Terms are
    /// therefore bounded by |t| <= |J v|, so that they add no energy. The function is compiled separately, because few contacts need it,
    /// and inlined it would slow down all.
    #[inline(never)]
    pub(crate) fn add_curvature(
        &self,
        input: &RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: R::Mask,
        [free, change]: [V3<R>; 2],
        offsets: &mut [[R; 2]; 3],
    ) -> [R; 2] {
        kernel!(R, || {
            let time_after = input.times_of_slot(contacts, k, lanes.bits()).after;
            let slot = &contacts.data[k];
            let n = slot.point.normal;
            let axes = [n, slot.tangent, cross(n, slot.tangent)];
            let deep = slot.point.distance.lt(-R::of(MAX_CURVED_OVERLAP));
            let lanes = lanes.and(R::Mask::from_bits(self.builder.both_move)).and_not(deep);
            let lanes = match self.problem.impacts.last() {
                Some(impact) => lanes.and_not(impact.lanes),
                None => lanes,
            };
            let rate = rate(input, contacts, k, lanes.bits());
            let mut curves = [R::zero(); 2];
            for i in 1..3 {
                let most = (free[i] - change[i]).abs();
                let curve = (dot(axes[i], rate) * time_after).clamp(-most, most);
                for offset in &mut offsets[i] {
                    *offset = R::select(lanes, *offset + curve, *offset);
                }
                curves[i - 1] = R::select(lanes, curve, R::zero());
            }
            curves
        })
    }
}

/// Acceleration kappa in the formula of the module, for the contacts in slot `k` (one contact per lane), in the lanes `lanes` (bits),
/// m/s^2.
#[inline(always)]
fn rate<R: Real>(input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> V3<R> {
    let RowState { compiled, kinematics, .. } = input.state;
    let point = &contacts.data[k].point;
    let n = point.normal;
    let half = point.distance * R::of(0.5);
    let mut out = zero();
    for (pair, same) in contacts.pairs(k, lanes) {
        let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
        let [first, second] = geoms;
        let (a, b) = (field(input, compiled.geoms[first].frame, point.pos), field(input, compiled.geoms[second].frame, point.pos));
        let (from_a, from_b) = (compiled.params.geom(first).size[0] + half, compiled.params.geom(second).size[0] + half);
        // Centres of spheres and capsule ends move with their bodies.
        let centre_a = sub(a.velocity, scale(cross(a.angular_velocity, n), from_a));
        let centre_b = add_scaled(b.velocity, cross(b.angular_velocity, n), from_b);
        let point_velocity = match [compiled.geoms[first].is_round, compiled.geoms[second].is_round] {
            [true, true] => {
                let apart = sub(centre_b, centre_a);
                let turned = scale(add_scaled(apart, n, -dot(apart, n)), from_b / (from_a + from_b));
                sub(centre_b, turned)
            }
            [false, true] => sub(centre_b, scale(cross(a.angular_velocity, n), from_b)),
            [true, false] => add_scaled(centre_a, cross(b.angular_velocity, n), from_a),
            [false, false] => b.velocity,
        };
        let conveyor_spin = surface_velocity::spin(compiled, kinematics, geoms);
        let relative_spin = add(sub(b.angular_velocity, a.angular_velocity), scale(n, dot(conveyor_spin, n)));
        let kappa = add(sub(b.rate, a.rate), cross(relative_spin, point_velocity));
        out = select(R::Mask::from_bits(same), kappa, out);
    }
    out
}

/// Velocity field of a frame at the point `p`.
#[inline(always)]
fn field<R: Real>(input: &RowInput<'_, R>, frame: usize, p: V3<R>) -> Field<R> {
    let RowState { compiled, kinematics, .. } = input.state;
    match frame.checked_sub(compiled.links.len() + 1) {
        _ if frame == 0 => Field { angular_velocity: zero(), velocity: zero(), rate: zero() },
        Some(mocap) => {
            let motion = &kinematics.mocap_velocities[mocap];
            let velocity = velocity_at(motion, sub(p, kinematics.pos[frame]));
            Field { angular_velocity: angular(motion), velocity, rate: cross(linear(motion), angular(motion)) }
        }
        None => {
            let (velocity, change) = (&input.motion.velocity[frame - 1], &input.motion.acceleration[frame - 1]);
            let arm = sub(p, kinematics.origin[compiled.links[frame - 1].tree]);
            // The recursion represents gravity as an upward acceleration of the world. Adding gravity removes it.
            let rate = add(velocity_at(change, arm), compiled.params.gravity());
            Field { angular_velocity: angular(velocity), velocity: velocity_at(velocity, arm), rate }
        }
    }
}

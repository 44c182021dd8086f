//! Vectors, rotations and spatial algebra over lanes, world-aligned.
//!
//! Spatial vectors are (angular, linear), both in world axes. Motions, forces and inertias of one kinematic tree refer to one point, the
//! position of its root. They therefore add without transforms (Featherstone 2008, chapter 2).

use stepper_real::Real;

pub use stepper_geometry::linear_algebra::*;

/// Spatial motion (angular velocity, velocity at the reference point) or spatial force (moment about the reference point, force), in world
/// axes.
pub type V6<R> = [R; 6];
/// Inertia of a rigid body about the reference point. Its ten numbers are the mass, the three first moments of mass, and the second moments
/// xx, yy, zz, xy, xz, yz.
pub type Inertia<R> = [R; 10];

/// Scalar product of a spatial motion and a spatial force: power.
#[inline(always)]
pub fn dot6<R: Real>(a: V6<R>, b: V6<R>) -> R {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) + (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])
}

/// Angular part of a spatial vector.
#[inline(always)]
pub fn angular<R: Real>(a: &V6<R>) -> V3<R> {
    [a[0], a[1], a[2]]
}

/// Linear part of a spatial vector.
#[inline(always)]
pub fn linear<R: Real>(a: &V6<R>) -> V3<R> {
    [a[3], a[4], a[5]]
}

/// Spatial vector from its angular part `w` and its linear part `v`.
#[inline(always)]
pub fn spatial<R: Real>(w: V3<R>, v: V3<R>) -> V6<R> {
    [w[0], w[1], w[2], v[0], v[1], v[2]]
}

/// Velocity of the point at `r`, relative to the reference point, in a spatial motion.
#[inline(always)]
pub fn velocity_at<R: Real>(motion: &V6<R>, r: V3<R>) -> V3<R> {
    add(linear(motion), cross(angular(motion), r))
}

/// Cross product of two spatial motions: time derivative of `m` if it moves with `v` (Featherstone 2008, eq. 2.31).
#[inline(always)]
pub fn cross_motion<R: Real>(v: &V6<R>, m: &V6<R>) -> V6<R> {
    spatial(cross(angular(v), angular(m)), add(cross(angular(v), linear(m)), cross(linear(v), angular(m))))
}

/// Cross product of a spatial motion and a spatial force (Featherstone 2008, eq. 2.32).
#[inline(always)]
pub fn cross_force<R: Real>(v: &V6<R>, f: &V6<R>) -> V6<R> {
    spatial(add(cross(angular(v), angular(f)), cross(linear(v), linear(f))), cross(angular(v), linear(f)))
}

/// Spatial momentum of a rigid body: inertia `i` times motion `m`.
#[inline(always)]
pub fn apply_inertia<R: Real>(i: &Inertia<R>, m: &V6<R>) -> V6<R> {
    let first = [i[1], i[2], i[3]];
    let (w, v) = (angular(m), linear(m));
    let second =
        [i[4] * w[0] + i[7] * w[1] + i[8] * w[2], i[7] * w[0] + i[5] * w[1] + i[9] * w[2], i[8] * w[0] + i[9] * w[1] + i[6] * w[2]];
    spatial(add(second, cross(first, v)), sub(scale(v, i[0]), cross(first, w)))
}

/// Inertia about the reference point of a body with mass `m`, kg, and centre of mass at `r` from the reference point, m.
///
/// `c` is the inertia about the centre of mass (xx, yy, zz, xy, xz, yz) in the body's axes, kg m^2. The columns of `x` are these axes in
/// the world.
#[inline(always)]
pub fn inertia_at<R: Real>(m: R, c: [R; 6], x: &M3<R>, r: V3<R>) -> Inertia<R> {
    let local = [c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2]];
    let t = mat_mul(x, &local);
    let mr = scale(r, m);
    [
        m,
        mr[0],
        mr[1],
        mr[2],
        entry_of_mat_mul_transposed(&t, x, 0, 0) + (mr[1] * r[1] + mr[2] * r[2]),
        entry_of_mat_mul_transposed(&t, x, 1, 1) + (mr[0] * r[0] + mr[2] * r[2]),
        entry_of_mat_mul_transposed(&t, x, 2, 2) + (mr[0] * r[0] + mr[1] * r[1]),
        entry_of_mat_mul_transposed(&t, x, 0, 1) - mr[0] * r[1],
        entry_of_mat_mul_transposed(&t, x, 0, 2) - mr[0] * r[2],
        entry_of_mat_mul_transposed(&t, x, 1, 2) - mr[1] * r[2],
    ]
}

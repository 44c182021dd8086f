//! Projections on the sets of admissible impulses, and arithmetic with masks and lengths, over lanes.

use stepper_real::{Mask, Real, Scalar};

/// Projection on the friction cone `|x_t| <= mu x_n`: the point of the cone that is nearest to `x = (n, t1, t2, ...)`.
///
/// The three cases are the polar cone (result 0), the cone (result `x`) and the region between them (result on the surface). With `mu = 0`
/// the cone is a half line.
#[inline(always)]
pub fn project<R: Real, const N: usize>(x: [R; N], mu: R) -> [R; N] {
    let (n, mut square) = (x[0], x[1] * x[1]);
    for &t in &x[2..] {
        square += t * t;
    }
    let tangent = square.sqrt();
    // Without friction, mu n is zero for every n. The second condition then excludes points with n < 0.
    let inside = tangent.le(mu * n).and(n.ge(R::zero()));
    let polar = (mu * tangent).le(-n);
    let height = (mu * tangent + n) / (R::one() + mu * mu);
    let scale = mu * height / R::select(tangent.gt(R::zero()), tangent, R::one());
    let mut out = x;
    for i in 0..N {
        let on_surface = if i == 0 { height } else { x[i] * scale };
        out[i] = R::select(inside, x[i], R::select(polar, R::zero(), on_surface));
    }
    out
}

/// Projection of `x` on the interval `[lo, hi]`.
#[inline(always)]
pub fn clamp<R: Real>(x: R, lo: R, hi: R) -> R {
    x.max(lo).min(hi)
}

/// Length of the vector (x, y).
#[inline(always)]
pub(crate) fn norm2<R: Real>(x: R, y: R) -> R {
    (x * x + y * y).sqrt()
}

/// Number `x` in the lanes of the mask `m`, and zero elsewhere.
#[inline(always)]
pub(crate) fn masked<R: Real>(m: R::Mask, x: R) -> R {
    R::select(m, x, R::zero())
}

/// Lanes of the mask `m` in which `x` is above zero.
#[inline(always)]
pub(crate) fn positive<R: Real>(m: R::Mask, x: R) -> R::Mask {
    m.and(x.gt(R::zero()))
}

/// Ratio of mobilities below which a contact counts as immovable along its normal. The ratio is the contact's mobility along its normal,
/// divided by the sum of its mobilities in all three directions.
///
/// The value is the square of a ratio of lever arms of 1e-5, or of a thousand rounding errors if that is larger. At a ratio of lever arms
/// of 1e-5, a body that rotates moves its contact point 1e5 times faster across the normal than along it. Stopping the point along the
/// normal takes 1e5 times the force that rotates it. Evidence: a cylinder that is steered about an axis through its contact passes this
/// pose, where forces were 1e15 N.
#[inline(always)]
fn negligible<R: Real>() -> f64 {
    let lever = f64::max(1e-5, 1e3 * <R::Scalar as Scalar>::EPSILON.to_f64());
    lever * lever
}

/// Lanes of the mask `m` in which a contact can move along its normal.
///
/// The mobility `along` the normal, 1/kg, must exceed `least`, and the fraction [`negligible`] of the sum `all` of the mobilities in the
/// contact's three directions.
#[inline(always)]
pub(crate) fn movable<R: Real>(m: R::Mask, along: R, all: R, least: R) -> R::Mask {
    positive(m, along).and(along.gt(least.max(all * R::of(negligible::<R>()))))
}

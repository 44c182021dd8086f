//! Projections on the sets of admissible impulses, and the arithmetic of masks and lengths that all kinds of constraints share.

use stepper_real::{Mask, Real, Scalar};

/// Projection on the friction cone `|x_t| <= mu x_n`: its point nearest to `x = (n, t1, t2, ...)`.
///
/// The three cases are the polar cone (result 0), the cone (result `x`) and the surface. With `mu = 0` the cone is a half line.
#[inline(always)]
pub fn project<R: Real, const N: usize>(x: [R; N], mu: R) -> [R; N] {
    let (n, mut square) = (x[0], x[1] * x[1]);
    for &t in &x[2..] {
        square += t * t;
    }
    let tangent = square.sqrt();
    // Without friction the cone is a half line, and mu n is zero on both of its sides.
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

/// Projection on the interval `[lo, hi]`.
#[inline(always)]
pub fn clamp<R: Real>(x: R, lo: R, hi: R) -> R {
    x.max(lo).min(hi)
}

/// Length of a tangent vector.
#[inline(always)]
pub(crate) fn norm2<R: Real>(x: R, y: R) -> R {
    (x * x + y * y).sqrt()
}

/// Masked number: `x` where `m`, else zero.
#[inline(always)]
pub(crate) fn masked<R: Real>(m: R::Mask, x: R) -> R {
    R::select(m, x, R::zero())
}

/// Lanes of `m` in which `x` is a number above zero.
#[inline(always)]
pub(crate) fn positive<R: Real>(m: R::Mask, x: R) -> R::Mask {
    m.and(x.gt(R::zero()))
}

/// Ratio of the mobility along a contact's normal to that in all three directions below which the normal mobility counts as zero.
///
/// It is the square of a lever arm of a hundred-thousandth of those of the other directions, or rounding. A body that turns about such a
/// lever arm approaches by 1e-5 of its speed. Holding it takes 1e5 times the force that turns it. A cylinder that is steered about an axis
/// through its contact passes this pose, where forces were 1e15 N.
#[inline(always)]
fn negligible<R: Real>() -> f64 {
    let lever = f64::max(1e-5, 1e3 * <R::Scalar as Scalar>::EPSILON.to_f64());
    lever * lever
}

/// Lanes of `m` in which a contact can move along its normal.
///
/// Its mobility `along`, 1/kg, must exceed `least` and a negligible fraction of the sum `all` of the mobilities in its three directions.
#[inline(always)]
pub(crate) fn movable<R: Real>(m: R::Mask, along: R, all: R, least: R) -> R::Mask {
    positive(m, along).and(along.gt(least.max(all * R::of(negligible::<R>()))))
}

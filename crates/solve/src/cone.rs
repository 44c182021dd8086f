//! Projections on the sets that impulses live in.

use stepper_real::{Mask, Real};

/// The point of the friction cone `|x_t| <= mu x_n` nearest to `x = (n, t1, t2)`.
///
/// The three cases are the polar cone (answer 0), the cone itself (answer `x`) and the surface. `mu = 0` is the half line.
#[inline(always)]
pub fn project<R: Real>(x: [R; 3], mu: R) -> [R; 3] {
    let [n, t1, t2] = x;
    let tangent = (t1 * t1 + t2 * t2).sqrt();
    // Without friction the cone is a half line, and mu n is zero on both of its sides.
    let inside = tangent.le(mu * n).and(n.ge(R::zero()));
    let polar = (mu * tangent).le(-n);
    let height = (mu * tangent + n) / (R::one() + mu * mu);
    let scale = mu * height / R::select(tangent.gt(R::zero()), tangent, R::one());
    let on_surface = [height, t1 * scale, t2 * scale];
    let mut out = x;
    for i in 0..3 {
        out[i] = R::select(inside, x[i], R::select(polar, R::zero(), on_surface[i]));
    }
    out
}

/// The point of `[lo, hi]` nearest to `x`.
#[inline(always)]
pub fn clamp<R: Real>(x: R, lo: R, hi: R) -> R {
    x.max(lo).min(hi)
}

/// Length of a tangent vector.
#[inline(always)]
pub(crate) fn norm2<R: Real>(x: R, y: R) -> R {
    (x * x + y * y).sqrt()
}

/// `|a - b|` for 3-vectors.
#[inline(always)]
pub(crate) fn distance3<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// `x` where `m`, else zero.
#[inline(always)]
pub(crate) fn keep<R: Real>(m: R::Mask, x: R) -> R {
    R::select(m, x, R::zero())
}

/// Lanes of `m` in which `x` is a number above zero.
#[inline(always)]
pub(crate) fn positive<R: Real>(m: R::Mask, x: R) -> R::Mask {
    m.and(x.gt(R::zero()))
}

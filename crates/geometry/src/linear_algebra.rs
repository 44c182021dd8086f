//! Vectors, rotation matrices and quaternions over lanes: a single one, or one in each lane of a SIMD type.

use stepper_real::{Mask, Real, Scalar};

/// Vector (x, y, z).
pub type V3<R> = [R; 3];
/// Rotation matrix, row by row. Its columns are the axes of a frame in the world.
pub type M3<R> = [R; 9];

/// Array with the entries f(0), f(1) and so on.
///
/// The function equals `std::array::from_fn`, but is always inlined. A function that is not inlined into a kernel would not have the
/// kernel's SIMD instructions, and would be called for each entry.
#[inline(always)]
pub fn array_of<T: Copy, const N: usize>(f: impl Fn(usize) -> T) -> [T; N] {
    let mut array = [f(0); N];
    for (k, x) in array.iter_mut().enumerate().skip(1) {
        *x = f(k);
    }
    array
}

/// Array with the entries of an inlined closure: `array!(|k| a[k] * b[k])`, see [`array_of`].
///
/// [`array_of`]: crate::linear_algebra::array_of
#[macro_export]
macro_rules! array {
    (|$k:ident| $entry:expr) => {
        $crate::linear_algebra::array_of(
            #[inline(always)]
            |$k| $entry,
        )
    };
}
pub use crate::array;

/// Defines functions of vectors from an expression for each entry.
macro_rules! entrywise {
    ($($(#[$doc:meta])* $f:ident($($a:ident: $t:ty),+) = |$i:ident| $entry:expr;)+) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $f<R: Real, const N: usize>($($a: $t),+) -> [R; N] {
            let mut out = [R::zero(); N];
            for $i in 0..N {
                out[$i] = $entry;
            }
            out
        }
    )+};
}

entrywise! {
    /// Sum a + b of two vectors.
    add(a: [R; N], b: [R; N]) = |i| a[i] + b[i];
    /// Difference a - b of two vectors.
    sub(a: [R; N], b: [R; N]) = |i| a[i] - b[i];
    /// Vector a times the number s.
    scale(a: [R; N], s: R) = |i| a[i] * s;
    /// Product of two vectors, entry by entry.
    times(a: [R; N], b: [R; N]) = |i| a[i] * b[i];
    /// Sum a + b s of two vectors, the second one times the number s.
    add_scaled(a: [R; N], b: [R; N], s: R) = |i| a[i] + b[i] * s;
    /// Vector `a` in the lanes of the mask `m`, and `b` elsewhere.
    select(m: R::Mask, a: [R; N], b: [R; N]) = |i| R::select(m, a[i], b[i]);
    /// Vector with the same numbers in every lane.
    splat(a: [R::Scalar; N]) = |i| R::splat(a[i]);
}

/// Entries of one lane, in f64.
#[inline(always)]
pub fn of_lane<R: Real, const N: usize>(x: &[R; N], lane: usize) -> [f64; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        out[i] = x[i].lane(lane).to_f64();
    }
    out
}

/// Zero vector.
#[inline(always)]
pub fn zero<R: Real, const N: usize>() -> [R; N] {
    [R::zero(); N]
}

/// Dot product a . b.
#[inline(always)]
pub fn dot<R: Real>(a: V3<R>, b: V3<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product a x b.
#[inline(always)]
pub fn cross<R: Real>(a: V3<R>, b: V3<R>) -> V3<R> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Length |a| of a vector.
#[inline(always)]
pub fn norm<R: Real>(a: V3<R>) -> R {
    dot(a, a).sqrt()
}

/// Unit vector along `v`, length of `v`, and lanes in which the length is not 0. The vector is `instead` in the other lanes.
#[inline(always)]
pub fn direction<R: Real>(v: V3<R>, instead: V3<R>) -> (V3<R>, R, R::Mask) {
    let length = norm(v);
    let some = length.gt(R::zero());
    (select(some, scale(v, R::one() / R::select(some, length, R::one())), instead), length, some)
}

/// Product M a: the vector `a` of a frame, in world axes, if the columns of M are the frame's axes in the world.
#[inline(always)]
pub fn rotate<R: Real>(m: &M3<R>, a: V3<R>) -> V3<R> {
    [m[0] * a[0] + m[1] * a[1] + m[2] * a[2], m[3] * a[0] + m[4] * a[1] + m[5] * a[2], m[6] * a[0] + m[7] * a[1] + m[8] * a[2]]
}

/// Product M^T a: the vector `a` of the world, in the axes of a frame, if the columns of M are the frame's axes in the world.
#[inline(always)]
pub fn rotate_back<R: Real>(m: &M3<R>, a: V3<R>) -> V3<R> {
    [m[0] * a[0] + m[3] * a[1] + m[6] * a[2], m[1] * a[0] + m[4] * a[1] + m[7] * a[2], m[2] * a[0] + m[5] * a[1] + m[8] * a[2]]
}

/// Product M N^T of two matrices.
#[inline(always)]
pub fn mat_mul_transposed<R: Real>(m: &M3<R>, n: &M3<R>) -> M3<R> {
    let mut out = [R::zero(); 9];
    for i in 0..3 {
        for j in 0..3 {
            out[3 * i + j] = entry_of_mat_mul_transposed(m, n, i, j);
        }
    }
    out
}

/// Product M N of two matrices.
#[inline(always)]
pub fn mat_mul<R: Real>(m: &M3<R>, n: &M3<R>) -> M3<R> {
    let mut out = [R::zero(); 9];
    for i in 0..3 {
        for j in 0..3 {
            out[3 * i + j] = m[3 * i] * n[j] + m[3 * i + 1] * n[3 + j] + m[3 * i + 2] * n[6 + j];
        }
    }
    out
}

/// Column k of a matrix: axis k of the frame, in the world.
#[inline(always)]
pub fn column<R: Real>(m: &M3<R>, k: usize) -> V3<R> {
    [m[k], m[3 + k], m[6 + k]]
}

/// Entry (i, j) of the matrix product T X^T.
#[inline(always)]
pub fn entry_of_mat_mul_transposed<R: Real>(t: &M3<R>, x: &M3<R>, i: usize, j: usize) -> R {
    t[3 * i] * x[3 * j] + t[3 * i + 1] * x[3 * j + 1] + t[3 * i + 2] * x[3 * j + 2]
}

/// Rotation matrix of a unit quaternion (w, x, y, z).
#[inline(always)]
pub fn quat_to_mat<R: Real>(q: [R; 4]) -> M3<R> {
    let [w, x, y, z] = q;
    let (ww, xx, yy, zz) = (w * w, x * x, y * y, z * z);
    let (wx, wy, wz, xy, xz, yz) = (w * x, w * y, w * z, x * y, x * z, y * z);
    let two = R::of(2.0);
    [
        ww + xx - yy - zz,
        two * (xy - wz),
        two * (xz + wy),
        two * (xy + wz),
        ww - xx + yy - zz,
        two * (yz - wx),
        two * (xz - wy),
        two * (yz + wx),
        ww - xx - yy + zz,
    ]
}

/// Unit quaternion (w, x, y, z) of a rotation matrix. The sign is arbitrary, because q and -q are the same rotation.
///
/// The columns of 4 q q^T are sums and differences of the matrix's entries. The longest column has the smallest rounding error (Shepperd,
/// 1978).
#[inline(always)]
pub fn mat_to_quat<R: Real>(m: &M3<R>) -> [R; 4] {
    let one = R::one();
    let (x, y, z) = (m[7] - m[5], m[2] - m[6], m[3] - m[1]);
    let (xy, xz, yz) = (m[1] + m[3], m[2] + m[6], m[5] + m[7]);
    let columns = [
        [one + m[0] + m[4] + m[8], x, y, z],
        [x, one + m[0] - m[4] - m[8], xy, xz],
        [y, xy, one - m[0] + m[4] - m[8], yz],
        [z, xz, yz, one - m[0] - m[4] + m[8]],
    ];
    let (mut best, mut most) = (columns[0], columns[0][0]);
    for k in 1..4 {
        let longer = columns[k][k].gt(most);
        best = select(longer, columns[k], best);
        most = R::select(longer, columns[k][k], most);
    }
    quat_normalize(best)
}

/// Product p q of two quaternions (w, x, y, z).
#[inline(always)]
pub fn quat_mul<R: Real>(p: [R; 4], q: [R; 4]) -> [R; 4] {
    [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]
}

/// Rotation from the orientation `from` to the orientation `to`, in the axes of `from`. All are quaternions (w, x, y, z).
#[inline(always)]
pub fn quat_between<R: Real>([w, x, y, z]: [R; 4], to: [R; 4]) -> [R; 4] {
    quat_mul([w, -x, -y, -z], to)
}

/// Unit quaternion q / |q|.
#[inline(always)]
pub fn quat_normalize<R: Real>(q: [R; 4]) -> [R; 4] {
    let n = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    scale(q, R::one() / n)
}

/// Unit quaternion of the rotation vector `a`, rad: the exponential map.
#[inline(always)]
pub fn quat_exp<R: Real>(a: V3<R>) -> [R; 4] {
    let half = norm(a) * R::of(0.5);
    let (s, c) = half.sin_cos();
    // The series of sin(x)/x is exact up to rounding while x^4/120 is below it. The quotient is accurate beyond.
    let small = half.lt(R::of(1e-4));
    let series = R::one() - half * half * R::of(1.0 / 6.0);
    let sinc = R::select(small, series, s / R::select(small, R::one(), half));
    let k = sinc * R::of(0.5);
    [c, a[0] * k, a[1] * k, a[2] * k]
}

/// Rotation vector, rad, of a unit quaternion, with a length of at most pi: the inverse of [`quat_exp`].
#[inline(always)]
pub fn quat_log<R: Real>(q: [R; 4]) -> V3<R> {
    // q and -q are the same rotation. The shorter rotation vector is taken.
    let flip = q[0].lt(R::zero());
    let q = select(flip, scale(q, -R::one()), q);
    let v = [q[1], q[2], q[3]];
    let s = norm(v);
    let small = s.lt(R::of(1e-8));
    let angle = s.atan2(q[0]) * R::of(2.0);
    let k = R::select(small, R::of(2.0), angle / R::select(small, R::one(), s));
    scale(v, k)
}

/// Time derivative of the rotation vector `a` of a frame with the orientation exp(a), rad/s (dexpinv).
///
/// `omega` is the angular velocity of the frame in its axes, rad/s. Small angles use the Bernoulli series of (1 - a/2 cot(a/2)) / a^2.
#[inline(always)]
pub fn rotation_rate<R: Real>(a: V3<R>, omega: V3<R>) -> V3<R> {
    /// Coefficients of the Bernoulli series in the square of the angle.
    const SERIES: [f64; 6] = [1.0 / 12.0, 1.0 / 720.0, 1.0 / 30240.0, 1.0 / 1_209_600.0, 1.0 / 47_900_160.0, 691.0 / 1_307_674_368_000.0];
    let square = dot(a, a);
    let small = square.lt(R::of(0.25));
    let mut factor = R::zero();
    for k in (0..SERIES.len()).rev() {
        factor = factor * square + R::of(SERIES[k]);
    }
    if !small.all() {
        let angle = R::select(small, R::one(), square).sqrt();
        let (sin, cos) = (angle * R::of(0.5)).sin_cos();
        let closed = (R::one() - angle * R::of(0.5) * cos / sin) / (angle * angle);
        factor = R::select(small, factor, closed);
    }
    let once = cross(a, omega);
    add(add_scaled(omega, once, R::of(0.5)), scale(cross(a, once), factor))
}

/// Rotation matrix about the unit vector `axis`, from sine and cosine of the angle (Rodrigues).
#[inline(always)]
pub fn axis_rotation<R: Real>(axis: V3<R>, sin: R, cos: R) -> M3<R> {
    let [x, y, z] = axis;
    let k = R::one() - cos;
    let (kx, ky, kz) = (k * x, k * y, k * z);
    [
        kx * x + cos,
        kx * y - sin * z,
        kx * z + sin * y,
        kx * y + sin * z,
        ky * y + cos,
        ky * z - sin * x,
        kx * z - sin * y,
        ky * z + sin * x,
        kz * z + cos,
    ]
}

/// Axes (n, t1, t2) of a contact with unit normal `n`, right-handed.
#[inline(always)]
pub fn contact_frame<R: Real>(n: V3<R>) -> [V3<R>; 3] {
    let t = tangent(n);
    [n, t, cross(n, t)]
}

/// Unit vector perpendicular to the unit normal `n`: the world's y axis, or z if the normal is near y, made orthogonal to n.
///
/// This is the rule of MuJoCo's `mju_makeFrame`.
#[inline(always)]
fn tangent<R: Real>(n: V3<R>) -> V3<R> {
    let (z, one) = (R::zero(), R::one());
    let near_y = n[1].abs().ge(R::of(0.5));
    let seed = select(near_y, [z, z, one], [z, one, z]);
    let t = add_scaled(seed, n, -dot(seed, n));
    scale(t, one / norm(t))
}

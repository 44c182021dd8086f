//! Single `f64` compiled with AVX2 instructions, for one environment. The arithmetic is that of `f64`, and the compiler may vectorise a
//! kernel across the numbers of the environment. Features: `avx2`.
//!
//! AVX-512 gives no speedup here (measured on the models of `benches/comparison`), so that its level uses the same type.

use crate::operators::{elementary_functions, inline_functions, operators, vectorize};
use crate::real::Real;

/// Single-lane type of a precision at the levels AVX2 and AVX-512. For `f32` it is plain `f32`, because a type with AVX2 instructions is
/// not faster.
macro_rules! single {
    (f64) => {
        crate::single_lane::F64x1
    };
    (f32) => {
        f32
    };
}
pub(crate) use single;

/// Single `f64` with AVX2 instructions. It may be used only after a check of the CPU level.
#[derive(Clone, Copy, Debug, Default)]
#[repr(transparent)]
pub struct F64x1(f64);

operators! { [] F64x1:
    Add add AddAssign add_assign = |a, b| F64x1(a.0 + b.0);
    Sub sub SubAssign sub_assign = |a, b| F64x1(a.0 - b.0);
    Mul mul MulAssign mul_assign = |a, b| F64x1(a.0 * b.0);
    Div div DivAssign div_assign = |a, b| F64x1(a.0 / b.0);
    - = |a| F64x1(-a.0);
}

impl Real for F64x1 {
    type Scalar = f64;
    type Mask = bool;
    type Single = Self;
    const LANES: usize = 1;
    vectorize!("avx2");
    elementary_functions!();

    inline_functions! {
        fn splat(x: f64) -> Self = F64x1(x);
        fn load(s: &[f64]) -> Self = F64x1(s[0]);
        fn lane(self, i: usize) -> f64 = self.0.lane(i);
        fn lt(self, o: Self) -> bool = self.0 < o.0;
        fn le(self, o: Self) -> bool = self.0 <= o.0;
        fn eq(self, o: Self) -> bool = self.0 == o.0;
        fn select(m: bool, a: Self, b: Self) -> Self = if m { a } else { b };
        fn min(self, o: Self) -> Self = F64x1(Real::min(self.0, o.0));
        fn max(self, o: Self) -> Self = F64x1(Real::max(self.0, o.0));
        fn abs(self) -> Self = F64x1(Real::abs(self.0));
        fn sqrt(self) -> Self = F64x1(Real::sqrt(self.0));
        fn copysign(self, sign: Self) -> Self = F64x1(Real::copysign(self.0, sign.0));
        fn round_even(self) -> Self = F64x1(Real::round_even(self.0));
        fn pow2(self) -> Self = F64x1(Real::pow2(self.0));
    }
    #[inline(always)]
    fn store(self, s: &mut [f64]) {
        s[0] = self.0;
    }
    // The numbers are copied in one call, because a vectorised loop over the few numbers of one environment takes longer.
    #[inline(always)]
    fn load_all(from: &[f64], out: &mut [Self]) {
        let n = from.len().min(out.len());
        // SAFETY: the type is `repr(transparent)` around `f64`.
        let out = unsafe { core::slice::from_raw_parts_mut(out.as_mut_ptr().cast::<f64>(), n) };
        out.copy_from_slice(&from[..n]);
    }
    #[inline(always)]
    fn store_all(all: &[Self], out: &mut [f64]) {
        let n = all.len().min(out.len());
        // SAFETY: the type is `repr(transparent)` around `f64`.
        let all = unsafe { core::slice::from_raw_parts(all.as_ptr().cast::<f64>(), n) };
        out[..n].copy_from_slice(all);
    }
    #[inline(always)]
    fn set_lane(&mut self, i: usize, x: f64) {
        self.0.set_lane(i, x);
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (mantissa, exponent) = Real::split(self.0);
        (F64x1(mantissa), F64x1(exponent))
    }
}

//! Lanes in two registers.
//!
//! One index, branch or call then serves twice as many environments. While an operation on one register waits for the operation before it,
//! an operation on the other register can run.

use crate::mask::Mask;
use crate::operators::{elementary_functions, inline_functions, operators};
use crate::real::Real;

/// Lanes of two registers. The lanes of the first register have the lower numbers.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Two<R>(R, R);

/// Mask of [`Two`]: one truth value for each lane.
#[derive(Clone, Copy, Debug)]
pub struct TwoMask<R: Real>(R::Mask, R::Mask);

operators! { [R: Real] Two<R>:
    Add add AddAssign add_assign = |a, b| Two(a.0 + b.0, a.1 + b.1);
    Sub sub SubAssign sub_assign = |a, b| Two(a.0 - b.0, a.1 - b.1);
    Mul mul MulAssign mul_assign = |a, b| Two(a.0 * b.0, a.1 * b.1);
    Div div DivAssign div_assign = |a, b| Two(a.0 / b.0, a.1 / b.1);
    - = |a| Two(-a.0, -a.1);
}

impl<R: Real<Half = R>> Real for Two<R> {
    type Scalar = R::Scalar;
    type Mask = TwoMask<R>;
    type Half = R;
    type Single = R::Single;
    const LANES: usize = 2 * R::LANES;
    elementary_functions!();

    #[inline(always)]
    fn vectorize<T>(kernel: impl FnOnce() -> T) -> T {
        R::vectorize(kernel)
    }
    inline_functions! {
        fn splat(x: R::Scalar) -> Self = Two(R::splat(x), R::splat(x));
        fn lane(self, i: usize) -> R::Scalar = if i < R::LANES { self.0.lane(i) } else { self.1.lane(i - R::LANES) };
        fn gather_lanes(self, sources: &[u32]) -> R = R::gather_lanes_of_two(self.0, self.1, sources);
        fn lt(self, o: Self) -> TwoMask<R> = TwoMask(self.0.lt(o.0), self.1.lt(o.1));
        fn le(self, o: Self) -> TwoMask<R> = TwoMask(self.0.le(o.0), self.1.le(o.1));
        fn eq(self, o: Self) -> TwoMask<R> = TwoMask(self.0.eq(o.0), self.1.eq(o.1));
        fn select(m: TwoMask<R>, a: Self, b: Self) -> Self = Two(R::select(m.0, a.0, b.0), R::select(m.1, a.1, b.1));
        fn min(self, o: Self) -> Self = Two(self.0.min(o.0), self.1.min(o.1));
        fn max(self, o: Self) -> Self = Two(self.0.max(o.0), self.1.max(o.1));
        fn abs(self) -> Self = Two(self.0.abs(), self.1.abs());
        fn sqrt(self) -> Self = Two(self.0.sqrt(), self.1.sqrt());
        fn copysign(self, sign: Self) -> Self = Two(self.0.copysign(sign.0), self.1.copysign(sign.1));
        fn round_even(self) -> Self = Two(self.0.round_even(), self.1.round_even());
        fn pow2(self) -> Self = Two(self.0.pow2(), self.1.pow2());
    }
    #[inline(always)]
    fn load(s: &[R::Scalar]) -> Self {
        let (low, high) = s[..Self::LANES].split_at(R::LANES);
        Two(R::load(low), R::load(high))
    }
    #[inline(always)]
    fn store(self, s: &mut [R::Scalar]) {
        let (low, high) = s[..Self::LANES].split_at_mut(R::LANES);
        self.0.store(low);
        self.1.store(high);
    }
    #[inline(always)]
    fn set_lane(&mut self, i: usize, x: R::Scalar) {
        let register = if i < R::LANES { &mut self.0 } else { &mut self.1 };
        register.set_lane(i % R::LANES, x);
    }
    #[inline(always)]
    fn replace_lanes(self, half: R, places: &[u32], lanes: TwoMask<R>) -> Self {
        let (low, high) = places[..Self::LANES].split_at(R::LANES);
        let [from_low, from_high] = [R::gather_lanes_of_two(half, half, low), R::gather_lanes_of_two(half, half, high)];
        Two(R::select(lanes.0, from_low, self.0), R::select(lanes.1, from_high, self.1))
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let ((low, low_exponent), (high, high_exponent)) = (self.0.split(), self.1.split());
        (Two(low, high), Two(low_exponent, high_exponent))
    }
}

impl<R: Real> Mask for TwoMask<R> {
    inline_functions! {
        fn splat(b: bool) -> Self = TwoMask(R::Mask::splat(b), R::Mask::splat(b));
        fn from_bits(bits: u32) -> Self = TwoMask(R::Mask::from_bits(bits), R::Mask::from_bits(bits >> R::LANES));
        fn bits(self) -> u32 = self.0.bits() | self.1.bits() << R::LANES;
        fn and(self, o: Self) -> Self = TwoMask(self.0.and(o.0), self.1.and(o.1));
        fn or(self, o: Self) -> Self = TwoMask(self.0.or(o.0), self.1.or(o.1));
        fn and_not(self, o: Self) -> Self = TwoMask(self.0.and_not(o.0), self.1.and_not(o.1));
        fn not(self) -> Self = TwoMask(self.0.not(), self.1.not());
        fn any(self) -> bool = self.0.or(self.1).any();
        fn all(self) -> bool = self.0.and(self.1).all();
    }
}

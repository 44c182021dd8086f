//! Lanes in two registers.
//!
//! One index, branch or call then serves twice as many environments. While an operation on one register waits for the operation before it,
//! an operation on the other register can run.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::mask::Mask;
use crate::operators::elementary_functions;
use crate::real::Real;

/// Lanes of two registers. The lanes of the first register have the lower numbers.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Two<R>(R, R);

/// Mask of [`Two`]: one truth value for each lane.
#[derive(Clone, Copy, Debug)]
pub struct TwoMask<R: Real>(R::Mask, R::Mask);

macro_rules! each {
    ($($op:ident $f:ident $assign:ident $f_assign:ident;)*) => {$(
        impl<R: Real> $op for Two<R> {
            type Output = Self;
            #[inline(always)]
            fn $f(self, o: Self) -> Self {
                Two($op::$f(self.0, o.0), $op::$f(self.1, o.1))
            }
        }
        impl<R: Real> $assign for Two<R> {
            #[inline(always)]
            fn $f_assign(&mut self, o: Self) {
                *self = $op::$f(*self, o);
            }
        }
    )*};
}
each! {
    Add add AddAssign add_assign;
    Sub sub SubAssign sub_assign;
    Mul mul MulAssign mul_assign;
    Div div DivAssign div_assign;
}

impl<R: Real> Neg for Two<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Two(-self.0, -self.1)
    }
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
    #[inline(always)]
    fn splat(x: R::Scalar) -> Self {
        Two(R::splat(x), R::splat(x))
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
    fn lane(self, i: usize) -> R::Scalar {
        if i < R::LANES { self.0.lane(i) } else { self.1.lane(i - R::LANES) }
    }
    #[inline(always)]
    fn set_lane(&mut self, i: usize, x: R::Scalar) {
        let register = if i < R::LANES { &mut self.0 } else { &mut self.1 };
        register.set_lane(i % R::LANES, x);
    }
    #[inline(always)]
    fn gather_lanes(self, sources: &[u32]) -> R {
        R::gather_lanes_of_two(self.0, self.1, sources)
    }
    #[inline(always)]
    fn replace_lanes(self, half: R, places: &[u32], lanes: TwoMask<R>) -> Self {
        let (low, high) = places[..Self::LANES].split_at(R::LANES);
        let [from_low, from_high] = [R::gather_lanes_of_two(half, half, low), R::gather_lanes_of_two(half, half, high)];
        Two(R::select(lanes.0, from_low, self.0), R::select(lanes.1, from_high, self.1))
    }
    #[inline(always)]
    fn lt(self, o: Self) -> TwoMask<R> {
        TwoMask(self.0.lt(o.0), self.1.lt(o.1))
    }
    #[inline(always)]
    fn le(self, o: Self) -> TwoMask<R> {
        TwoMask(self.0.le(o.0), self.1.le(o.1))
    }
    #[inline(always)]
    fn eq(self, o: Self) -> TwoMask<R> {
        TwoMask(self.0.eq(o.0), self.1.eq(o.1))
    }
    #[inline(always)]
    fn select(m: TwoMask<R>, a: Self, b: Self) -> Self {
        Two(R::select(m.0, a.0, b.0), R::select(m.1, a.1, b.1))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Two(self.0.min(o.0), self.1.min(o.1))
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Two(self.0.max(o.0), self.1.max(o.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Two(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Two(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Two(self.0.copysign(sign.0), self.1.copysign(sign.1))
    }
    #[inline(always)]
    fn round_even(self) -> Self {
        Two(self.0.round_even(), self.1.round_even())
    }
    #[inline(always)]
    fn pow2(self) -> Self {
        Two(self.0.pow2(), self.1.pow2())
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let ((low, low_exponent), (high, high_exponent)) = (self.0.split(), self.1.split());
        (Two(low, high), Two(low_exponent, high_exponent))
    }
}

impl<R: Real> Mask for TwoMask<R> {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        TwoMask(R::Mask::splat(b), R::Mask::splat(b))
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        TwoMask(R::Mask::from_bits(bits), R::Mask::from_bits(bits >> R::LANES))
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits() | self.1.bits() << R::LANES
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        TwoMask(self.0.and(o.0), self.1.and(o.1))
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        TwoMask(self.0.or(o.0), self.1.or(o.1))
    }
    #[inline(always)]
    fn and_not(self, o: Self) -> Self {
        TwoMask(self.0.and_not(o.0), self.1.and_not(o.1))
    }
    #[inline(always)]
    fn not(self) -> Self {
        TwoMask(self.0.not(), self.1.not())
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.or(self.1).any()
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0.and(self.1).all()
    }
}

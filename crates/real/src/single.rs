//! Plain `f64` (the reference) and `f32` as lane types of a single environment. They define the result of every operation for all backends.

use crate::operators::{elementary_functions, inline_functions, vectorize};
use crate::real::Real;

macro_rules! single {
    ($t:ident, $int:ident, $mantissa_bits:literal, $exponent_bias:literal) => {
        impl Real for $t {
            type Scalar = $t;
            type Mask = bool;
            type Single = Self;
            const LANES: usize = 1;
            vectorize!();
            elementary_functions!();

            inline_functions! {
                fn splat(x: $t) -> Self = x;
                fn load(s: &[$t]) -> Self = s[0];
                fn lt(self, o: Self) -> bool = self < o;
                fn le(self, o: Self) -> bool = self <= o;
                fn eq(self, o: Self) -> bool = self == o;
                fn select(m: bool, a: Self, b: Self) -> Self = if m { a } else { b };
                fn min(self, o: Self) -> Self = if self < o { self } else { o };
                fn max(self, o: Self) -> Self = if self > o { self } else { o };
                fn abs(self) -> Self = $t::abs(self);
                fn sqrt(self) -> Self = $t::sqrt(self);
                fn copysign(self, sign: Self) -> Self = $t::copysign(self, sign);
            }
            #[inline(always)]
            fn store(self, s: &mut [$t]) {
                s[0] = self;
            }
            #[inline(always)]
            fn lane(self, i: usize) -> $t {
                assert!(i == 0, "one lane only");
                self
            }
            #[inline(always)]
            fn set_lane(&mut self, i: usize, x: $t) {
                assert!(i == 0, "one lane only");
                *self = x;
            }
            #[inline(always)]
            fn round_even(self) -> Self {
                // All numbers of at least 2^mantissa_bits are integers. The sum of 2^mantissa_bits and a smaller number is therefore
                // rounded to an integer. (`round_ties_even` is a call into libm on a CPU without SSE4.1.)
                const INTEGERS: $t = (1u64 << $mantissa_bits) as $t;
                let magnitude = $t::abs(self);
                let rounded = $t::copysign((magnitude + INTEGERS) - INTEGERS, self);
                if magnitude < INTEGERS { rounded } else { self }
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // The low mantissa bits of the sum are the biased exponent. The shift moves them to the exponent and drops the rest.
                const BIASED: $t = (1u64 << $mantissa_bits) as $t + $exponent_bias;
                $t::from_bits((self + BIASED).to_bits() << $mantissa_bits)
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // The biased exponent becomes the low bits of a number whose last bit is worth 1. The fraction gets the exponent of 1.
                const ONE_BITS: $t = (1u64 << $mantissa_bits) as $t;
                const FRACTION: $int = (1 << $mantissa_bits) - 1;
                let bits = self.to_bits();
                let exponent = $t::from_bits((bits >> $mantissa_bits) | ONE_BITS.to_bits()) - (ONE_BITS + $exponent_bias);
                ($t::from_bits((bits & FRACTION) | (1.0 as $t).to_bits()), exponent)
            }
        }
    };
}

single!(f64, u64, 52, 1023.0);
single!(f32, u32, 23, 127.0);

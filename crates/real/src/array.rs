//! Portable lanes: arrays and element-wise loops, which the compiler vectorises with the instructions of the baseline level (SSE2, NEON).
//!
//! On all architectures except x86-64, they are the lanes of the only level.

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, inline_functions, lane_access, operators, vectorize};
use crate::real::Real;

macro_rules! each_lane {
    ($make:path, $n:literal, |$i:ident| $e:expr) => {{
        let mut lanes = [Default::default(); $n];
        for $i in 0..$n {
            lanes[$i] = $e;
        }
        $make(lanes)
    }};
}

macro_rules! array_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ident, $n:literal, $(#[$mask_doc:meta])* $mask:ident, $word:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(C, align(32))]
        pub struct $name(pub [$scalar; $n]);

        // Each truth value is an integer as wide as its lane. Comparisons, selections and logical operations then vectorise, which single
        // bits would prevent.
        $(#[$mask_doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(32))]
        pub struct $mask([$word; $n]);

        as_lanes!($name, $scalar, $n);

        operators! { [] $name:
            Add add AddAssign add_assign = |a, b| each_lane!($name, $n, |i| a.0[i] + b.0[i]);
            Sub sub SubAssign sub_assign = |a, b| each_lane!($name, $n, |i| a.0[i] - b.0[i]);
            Mul mul MulAssign mul_assign = |a, b| each_lane!($name, $n, |i| a.0[i] * b.0[i]);
            Div div DivAssign div_assign = |a, b| each_lane!($name, $n, |i| a.0[i] / b.0[i]);
            - = |a| each_lane!($name, $n, |i| -a.0[i]);
        }

        impl Real for $name {
            lane_access!($name, $scalar, $n);
            vectorize!();
            elementary_functions!();
            type Mask = $mask;
            type Single = $scalar;

            inline_functions! {
                fn splat(x: $scalar) -> Self = $name([x; $n]);
                fn lt(self, o: Self) -> $mask = each_lane!($mask, $n, |i| $word::MAX * (self.0[i] < o.0[i]) as $word);
                fn le(self, o: Self) -> $mask = each_lane!($mask, $n, |i| $word::MAX * (self.0[i] <= o.0[i]) as $word);
                fn eq(self, o: Self) -> $mask = each_lane!($mask, $n, |i| $word::MAX * (self.0[i] == o.0[i]) as $word);
                fn min(self, o: Self) -> Self = each_lane!($name, $n, |i| Real::min(self.0[i], o.0[i]));
                fn max(self, o: Self) -> Self = each_lane!($name, $n, |i| Real::max(self.0[i], o.0[i]));
                fn abs(self) -> Self = each_lane!($name, $n, |i| Real::abs(self.0[i]));
                fn sqrt(self) -> Self = each_lane!($name, $n, |i| Real::sqrt(self.0[i]));
                fn copysign(self, sign: Self) -> Self = each_lane!($name, $n, |i| Real::copysign(self.0[i], sign.0[i]));
                fn round_even(self) -> Self = each_lane!($name, $n, |i| Real::round_even(self.0[i]));
                fn pow2(self) -> Self = each_lane!($name, $n, |i| Real::pow2(self.0[i]));
            }
            #[inline(always)]
            fn load(s: &[$scalar]) -> Self {
                let s = &s[..$n];
                each_lane!($name, $n, |i| s[i])
            }
            #[inline(always)]
            fn store(self, s: &mut [$scalar]) {
                s[..$n].copy_from_slice(&self.0);
            }
            #[inline(always)]
            fn select(m: $mask, a: Self, b: Self) -> Self {
                each_lane!($name, $n, |i| $scalar::from_bits((m.0[i] & a.0[i].to_bits()) | (!m.0[i] & b.0[i].to_bits())))
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                (each_lane!($name, $n, |i| Real::split(self.0[i]).0), each_lane!($name, $n, |i| Real::split(self.0[i]).1))
            }
        }

        impl Mask for $mask {
            inline_functions! {
                fn splat(b: bool) -> Self = $mask([$word::MAX * b as $word; $n]);
                fn from_bits(bits: u32) -> Self = each_lane!($mask, $n, |i| $word::MAX * ((bits >> i) & 1) as $word);
                fn and(self, o: Self) -> Self = each_lane!($mask, $n, |i| self.0[i] & o.0[i]);
                fn or(self, o: Self) -> Self = each_lane!($mask, $n, |i| self.0[i] | o.0[i]);
                fn and_not(self, o: Self) -> Self = each_lane!($mask, $n, |i| self.0[i] & !o.0[i]);
                fn not(self) -> Self = each_lane!($mask, $n, |i| !self.0[i]);
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                let mut bits = 0;
                for i in 0..$n {
                    bits |= ((self.0[i] & 1) as u32) << i;
                }
                bits
            }
            #[inline(always)]
            fn any(self) -> bool {
                let mut any = 0;
                for i in 0..$n {
                    any |= self.0[i];
                }
                any != 0
            }
            #[inline(always)]
            fn all(self) -> bool {
                let mut all = $word::MAX;
                for i in 0..$n {
                    all &= self.0[i];
                }
                all != 0
            }
        }
    };
}

array_lanes! {
    /// Four `f64` lanes.
    F64x4, f64, 4,
    /// One truth value for each lane of [`F64x4`].
    M64x4, u64
}
array_lanes! {
    /// Eight `f32` lanes.
    F32x8, f32, 8,
    /// One truth value for each lane of [`F32x8`].
    M32x8, u32
}

//! Lanes in AVX registers, two of `f64` and one of `f32`, with masks as vectors of compare results. Features: `avx2`.
//!
//! # Safety
//! The functions here are safe to call but execute AVX2 instructions. The module is private, and its types can only be named through an
//! unsafe trait in [`at_level!`](crate::at_level), which checks the CPU level first. Every method is `#[inline(always)]`: the intrinsics
//! are inlined into the function that [`Real::vectorize`] makes, and inherit its `#[target_feature]`. Outside such a function they are
//! calls, which are slow but correct.

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, lane_access, operators, vectorize};
use crate::real::Real;
use core::arch::x86_64::{__m256i, _CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ};

/// Rounding mode of an intrinsic: to the nearest integer, half to even, without an inexact exception.
const NEAREST_EVEN: i32 = 0x08;

/// Evaluates an expression for each register of a lane type, and makes a value of the results. `$i` is the index of the register.
macro_rules! each {
    ($make:ident, 1, |$i:ident| $e:expr) => {{
        // SAFETY: the module's contract.
        unsafe {
            $make([{
                const $i: usize = 0;
                $e
            }])
        }
    }};
    ($make:ident, 2, |$i:ident| $e:expr) => {{
        // SAFETY: the module's contract.
        unsafe {
            $make([
                {
                    const $i: usize = 0;
                    $e
                },
                {
                    const $i: usize = 1;
                    $e
                },
            ])
        }
    }};
}

/// Defines a lane type of one precision and its mask. The intrinsics of the precision must be in scope under the short names used below.
macro_rules! avx2_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ident, $n:literal, $(#[$mask_doc:meta])* $mask:ident, $int:ident,
     registers $registers:tt of $bytes:literal bytes, mantissa $mantissa:literal, bias $bias:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(C, align($bytes))]
        pub struct $name([Raw; $registers]);

        $(#[$mask_doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align($bytes))]
        pub struct $mask([Raw; $registers]);

        /// Lanes in one register.
        const WIDTH: usize = $n / $registers;

        as_lanes!($name, $scalar, $n);

        operators! { $name:
            Add add AddAssign add_assign = |a, b| each!($name, $registers, |I| add(a.0[I], b.0[I]));
            Sub sub SubAssign sub_assign = |a, b| each!($name, $registers, |I| sub(a.0[I], b.0[I]));
            Mul mul MulAssign mul_assign = |a, b| each!($name, $registers, |I| mul(a.0[I], b.0[I]));
            Div div DivAssign div_assign = |a, b| each!($name, $registers, |I| div(a.0[I], b.0[I]));
        }

        impl core::ops::Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                each!($name, $registers, |I| xor(self.0[I], set1(-0.0)))
            }
        }

        impl Real for $name {
            lane_access!($name, $scalar, $n);
            vectorize!("avx2");
            elementary_functions!();
            type Mask = $mask;
            type Half = Self;
            type Single = crate::single_lane::single!($scalar);

            #[inline(always)]
            fn splat(x: $scalar) -> Self {
                each!($name, $registers, |_I| set1(x))
            }
            #[inline(always)]
            fn load(s: &[$scalar]) -> Self {
                let s = &s[..$n];
                each!($name, $registers, |I| loadu(s.as_ptr().add(I * WIDTH)))
            }
            #[inline(always)]
            fn store(self, s: &mut [$scalar]) {
                let s = &mut s[..$n];
                for (i, &register) in self.0.iter().enumerate() {
                    // SAFETY: the module's contract. The register is written within `s`.
                    unsafe { storeu(s.as_mut_ptr().add(i * WIDTH), register) }
                }
            }
            #[inline(always)]
            fn lt(self, o: Self) -> $mask {
                each!($mask, $registers, |I| cmp::<_CMP_LT_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn le(self, o: Self) -> $mask {
                each!($mask, $registers, |I| cmp::<_CMP_LE_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn eq(self, o: Self) -> $mask {
                each!($mask, $registers, |I| cmp::<_CMP_EQ_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn select(m: $mask, a: Self, b: Self) -> Self {
                each!($name, $registers, |I| blend(b.0[I], a.0[I], m.0[I]))
            }
            #[inline(always)]
            fn min(self, o: Self) -> Self {
                each!($name, $registers, |I| min(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn max(self, o: Self) -> Self {
                each!($name, $registers, |I| max(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                each!($name, $registers, |I| andnot(set1(-0.0), self.0[I]))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                each!($name, $registers, |I| sqrt(self.0[I]))
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                each!($name, $registers, |I| or(andnot(set1(-0.0), self.0[I]), and(set1(-0.0), sign.0[I])))
            }
            #[inline(always)]
            fn round_even(self) -> Self {
                each!($name, $registers, |I| round::<NEAREST_EVEN>(self.0[I]))
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // `pow2` in `single.rs` explains the method.
                const BIASED: $scalar = (1u64 << $mantissa) as $scalar + $bias;
                each!($name, $registers, |I| from_int(shift_left::<$mantissa>(to_int(add(self.0[I], set1(BIASED))))))
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // `split` in `single.rs` explains the method.
                const ONE_BITS: $scalar = (1u64 << $mantissa) as $scalar;
                const FRACTION: $scalar = $scalar::from_bits((1 << $mantissa) - 1);
                let exponent = each!($name, $registers, |I| from_int(shift_right::<$mantissa>(to_int(self.0[I]))));
                let mantissa = each!($name, $registers, |I| or(and(self.0[I], set1(FRACTION)), set1(1.0)));
                (mantissa, each!($name, $registers, |I| sub(or(exponent.0[I], set1(ONE_BITS)), set1(ONE_BITS + $bias))))
            }
        }

        impl Mask for $mask {
            #[inline(always)]
            fn splat(b: bool) -> Self {
                each!($mask, $registers, |_I| from_int(set1_int(-(b as $int))))
            }
            #[inline(always)]
            fn from_bits(bits: u32) -> Self {
                // Every lane gets all bits, and lane i tests bit i.
                const BIT_OF_LANE: [$int; $n] = {
                    let mut of_lane = [0; $n];
                    let mut i = 0;
                    while i < $n {
                        of_lane[i] = 1 << i;
                        i += 1;
                    }
                    of_lane
                };
                // SAFETY: both types have the same size, and all bit patterns are valid integer vectors.
                let bit: [__m256i; $registers] = unsafe { core::mem::transmute(BIT_OF_LANE) };
                each!($mask, $registers, |I| from_int(equal_int(and_int(set1_int(bits as $int), bit[I]), bit[I])))
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                let mut bits = 0;
                for (i, &register) in self.0.iter().enumerate() {
                    // SAFETY: the module's contract.
                    bits |= (unsafe { movemask(register) } as u32) << (i * WIDTH);
                }
                bits
            }
            #[inline(always)]
            fn and(self, o: Self) -> Self {
                each!($mask, $registers, |I| and(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn or(self, o: Self) -> Self {
                each!($mask, $registers, |I| or(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn and_not(self, o: Self) -> Self {
                each!($mask, $registers, |I| andnot(o.0[I], self.0[I]))
            }
            #[inline(always)]
            fn not(self) -> Self {
                Self::splat(true).and_not(self)
            }
            #[inline(always)]
            fn any(self) -> bool {
                // SAFETY: the module's contract. With one register, the first is also the last.
                unsafe { movemask(or(self.0[0], self.0[$registers - 1])) != 0 }
            }
            #[inline(always)]
            fn all(self) -> bool {
                // SAFETY: the module's contract.
                unsafe { movemask(and(self.0[0], self.0[$registers - 1])) == (1 << WIDTH) - 1 }
            }
        }
    };
}

mod double {
    use crate::avx2::*;
    use core::arch::x86_64::{
        __m256d as Raw, _mm256_add_pd as add, _mm256_and_pd as and, _mm256_and_si256 as and_int, _mm256_andnot_pd as andnot,
        _mm256_blendv_pd as blend, _mm256_castpd_si256 as to_int, _mm256_castsi256_pd as from_int, _mm256_cmp_pd as cmp,
        _mm256_cmpeq_epi64 as equal_int, _mm256_div_pd as div, _mm256_loadu_pd as loadu, _mm256_max_pd as max, _mm256_min_pd as min,
        _mm256_movemask_pd as movemask, _mm256_mul_pd as mul, _mm256_or_pd as or, _mm256_round_pd as round, _mm256_set1_epi64x as set1_int,
        _mm256_set1_pd as set1, _mm256_slli_epi64 as shift_left, _mm256_sqrt_pd as sqrt, _mm256_srli_epi64 as shift_right,
        _mm256_storeu_pd as storeu, _mm256_sub_pd as sub, _mm256_xor_pd as xor,
    };
    avx2_lanes! {
        /// Eight `f64` lanes.
        F64x8, f64, 8,
        /// One truth value for each lane of [`F64x8`].
        M64x8, i64, registers 2 of 64 bytes, mantissa 52, bias 1023.0
    }
}
mod single {
    use crate::avx2::*;
    use core::arch::x86_64::{
        __m256 as Raw, _mm256_add_ps as add, _mm256_and_ps as and, _mm256_and_si256 as and_int, _mm256_andnot_ps as andnot,
        _mm256_blendv_ps as blend, _mm256_castps_si256 as to_int, _mm256_castsi256_ps as from_int, _mm256_cmp_ps as cmp,
        _mm256_cmpeq_epi32 as equal_int, _mm256_div_ps as div, _mm256_loadu_ps as loadu, _mm256_max_ps as max, _mm256_min_ps as min,
        _mm256_movemask_ps as movemask, _mm256_mul_ps as mul, _mm256_or_ps as or, _mm256_round_ps as round, _mm256_set1_epi32 as set1_int,
        _mm256_set1_ps as set1, _mm256_slli_epi32 as shift_left, _mm256_sqrt_ps as sqrt, _mm256_srli_epi32 as shift_right,
        _mm256_storeu_ps as storeu, _mm256_sub_ps as sub, _mm256_xor_ps as xor,
    };
    avx2_lanes! {
        /// Eight `f32` lanes.
        F32x8, f32, 8,
        /// One truth value for each lane of [`F32x8`].
        M32x8, i32, registers 1 of 32 bytes, mantissa 23, bias 127.0
    }
}
pub(crate) use double::F64x8;
pub(crate) use single::F32x8;

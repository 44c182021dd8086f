//! Lanes in two AVX registers, masks as vectors of compare results. Features: `avx2`.
//!
//! # Safety
//! The functions here are safe to call but execute AVX2 instructions. The module is private, and its types have no name outside but
//! through an unsafe trait: below [`at_level!`](crate::at_level), which asks the CPU for the level before. Every method is
//! `#[inline(always)]`, so that the intrinsics end up inlined into the function that [`Real::vectorize`] makes and inherit its
//! `#[target_feature]`; outside of one they are calls, slow but right.

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, lane_access, operators, vectorize};
use crate::real::Real;
use core::arch::x86_64::{__m256i, _CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ};

/// Round to the nearest integer, ties to even, with no inexact exception.
const NEAREST_EVEN: i32 = 0x08;

/// The same expression of both halves; `$i` is the half.
macro_rules! halves {
    ($make:ident, |$i:ident| $e:expr) => {{
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

/// Expects the intrinsics of one precision in scope under the short names used below.
macro_rules! avx2_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ident, $n:literal, $(#[$mask_doc:meta])* $mask:ident, $int:ident,
     mantissa $mantissa:literal, bias $bias:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(C, align(64))]
        pub struct $name([Raw; 2]);

        $(#[$mask_doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(64))]
        pub struct $mask([Raw; 2]);

        /// Lanes in one half.
        const HALF: usize = $n / 2;

        as_lanes!($name, $scalar, $n);

        operators! { $name:
            Add add AddAssign add_assign = |a, b| halves!($name, |I| add(a.0[I], b.0[I]));
            Sub sub SubAssign sub_assign = |a, b| halves!($name, |I| sub(a.0[I], b.0[I]));
            Mul mul MulAssign mul_assign = |a, b| halves!($name, |I| mul(a.0[I], b.0[I]));
            Div div DivAssign div_assign = |a, b| halves!($name, |I| div(a.0[I], b.0[I]));
        }

        impl core::ops::Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                halves!($name, |I| xor(self.0[I], set1(-0.0)))
            }
        }

        impl Real for $name {
            lane_access!($name, $scalar, $n);
            vectorize!("avx2");
            elementary_functions!();
            type Mask = $mask;
            type Half = Self;

            #[inline(always)]
            fn splat(x: $scalar) -> Self {
                halves!($name, |_I| set1(x))
            }
            #[inline(always)]
            fn load(s: &[$scalar]) -> Self {
                let s = &s[..$n];
                halves!($name, |I| loadu(s.as_ptr().add(I * HALF)))
            }
            #[inline(always)]
            fn store(self, s: &mut [$scalar]) {
                let s = &mut s[..$n];
                // SAFETY: the module's contract.
                unsafe {
                    storeu(s.as_mut_ptr(), self.0[0]);
                    storeu(s.as_mut_ptr().add(HALF), self.0[1]);
                }
            }
            #[inline(always)]
            fn lt(self, o: Self) -> $mask {
                halves!($mask, |I| cmp::<_CMP_LT_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn le(self, o: Self) -> $mask {
                halves!($mask, |I| cmp::<_CMP_LE_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn eq(self, o: Self) -> $mask {
                halves!($mask, |I| cmp::<_CMP_EQ_OQ>(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn select(m: $mask, a: Self, b: Self) -> Self {
                halves!($name, |I| blend(b.0[I], a.0[I], m.0[I]))
            }
            #[inline(always)]
            fn min(self, o: Self) -> Self {
                halves!($name, |I| min(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn max(self, o: Self) -> Self {
                halves!($name, |I| max(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                halves!($name, |I| andnot(set1(-0.0), self.0[I]))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                halves!($name, |I| sqrt(self.0[I]))
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                halves!($name, |I| or(andnot(set1(-0.0), self.0[I]), and(set1(-0.0), sign.0[I])))
            }
            #[inline(always)]
            fn round_even(self) -> Self {
                halves!($name, |I| round::<NEAREST_EVEN>(self.0[I]))
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // See the scalar's pow2.
                const BIASED: $scalar = (1u64 << $mantissa) as $scalar + $bias;
                halves!($name, |I| from_int(shift_left::<$mantissa>(to_int(add(self.0[I], set1(BIASED))))))
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // See the scalar's split.
                const ONE_BITS: $scalar = (1u64 << $mantissa) as $scalar;
                const FRACTION: $scalar = $scalar::from_bits((1 << $mantissa) - 1);
                let exponent = halves!($name, |I| from_int(shift_right::<$mantissa>(to_int(self.0[I]))));
                let mantissa = halves!($name, |I| or(and(self.0[I], set1(FRACTION)), set1(1.0)));
                (mantissa, halves!($name, |I| sub(or(exponent.0[I], set1(ONE_BITS)), set1(ONE_BITS + $bias))))
            }
        }

        impl Mask for $mask {
            #[inline(always)]
            fn splat(b: bool) -> Self {
                halves!($mask, |_I| from_int(set1_int(-(b as $int))))
            }
            #[inline(always)]
            fn from_bits(bits: u32) -> Self {
                // Lane i keeps bit i of the broadcast word, and is true when that is still there.
                const BIT_OF_LANE: [$int; $n] = {
                    let mut of_lane = [0; $n];
                    let mut i = 0;
                    while i < $n {
                        of_lane[i] = 1 << i;
                        i += 1;
                    }
                    of_lane
                };
                // SAFETY: 64 bytes both, and any bits are a valid integer vector.
                let bit: [__m256i; 2] = unsafe { core::mem::transmute(BIT_OF_LANE) };
                halves!($mask, |I| from_int(equal_int(and_int(set1_int(bits as $int), bit[I]), bit[I])))
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                // SAFETY: the module's contract.
                unsafe { movemask(self.0[0]) as u32 | (movemask(self.0[1]) as u32) << HALF }
            }
            #[inline(always)]
            fn and(self, o: Self) -> Self {
                halves!($mask, |I| and(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn or(self, o: Self) -> Self {
                halves!($mask, |I| or(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn and_not(self, o: Self) -> Self {
                halves!($mask, |I| andnot(o.0[I], self.0[I]))
            }
            #[inline(always)]
            fn not(self) -> Self {
                Self::splat(true).and_not(self)
            }
            #[inline(always)]
            fn any(self) -> bool {
                // SAFETY: the module's contract.
                unsafe { movemask(or(self.0[0], self.0[1])) != 0 }
            }
            #[inline(always)]
            fn all(self) -> bool {
                // SAFETY: the module's contract.
                unsafe { movemask(and(self.0[0], self.0[1])) == (1 << HALF) - 1 }
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
        M64x8, i64, mantissa 52, bias 1023.0
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
        /// Sixteen `f32` lanes.
        F32x16, f32, 16,
        /// One truth value for each lane of [`F32x16`].
        M32x16, i32, mantissa 23, bias 127.0
    }
}
pub(crate) use double::F64x8;
pub(crate) use single::F32x16;

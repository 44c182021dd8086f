//! Lanes in AVX registers, two of `f64` and one of `f32`, with masks as vectors of compare results. Features: `avx2`.
//!
//! # Safety
//! The functions here are safe to call but execute AVX2 instructions. The module is private, and its types can only be named through an
//! unsafe trait in [`at_level!`](crate::at_level), which checks the CPU level first. Every method is `#[inline(always)]`: the intrinsics
//! are inlined into the function that [`Real::vectorize`] makes, and inherit its `#[target_feature]`. Outside such a function they are
//! calls, which are slow but correct.

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, inline_functions, lane_access, operators, vectorize};
use crate::real::Real;
use crate::registers::{each_register, register_lanes, register_mask};
use core::arch::x86_64::{
    __m256i as Integers, _CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ, _mm256_and_si256 as and_int, _mm256_cmpeq_epi32 as equal_int,
    _mm256_set1_epi32 as set1_int,
};

/// Rounding mode of an intrinsic: to the nearest integer, half to even, without an inexact exception.
const NEAREST_EVEN: i32 = 0x08;

/// Definition of a lane type of one precision and its mask.
macro_rules! avx2_lanes {
    ($name:ident, $scalar:ident, $n:literal, $mask:ident, $registers:tt of $bytes:literal bytes, $mantissa:literal, $bias:literal) => {
        register_lanes! {
            $name, $scalar, $n, $mask, registers $registers as #[repr(C, align($bytes))] [Raw; $registers], mantissa $mantissa, bias $bias,
            type Single = crate::single_lane::single!($scalar);
            vectorize!("avx2");
            inline_functions! {
                fn lt(self, o: Self) -> $mask = each_register!($mask, $registers, |I| cmp::<_CMP_LT_OQ>(self.0[I], o.0[I]));
                fn le(self, o: Self) -> $mask = each_register!($mask, $registers, |I| cmp::<_CMP_LE_OQ>(self.0[I], o.0[I]));
                fn eq(self, o: Self) -> $mask = each_register!($mask, $registers, |I| cmp::<_CMP_EQ_OQ>(self.0[I], o.0[I]));
                fn select(m: $mask, a: Self, b: Self) -> Self = each_register!($name, $registers, |I| blend(b.0[I], a.0[I], m.0[I]));
                fn round_even(self) -> Self = each_register!($name, $registers, |I| round::<NEAREST_EVEN>(self.0[I]));
            }
        }
        register_mask!($name, $n, $mask, registers $registers of $bytes bytes);
    };
}

mod double {
    use crate::avx2::*;
    use core::arch::x86_64::{
        __m256d as Raw, _mm256_add_pd as add, _mm256_and_pd as and, _mm256_andnot_pd as andnot, _mm256_blendv_pd as blend,
        _mm256_castpd_si256 as to_int, _mm256_castsi256_pd as from_int, _mm256_cmp_pd as cmp, _mm256_div_pd as div,
        _mm256_loadu_pd as loadu, _mm256_max_pd as max, _mm256_min_pd as min, _mm256_movemask_pd as movemask, _mm256_mul_pd as mul,
        _mm256_or_pd as or, _mm256_round_pd as round, _mm256_set1_pd as set1, _mm256_slli_epi64 as shift_left, _mm256_sqrt_pd as sqrt,
        _mm256_srli_epi64 as shift_right, _mm256_storeu_pd as storeu, _mm256_sub_pd as sub, _mm256_xor_pd as xor,
    };
    avx2_lanes!(F64x8, f64, 8, M64x8, 2 of 64 bytes, 52, 1023.0);
}
mod single {
    use crate::avx2::*;
    use core::arch::x86_64::{
        __m256 as Raw, _mm256_add_ps as add, _mm256_and_ps as and, _mm256_andnot_ps as andnot, _mm256_blendv_ps as blend,
        _mm256_castps_si256 as to_int, _mm256_castsi256_ps as from_int, _mm256_cmp_ps as cmp, _mm256_div_ps as div,
        _mm256_loadu_ps as loadu, _mm256_max_ps as max, _mm256_min_ps as min, _mm256_movemask_ps as movemask, _mm256_mul_ps as mul,
        _mm256_or_ps as or, _mm256_round_ps as round, _mm256_set1_ps as set1, _mm256_slli_epi32 as shift_left, _mm256_sqrt_ps as sqrt,
        _mm256_srli_epi32 as shift_right, _mm256_storeu_ps as storeu, _mm256_sub_ps as sub, _mm256_xor_ps as xor,
    };
    avx2_lanes!(F32x8, f32, 8, M32x8, 1 of 32 bytes, 23, 127.0);
}
pub(crate) use double::F64x8;
pub(crate) use single::F32x8;

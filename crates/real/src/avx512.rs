//! Lanes in one AVX-512 register, with masks in mask registers. Features: `avx512f,avx512dq,avx512vl`.
//!
//! # Safety
//! The functions here are safe to call but execute AVX-512 instructions. The module is private, and its types can only be named through an
//! unsafe trait in [`at_level!`](crate::at_level), which checks the CPU level first. Every method is `#[inline(always)]`: the intrinsics
//! are inlined into the function that [`Real::vectorize`] makes, and inherit its `#[target_feature]`. Outside such a function they are
//! calls, which are slow but correct.

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, inline_functions, lane_access, operators, vectorize};
use crate::real::Real;
use crate::registers::{Whole, each_register, register_lanes};
use core::arch::x86_64::{_CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ};

/// Rounding mode of an intrinsic: to the nearest integer, half to even, without scaling and without an inexact exception.
const NEAREST_EVEN: i32 = 0x08;

/// Definition of a lane type of one precision and its mask.
macro_rules! avx512_lanes {
    ($name:ident, $scalar:ident, $n:literal, $mask:ident, $bits:ident, $mantissa:literal, $bias:literal) => {
        register_lanes! {
            $name, $scalar, $n, $mask, registers whole as #[repr(transparent)] Whole<Raw>, mantissa $mantissa, bias $bias,
            type Single = crate::single_lane::single!($scalar);
            vectorize!("avx512f,avx512dq,avx512vl");
            inline_functions! {
                // SAFETY of these comparisons: the module's contract.
                fn lt(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_LT_OQ>(self.0[0], o.0[0]) });
                fn le(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_LE_OQ>(self.0[0], o.0[0]) });
                fn eq(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_EQ_OQ>(self.0[0], o.0[0]) });
                fn select(m: $mask, a: Self, b: Self) -> Self = each_register!($name, whole, |I| blend(m.0, b.0[I], a.0[I]));
                fn round_even(self) -> Self = each_register!($name, whole, |I| round::<NEAREST_EVEN>(self.0[I]));
            }
        }

        #[doc = concat!("One truth value for each lane of [`", stringify!($name), "`].")]
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $mask($bits);

        // Masks are plain integers. The compiler keeps them in mask registers if that is faster.
        impl Mask for $mask {
            inline_functions! {
                fn splat(b: bool) -> Self = $mask($bits::MAX * b as $bits);
                fn from_bits(bits: u32) -> Self = $mask(bits as $bits);
                fn bits(self) -> u32 = self.0 as u32;
                fn and(self, o: Self) -> Self = $mask(self.0 & o.0);
                fn or(self, o: Self) -> Self = $mask(self.0 | o.0);
                fn and_not(self, o: Self) -> Self = $mask(self.0 & !o.0);
                fn not(self) -> Self = $mask(!self.0);
                fn any(self) -> bool = self.0 != 0;
                fn all(self) -> bool = self.0 == $bits::MAX;
            }
        }
    };
}

mod double {
    use crate::avx512::*;
    use core::arch::x86_64::{
        __m512d as Raw, _mm512_add_pd as add, _mm512_and_pd as and, _mm512_andnot_pd as andnot, _mm512_castpd_si512 as to_int,
        _mm512_castsi512_pd as from_int, _mm512_cmp_pd_mask as cmp, _mm512_div_pd as div, _mm512_loadu_pd as loadu,
        _mm512_mask_blend_pd as blend, _mm512_max_pd as max, _mm512_min_pd as min, _mm512_mul_pd as mul, _mm512_or_pd as or,
        _mm512_roundscale_pd as round, _mm512_set1_pd as set1, _mm512_slli_epi64 as shift_left, _mm512_sqrt_pd as sqrt,
        _mm512_srli_epi64 as shift_right, _mm512_storeu_pd as storeu, _mm512_sub_pd as sub, _mm512_xor_pd as xor,
    };
    avx512_lanes!(F64x8, f64, 8, M64x8, u8, 52, 1023.0);
}
mod single {
    use crate::avx512::*;
    use core::arch::x86_64::{
        __m512 as Raw, _mm512_add_ps as add, _mm512_and_ps as and, _mm512_andnot_ps as andnot, _mm512_castps_si512 as to_int,
        _mm512_castsi512_ps as from_int, _mm512_cmp_ps_mask as cmp, _mm512_div_ps as div, _mm512_loadu_ps as loadu,
        _mm512_mask_blend_ps as blend, _mm512_max_ps as max, _mm512_min_ps as min, _mm512_mul_ps as mul, _mm512_or_ps as or,
        _mm512_roundscale_ps as round, _mm512_set1_ps as set1, _mm512_slli_epi32 as shift_left, _mm512_sqrt_ps as sqrt,
        _mm512_srli_epi32 as shift_right, _mm512_storeu_ps as storeu, _mm512_sub_ps as sub, _mm512_xor_ps as xor,
    };
    avx512_lanes!(F32x16, f32, 16, M32x16, u16, 23, 127.0);
}
pub(crate) use double::F64x8;
pub(crate) use single::F32x16;

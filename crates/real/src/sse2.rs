//! Lanes in two SSE registers, with masks as vectors of compare results. Every x86-64 CPU has SSE2, so these are the lanes of its baseline
//! level. Four registers per value would exceed the sixteen registers of the CPU, and double the compile time.
//!
//! [Portable lanes](crate::array) compile to similar instructions. But the compiler must first find the vectors among scalars. Compiling
//! them took longer than compiling all other lane types together.

use core::arch::x86_64::{__m128i as Integers, _mm_and_si128 as and_int, _mm_cmpeq_epi32 as equal_int, _mm_set1_epi32 as set1_int};

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, inline_functions, lane_access, operators, vectorize};
use crate::real::Real;
use crate::registers::{each_register, register_lanes, register_mask};

/// Definition of a lane type of one precision and its mask.
macro_rules! sse2_lanes {
    ($name:ident, $scalar:ident, $n:literal, $mask:ident, $mantissa:literal, $bias:literal) => {
        register_lanes! {
            $name, $scalar, $n, $mask, registers 2 as #[repr(C, align(32))] [Raw; 2], mantissa $mantissa, bias $bias,
            type Single = $scalar;
            vectorize!();
            inline_functions! {
                fn lt(self, o: Self) -> $mask = each_register!($mask, 2, |I| less(self.0[I], o.0[I]));
                fn le(self, o: Self) -> $mask = each_register!($mask, 2, |I| less_equal(self.0[I], o.0[I]));
                fn eq(self, o: Self) -> $mask = each_register!($mask, 2, |I| equal(self.0[I], o.0[I]));
            }
            #[inline(always)]
            fn select(m: $mask, a: Self, b: Self) -> Self {
                each_register!($name, 2, |I| or(and(m.0[I], a.0[I]), andnot(m.0[I], b.0[I])))
            }
            #[inline(always)]
            fn round_even(self) -> Self {
                // `round_even` in `single.rs` explains the method.
                const INTEGERS: $scalar = (1u64 << $mantissa) as $scalar;
                let (magnitude, integers) = (self.abs(), Self::splat(INTEGERS));
                let rounded = ((magnitude + integers) - integers).copysign(self);
                Self::select(magnitude.lt(integers), rounded, self)
            }
        }
        register_mask!($name, $n, $mask, registers 2 of 32 bytes);
    };
}

mod double {
    use crate::sse2::*;
    use core::arch::x86_64::{
        __m128d as Raw, _mm_add_pd as add, _mm_and_pd as and, _mm_andnot_pd as andnot, _mm_castpd_si128 as to_int,
        _mm_castsi128_pd as from_int, _mm_cmpeq_pd as equal, _mm_cmple_pd as less_equal, _mm_cmplt_pd as less, _mm_div_pd as div,
        _mm_loadu_pd as loadu, _mm_max_pd as max, _mm_min_pd as min, _mm_movemask_pd as movemask, _mm_mul_pd as mul, _mm_or_pd as or,
        _mm_set1_pd as set1, _mm_slli_epi64 as shift_left, _mm_sqrt_pd as sqrt, _mm_srli_epi64 as shift_right, _mm_storeu_pd as storeu,
        _mm_sub_pd as sub, _mm_xor_pd as xor,
    };
    sse2_lanes!(F64x4, f64, 4, M64x4, 52, 1023.0);
}
mod single {
    use crate::sse2::*;
    use core::arch::x86_64::{
        __m128 as Raw, _mm_add_ps as add, _mm_and_ps as and, _mm_andnot_ps as andnot, _mm_castps_si128 as to_int,
        _mm_castsi128_ps as from_int, _mm_cmpeq_ps as equal, _mm_cmple_ps as less_equal, _mm_cmplt_ps as less, _mm_div_ps as div,
        _mm_loadu_ps as loadu, _mm_max_ps as max, _mm_min_ps as min, _mm_movemask_ps as movemask, _mm_mul_ps as mul, _mm_or_ps as or,
        _mm_set1_ps as set1, _mm_slli_epi32 as shift_left, _mm_sqrt_ps as sqrt, _mm_srli_epi32 as shift_right, _mm_storeu_ps as storeu,
        _mm_sub_ps as sub, _mm_xor_ps as xor,
    };
    sse2_lanes!(F32x8, f32, 8, M32x8, 23, 127.0);
}
pub use double::F64x4;
pub use single::F32x8;

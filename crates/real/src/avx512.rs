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
use core::arch::x86_64::{_CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ};

/// Rounding mode of an intrinsic: to the nearest integer, half to even, without scaling and without an inexact exception.
const NEAREST_EVEN: i32 = 0x08;

/// Defines a lane type of one precision and its mask. The intrinsics of the precision must be in scope under the short names used below.
macro_rules! avx512_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ident, $n:literal, $(#[$mask_doc:meta])* $mask:ident, $bits:ident,
     mantissa $mantissa:literal, bias $bias:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(transparent)]
        pub struct $name(Raw);

        $(#[$mask_doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $mask($bits);

        as_lanes!($name, $scalar, $n);

        // SAFETY of all intrinsics below: the module's contract.
        operators! { [] $name:
            Add add AddAssign add_assign = |a, b| $name(unsafe { add(a.0, b.0) });
            Sub sub SubAssign sub_assign = |a, b| $name(unsafe { sub(a.0, b.0) });
            Mul mul MulAssign mul_assign = |a, b| $name(unsafe { mul(a.0, b.0) });
            Div div DivAssign div_assign = |a, b| $name(unsafe { div(a.0, b.0) });
            - = |a| $name(unsafe { xor(a.0, set1(-0.0)) });
        }

        impl Real for $name {
            lane_access!($name, $scalar, $n);
            vectorize!("avx512f,avx512dq,avx512vl");
            elementary_functions!();
            type Mask = $mask;
            type Single = crate::single_lane::single!($scalar);

            inline_functions! {
                fn splat(x: $scalar) -> Self = $name(unsafe { set1(x) });
                fn lt(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_LT_OQ>(self.0, o.0) });
                fn le(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_LE_OQ>(self.0, o.0) });
                fn eq(self, o: Self) -> $mask = $mask(unsafe { cmp::<_CMP_EQ_OQ>(self.0, o.0) });
                fn select(m: $mask, a: Self, b: Self) -> Self = $name(unsafe { blend(m.0, b.0, a.0) });
                fn min(self, o: Self) -> Self = $name(unsafe { min(self.0, o.0) });
                fn max(self, o: Self) -> Self = $name(unsafe { max(self.0, o.0) });
                fn abs(self) -> Self = $name(unsafe { andnot(set1(-0.0), self.0) });
                fn sqrt(self) -> Self = $name(unsafe { sqrt(self.0) });
                fn copysign(self, sign: Self) -> Self = $name(unsafe { or(andnot(set1(-0.0), self.0), and(set1(-0.0), sign.0)) });
                fn round_even(self) -> Self = $name(unsafe { roundscale::<NEAREST_EVEN>(self.0) });
            }
            #[inline(always)]
            fn load(s: &[$scalar]) -> Self {
                let s = &s[..$n];
                $name(unsafe { loadu(s.as_ptr()) })
            }
            #[inline(always)]
            fn store(self, s: &mut [$scalar]) {
                let s = &mut s[..$n];
                unsafe { storeu(s.as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // `pow2` in `single.rs` explains the method.
                const BIASED: $scalar = (1u64 << $mantissa) as $scalar + $bias;
                $name(unsafe { from_int(shift_left::<$mantissa>(to_int(add(self.0, set1(BIASED))))) })
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // `split` in `single.rs` explains the method.
                const ONE_BITS: $scalar = (1u64 << $mantissa) as $scalar;
                const FRACTION: $scalar = $scalar::from_bits((1 << $mantissa) - 1);
                unsafe {
                    let exponent = from_int(shift_right::<$mantissa>(to_int(self.0)));
                    let mantissa = or(and(self.0, set1(FRACTION)), set1(1.0));
                    ($name(mantissa), $name(sub(or(exponent, set1(ONE_BITS)), set1(ONE_BITS + $bias))))
                }
            }
        }

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
        _mm512_roundscale_pd as roundscale, _mm512_set1_pd as set1, _mm512_slli_epi64 as shift_left, _mm512_sqrt_pd as sqrt,
        _mm512_srli_epi64 as shift_right, _mm512_storeu_pd as storeu, _mm512_sub_pd as sub, _mm512_xor_pd as xor,
    };
    avx512_lanes! {
        /// Eight `f64` lanes.
        F64x8, f64, 8,
        /// One truth value for each lane of [`F64x8`].
        M64x8, u8, mantissa 52, bias 1023.0
    }
}
mod single {
    use crate::avx512::*;
    use core::arch::x86_64::{
        __m512 as Raw, _mm512_add_ps as add, _mm512_and_ps as and, _mm512_andnot_ps as andnot, _mm512_castps_si512 as to_int,
        _mm512_castsi512_ps as from_int, _mm512_cmp_ps_mask as cmp, _mm512_div_ps as div, _mm512_loadu_ps as loadu,
        _mm512_mask_blend_ps as blend, _mm512_max_ps as max, _mm512_min_ps as min, _mm512_mul_ps as mul, _mm512_or_ps as or,
        _mm512_roundscale_ps as roundscale, _mm512_set1_ps as set1, _mm512_slli_epi32 as shift_left, _mm512_sqrt_ps as sqrt,
        _mm512_srli_epi32 as shift_right, _mm512_storeu_ps as storeu, _mm512_sub_ps as sub, _mm512_xor_ps as xor,
    };
    avx512_lanes! {
        /// Sixteen `f32` lanes.
        F32x16, f32, 16,
        /// One truth value for each lane of [`F32x16`].
        M32x16, u16, mantissa 23, bias 127.0
    }
}
pub(crate) use double::F64x8;
pub(crate) use single::F32x16;

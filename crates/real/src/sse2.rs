//! Lanes in two SSE registers, with masks as vectors of compare results. Every x86-64 CPU has SSE2, so these are the lanes of its baseline
//! level. Four registers per value would exceed the sixteen registers of the CPU, and double the compile time.
//!
//! [Portable lanes](crate::array) compile to similar instructions. But the compiler must first find the vectors among scalars. Compiling
//! them took longer than compiling all other lane types together.

use core::arch::x86_64::{__m128i, _mm_and_si128 as and_int, _mm_cmpeq_epi32 as equal_int, _mm_set1_epi32 as set1_int};

use crate::mask::Mask;
use crate::operators::{as_lanes, elementary_functions, lane_access, operators, vectorize};
use crate::real::Real;

/// Evaluates an expression for both registers of a lane type, and makes a value of the results. `$i` is the index of the register.
macro_rules! halves {
    ($make:ident, |$i:ident| $e:expr) => {{
        // SAFETY: every x86-64 CPU has SSE2, and only entries of the slice are read.
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
macro_rules! sse2_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ident, $n:literal, $(#[$mask_doc:meta])* $mask:ident,
     mantissa $mantissa:literal, bias $bias:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(C, align(32))]
        pub struct $name([Raw; 2]);

        $(#[$mask_doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(32))]
        pub struct $mask([Raw; 2]);

        /// Lanes in one register.
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
            vectorize!();
            elementary_functions!();
            type Mask = $mask;
            type Half = Self;
            type Single = $scalar;

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
                for (i, &half) in self.0.iter().enumerate() {
                    // SAFETY: every x86-64 CPU has SSE2. The register is written within `s`.
                    unsafe { storeu(s.as_mut_ptr().add(i * HALF), half) }
                }
            }
            #[inline(always)]
            fn lt(self, o: Self) -> $mask {
                halves!($mask, |I| less(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn le(self, o: Self) -> $mask {
                halves!($mask, |I| less_equal(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn eq(self, o: Self) -> $mask {
                halves!($mask, |I| equal(self.0[I], o.0[I]))
            }
            #[inline(always)]
            fn select(m: $mask, a: Self, b: Self) -> Self {
                halves!($name, |I| or(and(m.0[I], a.0[I]), andnot(m.0[I], b.0[I])))
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
                // `round_even` in `single.rs` explains the method.
                const INTEGERS: $scalar = (1u64 << $mantissa) as $scalar;
                let (magnitude, integers) = (self.abs(), Self::splat(INTEGERS));
                let rounded = ((magnitude + integers) - integers).copysign(self);
                Self::select(magnitude.lt(integers), rounded, self)
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // `pow2` in `single.rs` explains the method.
                const BIASED: $scalar = (1u64 << $mantissa) as $scalar + $bias;
                halves!($name, |I| from_int(shift_left::<$mantissa>(to_int(add(self.0[I], set1(BIASED))))))
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // `split` in `single.rs` explains the method.
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
                halves!($mask, |_I| from_int(set1_int(-(b as i32))))
            }
            #[inline(always)]
            fn from_bits(bits: u32) -> Self {
                // Every lane gets all bits, and lane i tests bit i. SSE2 compares at most 32 bits, so that each half of a 64-bit lane tests
                // the bit of the lane.
                const BIT: [i32; 8] = {
                    let mut bit = [0; 8];
                    let mut i = 0;
                    while i < 8 {
                        bit[i] = 1 << (i * $n / 8);
                        i += 1;
                    }
                    bit
                };
                // SAFETY: both types have 32 bytes, and all bit patterns are valid integer vectors.
                let bit: [__m128i; 2] = unsafe { core::mem::transmute(BIT) };
                halves!($mask, |I| from_int(equal_int(and_int(set1_int(bits as i32), bit[I]), bit[I])))
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                let [a, b] = self.0;
                // SAFETY: every x86-64 CPU has SSE2.
                unsafe { movemask(a) as u32 | (movemask(b) as u32) << HALF }
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
                let [a, b] = self.0;
                // SAFETY: every x86-64 CPU has SSE2.
                unsafe { movemask(or(a, b)) != 0 }
            }
            #[inline(always)]
            fn all(self) -> bool {
                let [a, b] = self.0;
                // SAFETY: every x86-64 CPU has SSE2.
                unsafe { movemask(and(a, b)) == (1 << HALF) - 1 }
            }
        }
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
    sse2_lanes! {
        /// Four `f64` lanes.
        F64x4, f64, 4,
        /// One truth value for each lane of [`F64x4`].
        M64x4, mantissa 52, bias 1023.0
    }
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
    sse2_lanes! {
        /// Eight `f32` lanes.
        F32x8, f32, 8,
        /// One truth value for each lane of [`F32x8`].
        M32x8, mantissa 23, bias 127.0
    }
}
pub use double::F64x4;
pub use single::F32x8;

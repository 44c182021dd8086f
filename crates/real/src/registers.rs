//! Lanes in x86 registers, for all instruction sets, and masks as vectors of compare results, for the SSE2 and the AVX2 lanes.

/// Array of one register, which the compiler treats as the register itself. With an array it vectorises loops over single lanes less well.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Whole<T>(pub(crate) T);

impl<T> core::ops::Index<usize> for Whole<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, _: usize) -> &T {
        &self.0
    }
}

/// Value whose registers are results of an expression, one per register. `$i` is the index of the register.
macro_rules! each_register {
    ($make:ident, whole, |$i:ident| $e:expr) => {
        $make(crate::registers::Whole(each_register!(@ 0, |$i| $e)))
    };
    ($make:ident, 1, |$i:ident| $e:expr) => {
        $make([each_register!(@ 0, |$i| $e)])
    };
    ($make:ident, 2, |$i:ident| $e:expr) => {
        $make([each_register!(@ 0, |$i| $e), each_register!(@ 1, |$i| $e)])
    };
    (@ $index:literal, |$i:ident| $e:expr) => {{
        const $i: usize = $index;
        // SAFETY: the contract of the module with the lane type.
        unsafe { $e }
    }};
}

/// Definition of a lane type of one precision, from the methods of `impl Real` that differ between instruction sets. The intrinsics of the
/// precision must be in scope under the short names used below.
macro_rules! register_lanes {
    ($name:ident, $scalar:ident, $n:literal, $mask:ident, registers $registers:tt as #[$repr:meta] $storage:ty,
     mantissa $mantissa:literal, bias $bias:literal, $($method:tt)*) => {
        #[doc = concat!("Vector of ", $n, " `", stringify!($scalar), "` lanes.")]
        #[derive(Clone, Copy)]
        #[$repr]
        pub struct $name($storage);

        /// Lanes in one register.
        const WIDTH: usize = $n * size_of::<Raw>() / size_of::<$name>();

        as_lanes!($name, $scalar, $n);

        operators! { [] $name:
            Add add AddAssign add_assign = |a, b| each_register!($name, $registers, |I| add(a.0[I], b.0[I]));
            Sub sub SubAssign sub_assign = |a, b| each_register!($name, $registers, |I| sub(a.0[I], b.0[I]));
            Mul mul MulAssign mul_assign = |a, b| each_register!($name, $registers, |I| mul(a.0[I], b.0[I]));
            Div div DivAssign div_assign = |a, b| each_register!($name, $registers, |I| div(a.0[I], b.0[I]));
            - = |a| each_register!($name, $registers, |I| xor(a.0[I], set1(-0.0)));
        }

        impl Real for $name {
            lane_access!($name, $scalar, $n);
            elementary_functions!();
            type Mask = $mask;
            $($method)*

            #[inline(always)]
            fn load(s: &[$scalar]) -> Self {
                let s = &s[..$n];
                each_register!($name, $registers, |I| loadu(s.as_ptr().add(I * WIDTH)))
            }
            #[inline(always)]
            fn store(self, s: &mut [$scalar]) {
                let s = &mut s[..$n];
                for i in 0..$n / WIDTH {
                    // SAFETY: the contract of the module with the lane type. The register is written within `s`.
                    unsafe { storeu(s.as_mut_ptr().add(i * WIDTH), self.0[i]) }
                }
            }
            inline_functions! {
                fn splat(x: $scalar) -> Self = each_register!($name, $registers, |_I| set1(x));
                fn min(self, o: Self) -> Self = each_register!($name, $registers, |I| min(self.0[I], o.0[I]));
                fn max(self, o: Self) -> Self = each_register!($name, $registers, |I| max(self.0[I], o.0[I]));
                fn abs(self) -> Self = each_register!($name, $registers, |I| andnot(set1(-0.0), self.0[I]));
                fn sqrt(self) -> Self = each_register!($name, $registers, |I| sqrt(self.0[I]));
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                each_register!($name, $registers, |I| or(andnot(set1(-0.0), self.0[I]), and(set1(-0.0), sign.0[I])))
            }
            #[inline(always)]
            fn pow2(self) -> Self {
                // `pow2` in `single.rs` explains the method.
                const BIASED: $scalar = (1u64 << $mantissa) as $scalar + $bias;
                each_register!($name, $registers, |I| from_int(shift_left::<$mantissa>(to_int(add(self.0[I], set1(BIASED))))))
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // `split` in `single.rs` explains the method.
                const ONE_BITS: $scalar = (1u64 << $mantissa) as $scalar;
                const FRACTION: $scalar = $scalar::from_bits((1 << $mantissa) - 1);
                let exponent = each_register!($name, $registers, |I| from_int(shift_right::<$mantissa>(to_int(self.0[I]))));
                let mantissa = each_register!($name, $registers, |I| or(and(self.0[I], set1(FRACTION)), set1(1.0)));
                (mantissa, each_register!($name, $registers, |I| sub(or(exponent.0[I], set1(ONE_BITS)), set1(ONE_BITS + $bias))))
            }
        }
    };
}

/// Definition of a mask as vectors of compare results, for a lane type that [`register_lanes!`] defines in the same module.
macro_rules! register_mask {
    ($name:ident, $n:literal, $mask:ident, registers $registers:tt of $bytes:literal bytes) => {
        #[doc = concat!("One truth value for each lane of [`", stringify!($name), "`].")]
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align($bytes))]
        pub struct $mask([Raw; $registers]);

        impl Mask for $mask {
            #[inline(always)]
            fn from_bits(bits: u32) -> Self {
                // Every lane gets all bits, and lane i tests bit i. SSE2 compares at most 32 bits, so that each half of a 64-bit lane tests
                // the bit of the lane.
                const BIT: [i32; $bytes / 4] = {
                    let mut bit = [0; $bytes / 4];
                    let mut i = 0;
                    while i < bit.len() {
                        bit[i] = 1 << (i * $n / bit.len());
                        i += 1;
                    }
                    bit
                };
                // SAFETY: both types have the same size, and all bit patterns are valid integer vectors.
                let bit: [Integers; $registers] = unsafe { core::mem::transmute(BIT) };
                each_register!($mask, $registers, |I| from_int(equal_int(and_int(set1_int(bits as i32), bit[I]), bit[I])))
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                let mut bits = 0;
                for (i, &register) in self.0.iter().enumerate() {
                    // SAFETY: the contract of the module with the lane type.
                    bits |= (unsafe { movemask(register) } as u32) << (i * WIDTH);
                }
                bits
            }
            inline_functions! {
                fn splat(b: bool) -> Self = each_register!($mask, $registers, |_I| from_int(set1_int(-(b as i32))));
                fn and(self, o: Self) -> Self = each_register!($mask, $registers, |I| and(self.0[I], o.0[I]));
                fn or(self, o: Self) -> Self = each_register!($mask, $registers, |I| or(self.0[I], o.0[I]));
                fn and_not(self, o: Self) -> Self = each_register!($mask, $registers, |I| andnot(o.0[I], self.0[I]));
                fn not(self) -> Self = Self::splat(true).and_not(self);
                // SAFETY: the contract of the module with the lane type. With one register, the first is also the last.
                fn any(self) -> bool = unsafe { movemask(or(self.0[0], self.0[$registers - 1])) != 0 };
                // SAFETY: as above.
                fn all(self) -> bool = unsafe { movemask(and(self.0[0], self.0[$registers - 1])) == (1 << WIDTH) - 1 };
            }
        }
    };
}

pub(crate) use {each_register, register_lanes, register_mask};

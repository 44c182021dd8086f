//! Code that all lane types share: operators, inline functions, `Default`, `Debug`, access to lanes, elementary functions, and
//! `Real::vectorize`.

/// Implements the operators of a lane type from one expression each. `[...]` has the generic parameters of the type.
macro_rules! operators {
    ($generics:tt $t:ty:
     $($op:ident $f:ident $assign:ident $f_assign:ident = |$a:ident, $b:ident| $e:expr;)*
     - = |$x:ident| $negative:expr;) => {
        $(operators!(@binary $generics $t: $op $f $assign $f_assign = |$a, $b| $e);)*
        operators!(@negative $generics $t: |$x| $negative);
    };
    (@binary [$($generics:tt)*] $t:ty: $op:ident $f:ident $assign:ident $f_assign:ident = |$a:ident, $b:ident| $e:expr) => {
        impl<$($generics)*> core::ops::$op for $t {
            type Output = Self;
            #[inline(always)]
            fn $f(self, rhs: Self) -> Self {
                let ($a, $b) = (self, rhs);
                $e
            }
        }
        impl<$($generics)*> core::ops::$assign for $t {
            #[inline(always)]
            fn $f_assign(&mut self, rhs: Self) {
                *self = core::ops::$op::$f(*self, rhs);
            }
        }
    };
    (@negative [$($generics:tt)*] $t:ty: |$x:ident| $negative:expr) => {
        impl<$($generics)*> core::ops::Neg for $t {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                let $x = self;
                $negative
            }
        }
    };
}

/// Defines inline functions from one expression each. The macro is used inside an impl.
#[doc(hidden)]
#[macro_export]
macro_rules! inline_functions {
    ($(fn $f:ident($($parameters:tt)*) -> $result:ty = $e:expr;)*) => {$(
        #[inline(always)]
        fn $f($($parameters)*) -> $result {
            $e
        }
    )*};
}

/// Implements access to all lanes as an array, for a lane type that is `[$scalar; $n]` in memory.
macro_rules! as_lanes {
    ($t:ident, $scalar:ident, $n:literal) => {
        // The type has no padding, so that its lanes are an array in memory. Its alignment equals its size, so that no value is in two
        // cache lines.
        const _: () = assert!(size_of::<$t>() == align_of::<$t>() && size_of::<[$scalar; $n]>() == size_of::<$t>());

        impl $t {
            /// Lanes as an array.
            #[inline(always)]
            pub fn to_array(self) -> [$scalar; $n] {
                // SAFETY: both types have the same size, and all bit patterns are valid numbers.
                unsafe { core::mem::transmute(self) }
            }
        }
        impl Default for $t {
            #[inline(always)]
            fn default() -> Self {
                // SAFETY: all bit patterns are valid numbers. Those of zeros are zeros.
                unsafe { core::mem::zeroed() }
            }
        }
        impl core::fmt::Debug for $t {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                write!(f, "{:?}", self.to_array())
            }
        }
    };
}

/// Implements `Real::vectorize` as a separate function with given CPU features.
macro_rules! vectorize {
    ($($feature:literal)?) => {
        #[inline(always)]
        fn vectorize<T>(kernel: impl FnOnce() -> T) -> T {
            #[inline(never)]
            $(#[target_feature(enable = $feature)])?
            fn run<T>(kernel: impl FnOnce() -> T) -> T {
                kernel()
            }
            // SAFETY: this type is used only where the CPU has these features (see the module's documentation).
            #[allow(unused_unsafe)]
            unsafe {
                run(kernel)
            }
        }
    };
}

/// Methods of `impl Real` that access single lanes, which are equal for all lane types. The macro is used inside the impl.
macro_rules! lane_access {
    ($t:ident, $scalar:ident, $n:literal) => {
        type Scalar = $scalar;
        const LANES: usize = $n;

        #[inline(always)]
        fn lane(self, i: usize) -> $scalar {
            self.to_array()[i]
        }
        #[inline(always)]
        fn set_lane(&mut self, i: usize, x: $scalar) {
            assert!(i < $n, "lane {i} of {}", $n);
            // SAFETY: the lanes are an array in memory (size and alignment are asserted next to the type), and all bit patterns are valid
            // in both types. A single scalar store is faster than a new vector.
            unsafe { *core::ptr::from_mut(self).cast::<$scalar>().add(i) = x }
        }
    };
}

/// Methods of `impl Real` for elementary functions, which are equal for all lane types. The macro is used inside the impl. The trait thus
/// does not depend on the module with these functions, which are written for the trait.
#[macro_export]
macro_rules! elementary_functions {
    () => {
        $crate::inline_functions! {
            fn sin_cos(self) -> (Self, Self) = $crate::elementary::sin_cos(self);
            fn sin_cos_octant(self) -> (Self, Self) = $crate::elementary::sin_cos_octant(self);
            fn ln(self) -> Self = $crate::elementary::ln(self);
            fn ln_normal(self) -> Self = $crate::elementary::ln_normal(self);
            fn exp(self) -> Self = $crate::elementary::exp(self);
            fn atan2(self, x: Self) -> Self = $crate::elementary::atan2(self, x);
            fn acos(self) -> Self = $crate::elementary::acos(self);
        }
    };
}

pub(crate) use {as_lanes, elementary_functions, inline_functions, lane_access, operators, vectorize};

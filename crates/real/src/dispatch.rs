//! One function per CPU level out of a generic kernel.

/// Instantiates generic kernels once per CPU level and makes a function that picks one at run time.
///
/// ```
/// mod step {
///     use stepper_real::{F32x16, F64x8, Real};
///
///     #[inline(always)]
///     fn step_group<R: Real>(weights: &[R::Scalar], state: &mut [R::Stored]) {
///         for x in R::view_mut(state) {
///             *x *= R::splat(weights[0]);
///         }
///     }
///
///     stepper_real::dispatch! {
///         /// One step of eight environments.
///         pub fn step_group_f64(weights: &[f64], state: &mut [F64x8]) = step_group::<F64x8>;
///         /// One step of sixteen environments.
///         pub fn step_group_f32(weights: &[f32], state: &mut [F32x16]) = step_group::<F32x16>;
///     }
/// }
///
/// use stepper_real::{F32x16, Level, Real};
/// let mut state = [F32x16::of(3.0)];
/// for &level in Level::available() {
///     step::step_group_f32(level, &[2.0], &mut state);
/// }
/// ```
///
/// `= kernel::<F64x8>` names a generic function in scope and, as its first type argument, which lanes it is instantiated with
/// (`F64x8` or `F32x16`, of each level in turn; further type arguments may follow; the name need not be imported). The generated function takes a [`Level`] before the
/// listed arguments, and panics when the machine lacks it: get one from [`Level::best`] or [`Level::available`], once, and keep it.
///
/// The kernel and all that it calls must be `#[inline(always)]`, closures kept out, or it runs with baseline instructions. Its argument
/// types are the same at every level, so lanes are passed as [`Real::Stored`] and looked at through [`Real::view`].
///
/// Beside the function there is a module of the same name with one module per level, because the compiler splits a crate into parallel
/// units along modules.
///
/// [`Level`]: crate::Level
/// [`Level::best`]: crate::Level::best
/// [`Level::available`]: crate::Level::available
/// [`Real::Stored`]: crate::Real::Stored
/// [`Real::view`]: crate::Real::view
#[macro_export]
macro_rules! dispatch {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident $(<$($life:lifetime),+>)? ($($arg:ident: $ty:ty),* $(,)?) $(-> $out:ty)?
        = $kernel:ident::<$lanes:ident $(, $extra:ty)*>;)+) => {$(
        #[doc(hidden)]
        mod $name {
            pub(super) mod baseline {
                #[allow(unused_imports)]
                use super::super::*;
                #[inline(never)]
                #[allow(clippy::too_many_arguments)]
                pub(in super::super) fn run $(<$($life),+>)? ($($arg: $ty),*) $(-> $out)? {
                    $kernel::<$crate::array::$lanes $(, $extra)*>($($arg),*)
                }
            }
            $crate::__with_avx2! {
                pub(super) mod avx2 {
                    #[allow(unused_imports)]
                    use super::super::*;
                    #[inline(never)]
                    #[target_feature(enable = "avx2")]
                    #[allow(clippy::too_many_arguments)]
                    pub(in super::super) fn run $(<$($life),+>)? ($($arg: $ty),*) $(-> $out)? {
                        $kernel::<$crate::avx2::$lanes $(, $extra)*>($($arg),*)
                    }
                }
            }
            $crate::__with_avx512! {
                pub(super) mod avx512 {
                    #[allow(unused_imports)]
                    use super::super::*;
                    #[inline(never)]
                    #[target_feature(enable = "avx512f,avx512dq,avx512vl")]
                    #[allow(clippy::too_many_arguments)]
                    pub(in super::super) fn run $(<$($life),+>)? ($($arg: $ty),*) $(-> $out)? {
                        $kernel::<$crate::avx512::$lanes $(, $extra)*>($($arg),*)
                    }
                }
            }
        }
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name $(<$($life),+>)? (level: $crate::Level, $($arg: $ty),*) $(-> $out)? {
            assert!(level.is_available(), "CPU level {level} is not available on this machine");
            match level {
                // SAFETY, here and below: the CPU has the level's features, as just asserted.
                $crate::Level::Avx512 => $crate::__with_avx512_or_unreachable!(unsafe { $name::avx512::run($($arg),*) }),
                $crate::Level::Avx2 => $crate::__with_avx2_or_unreachable!(unsafe { $name::avx2::run($($arg),*) }),
                $crate::Level::Baseline => $name::baseline::run($($arg),*),
            }
        }
    )+};
}

// A `cfg` inside `dispatch!` would ask the features of the crate that uses it; these ask those of this crate.
#[rustfmt::skip] // It indents the inner macros further at every run.
macro_rules! with_level {
    ($d:tt $feature:literal $with:ident $with_or_unreachable:ident) => {
        #[cfg(all(target_arch = "x86_64", feature = $feature))]
        #[doc(hidden)]
        #[macro_export]
        macro_rules! $with {
            ($d($d kept:tt)*) => { $d($d kept)* };
        }
        #[cfg(not(all(target_arch = "x86_64", feature = $feature)))]
        #[doc(hidden)]
        #[macro_export]
        macro_rules! $with {
            ($d($d dropped:tt)*) => {};
        }
        #[cfg(all(target_arch = "x86_64", feature = $feature))]
        #[doc(hidden)]
        #[macro_export]
        macro_rules! $with_or_unreachable {
            ($d($d kept:tt)*) => { $d($d kept)* };
        }
        #[cfg(not(all(target_arch = "x86_64", feature = $feature)))]
        #[doc(hidden)]
        #[macro_export]
        macro_rules! $with_or_unreachable {
            ($d($d dropped:tt)*) => { unreachable!("a level that this build lacks is never available") };
        }
    };
}
with_level! { $ "avx2" __with_avx2 __with_avx2_or_unreachable }
with_level! { $ "avx512" __with_avx512 __with_avx512_or_unreachable }

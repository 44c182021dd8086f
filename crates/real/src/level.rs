//! CPU levels: detection of the machine's instructions, selection of a level, and calls with its lane types.

use core::fmt;
use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
use crate::real::Real;

/// Environment variable that overrides [`Level::best`].
const VARIABLE: &str = "STEPPER_CPU_LEVEL";

/// Set of CPU instructions for which kernels are compiled. Results are equal bit for bit at all levels; only the speed differs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// Instructions of every CPU of the architecture: SSE2 on x86-64, NEON on AArch64.
    Baseline,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 F, DQ and VL (server cores since Skylake-SP, Zen 4 and later).
    Avx512,
}

impl Level {
    /// All levels, slowest first.
    const ALL: [Level; 3] = [Level::Baseline, Level::Avx2, Level::Avx512];

    /// Levels that this machine and this build support, slowest first.
    pub fn available() -> &'static [Level] {
        static AVAILABLE: OnceLock<Vec<Level>> = OnceLock::new();
        AVAILABLE.get_or_init(|| Level::ALL.into_iter().filter(|level| level.detect()).collect())
    }

    /// Whether [`Level::available`] contains the level.
    pub fn is_available(self) -> bool {
        Level::available().contains(&self)
    }

    /// Fastest available level, or the level that the environment variable `STEPPER_CPU_LEVEL` names (`baseline`, `avx2` or `avx512`). The
    /// variable is read at the first call.
    ///
    /// # Errors
    /// [`LevelError`] if the variable does not name a level, or names one that this machine or build lacks. Measurements thus never run at
    /// an unexpected level.
    pub fn best() -> Result<Level, LevelError> {
        static BEST: OnceLock<Result<Level, LevelError>> = OnceLock::new();
        BEST.get_or_init(|| match std::env::var_os(VARIABLE) {
            None => Ok(*Level::available().last().expect("the baseline is always available")),
            Some(word) => Level::if_available(&word.to_string_lossy()),
        })
        .clone()
    }

    /// Level with this name, if this machine and build support it.
    fn if_available(word: &str) -> Result<Level, LevelError> {
        let found = Level::ALL.into_iter().find(|level| level.name().eq_ignore_ascii_case(word.trim()));
        let level = found.ok_or_else(|| LevelError::Unknown(word.to_owned()))?;
        if level.is_available() { Ok(level) } else { Err(LevelError::Unavailable(level)) }
    }

    /// Name of the level, as in the environment variable `STEPPER_CPU_LEVEL`.
    fn name(self) -> &'static str {
        match self {
            Level::Baseline => "baseline",
            Level::Avx2 => "avx2",
            Level::Avx512 => "avx512",
        }
    }

    /// Whether the build contains the level and the CPU has the features that `Real::vectorize` enables for it.
    fn detect(self) -> bool {
        match self {
            Level::Baseline => cfg!(has_level = "baseline"),
            #[cfg(has_level = "avx2")]
            Level::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(has_level = "avx512")]
            Level::Avx512 => {
                is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") && is_x86_feature_detected!("avx512vl")
            }
            #[allow(unreachable_patterns, reason = "a build may lack levels")]
            _ => false,
        }
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Error of a CPU level that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LevelError {
    /// Name that no level has.
    Unknown(String),
    /// Level that this machine or this build lacks.
    Unavailable(Level),
}

impl fmt::Display for LevelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LevelError::Unknown(word) => write!(f, "unknown CPU level {word:?}: expected baseline, avx2 or avx512 (set by {VARIABLE}?)"),
            LevelError::Unavailable(level) => {
                let have: Vec<&str> = Level::available().iter().map(|level| level.name()).collect();
                write!(
                    f,
                    "CPU level {level} is not available on this machine and build (set by {VARIABLE}?); there are: {}",
                    have.join(", ")
                )
            }
        }
    }
}

impl std::error::Error for LevelError {}

/// Calls a generic function with the lane type of a CPU level that is chosen at run time.
///
/// `at_level!(level, F64Lanes, step(state, h))` calls `step::<F64Lanes>(state, h)` with the `F64Lanes` of that [`Level`]. The first type
/// argument of the function is the lane type: `F64x1`, `F64Lanes` or `F32Lanes`, which need not be imported. Further type arguments are
/// written `step::<_, Further>(state, h)`. The types of arguments and result are the same at every level. Numbers are passed as scalars,
/// and converted by [`Real::load`] and [`Real::store`].
///
/// The function is ordinary code that computes inside [`Real::vectorize`], which compiles a closure with the level's instructions. The
/// closure and all functions that it calls must be `#[inline(always)]`. Otherwise they run with baseline instructions.
///
/// ```
/// use stepper_real::{Level, Real, at_level};
///
/// /// Multiplies every number.
/// fn scale<R: Real>(by: R::Scalar, x: &mut [R::Scalar]) {
///     R::vectorize(
///         #[inline(always)]
///         || {
///             for x in x.chunks_exact_mut(R::LANES) {
///                 (R::load(x) * R::splat(by)).store(x);
///             }
///         },
///     )
/// }
///
/// let mut x = [3.0f32; 32];
/// at_level!(Level::best()?, F32Lanes, scale(2.0, &mut x));
/// assert_eq!(x, [6.0; 32]);
/// # Ok::<(), stepper_real::LevelError>(())
/// ```
///
/// # Panics
/// If the machine or this build lacks the level. Get a level once from [`Level::best`] or [`Level::available`] and store it. A lane type
/// executes its level's instructions wherever it is used. This macro is therefore the only way to use it: code without `unsafe` cannot name
/// the type.
///
/// ```compile_fail
/// use stepper_real::{Real, avx512};
/// // Undefined on a CPU without AVX-512.
/// avx512::F64x8::splat(1.0);
/// ```
///
/// ```compile_fail
/// struct Checked; // Without a check of the CPU.
/// impl stepper_real::HasAvx2 for Checked {}
/// ```
///
/// [`Level`]: crate::Level
/// [`Level::best`]: crate::Level::best
/// [`Level::available`]: crate::Level::available
/// [`Real::load`]: crate::Real::load
/// [`Real::store`]: crate::Real::store
/// [`Real::vectorize`]: crate::Real::vectorize
#[macro_export]
macro_rules! at_level {
    ($level:expr, $lanes:ident, $run:ident $(::<_, $($extra:ty),+>)? ($($arg:expr),* $(,)?)) => {{
        let level: $crate::Level = $level;
        assert!(level.is_available(), "CPU level {level} is not available on this machine and build");
        match level {
            $crate::Level::Avx512 => $crate::code_of::avx512!({
                struct Checked;
                // SAFETY: the check is above.
                unsafe impl $crate::HasAvx512 for Checked {}
                $run::<<Checked as $crate::Avx512>::$lanes $(, $($extra),+)?>($($arg),*)
            }),
            $crate::Level::Avx2 => $crate::code_of::avx2!({
                struct Checked;
                // SAFETY: the check is above.
                unsafe impl $crate::HasAvx2 for Checked {}
                $run::<<Checked as $crate::Avx2>::$lanes $(, $($extra),+)?>($($arg),*)
            }),
            $crate::Level::Baseline => $crate::code_of::baseline!($run::<$crate::baseline::$lanes $(, $($extra),+)?>($($arg),*)),
        }
    }};
}

/// Marker of a type that exists only after a check that the CPU has the instructions of [`Level::Avx2`]. The lane types of this level can
/// only be named through [`Avx2`].
///
/// # Safety
/// The implementor may be named only after [`Level::is_available`] returned true. [`at_level!`](crate::at_level) ensures this.
#[cfg(target_arch = "x86_64")]
pub unsafe trait HasAvx2 {}

/// Marker of a type that exists only after a check that the CPU has the instructions of [`Level::Avx512`].
///
/// # Safety
/// As for [`HasAvx2`].
#[cfg(target_arch = "x86_64")]
pub unsafe trait HasAvx512 {}

/// Lane types of the level AVX2.
#[cfg(target_arch = "x86_64")]
pub trait Avx2 {
    /// Single `f64`.
    type F64x1: Real<Scalar = f64>;
    /// Eight `f64` lanes in two registers.
    type F64Lanes: Real<Scalar = f64>;
    /// Eight `f32` lanes in one register.
    type F32Lanes: Real<Scalar = f32>;
}

/// Lane types of the level AVX-512.
#[cfg(target_arch = "x86_64")]
pub trait Avx512 {
    /// Single `f64`.
    type F64x1: Real<Scalar = f64>;
    /// Eight `f64` lanes.
    type F64Lanes: Real<Scalar = f64>;
    /// Sixteen `f32` lanes.
    type F32Lanes: Real<Scalar = f32>;
}

#[cfg(target_arch = "x86_64")]
impl<T: HasAvx2> Avx2 for T {
    type F64x1 = crate::single_lane::F64x1;
    type F64Lanes = crate::avx2::F64x8;
    type F32Lanes = crate::avx2::F32x8;
}

// A single `f64` is not faster with AVX-512.
#[cfg(target_arch = "x86_64")]
impl<T: HasAvx512> Avx512 for T {
    type F64x1 = crate::single_lane::F64x1;
    type F64Lanes = crate::avx512::F64x8;
    type F32Lanes = crate::avx512::F32x16;
}

/// Code of a level that this build has.
#[doc(hidden)]
#[macro_export]
macro_rules! __run {
    ($($run:tt)*) => { $($run)* };
}
/// Code of a level that this build lacks.
#[doc(hidden)]
#[macro_export]
macro_rules! __never {
    ($($run:tt)*) => {
        unreachable!("a level that this build lacks is never available")
    };
}

/// Macros for the code of each level. A `cfg` inside `at_level!` would test the features of the calling crate. The build script of this
/// crate sets `has_level` for each level of the build.
#[doc(hidden)]
pub mod code_of {
    #[cfg(not(has_level = "avx2"))]
    pub use crate::__never as avx2;
    #[cfg(not(has_level = "avx512"))]
    pub use crate::__never as avx512;
    #[cfg(not(has_level = "baseline"))]
    pub use crate::__never as baseline;
    #[cfg(has_level = "avx2")]
    pub use crate::__run as avx2;
    #[cfg(has_level = "avx512")]
    pub use crate::__run as avx512;
    #[cfg(has_level = "baseline")]
    pub use crate::__run as baseline;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_word_is_an_error_that_says_what_is_expected() {
        let error = Level::if_available("sse9").unwrap_err();
        assert_eq!(error, LevelError::Unknown("sse9".to_owned()));
        assert!(error.to_string().contains("baseline, avx2 or avx512"));
        assert!(Level::if_available("").is_err());
    }

    #[test]
    fn a_missing_level_is_an_error_that_names_what_there_is() {
        for level in Level::ALL {
            for word in [level.to_string(), format!(" {}\n", level.name().to_uppercase())] {
                match Level::if_available(&word) {
                    Ok(found) => assert!(found == level && level.is_available()),
                    Err(error) => assert!(error == LevelError::Unavailable(level) && error.to_string().contains("baseline")),
                }
            }
        }
    }

    #[test]
    fn the_baseline_is_everywhere_and_levels_are_sorted() {
        assert_eq!(Level::available()[0], Level::Baseline);
        assert!(Level::available().is_sorted());
    }
}

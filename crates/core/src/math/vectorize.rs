//! Macros for kernels, which give closures the attribute `#[inline(always)]` that `Real::vectorize` requires.

/// Runs a block as a kernel: `vectorize!(R, { ... })` is `R::vectorize` with the block as an inlined closure. A `return` ends the block.
macro_rules! vectorize {
    ($real:ident, $kernel:expr) => {
        $real::vectorize(
            #[inline(always)]
            || $kernel,
        )
    };
}

/// Array with the entries of an inlined closure: `array!(|k| a[k] * b[k])`, see [`array_of`](crate::math::spatial::array_of).
macro_rules! array {
    (|$k:ident| $entry:expr) => {
        $crate::math::spatial::array_of(
            #[inline(always)]
            |$k| $entry,
        )
    };
}

pub(crate) use {array, vectorize};

//! Number type that counts the operations on it, so that the floating-point operations of a step are measured.

use std::cell::Cell;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use stepper_core::internals::probe::Span;
use stepper_real::Real;

use crate::recorder::READINGS;

thread_local! {
    static DONE: Cell<Operations> = const { Cell::new(Operations { sums: 0, divisions: 0, others: 0 }) };
}

/// Numbers of floating-point operations by kind.
#[derive(Clone, Copy)]
struct Operations {
    /// Number of additions, subtractions and multiplications.
    sums: u64,
    /// Number of divisions and square roots.
    divisions: u64,
    /// Number of comparisons, selections, minima, maxima, sign operations and roundings.
    others: u64,
}

/// Meter for a recorder: numbers of operations that this thread has made on [`Counted`] numbers so far.
///
/// A reading has the numbers of sums (with products), divisions (with square roots) and other operations.
pub fn operations(_: Option<Span>) -> [u64; READINGS] {
    let Operations { sums, divisions, others } = DONE.get();
    [sums, divisions, others]
}

fn sum() {
    DONE.set(Operations { sums: DONE.get().sums + 1, ..DONE.get() });
}

fn division() {
    DONE.set(Operations { divisions: DONE.get().divisions + 1, ..DONE.get() });
}

fn other() {
    DONE.set(Operations { others: DONE.get().others + 1, ..DONE.get() });
}

/// SIMD lane type that computes like `R` and counts its operations.
///
/// An operation on all lanes counts once. The count of an environment's step is therefore exact if only one environment is stepped.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counted<R>(R);

macro_rules! operator {
    ($trait:ident $f:ident $assign:ident $f_assign:ident $count:ident) => {
        impl<R: Real> $trait for Counted<R> {
            type Output = Self;
            fn $f(self, o: Self) -> Self {
                $count();
                Self(self.0.$f(o.0))
            }
        }
        impl<R: Real> $assign for Counted<R> {
            fn $f_assign(&mut self, o: Self) {
                *self = $trait::$f(*self, o);
            }
        }
    };
}

operator!(Add add AddAssign add_assign sum);
operator!(Sub sub SubAssign sub_assign sum);
operator!(Mul mul MulAssign mul_assign sum);
operator!(Div div DivAssign div_assign division);

impl<R: Real> Neg for Counted<R> {
    type Output = Self;
    fn neg(self) -> Self {
        other();
        Self(-self.0)
    }
}

impl<R: Real> Real for Counted<R> {
    type Scalar = R::Scalar;
    type Mask = R::Mask;
    type Single = Counted<R::Single>;
    const LANES: usize = R::LANES;

    stepper_real::elementary_functions!();

    fn splat(x: R::Scalar) -> Self {
        Self(R::splat(x))
    }
    fn load(s: &[R::Scalar]) -> Self {
        Self(R::load(s))
    }
    fn store(self, s: &mut [R::Scalar]) {
        self.0.store(s);
    }
    fn lane(self, i: usize) -> R::Scalar {
        self.0.lane(i)
    }
    fn set_lane(&mut self, i: usize, x: R::Scalar) {
        self.0.set_lane(i, x);
    }
    fn vectorize<T>(kernel: impl FnOnce() -> T) -> T {
        kernel()
    }
    fn lt(self, o: Self) -> R::Mask {
        other();
        self.0.lt(o.0)
    }
    fn le(self, o: Self) -> R::Mask {
        other();
        self.0.le(o.0)
    }
    fn eq(self, o: Self) -> R::Mask {
        other();
        Real::eq(self.0, o.0)
    }
    fn select(m: R::Mask, a: Self, b: Self) -> Self {
        other();
        Self(R::select(m, a.0, b.0))
    }
    fn min(self, o: Self) -> Self {
        other();
        Self(Real::min(self.0, o.0))
    }
    fn max(self, o: Self) -> Self {
        other();
        Self(Real::max(self.0, o.0))
    }
    fn abs(self) -> Self {
        other();
        Self(Real::abs(self.0))
    }
    fn sqrt(self) -> Self {
        division();
        Self(Real::sqrt(self.0))
    }
    fn copysign(self, sign: Self) -> Self {
        other();
        Self(Real::copysign(self.0, sign.0))
    }
    fn round_even(self) -> Self {
        other();
        Self(Real::round_even(self.0))
    }
    fn pow2(self) -> Self {
        other();
        Self(Real::pow2(self.0))
    }
    fn split(self) -> (Self, Self) {
        other();
        let (mantissa, exponent) = Real::split(self.0);
        (Self(mantissa), Self(exponent))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorder::record;

    #[test]
    fn a_dot_product_is_five_sums_and_its_root_a_division() {
        let a = [1.0, 2.0, 2.0].map(Counted::<f64>::splat);
        let mut length = Counted::<f64>::zero();
        let done = record(operations, || length = stepper_core::internals::math::spatial::norm(a));
        assert_eq!(done.unaccounted.readings, [5.0, 1.0, 0.0]);
        assert_eq!(length.0, 3.0);
    }

    #[test]
    fn what_is_done_with_all_lanes_is_one_operation() {
        let done = record(operations, || {
            std::hint::black_box(Counted(stepper_real::F32Lanes::one()) * Counted(stepper_real::F32Lanes::of(2.0)));
        });
        assert_eq!(done.unaccounted.readings, [1.0, 0.0, 0.0]);
    }
}

//! A number that counts what is done with it, so that a step's floating point operations are known and not estimated.

use std::cell::Cell;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use stepper_core::internals::probe::Span;
use stepper_real::Real;

use crate::recorder::READINGS;

thread_local! {
    static DONE: Cell<Operations> = const { Cell::new(Operations { sums: 0, divisions: 0, others: 0 }) };
}

/// Numbers of operations.
#[derive(Clone, Copy)]
struct Operations {
    /// Additions, subtractions, multiplications.
    sums: u64,
    /// Divisions and square roots.
    divisions: u64,
    /// Comparisons, selections, least and greatest, signs, rounding.
    others: u64,
}

/// A meter of what this thread does with [`Counted`] numbers: sums, divisions and others.
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

/// One environment, as `f64` is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counted(f64);

macro_rules! operator {
    ($trait:ident $f:ident $assign:ident $f_assign:ident $count:ident) => {
        impl $trait for Counted {
            type Output = Self;
            fn $f(self, o: Self) -> Self {
                $count();
                Self(self.0.$f(o.0))
            }
        }
        impl $assign for Counted {
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

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        other();
        Self(-self.0)
    }
}

impl Real for Counted {
    type Scalar = f64;
    type Mask = bool;
    type Half = Self;
    const LANES: usize = 1;

    stepper_real::elementary_functions!();

    fn splat(x: f64) -> Self {
        Self(x)
    }
    fn load(s: &[f64]) -> Self {
        Self(s[0])
    }
    fn store(self, s: &mut [f64]) {
        s[0] = self.0;
    }
    fn lane(self, i: usize) -> f64 {
        assert!(i == 0, "one lane only");
        self.0
    }
    fn set_lane(&mut self, i: usize, x: f64) {
        assert!(i == 0, "one lane only");
        self.0 = x;
    }
    fn vectorize<T>(kernel: impl FnOnce() -> T) -> T {
        kernel()
    }
    fn lt(self, o: Self) -> bool {
        other();
        self.0 < o.0
    }
    fn le(self, o: Self) -> bool {
        other();
        self.0 <= o.0
    }
    fn eq(self, o: Self) -> bool {
        other();
        self.0 == o.0
    }
    fn select(m: bool, a: Self, b: Self) -> Self {
        other();
        if m { a } else { b }
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
        Self(self.0.abs())
    }
    fn sqrt(self) -> Self {
        division();
        Self(self.0.sqrt())
    }
    fn copysign(self, sign: Self) -> Self {
        other();
        Self(self.0.copysign(sign.0))
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
        let a = [1.0, 2.0, 2.0].map(Counted::splat);
        let mut length = Counted::zero();
        let done = record(operations, || length = stepper_core::internals::math::spatial::norm(a));
        assert_eq!(done.unaccounted.readings, [5.0, 1.0, 0.0]);
        assert_eq!(length.0, 3.0);
    }
}

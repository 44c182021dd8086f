//! Tests of the errors of the elementary functions, in ulps, over dense samples.
//!
//! Results in f64 are compared with std's functions. These come from the platform's libm, and are within one ulp of the true result. The
//! bounds for f64 are therefore bounds of the difference from libm. Results in f32 are compared with results in f64, so that their bounds
//! are bounds of the error. Scalars represent all lane types, because `tests/backends.rs` shows that all give the same bits.

use core::f64::consts::PI;
use stepper_real::Real;

/// Largest measured |result - expected| / ulp(expected), and its argument.
#[derive(Default)]
struct Worst {
    ulps: f64,
    at: (f64, f64),
}

impl Worst {
    /// Compares the result `got` at the argument `at` with the expected result `want`, and stores the error if it is the largest so far.
    /// `ulp` is the distance between neighbouring numbers of the result's type at `want`.
    fn see(&mut self, at: (f64, f64), got: f64, want: f64, ulp: f64) {
        assert_eq!(got.is_nan(), want.is_nan(), "at {at:?}: {got:e}, not {want:e}");
        let ulps = if got == want || want.is_nan() { 0.0 } else { (got - want).abs() / ulp };
        if ulps > self.ulps || ulps.is_nan() {
            *self = Worst { ulps, at };
        }
    }
    fn see_f64(&mut self, at: (f64, f64), got: f64, want: f64) {
        self.see(at, got, want, want.abs().next_up() - want.abs());
    }
    fn see_f32(&mut self, at: (f64, f64), got: f32, want: f64) {
        // Below the smallest normal number, the distance between neighbours is constant.
        let near = (want.abs() as f32).max(f32::MIN_POSITIVE);
        self.see(at, got as f64, want, (near.next_up() - near) as f64);
    }
    fn assert_within(&self, bound: f64, what: &str) {
        println!("{what}: {:.3} ulp at {:?}", self.ulps, self.at);
        assert!(self.ulps <= bound, "{what}: {} ulp at {:?}", self.ulps, self.at);
    }
}

/// `n` points between `from` and `to`. An offset within the intervals avoids special values.
fn sweep(from: f64, to: f64, n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| from + (to - from) * (i as f64 + 0.41421356) / n as f64)
}

/// Numbers with `n` magnitudes between `smallest` and `largest`, at equal ratios, each with both signs.
fn magnitudes(smallest: f64, largest: f64, n: usize) -> impl Iterator<Item = f64> {
    sweep(smallest.log2(), largest.log2(), n).flat_map(|e| [e.exp2(), -e.exp2()])
}

/// Doubles at and next to multiples of pi/2 up to `most`, where sine or cosine nearly vanishes and an inaccurate argument reduction shows.
fn around_quarter_turns(most: f64) -> impl Iterator<Item = f64> {
    (1..=(most / (PI / 2.0)) as u32).flat_map(|k| {
        let x = f64::from(k) * (PI / 2.0);
        [x, x.next_down(), x.next_up(), -x]
    })
}

// Bound 1 ulp. The result is within 0.77 ulp of the true value (measured with mpmath), and libm's result within about 0.55 ulp. Their
// distance is thus below 2 ulp, so that the two doubles are equal or neighbours.
#[test]
fn sin_cos_f64() {
    let (mut sin, mut cos) = (Worst::default(), Worst::default());
    let inputs = sweep(-10.0, 10.0, 2_000_000)
        .chain(sweep(-1e5, 1e5, 2_000_000))
        .chain(magnitudes(1e-310, 1.6e6, 500_000))
        .chain(around_quarter_turns(1.6e6));
    for x in inputs {
        let (s, c) = Real::sin_cos(x);
        sin.see_f64((x, 0.0), s, x.sin());
        cos.see_f64((x, 0.0), c, x.cos());
    }
    sin.assert_within(1.0, "sin f64");
    cos.assert_within(1.0, "cos f64");
}

// Bound 0.8 ulp. A test of every f32 in the range found 0.79998 ulp for sin and 0.792 ulp for cos. A correctly rounded result has up to 0.5
// ulp.
#[test]
fn sin_cos_f32() {
    let (mut sin, mut cos) = (Worst::default(), Worst::default());
    let near_zeros = around_quarter_turns(1.2e4).flat_map(|x| [x as f32, (x as f32).next_up(), (x as f32).next_down()]);
    let spread = sweep(-10.0, 10.0, 2_000_000).chain(sweep(-1.2e4, 1.2e4, 2_000_000)).chain(magnitudes(1e-44, 1.2e4, 500_000));
    for x in spread.map(|x| x as f32).chain(near_zeros) {
        let (s, c) = Real::sin_cos(x);
        sin.see_f32((x.into(), 0.0), s, f64::from(x).sin());
        cos.see_f32((x.into(), 0.0), c, f64::from(x).cos());
    }
    sin.assert_within(0.8, "sin f32");
    cos.assert_within(0.8, "cos f32");
}

#[test]
fn sin_cos_out_of_range_stay_on_the_circle() {
    let unit = |x: f64| (-1.0..=1.0).contains(&x);
    for x in magnitudes(1e6, 1e308, 200_000).chain([f64::MAX, f64::MIN]) {
        let (s, c) = Real::sin_cos(x);
        assert!(unit(s) && unit(c), "{x:e}: {s:e} {c:e}");
        // Beyond the range of the argument reduction, the error is about as large as the effect of one ulp of the angle.
        if x.abs() < 1e9 {
            let bound = 2.0 * (x.abs().next_up() - x.abs()) + f64::EPSILON;
            assert!((s - x.sin()).abs() < bound && (c - x.cos()).abs() < bound, "{x:e}: {s:e} {c:e}");
        }
    }
    for x in magnitudes(1e3, 3e38, 200_000).map(|x| x as f32).chain([f32::MAX, f32::MIN]) {
        let (s, c) = Real::sin_cos(x);
        assert!(unit(s.into()) && unit(c.into()), "{x:e}: {s:e} {c:e}");
    }
    for x in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        let (s, c) = Real::sin_cos(x);
        assert!(s.is_nan() && c.is_nan());
        let (s, c) = Real::sin_cos(x as f32);
        assert!(s.is_nan() && c.is_nan());
    }
}

// Bound 1 ulp: equal or neighbouring doubles, as for sin. The error against mpmath is 0.86 ulp.
#[test]
fn exp_f64() {
    let mut worst = Worst::default();
    let inputs = sweep(-708.0, 709.7, 2_000_000).chain(sweep(-2.0, 2.0, 1_000_000)).chain(magnitudes(1e-310, 1.0, 200_000));
    for x in inputs {
        worst.see_f64((x, 0.0), Real::exp(x), x.exp());
    }
    worst.assert_within(1.0, "exp f64");
    // Results below the smallest normal number are rounded a second time.
    let mut gradual = Worst::default();
    for x in sweep(-747.0, -707.0, 500_000) {
        gradual.see_f64((x, 0.0), Real::exp(x), x.exp());
    }
    gradual.assert_within(1.0, "exp f64, subnormal");
}

// Bound 0.95 ulp. A test of every f32 found 0.911 ulp.
#[test]
fn exp_f32() {
    let mut worst = Worst::default();
    let inputs = sweep(-106.0, 88.7, 3_000_000).chain(sweep(-2.0, 2.0, 1_000_000)).chain(magnitudes(1e-44, 1.0, 200_000));
    for x in inputs.map(|x| x as f32) {
        worst.see_f32((x.into(), 0.0), Real::exp(x), f64::from(x).exp());
    }
    worst.assert_within(0.95, "exp f32");
}

// Bound 1 ulp: equal or neighbouring doubles, as for exp. The error against extended precision is 0.83 ulp.
#[test]
fn ln_f64() {
    let mut worst = Worst::default();
    let inputs = sweep(0.0, 4.0, 2_000_000).chain(magnitudes(5e-324, 1.7e308, 1_000_000)).chain(sweep(0.999, 1.001, 500_000));
    for x in inputs.filter(|x| *x > 0.0) {
        worst.see_f64((x, 0.0), Real::ln(x), x.ln());
    }
    worst.assert_within(1.0, "ln f64");
}

// Bound 0.85 ulp. A test of every positive f32 found 0.840 ulp.
#[test]
fn ln_f32() {
    let mut worst = Worst::default();
    let inputs = sweep(0.0, 4.0, 2_000_000).chain(magnitudes(1e-45, 3e38, 1_000_000)).chain(sweep(0.999, 1.001, 500_000));
    for x in inputs.map(|x| x as f32).filter(|x| *x > 0.0) {
        worst.see_f32((x.into(), 0.0), Real::ln(x), f64::from(x).ln());
    }
    worst.assert_within(0.85, "ln f32");
}

#[test]
fn ln_outside_its_domain_as_ieee() {
    assert_eq!([0.0, -0.0].map(<f64 as Real>::ln), [f64::NEG_INFINITY; 2]);
    assert_eq!([0.0, -0.0].map(<f32 as Real>::ln), [f32::NEG_INFINITY; 2]);
    assert_eq!((Real::ln(f64::INFINITY), Real::ln(f32::INFINITY)), (f64::INFINITY, f32::INFINITY));
    for x in [-1.0, -1e-310, f64::NEG_INFINITY, f64::NAN] {
        assert!(Real::ln(x).is_nan() && Real::ln(x as f32 * 1.0).is_nan() == (x as f32 != 0.0), "{x:e}");
    }
}

// The argument needs no reduction. The bounds are those of sin and cos: equal or neighbouring doubles in f64, and at most 0.8 ulp in f32.
#[test]
fn sin_cos_octant_is_sin_cos() {
    let mut worst = Worst::default();
    for x in sweep(-PI / 4.0, PI / 4.0, 1_000_000) {
        let (s, c) = Real::sin_cos_octant(x);
        worst.see_f64((x, 0.0), s, x.sin());
        worst.see_f64((x, 0.0), c, x.cos());
    }
    worst.assert_within(1.0, "sin_cos_octant f64");
    let mut worst = Worst::default();
    for x in sweep(-PI / 4.0, PI / 4.0, 1_000_000).map(|x| x as f32) {
        let (s, c) = Real::sin_cos_octant(x);
        worst.see_f32((x.into(), 0.0), s, f64::from(x).sin());
        worst.see_f32((x.into(), 0.0), c, f64::from(x).cos());
    }
    worst.assert_within(0.8, "sin_cos_octant f32");
}

#[test]
fn exp_over_and_underflows_as_ieee() {
    assert_eq!([0.0, -0.0].map(<f64 as Real>::exp), [1.0, 1.0]);
    assert_eq!([709.8, 710.0, 1e300, f64::INFINITY].map(<f64 as Real>::exp), [f64::INFINITY; 4]);
    assert_eq!([-745.2, -746.0, -1e300, f64::NEG_INFINITY].map(<f64 as Real>::exp), [0.0; 4]);
    assert_eq!([88.73, 89.0, 1e38, f32::INFINITY].map(<f32 as Real>::exp), [f32::INFINITY; 4]);
    assert_eq!([-104.0, -105.0, -1e38, f32::NEG_INFINITY].map(<f32 as Real>::exp), [0.0; 4]);
    assert!(Real::exp(f64::NAN).is_nan() && Real::exp(f32::NAN).is_nan());
}

// Bound 2 ulp. The error against mpmath is 1.40 ulp: to the final rounding, the quotient adds two roundings of up to 0.5 ulp each, or more
// just above a power of two. libm adds up to 0.5 ulp. Doubles that are less than 3 ulp apart are at most 2 ulp apart.
#[test]
fn atan2_f64() {
    let mut worst = Worst::default();
    // All directions at three lengths, then all ratios.
    for angle in sweep(-PI, PI, 2_000_000) {
        for length in [1.0, 3.7e-5, 8.1e10] {
            let (y, x) = (length * angle.sin(), length * angle.cos());
            worst.see_f64((y, x), Real::atan2(y, x), y.atan2(x));
        }
    }
    for (y, x) in magnitudes(1e-305, 1e305, 500_000).flat_map(|y| [(y, 1.0), (y, -1.0), (1.0, y), (-1.0, y), (y, 0.3 * y)]) {
        worst.see_f64((y, x), Real::atan2(y, x), y.atan2(x));
    }
    worst.assert_within(2.0, "atan2 f64");
}

// Bound 1.6 ulp: as for f64, without the error of libm.
#[test]
fn atan2_f32() {
    let mut worst = Worst::default();
    for angle in sweep(-PI, PI, 2_000_000) {
        for length in [1.0, 3.7e-5, 8.1e10] {
            let (y, x) = ((length * angle.sin()) as f32, (length * angle.cos()) as f32);
            worst.see_f32((y.into(), x.into()), Real::atan2(y, x), f64::from(y).atan2(x.into()));
        }
    }
    for y in magnitudes(1e-37, 1e37, 500_000).map(|y| y as f32) {
        for (y, x) in [(y, 1.0), (y, -1.0), (1.0, y), (-1.0, y), (y, 0.3 * y)] {
            worst.see_f32((y.into(), x.into()), Real::atan2(y, x), f64::from(y).atan2(x.into()));
        }
    }
    worst.assert_within(1.6, "atan2 f32");
}

#[test]
fn atan2_knows_quadrants_zeros_and_infinities_as_ieee() {
    let edges = [0.0, -0.0, 1.0, -1.0, 1e-310, 1e308, -1e308, f64::MAX, f64::INFINITY, f64::NEG_INFINITY];
    for y in edges {
        for x in edges {
            let (got, want) = (Real::atan2(y, x), y.atan2(x));
            assert_eq!(got.to_bits(), want.to_bits(), "atan2({y:e}, {x:e}): {got:e}, not {want:e}");
            let (got, want) = (Real::atan2(y as f32, x as f32), f64::from(y as f32).atan2(f64::from(x as f32)));
            assert_eq!(got.to_bits(), (want as f32).to_bits(), "atan2({y:e}, {x:e}) in f32: {got:e}, not {want:e}");
        }
        for (y, x) in [(y, f64::NAN), (f64::NAN, y)] {
            assert!(Real::atan2(y, x).is_nan() && Real::atan2(y as f32, x as f32).is_nan());
        }
    }
}

// Bound 1 ulp: equal or neighbouring doubles, as for sin. The error against mpmath is 0.87 ulp.
#[test]
fn acos_f64() {
    let mut worst = Worst::default();
    let near_one = magnitudes(1e-16, 0.5, 500_000).map(|d| if d > 0.0 { 1.0 - d } else { -1.0 - d });
    let near_zero = magnitudes(1e-310, 0.5, 500_000);
    for x in sweep(-1.0, 1.0, 3_000_000).chain(near_one).chain(near_zero).chain([0.0, 1.0, -1.0, 0.5, -0.5]) {
        worst.see_f64((x, 0.0), Real::acos(x), x.acos());
    }
    worst.assert_within(1.0, "acos f64");
}

// Bound 0.95 ulp. A test of every f32 found 0.918 ulp.
#[test]
fn acos_f32() {
    let mut worst = Worst::default();
    let near_one = magnitudes(1e-8, 0.5, 500_000).map(|d| if d > 0.0 { 1.0 - d } else { -1.0 - d });
    let near_zero = magnitudes(1e-44, 0.5, 500_000);
    for x in sweep(-1.0, 1.0, 3_000_000).chain(near_one).chain(near_zero).map(|x| x as f32) {
        worst.see_f32((x.into(), 0.0), Real::acos(x), f64::from(x).acos());
    }
    worst.assert_within(0.95, "acos f32");
}

#[test]
fn acos_outside_its_domain_is_nan() {
    for x in [1.0f64.next_up(), -(1.0f64.next_up()), 2.0, -1e300, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        assert!(Real::acos(x).is_nan(), "{x:e}");
    }
    for x in [1.0f32.next_up(), -(1.0f32.next_up()), 2.0, -1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
        assert!(Real::acos(x).is_nan(), "{x:e}");
    }
}

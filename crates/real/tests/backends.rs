//! Tests that every lane of every lane type has the same bits as a scalar.

use proptest::prelude::*;
use stepper_real::{Level, Mask, Real, array, at_level};

/// Names of the operations whose results `operations` writes, in the same order.
const NAMES: [&str; 43] = [
    "add",
    "sub",
    "mul",
    "div",
    "neg",
    "+=",
    "-=",
    "*=",
    "/=",
    "lt",
    "le",
    "gt",
    "ge",
    "eq",
    "select",
    "min",
    "max",
    "abs",
    "sqrt",
    "copysign",
    "round_even",
    "is_finite",
    "recip",
    "clamp",
    "square",
    "pow2",
    "pow2 of integer",
    "split.0",
    "split.1",
    "sin_cos.0",
    "sin_cos.1",
    "sin",
    "cos",
    "sin_cos_octant.0",
    "sin_cos_octant.1",
    "ln",
    "ln_normal",
    "exp",
    "atan2",
    "acos",
    "sum of products",
    "load",
    "set_lane",
];

#[inline(always)]
fn truth<R: Real>(m: R::Mask) -> R {
    R::select(m, R::one(), R::zero())
}

/// Applies every operation of [`NAMES`] to the lanes `a` and `b`. Writes the results to `out`, one after the other, each with all its
/// lanes.
#[inline(always)]
fn operations<R: Real>(a: &[R::Scalar], b: &[R::Scalar], out: &mut [R::Scalar]) {
    let (a, b) = (R::load(a), R::load(b));
    let (mut added, mut subtracted, mut multiplied, mut divided) = (a, a, a, a);
    added += b;
    subtracted -= b;
    multiplied *= b;
    divided /= b;
    let mut lanes = [a.lane(0); 32];
    b.store(&mut lanes);
    let loaded = R::load(&lanes);
    let mut replaced = a;
    for i in 0..R::LANES {
        replaced.set_lane(i, b.lane(i));
    }
    let (sin, cos) = a.sin_cos();
    let (octant_sin, octant_cos) = a.sin_cos_octant();
    let (mantissa, exponent) = a.split();
    let results: [R; NAMES.len()] = [
        a + b,
        a - b,
        a * b,
        a / b,
        -a,
        added,
        subtracted,
        multiplied,
        divided,
        truth(a.lt(b)),
        truth(a.le(b)),
        truth(a.gt(b)),
        truth(a.ge(b)),
        truth(a.eq(b)),
        R::select(a.lt(b).or(b.eq(b).not()), a, b),
        a.min(b),
        a.max(b),
        a.abs(),
        a.sqrt(),
        a.copysign(b),
        a.round_even(),
        truth(a.is_finite()),
        a.recip(),
        a.clamp(-b, b),
        a.square(),
        a.pow2(),
        a.round_even().clamp(R::of(-126.0), R::of(127.0)).pow2(),
        mantissa,
        exponent,
        sin,
        cos,
        a.sin(),
        a.cos(),
        octant_sin,
        octant_cos,
        a.ln(),
        a.ln_normal(),
        a.exp(),
        a.atan2(b),
        a.acos(),
        // Expression that a compiler could contract to fused multiply-adds.
        a * b + a * a - b * R::of(0.1),
        loaded,
        replaced,
    ];
    assert_eq!(out.len(), results.len() * R::LANES);
    for (result, out) in results.into_iter().zip(out.chunks_exact_mut(R::LANES)) {
        result.store(out);
    }
}

fn vectorized<R: Real>(a: &[R::Scalar], b: &[R::Scalar], out: &mut [R::Scalar]) {
    R::vectorize(
        #[inline(always)]
        || operations::<R>(a, b, out),
    )
}

fn lanes<R: Real>() -> usize {
    R::LANES
}

/// Checks that every lane at every level has the same bits as a computation with scalars; only the bits of a NaN may differ. `$lanes`
/// returns the number of lanes at a level, or 0 if the level does not have the type.
macro_rules! check {
    ($name:ident, $scalar:ident, $lanes:expr, $run:expr) => {
        fn $name(a: &[$scalar], b: &[$scalar]) {
            for (level, n) in Level::available().iter().map(|&level| (level, $lanes(level))).filter(|found| found.1 > 0) {
                let (mut group_a, mut group_b, mut out) = (vec![0.0; n], vec![0.0; n], vec![0.0; n * NAMES.len()]);
                for (a, b) in a.chunks(n).zip(b.chunks(n)) {
                    group_a[..a.len()].copy_from_slice(a);
                    group_b[..b.len()].copy_from_slice(b);
                    $run(level, &group_a, &group_b, &mut out);
                    for lane in 0..n {
                        let mut expected = [0.0; NAMES.len()];
                        operations::<$scalar>(&group_a[lane..], &group_b[lane..], &mut expected);
                        for (op, name) in NAMES.iter().enumerate() {
                            let (x, y) = (out[op * n + lane], expected[op]);
                            assert!(
                                x.to_bits() == y.to_bits() || (x.is_nan() && y.is_nan()),
                                "{name} of {:e} and {:e}: {x:e} at level {level}, {y:e} alone",
                                group_a[lane],
                                group_b[lane]
                            );
                        }
                    }
                }
            }
        }
    };
}

macro_rules! check_level {
    ($name:ident, $scalar:ident, $lanes:ident) => {
        check!($name, $scalar, |level| at_level!(level, $lanes, lanes()), |level, a: &[_], b: &[_], out: &mut [_]| at_level!(
            level,
            $lanes,
            vectorized(a, b, out)
        ));
    };
}

/// Checks the portable lanes, which no x86-64 level uses. The check runs once instead of at every level.
macro_rules! check_portable {
    ($name:ident, $scalar:ident, $lanes:ident, $n:literal) => {
        check!($name, $scalar, |level| if level == Level::available()[0] { $n } else { 0 }, |_, a: &[_], b: &[_], out: &mut [_]| {
            vectorized::<array::$lanes>(a, b, out)
        });
    };
}

check_level!(check_f64, f64, F64Lanes);
check_level!(check_alone, f64, F64x1);
check_level!(check_f32, f32, F32Lanes);
check_portable!(check_portable, f64, F64x4, 4);
check_portable!(check_portable_f32, f32, F32x8, 8);

/// Numbers near which the sign, the rounding or the case of an algorithm changes, and numbers at the ends of the range.
macro_rules! specials {
    ($name:ident, $scalar:ident) => {
        fn $name() -> Vec<$scalar> {
            use core::$scalar::consts::*;
            let (two, bits) = (2.0 as $scalar, $scalar::MANTISSA_DIGITS as i32);
            let mut all = vec![0.0, $scalar::INFINITY, $scalar::NAN, $scalar::MAX, $scalar::MIN_POSITIVE, $scalar::EPSILON];
            all.extend([$scalar::from_bits(1), $scalar::MIN_POSITIVE / 2.0, $scalar::MAX / 2.0, $scalar::MAX.sqrt()]);
            all.extend([0.1, 0.25, 0.4375, 0.5, 0.6875, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 709.0, 710.0, 745.0, 746.0, 88.0, 89.0, 104.0]);
            all.extend([PI, FRAC_PI_2, FRAC_PI_4, 3.0 * FRAC_PI_4, 2.0 * PI, 100.0 * PI, LN_2, LN_2 / 2.0, 1e4, 1e5, 2e6, 1e9, 1e20, 1e37]);
            all.extend([bits - 2, bits - 1, bits].map(|k| two.powi(k) - 0.5));
            all.extend([bits - 2, bits - 1, bits].map(|k| two.powi(k) + 1.0));
            let beside: Vec<$scalar> = all.iter().flat_map(|x| [x.next_down(), x.next_up()]).collect();
            all.extend(beside);
            let negative: Vec<$scalar> = all.iter().map(|&x| -x).collect();
            all.extend(negative);
            all
        }
    };
}

specials!(specials_f64, f64);
specials!(specials_f32, f32);

/// Random numbers: any bits (NaN, subnormal, huge), ordinary magnitudes, and special values.
macro_rules! inputs {
    ($scalar:ident, $bits:ident, $specials:ident) => {
        prop::collection::vec(
            prop_oneof![
                any::<$bits>().prop_map($scalar::from_bits),
                -1.2..1.2 as $scalar,
                -2e3..2e3 as $scalar,
                prop::sample::select($specials())
            ],
            64,
        )
    };
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn f64_lanes_give_the_bits_of_scalars(a in inputs!(f64, u64, specials_f64), b in inputs!(f64, u64, specials_f64)) {
        check_f64(&a, &b);
        check_portable(&a, &b);
        check_alone(&a, &b);
    }

    #[test]
    fn f32_lanes_give_the_bits_of_scalars(a in inputs!(f32, u32, specials_f32), b in inputs!(f32, u32, specials_f32)) {
        check_f32(&a, &b);
        check_portable_f32(&a, &b);
    }
}

#[test]
fn special_values_pair_by_pair() {
    let specials = specials_f64();
    for &a in &specials {
        check_f64(&vec![a; specials.len()], &specials);
        check_portable(&vec![a; specials.len()], &specials);
        check_alone(&vec![a; specials.len()], &specials);
    }
    let specials = specials_f32();
    for &a in &specials {
        check_f32(&vec![a; specials.len()], &specials);
        check_portable_f32(&vec![a; specials.len()], &specials);
    }
}

#[test]
fn a_lane_does_not_see_its_neighbours() {
    let lane_1 = |level: Level, a: &[f64; 8]| -> Vec<u64> {
        let n = at_level!(level, F64Lanes, lanes());
        let mut out = vec![0.0; n * NAMES.len()];
        at_level!(level, F64Lanes, vectorized(a, &[0.7; 8], &mut out));
        out.chunks_exact(n).map(|x| x[1].to_bits()).collect()
    };
    for &level in Level::available() {
        let mut quiet = [0.3; 8];
        let alone = lane_1(level, &quiet);
        quiet[0] = f64::NAN;
        quiet[2] = 1e300;
        assert_eq!(alone, lane_1(level, &quiet), "level {level}");
    }
}

#[test]
fn min_and_max_take_the_second_operand_when_unordered_or_equal() {
    assert_eq!(Real::min(0.0f64, -0.0).to_bits(), (-0.0f64).to_bits());
    assert_eq!(Real::max(-0.0f64, 0.0).to_bits(), 0.0f64.to_bits());
    assert_eq!(Real::min(f64::NAN, 2.0), 2.0);
    assert!(Real::max(2.0, f64::NAN).is_nan());
}

#[test]
fn max_or_nan_is_nan_if_either_number_is() {
    for (a, b) in [(f64::NAN, 2.0), (2.0, f64::NAN), (f64::NAN, f64::NAN)] {
        assert!(Real::max_or_nan(a, b).is_nan(), "{a} {b}");
    }
    assert_eq!([Real::max_or_nan(1.0, 2.0), Real::max_or_nan(2.0, 1.0)], [2.0; 2]);
}

#[test]
fn round_even_is_the_standard_rounding() {
    for x in specials_f64() {
        assert!(Real::round_even(x).to_bits() == x.round_ties_even().to_bits() || x.is_nan(), "{x:e}");
    }
    for x in specials_f32() {
        assert!(Real::round_even(x).to_bits() == x.round_ties_even().to_bits() || x.is_nan(), "{x:e}");
    }
}

#[test]
fn split_takes_a_number_apart() {
    for x in specials_f64().into_iter().filter(|x| x.is_normal() && *x > 0.0) {
        let (m, e) = Real::split(x);
        assert!((1.0..2.0).contains(&m) && m * (e * 0.5).floor().exp2() * (e - (e * 0.5).floor()).exp2() == x, "{x:e}: {m} 2^{e}");
    }
    for x in specials_f32().into_iter().filter(|x| x.is_normal() && *x > 0.0) {
        let (m, e) = Real::split(x);
        assert!((1.0..2.0).contains(&m) && f64::from(m) * f64::from(e).exp2() == f64::from(x), "{x:e}: {m} 2^{e}");
    }
}

#[test]
fn pow2_is_exact_over_the_normal_range() {
    for k in -1022..=1023 {
        assert_eq!(f64::from(k).pow2(), 2f64.powi(k));
    }
    for k in -126..=127 {
        assert_eq!((k as f32).pow2(), 2f32.powi(k));
    }
}

fn load<R: Real>(s: &[R::Scalar], i: usize) -> R::Scalar {
    R::vectorize(
        #[inline(always)]
        || R::load(s).lane(i),
    )
}

fn store<R: Real>(s: &mut [R::Scalar], i: usize, x: R::Scalar) {
    R::vectorize(
        #[inline(always)]
        || {
            let mut lanes = R::zero();
            lanes.set_lane(i, x);
            lanes.store(s);
        },
    )
}

#[test]
fn short_slices_and_missing_lanes_panic_at_every_level() {
    let panics = |f: &dyn Fn()| std::panic::catch_unwind(std::panic::AssertUnwindSafe(f)).is_err();
    for &level in Level::available() {
        let [n, m] = [at_level!(level, F64Lanes, lanes()), at_level!(level, F32Lanes, lanes())];
        assert_eq!(at_level!(level, F64Lanes, load(&vec![3.0; n + 1], n - 1)), 3.0);
        assert!(panics(&|| _ = at_level!(level, F64Lanes, load(&vec![3.0; n - 1], 0))));
        assert!(panics(&|| _ = at_level!(level, F64Lanes, load(&vec![3.0; n], n))));
        assert!(panics(&|| _ = at_level!(level, F32Lanes, load(&vec![3.0; m - 1], 0))));
        assert!(panics(&|| _ = at_level!(level, F32Lanes, load(&vec![3.0; m], m))));
        assert!(panics(&|| at_level!(level, F64Lanes, store(&mut vec![0.0; n - 1], 0, 1.0))));
        assert!(panics(&|| at_level!(level, F64Lanes, store(&mut vec![0.0; n], n, 1.0))));
        assert!(panics(&|| at_level!(level, F32Lanes, store(&mut vec![0.0; m - 1], 0, 1.0))));
        assert!(panics(&|| at_level!(level, F32Lanes, store(&mut vec![0.0; m], m, 1.0))));
    }
}

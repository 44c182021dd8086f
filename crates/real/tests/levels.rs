//! Tests of `at_level!`, and of its rejection of a level that the machine or the build lacks.

use stepper_real::{Level, Real, at_level};

/// Number that the test function `shift` adds to every entry, as a type parameter in addition to the lane type.
trait Offset {
    const BY: f64;
}
struct Two;
impl Offset for Two {
    const BY: f64 = 2.0;
}

struct Context<'a> {
    gain: &'a [f64],
}

fn shift<R: Real<Scalar = f64>, O: Offset>(context: &Context<'_>, x: &mut [f64]) -> usize {
    R::vectorize(
        #[inline(always)]
        || {
            let mut changed = 0;
            for x in x.chunks_exact_mut(R::LANES) {
                (R::load(x) * R::splat(context.gain[0]) + R::of(O::BY)).store(x);
                changed += R::LANES;
            }
            changed
        },
    )
}

fn longest<'a, R: Real>(a: &'a [R::Scalar], b: &'a [R::Scalar]) -> &'a [R::Scalar] {
    R::vectorize(
        #[inline(always)]
        || if a.len() > b.len() { a } else { b },
    )
}

fn lanes<R: Real>() -> usize {
    R::vectorize(
        #[inline(always)]
        || R::LANES,
    )
}

fn type_name<R: Real>() -> &'static str {
    std::any::type_name::<R>()
}

#[test]
fn arguments_and_results_pass_through() {
    for &level in Level::available() {
        let mut x = [5.0; 24];
        let context = Context { gain: &[10.0] };
        assert_eq!(at_level!(level, F64Lanes, shift::<_, Two>(&context, &mut x)), 24);
        assert_eq!(x, [52.0; 24]);
        assert_eq!(at_level!(level, F64Lanes, longest(&x, &x[..2],)).len(), 24);
        assert_eq!(at_level!(level, F32Lanes, lanes()), if level == Level::Avx512 { 16 } else { 8 });
    }
}

#[test]
fn the_lanes_are_those_of_the_level() {
    for &level in Level::available() {
        let baseline = if cfg!(target_arch = "x86_64") { "sse2" } else { "array" };
        let module = if level == Level::Baseline { baseline.to_owned() } else { level.to_string() };
        for name in [at_level!(level, F64Lanes, type_name()), at_level!(level, F32Lanes, type_name())] {
            assert!(name.contains(&format!("::{module}::")), "{name} at level {level}");
        }
    }
}

#[test]
fn the_level_is_evaluated_once() {
    let mut asked = 0;
    let mut ask = || {
        asked += 1;
        Level::Baseline
    };
    at_level!(ask(), F32Lanes, lanes());
    assert_eq!(asked, 1);
}

#[test]
fn a_missing_level_is_refused() {
    for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
        let ran = std::panic::catch_unwind(|| at_level!(level, F32Lanes, lanes())).is_ok();
        assert_eq!(ran, Level::available().contains(&level), "{level}");
    }
}

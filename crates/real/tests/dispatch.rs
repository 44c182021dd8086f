//! What `dispatch!` accepts, and that it refuses a level that the machine lacks.

use stepper_real::{F64x8, Level, Real};

/// Something the kernel is generic over beside its lanes.
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

#[inline(always)]
fn shift<R: Real<Scalar = f64>, O: Offset>(context: &Context<'_>, x: &mut [R::Stored]) -> usize {
    let mut changed = 0;
    for x in R::view_mut(x) {
        *x = *x * R::splat(context.gain[0]) + R::of(O::BY);
        changed += R::LANES;
    }
    changed
}

#[inline(always)]
fn longest<'a, R: Real>(a: &'a [R::Stored], b: &'a [R::Stored]) -> &'a [R::Stored] {
    if a.len() > b.len() { a } else { b }
}

#[inline(always)]
fn lanes<R: Real>() -> usize {
    R::LANES
}

stepper_real::dispatch! {
    /// A further type argument, a return value, a context with a lifetime.
    fn shift_by_two(context: &Context<'_>, x: &mut [F64x8]) -> usize = shift::<F64x8, Two>;
    fn longest_of<'a>(a: &'a [F64x8], b: &'a [F64x8],) -> &'a [F64x8] = longest::<F64x8>;
    fn lanes_f32() -> usize = lanes::<F32x16>;
}

#[test]
fn arguments_and_results_pass_through() {
    for &level in Level::available() {
        let mut x = [F64x8::of(5.0); 3];
        assert_eq!(shift_by_two(level, &Context { gain: &[10.0] }, &mut x), 24);
        assert_eq!(x[2].to_array(), [52.0; 8]);
        assert_eq!(longest_of(level, &x, &x[..2]).len(), 3);
        assert_eq!(lanes_f32(level), 16);
    }
}

#[test]
fn a_missing_level_is_refused() {
    for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
        let ran = std::panic::catch_unwind(|| lanes_f32(level)).is_ok();
        assert_eq!(ran, Level::available().contains(&level), "{level}");
    }
}

#[test]
fn views_see_the_stored_lanes() {
    let mut stored = [F64x8::zero(); 2];
    stored[1].set_lane(3, 7.0);
    F64x8::view_mut(&mut stored)[0].set_lane(0, 1.5);
    assert_eq!(F64x8::view(&stored)[1].lane(3), 7.0);
    assert_eq!(stored[0].lane(0), 1.5);
    assert_eq!(<f64 as Real>::view(&[1.0, 2.0]), [1.0, 2.0]);
}

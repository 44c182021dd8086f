//! Force and activation of muscles, as in MuJoCo.
//!
//! A muscle of the length l pulls with the force -(a FL(L) FV(V) + FP(L)) F0. Here a is the activation, L the length relative to the
//! optimal length, V the velocity relative to the highest speed of shortening, and F0 the peak force.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{AffineForce, Motion};
use crate::compile::{CompiledMuscle, MuscleCurve, SMALLEST};

/// Value of a function, and its derivative.
#[derive(Clone, Copy)]
struct Slope<R> {
    value: R,
    slope: R,
}

/// Force of a muscle with the input `input`, as the affine function that has the same value and derivatives at `motion`.
#[inline(always)]
pub(crate) fn muscle_force<R: Real>(muscle: &CompiledMuscle<R::Scalar>, input: R, motion: &Motion<R>) -> AffineForce<R> {
    let (mut force, mut slope, mut rate) = (R::zero(), R::zero(), R::zero());
    if let Some(curve) = &muscle.active {
        let (length, velocity) = (active_length(curve, relative_length(curve, motion)), active_velocity(curve, motion.velocity));
        let peak = R::splat(curve.force) * input;
        force -= peak * length.value * velocity.value;
        slope -= peak * length.slope / R::splat(curve.optimum) * velocity.value;
        rate -= peak * length.value * velocity.slope / R::splat(curve.speed);
    }
    if let Some(curve) = &muscle.passive {
        let length = passive_length(curve, relative_length(curve, motion));
        let peak = R::splat(curve.force) * R::splat(curve.passive);
        force -= peak * length.value;
        slope -= peak * length.slope / R::splat(curve.optimum);
    }
    AffineForce { level: force - slope * motion.length - rate * motion.velocity, slope, rate }
}

/// Length relative to the optimal length.
#[inline(always)]
fn relative_length<R: Real>(curve: &MuscleCurve<R::Scalar>, motion: &Motion<R>) -> R {
    R::splat(curve.first) + (motion.length - R::splat(curve.start)) / R::splat(curve.optimum)
}

/// Active force FL at the relative length `x`: a smooth bump of parabolas with its maximum 1 at the optimal length.
#[inline(always)]
fn active_length<R: Real>(curve: &MuscleCurve<R::Scalar>, x: R) -> Slope<R> {
    let (one, half) = (R::one(), R::of(0.5));
    let [low, high] = [R::splat(curve.range[0]), R::splat(curve.range[1])];
    let (rising, falling) = (half * (low + one), half * (one + high));
    let above = choose(x.le(falling), inner_parabola(x, falling - one), outer_parabola(x, high, high - falling, -one));
    let below = choose(x.le(rising), outer_parabola(x, low, rising - low, one), inner_parabola(x, one - rising));
    let inside = low.le(x).and(x.le(high));
    choose(inside, choose(x.le(one), below, above), Slope { value: R::zero(), slope: R::zero() })
}

/// Parabola y^2 / 2 from the end `end` of the range inwards, with y = 1 at the distance `width`. `sign` is 1 at the lower end and -1 at the
/// upper one.
#[inline(always)]
fn outer_parabola<R: Real>(x: R, end: R, width: R, sign: R) -> Slope<R> {
    let width = width.max(R::of(SMALLEST));
    let y = sign * (x - end) / width;
    Slope { value: R::of(0.5) * y * y, slope: sign * y / width }
}

/// Parabola 1 - y^2 / 2 about the optimal length, with y = 1 at the distance `width`.
#[inline(always)]
fn inner_parabola<R: Real>(x: R, width: R) -> Slope<R> {
    let width = width.max(R::of(SMALLEST));
    let y = (x - R::one()) / width;
    Slope { value: R::one() - R::of(0.5) * y * y, slope: -(y / width) }
}

/// First value in the lanes of `first_lanes`, second value in the others.
#[inline(always)]
fn choose<R: Real>(first_lanes: R::Mask, first: Slope<R>, second: Slope<R>) -> Slope<R> {
    Slope { value: R::select(first_lanes, first.value, second.value), slope: R::select(first_lanes, first.slope, second.slope) }
}

/// Active force FV at the velocity `velocity`, m/s: 0 at the highest speed of shortening, 1 at rest.
#[inline(always)]
fn active_velocity<R: Real>(curve: &MuscleCurve<R::Scalar>, velocity: R) -> Slope<R> {
    let (zero, one, two) = (R::zero(), R::one(), R::of(2.0));
    let (x, most) = (velocity / R::splat(curve.speed), R::splat(curve.lengthening));
    let (width, divisor) = (most - one, (most - one).max(R::of(SMALLEST)));
    let shortening = (one + x).max(zero);
    let (lengthening, slope) = (most - (width - x).square() / divisor, two * (width - x) / divisor);
    let (shortens, saturates) = (x.le(zero), x.gt(width));
    Slope {
        value: R::select(shortens, shortening.square(), R::select(saturates, most, lengthening)),
        slope: R::select(shortens, two * shortening, R::select(saturates, zero, slope)),
    }
}

/// Passive force FP at the relative length `x`, relative to that at the highest length: a parabola, then a line.
#[inline(always)]
fn passive_length<R: Real>(curve: &MuscleCurve<R::Scalar>, x: R) -> Slope<R> {
    let (zero, one, half) = (R::zero(), R::one(), R::of(0.5));
    let width = (half * (one + R::splat(curve.range[1])) - one).max(R::of(SMALLEST));
    let end = half * (one + R::splat(curve.range[1]));
    let (y, beyond) = ((x - one) / width, (x - end) / width);
    let (slack, curved) = (x.le(one), x.le(end));
    Slope {
        value: R::select(slack, zero, R::select(curved, half * y * y, half + beyond)),
        slope: R::select(slack, zero, R::select(curved, y, one) / width),
    }
}

/// Time derivative of a muscle's activation `act`, 1/s, with the control `ctrl` and the time constants of activation and deactivation.
///
/// The difference of control and activation selects the time constant, with a smooth switch of the width `smoothing` (MuJoCo's
/// `tausmooth`).
#[inline(always)]
pub(crate) fn activation_rate_of_muscle<R: Real>(ctrl: R, act: R, [rise, fall, smoothing]: [f64; 3]) -> R {
    let (zero, one, smallest) = (R::zero(), R::one(), R::of(SMALLEST));
    let scale = R::of(0.5) + R::of(1.5) * act.max(zero).min(one);
    let (rise, fall) = (R::of(rise) * scale, R::of(fall) / scale);
    let excess = R::select(ctrl.eq(ctrl), ctrl.max(zero).min(one), ctrl) - act;
    let time = if smoothing < SMALLEST {
        R::select(excess.gt(zero), rise, fall)
    } else {
        let x = (excess / R::of(smoothing) + R::of(0.5)).max(zero).min(one);
        fall + (rise - fall) * (x * x * x * (x * (R::of(6.0) * x - R::of(15.0)) + R::of(10.0)))
    };
    excess / time.max(smallest)
}

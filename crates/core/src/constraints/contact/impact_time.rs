//! Impact time of an elastic contact within a flight, and whether the contact bounces. A flight is the whole step, or its part between two
//! impacts.
//!
//! With the midpoint rule, the gap of a contact follows phi(t) = phi + v t + a t^2 / 2. Here v is the velocity before the flight and a the
//! acceleration of the free motion. With the other rules, 2 a replaces a. The gap closes at
//!
//! ```text
//! t* = (-v - s) / a = 2 phi / (s - v),    s = sqrt(v^2 - 2 a phi),    where v(t*) = -s
//! ```
//!
//! There the flight ends, and an impact follows, in which Newton's law of restitution applies.

use stepper_real::{Mask, Real};

use crate::options::StepSettings;
use crate::tuning::END_TOLERANCE;

/// Motion of an elastic contact's gap during a flight: the whole step, or its part between two impacts.
#[derive(Clone, Copy, Debug)]
pub struct Flight<R> {
    /// Gap at the time at which the flight evaluates contacts, m.
    pub gap: R,
    /// Normal velocity before the flight, m/s; negative where the gap closes.
    pub before: R,
    /// Normal velocity after the flight without constraints, m/s.
    pub free: R,
    /// Time from the beginning of the flight to the evaluation of the gap, s.
    pub time_before: R,
    /// Length of the flight, s.
    pub h: R,
    /// Longest length that the flight can have, s.
    pub longest: R,
    /// Whether the integration rule evaluates forces in the middle of the flight. An acceleration a then displaces by a t^2 / 2 in the time
    /// t. With the other rules, which displace with the velocity after the flight, it displaces by a t^2.
    pub in_the_middle: bool,
}

/// Predicted behaviour of an elastic contact in a flight.
#[derive(Clone, Copy, Debug)]
pub struct ImpactPrediction<R: Real> {
    /// Lanes in which the contact collides fast enough to bounce.
    pub collides: R::Mask,
    /// Lanes in which the contact touches and its surfaces separate. The solver includes such a contact, because an impact elsewhere may
    /// close its gap again.
    pub separates: R::Mask,
    /// Lanes in which the contact touches or is about to touch, and does not bounce.
    pub rests: R::Mask,
    /// Time of the bounce after the beginning of the flight, s.
    pub time: R,
}

impl<R: Real> Flight<R> {
    /// Predicts the behaviour of the contact in the lanes `lanes`. `e` is the coefficient of restitution, and `gravity` the magnitude of
    /// gravity, m/s^2.
    ///
    /// A contact that would fly for less than a time step after the bounce counts as resting. This neglects bounces of up to a height of
    /// a h^2 / 8, which is of second order.
    #[inline(always)]
    pub fn predict(&self, options: &StepSettings, gravity: R, e: R, lanes: R::Mask) -> ImpactPrediction<R> {
        let Self { gap, before, free, time_before, h, longest, in_the_middle } = *self;
        let (zero, one, two) = (R::zero(), R::one(), R::of(2.0));
        let (slop, threshold) = (R::of(options.slop), R::of(options.restitution_threshold));
        let change = (free - before) / h;
        let pull = if in_the_middle { change } else { change + change };
        let start = gap - before * time_before;
        let square = before * before - two * pull * start;
        let speed = square.max(zero).sqrt();
        let (falls, sinks) = (before.lt(zero), pull.lt(zero));
        // Of the two formulas for the root, use the one whose denominator is not a difference of similar numbers.
        let late = R::select(falls, two * start / R::select(falls, speed - before, one), (before + speed) / R::select(sinks, -pull, one));
        let overlaps = falls.and(start.le(zero));
        // A collision at the very end of the flight must still be found after rounding, when contacts are evaluated there again.
        let meets = falls.or(sinks).and(square.ge(zero)).and(late.le(longest * R::of(1.0 + END_TOLERANCE))).or(overlaps);
        let time = late.max(zero).min(longest);
        let speed = -(before + change * time);
        let flies = (e * speed).gt((-change).max(zero) * R::of(0.5 * options.timestep));
        let collides = lanes.and(meets).and(speed.gt(threshold)).and(flies);
        let (touches, here) = (gap.le(slop), before + change * time_before);
        let separates = lanes.and(touches).and_not(meets).and(here.gt(threshold));
        // Gaps that a slow contact and gravity can close within the flight. A fast contact with a remaining gap collides later.
        let near = before.abs().le(threshold).and(gap.le(h * (threshold + h * gravity) + slop));
        let lies = touches.and(gap.lt(zero).or(here.abs().le(threshold)));
        let rests = lanes.and(meets.or(lies).or(near)).and_not(collides).and_not(separates);
        ImpactPrediction { collides, separates, rests, time: R::select(collides, time, time_before) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::precision::Precision;
    use crate::options::{ModelScales, Options, StepSettings};

    fn settings(timestep: f64) -> StepSettings {
        let scales = ModelScales { timestep, gravity: 9.81, smallest_gyration_radius: f64::INFINITY, integrator: None };
        Options::default().resolve(&scales, Precision::F64).unwrap()
    }

    fn predict(gap: f64, before: f64, free: f64, e: f64) -> ImpactPrediction<f64> {
        let options = settings(0.01);
        Flight { gap, before, free, time_before: 0.005, h: 0.01, longest: 0.01, in_the_middle: true }.predict(
            &options,
            9.81,
            e,
            <f64 as Real>::Mask::splat(true),
        )
    }

    #[test]
    fn a_fall_collides_when_it_has_come_down() {
        // Falling from the height H with the initial speed v: H - v t - g t^2 / 2 = 0.
        let (v, t) = (1.0, 0.004);
        let height = v * t + 9.81 * t * t / 2.0;
        let found = predict(height - v * 0.005, -v, -v - 9.81 * 0.01, 0.5);
        assert!(found.collides.any() && (found.time - t).abs() < 1e-15);
    }

    #[test]
    fn a_throw_collides_when_it_has_come_back() {
        // Moving upward from the surface with the speed v, the body is back after 2 v / g. The contact at the beginning is no impact.
        let v = 9.81 * 0.008 / 2.0;
        let found = predict(v * 0.005, v, v - 9.81 * 0.01, 1.0);
        assert!(found.rests.any(), "its flight is shorter than a step");
        let found = predict(v * 0.005 + 2e-4, v, v - 9.81 * 0.01, 1.0);
        assert!(found.collides.none() && found.time == 0.005, "it comes down later");
    }

    #[test]
    fn an_overlap_collides_at_once_where_it_closes_and_never_where_it_parts() {
        assert_eq!(predict(-0.02, -1.0, -1.1, 0.5).time, 0.0);
        let parting = predict(-0.02, 1.0, 0.9, 0.5);
        assert!(parting.collides.none() && parting.separates.any());
    }

    #[test]
    fn a_collision_at_the_end_of_a_step_is_placed_there() {
        let options = settings(0.02);
        for gap in [-1e-17, 0.0, 1e-17, 1e-12] {
            let flight = Flight { gap, before: -0.5, free: -0.5, time_before: 0.02, h: 0.02, longest: 0.02, in_the_middle: true };
            let found: ImpactPrediction<f64> = flight.predict(&options, 0.0, 1.0, <f64 as Real>::Mask::splat(true));
            assert!(found.collides.any() && found.time <= 0.02, "{gap}");
        }
    }

    #[test]
    fn what_lies_rests() {
        let found = predict(-1e-6, 0.0, -9.81 * 0.01, 1.0);
        assert!(found.rests.any() && found.collides.none());
    }
}

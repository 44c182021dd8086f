//! The transfer functions at work: one sensor of a group of lanes at a time.

use stepper_real::{Mask, Real, Scalar};

use super::draws::{Keys, Purpose, draw, draw_uniform};
use super::{Errors, Imperfect, Number};
use crate::model::Quantity;
use crate::spatial::*;

/// Room for one sensor's numbers.
#[derive(Clone, Debug, Default)]
pub struct Work<R> {
    pub(super) drawn: Vec<R>,
    pub(super) error: Vec<R>,
    pub(super) sample: Vec<R>,
    pub(super) mixed: Vec<R>,
}

/// What survives a step, lane-interleaved, and what the sensors say.
#[derive(Debug)]
pub struct Slots<'a, S> {
    /// Numbers of the transfer functions.
    pub numbers: &'a mut [S],
    /// Where each delay line was written last.
    pub cursors: &'a mut [u32],
    /// What each sensor clipped and lost, counted.
    pub faults: &'a mut [u32],
    /// Readings.
    pub observation: &'a mut [S],
}

impl<S: Scalar> Errors<S> {
    /// Room for the largest sensor.
    pub fn work<R: Real<Scalar = S>>(&self) -> Work<R> {
        let most = self.sensors.iter().map(|s| s.dim).max().unwrap_or(0);
        let zeros = |n: usize| vec![R::zero(); n];
        Work { drawn: zeros(most * most + 4), error: zeros(most.max(3)), sample: zeros(most), mixed: zeros(most) }
    }

    /// Readings of the lanes `lanes` of a group, from the truth: the first ones of their episodes if `start`, else those of the next step of
    /// length `h`.
    #[expect(clippy::too_many_arguments, reason = "what is read, by whom, and what is remembered")]
    pub fn observe<R: Real<Scalar = S>>(
        &self,
        group: usize,
        truth: &[R],
        keys: &Keys,
        lanes: R::Mask,
        start: bool,
        h: f64,
        work: &mut Work<R>,
        slots: &mut Slots<'_, S>,
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                for (i, &x) in truth.iter().enumerate() {
                    put(slots.observation, i, lanes, x);
                }
            },
        );
        for (k, sensor) in self.sensors.iter().enumerate() {
            let table = &self.table(group)[sensor.table * R::LANES..];
            sensor.observe(table, truth, keys, lanes, start, h, work, slots, k);
        }
    }
}

/// Writes several numbers in some lanes.
fn write<R: Real>(from: &[R], at: usize, lanes: R::Mask, to: &mut [R::Scalar]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (k, &x) in from.iter().enumerate() {
                put(to, at + k, lanes, x);
            }
        },
    )
}

#[inline(always)]
pub(super) fn get<R: Real>(numbers: &[R::Scalar], at: usize) -> R {
    R::load(&numbers[at * R::LANES..])
}

/// Writes in some lanes.
#[inline(always)]
pub(super) fn put<R: Real>(numbers: &mut [R::Scalar], at: usize, lanes: R::Mask, x: R) {
    let old = get::<R>(numbers, at);
    R::select(lanes, x, old).store(&mut numbers[at * R::LANES..]);
}

/// Adds one in some lanes.
fn count<R: Real>(lanes: R::Mask, counts: &mut [u32]) {
    let mut bits = lanes.bits();
    while bits != 0 {
        counts[bits.trailing_zeros() as usize] += 1;
        bits &= bits - 1;
    }
}

impl<S: Scalar> Imperfect<S> {
    #[expect(clippy::too_many_arguments, reason = "what is read, by whom, and what is remembered")]
    fn observe<R: Real<Scalar = S>>(
        &self,
        table: &[S],
        truth: &[R],
        keys: &Keys,
        lanes: R::Mask,
        start: bool,
        h: f64,
        work: &mut Work<R>,
        slots: &mut Slots<'_, S>,
        index: usize,
    ) {
        if start {
            self.begin(table, keys, lanes, work, slots.numbers);
        }
        let mut timing = [R::zero(); 2];
        if self.lossy || self.jittery {
            draw_uniform(keys, Purpose::Timing, self.sensor, &mut timing);
        }
        let [taken, lost] = self.taken(table, timing[0], lanes, start, h, slots.numbers);
        let (clips, losses) = slots.faults[2 * index * R::LANES..][..2 * R::LANES].split_at_mut(R::LANES);
        count::<R>(lost, losses);
        if self.drifts {
            let numbers = if taken.any() { self.noise_at() + self.freedom } else { self.freedom };
            draw(keys, Purpose::Drift, self.sensor, false, &mut work.drawn[..numbers]);
            if !start {
                self.drift(table, lanes, work, slots.numbers);
            }
        }
        if taken.any() {
            let clipped = self.sample(table, truth, keys, work, slots.numbers);
            // The first reading of an episode belongs to no step.
            if !start {
                count::<R>(clipped.and(taken), clips);
            }
            write(&work.sample[..self.dim], self.held_at(), taken, slots.numbers);
        }
        if self.line > 0 {
            self.delay(table, timing[1], lanes, start, slots, index, work);
            write(&work.sample[..self.dim], self.at, lanes, slots.observation);
        } else {
            let held = &slots.numbers[self.held_at() * R::LANES..][..self.dim * R::LANES];
            for (k, held) in held.chunks_exact(R::LANES).enumerate() {
                write(&[R::load(held)], self.at + k, lanes, slots.observation);
            }
        }
    }

    /// Which lanes take a sample now, and which lose the one that is due.
    fn taken<R: Real<Scalar = S>>(&self, table: &[S], chance: R, lanes: R::Mask, start: bool, h: f64, memory: &mut [S]) -> [R::Mask; 2] {
        R::vectorize(
            #[inline(always)]
            || {
                let number = |n: Number| get::<R>(table, n as usize);
                let mut taken = lanes;
                if self.sampled {
                    let (phase, period) = (get::<R>(memory, self.phase_at()) + R::of(h), number(Number::Period));
                    // Times are sums of steps: what is due to rounding is due.
                    let due = phase.ge(period - R::of(1e-6 * h));
                    let rest = R::select(due, (phase - period).min(R::of(h)), phase);
                    put(memory, self.phase_at(), lanes, if start { R::zero() } else { rest });
                    taken = if start { lanes } else { lanes.and(due) };
                }
                let lost = if self.lossy && !start { taken.and(chance.lt(number(Number::Dropout))) } else { R::Mask::splat(false) };
                [taken.and_not(lost), lost]
            },
        )
    }

    /// Draws what stays for an episode.
    fn begin<R: Real<Scalar = S>>(&self, table: &[S], keys: &Keys, lanes: R::Mask, work: &mut Work<R>, memory: &mut [S]) {
        R::vectorize(
            #[inline(always)]
            || {
                let number = |n: Number| get::<R>(table, n as usize);
                if self.mixed {
                    let n = self.dim;
                    draw(keys, Purpose::Mixing, self.sensor, false, &mut work.drawn[..n * n]);
                    for i in 0..n {
                        for j in 0..n {
                            let given = match self.matrix.get(i * n + j) {
                                Some(&x) => R::splat(x),
                                None if i == j => R::one(),
                                None => R::zero(),
                            };
                            let std = number(if i == j { Number::ScaleStd } else { Number::MisalignmentStd });
                            put(memory, self.matrix_at() + i * n + j, lanes, given + std * work.drawn[i * n + j]);
                        }
                    }
                }
                if self.biased {
                    draw(keys, Purpose::Bias, self.sensor, false, &mut work.drawn[..self.freedom]);
                    for k in 0..self.freedom {
                        put(memory, self.bias_at() + k, lanes, number(Number::BiasStd) * work.drawn[k]);
                    }
                }
                if self.drifts {
                    for k in 0..self.freedom {
                        put(memory, self.drift_at() + k, lanes, R::zero());
                    }
                }
            },
        )
    }

    /// A step of the drift by the numbers drawn.
    fn drift<R: Real<Scalar = S>>(&self, table: &[S], lanes: R::Mask, work: &Work<R>, memory: &mut [S]) {
        R::vectorize(
            #[inline(always)]
            || {
                let (decay, kick): (R, R) = (get(table, Number::Decay as usize), get(table, Number::Kick as usize));
                for k in 0..self.freedom {
                    let at = self.drift_at() + k;
                    let next = get::<R>(memory, at) * decay + kick * work.drawn[k];
                    put(memory, at, lanes, next);
                }
            },
        )
    }

    /// Scale and misalignment, bias, drift, noise, quantisation and clip: the sample of now, left in `work.sample`. Returns where it was clipped.
    fn sample<R: Real<Scalar = S>>(&self, table: &[S], truth: &[R], keys: &Keys, work: &mut Work<R>, memory: &[S]) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let number = |n: Number| get::<R>(table, n as usize);
                let (dim, freedom) = (self.dim, self.freedom);
                let truth = &truth[self.at..self.at + dim];
                work.error[..freedom].fill(R::zero());
                if self.noisy {
                    let from = self.noise_at();
                    if from == 0 {
                        draw(keys, Purpose::Noise, self.sensor, self.uniform, &mut work.drawn[..freedom]);
                    }
                    for k in 0..freedom {
                        work.error[k] = number(Number::Noise) * work.drawn[from + k];
                    }
                }
                for k in 0..freedom {
                    let bias = if self.biased { get(memory, self.bias_at() + k) } else { R::zero() };
                    let drift = if self.drifts { get(memory, self.drift_at() + k) } else { R::zero() };
                    work.error[k] = (bias + drift) + work.error[k];
                }
                match self.quantity {
                    Quantity::Real | Quantity::Positive => self.shift(number(Number::Scale), truth, work, memory),
                    Quantity::Axis | Quantity::Quaternion => turn(truth, work),
                }
                let mut clipped = R::Mask::splat(false);
                for k in 0..dim {
                    let mut x = work.sample[k];
                    if self.quantised {
                        let quantum = number(Number::Quantum);
                        let coarse = quantum.gt(R::zero());
                        let grid = (x / R::select(coarse, quantum, R::one())).round_even() * quantum;
                        x = R::select(coarse, grid, x);
                    }
                    if self.clipped {
                        let (low, high) = (number(Number::Low), number(Number::High));
                        clipped = clipped.or(x.lt(low)).or(high.lt(x));
                        x = R::select(x.eq(x), x.clamp(low, high), x);
                    }
                    work.sample[k] = x;
                }
                clipped
            },
        )
    }

    /// scale A x + error
    fn shift<R: Real<Scalar = S>>(&self, factor: R, truth: &[R], work: &mut Work<R>, memory: &[S]) {
        R::vectorize(
            #[inline(always)]
            || {
                let dim = self.dim;
                work.mixed[..dim].copy_from_slice(truth);
                if self.mixed {
                    for i in 0..dim {
                        let mut sum = R::zero();
                        for (j, &x) in truth.iter().enumerate() {
                            sum += get::<R>(memory, self.matrix_at() + i * dim + j) * x;
                        }
                        work.mixed[i] = sum;
                    }
                }
                for k in 0..dim {
                    let scaled = if self.scaled { work.mixed[k] * factor } else { work.mixed[k] };
                    let x = scaled + work.error[k];
                    // A distance that was not found, a place without force: there is nothing to disturb.
                    let silent = truth[k].le(R::zero());
                    work.sample[k] = if self.quantity == Quantity::Positive { R::select(silent, truth[k], x.max(R::zero())) } else { x };
                }
            },
        )
    }
}

/// Turns a unit vector or quaternion by the rotation vector `work.error`; the quaternion in its own frame.
fn turn<R: Real>(truth: &[R], work: &mut Work<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let twist = quat_exp([work.error[0], work.error[1], work.error[2]]);
            if truth.len() == 4 {
                work.sample[..4].copy_from_slice(&quat_mul([truth[0], truth[1], truth[2], truth[3]], twist));
            } else {
                work.sample[..3].copy_from_slice(&rotate(&quat_to_mat(twist), [truth[0], truth[1], truth[2]]));
            }
        },
    )
}

pub(super) fn normalise<R: Real>(x: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            let mut square = R::zero();
            for &x in x.iter() {
                square += x * x;
            }
            let there = square.gt(R::zero());
            let factor = R::one() / R::select(there, square, R::one()).sqrt();
            for x in x {
                *x *= factor;
            }
        },
    )
}

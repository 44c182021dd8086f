//! Application of the transfer functions of all sensors, for a group of lanes.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::math::lanes::{count, get, put};
use crate::math::spatial::*;
use crate::model::Quantity;
use crate::sensing::errors::draws::{Keys, Purpose};
use crate::sensing::errors::{Errors, Imperfect, Number, Numbers};
use crate::sensing::memory::Memory;

/// Workspace of the transfer functions of all sensors.
#[derive(Clone, Debug)]
pub struct Work<R: Real> {
    /// Lanes in which each sensor takes a new sample in this step.
    due: Vec<R::Mask>,
    /// Random numbers of this step, of all sensors.
    drawn: Vec<R>,
}

impl<S: Scalar> Errors<S> {
    /// Creates the workspace in which the transfer functions of all sensors compute readings.
    pub fn work<R: Real<Scalar = S>>(&self) -> Work<R> {
        // Enough for all numbers of a step, and for the scale and misalignment matrix of one sensor.
        let drawn = self.sensors.iter().map(|s| (s.dim * s.dim).max(s.freedom)).fold(self.draws, usize::max);
        Work { due: vec![R::Mask::splat(false); self.sensors.len()], drawn: vec![R::zero(); drawn] }
    }

    /// Computes the readings in the lanes `lanes` of a group from the true readings `truth`.
    ///
    /// If `start` is true, they are the first readings of an episode. Otherwise they are the readings after the next step of `h` seconds.
    #[expect(clippy::too_many_arguments, reason = "what is read, by whom, and what is remembered")]
    pub fn observe<R: Real<Scalar = S>>(
        &self,
        group: usize,
        truth: &[R],
        lanes: R::Mask,
        start: bool,
        h: f64,
        work: &mut Work<R>,
        memory: &mut Memory<S>,
    ) {
        let (table, keys) = (self.table(group), Keys::of(memory));
        if start {
            for (k, sensor) in self.sensors.iter().enumerate() {
                sensor.begin(&table.of(k), &keys, lanes, work, &mut memory.numbers);
            }
        }
        // One kernel computes all sensors, stage by stage, so that the processor overlaps their latencies.
        kernel!(R, || {
            for &i in &self.ideal {
                put(&mut memory.observation, i, lanes, truth[i]);
            }
            for (k, sensor) in self.sensors.iter().enumerate() {
                work.due[k] = sensor.due::<R>(&table.of(k), lanes, start, h, &mut memory.numbers);
                let (normal, count) = sensor.draws_of(work.due[k].any());
                keys.draw(Purpose::Step, sensor.sensor, normal, &mut work.drawn[sensor.draws..sensor.draws + count]);
            }
            for (k, sensor) in self.sensors.iter().enumerate() {
                sensor.observe(&table.of(k), truth, lanes, start, work, memory, k);
            }
        })
    }
}

impl<S: Scalar> Imperfect<S> {
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "what is read, by whom, and what is remembered")]
    fn observe<R: Real<Scalar = S>>(
        &self,
        table: &Numbers<'_, S>,
        truth: &[R],
        lanes: R::Mask,
        start: bool,
        work: &Work<R>,
        memory: &mut Memory<S>,
        index: usize,
    ) {
        let due = work.due[index];
        let sampling = due.any();
        let drawn = &work.drawn[self.draws..];
        let mut lost = R::Mask::splat(false);
        if self.lossy && sampling && !start {
            lost = due.and(drawn[self.timing_at()].le(table.number(Number::Dropout)));
        }
        let taken = due.and_not(lost);
        if self.drifts && !start {
            self.drift(table, lanes, drawn, &mut memory.numbers);
        }
        let (held, kept) = self.advance_delay_line(start, &mut memory.cursors, index);
        let mut clipped = R::Mask::splat(false);
        if taken.any() {
            clipped = self.sample(table, &truth[self.at..], [taken, lanes], drawn, [held, kept], &mut memory.numbers);
        } else {
            for k in 0..self.dim {
                let old: R = get(&memory.numbers, held + k);
                put(&mut memory.numbers, kept + k, lanes, old);
            }
        }
        let faults = &mut memory.faults[2 * index * R::LANES..];
        count(lost.bits(), &mut faults[R::LANES..]);
        // The first reading of an episode belongs to no step, and is not counted.
        if !start {
            count(clipped.and(taken).bits(), faults);
        }
        if self.line > 0 {
            let chance = if self.jittery { drawn[self.timing_at() + 1] } else { R::zero() };
            self.delay(table, chance, lanes, start, memory, index);
        } else {
            for k in 0..self.dim {
                put(&mut memory.observation, self.at + k, lanes, get::<R>(&memory.numbers, kept + k));
            }
        }
    }

    /// Returns the lanes in which the sensor takes a new sample in a step of `h` seconds. The function also updates the time since the last
    /// sample in `memory`, the stored values of the sensors. The sampling period is in `table`.
    ///
    /// If `start` is true, an episode begins, and the sensor takes its first sample in all lanes of the mask `lanes`.
    #[inline(always)]
    fn due<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, lanes: R::Mask, start: bool, h: f64, memory: &mut [S]) -> R::Mask {
        if !self.sampled {
            return lanes;
        }
        let (phase, period) = (get::<R>(memory, self.phase_at()) + R::of(h), table.number::<R>(Number::Period));
        // The phase is a sum of time steps, so that the comparison allows for rounding.
        let due = phase.ge(period - R::of(1e-6 * h));
        let rest = R::select(due, (phase - period).min(R::of(h)), phase);
        put(memory, self.phase_at(), lanes, if start { R::zero() } else { rest });
        if start { lanes } else { lanes.and(due) }
    }

    /// Draws the random values that are constant in an episode, in the lanes `lanes`: scale errors, misalignment and bias. The function
    /// also sets the drift to zero.
    fn begin<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, keys: &Keys, lanes: R::Mask, work: &mut Work<R>, memory: &mut [S]) {
        kernel!(R, || {
            if self.mixed {
                let n = self.dim;
                keys.draw(Purpose::Mixing, self.sensor, n * n, &mut work.drawn[..n * n]);
                for i in 0..n {
                    for j in 0..n {
                        let given = match self.matrix.get(i * n + j) {
                            Some(&x) => R::splat(x),
                            None if i == j => R::one(),
                            None => R::zero(),
                        };
                        let std: R = table.number(if i == j { Number::ScaleStd } else { Number::MisalignmentStd });
                        put(memory, self.matrix_at() + i * n + j, lanes, given + std * work.drawn[i * n + j]);
                    }
                }
            }
            if self.biased {
                keys.draw(Purpose::Bias, self.sensor, self.freedom, &mut work.drawn[..self.freedom]);
                for k in 0..self.freedom {
                    let (mean, std): (R, R) = (table.number(Number::Bias), table.number(Number::BiasStd));
                    put(memory, self.bias_at() + k, lanes, mean + std * work.drawn[k]);
                }
            }
            if self.drifts {
                for k in 0..self.freedom {
                    put(memory, self.drift_at() + k, lanes, R::zero());
                }
            }
        })
    }

    /// Advances the drift of the sensor by one step, with the random numbers `drawn`.
    #[inline(always)]
    fn drift<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, lanes: R::Mask, drawn: &[R], memory: &mut [S]) {
        let (decay, kick): (R, R) = (table.number(Number::Decay), table.number(Number::Kick));
        for k in 0..self.freedom {
            let at = self.drift_at() + k;
            let next = get::<R>(memory, at) * decay + kick * drawn[k];
            put(memory, at, lanes, next);
        }
    }

    /// Takes a sample of the sensor: applies scale, misalignment, bias, drift, noise, quantisation and clip.
    ///
    /// Lanes outside `taken` repeat the previous sample. Returns the lanes with a clipped reading.
    #[inline(always)]
    fn sample<R: Real<Scalar = S>>(
        &self,
        table: &Numbers<'_, S>,
        truth: &[R],
        [taken, lanes]: [R::Mask; 2],
        drawn: &[R],
        [held, kept]: [usize; 2],
        memory: &mut [S],
    ) -> R::Mask {
        let mut clipped = R::Mask::splat(false);
        let error = |k: usize, memory: &[S]| self.error(table, k, drawn, memory);
        let mut turned = [R::zero(); 4];
        let turns = matches!(self.quantity, Quantity::Axis | Quantity::Quaternion);
        if turns {
            turned = turn(&truth[..self.dim], [error(0, memory), error(1, memory), error(2, memory)]);
        }
        for k in 0..self.dim {
            let x = if turns { turned[k] } else { self.shift(table, truth, k, error(k, memory), memory) };
            let (x, beyond) = self.read_off(table, x);
            clipped = clipped.or(beyond);
            put(memory, kept + k, lanes, R::select(taken, x, get(memory, held + k)));
        }
        clipped
    }

    /// Sum of bias, drift and noise of channel `k`.
    #[inline(always)]
    fn error<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, k: usize, drawn: &[R], memory: &[S]) -> R {
        let mut error = R::zero();
        if self.noisy {
            let noise = if self.uniform {
                let u = drawn[self.uniform_at() + k];
                u + u - R::one()
            } else {
                drawn[self.noise_at() + k]
            };
            error = table.number::<R>(Number::Noise) * noise;
        }
        let bias = if self.biased { get(memory, self.bias_at() + k) } else { R::zero() };
        let drift = if self.drifts { get(memory, self.drift_at() + k) } else { R::zero() };
        (bias + drift) + error
    }

    /// Channel `k` of A x + error, where A is the scale and misalignment matrix.
    #[inline(always)]
    fn shift<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, truth: &[R], k: usize, error: R, memory: &[S]) -> R {
        let dim = self.dim;
        let mut x = truth[k];
        if self.mixed {
            x = R::zero();
            for (j, &t) in truth[..dim].iter().enumerate() {
                x += get::<R>(memory, self.matrix_at() + k * dim + j) * t;
            }
        }
        if self.scaled {
            x *= table.number(Number::Scale);
        }
        x += error;
        if self.quantity == Quantity::Positive {
            // A distance of -1 (no hit) and a force of zero have no error.
            x = R::select(truth[k].le(R::zero()), truth[k], x.max(R::zero()));
        }
        x
    }

    /// Reading `x` after quantisation and clipping, and the lanes in which it was clipped.
    #[inline(always)]
    fn read_off<R: Real<Scalar = S>>(&self, table: &Numbers<'_, S>, mut x: R) -> (R, R::Mask) {
        let mut clipped = R::Mask::splat(false);
        if self.quantised {
            let quantum: R = table.number(Number::Quantum);
            let coarse = quantum.gt(R::zero());
            let grid = (x / R::select(coarse, quantum, R::one())).round_even() * quantum;
            x = R::select(coarse, grid, x);
        }
        if self.clipped {
            let (low, high): (R, R) = (table.number(Number::Low), table.number(Number::High));
            clipped = x.lt(low).or(high.lt(x));
            x = R::select(x.eq(x), x.clamp(low, high), x);
        }
        (x, clipped)
    }
}

/// Rotates a unit vector or quaternion by the rotation vector `error`. For a quaternion, the vector is in the rotated frame's axes.
#[inline(always)]
fn turn<R: Real>(truth: &[R], error: V3<R>) -> [R; 4] {
    let twist = quat_exp(error);
    if truth.len() == 4 {
        quat_mul([truth[0], truth[1], truth[2], truth[3]], twist)
    } else {
        let [x, y, z] = rotate(&quat_to_mat(twist), [truth[0], truth[1], truth[2]]);
        [x, y, z, R::zero()]
    }
}

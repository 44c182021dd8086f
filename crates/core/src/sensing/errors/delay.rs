//! Delay of a sensor's readings: samples from an earlier step, or interpolated between two steps.

use stepper_real::{Mask, Real, Scalar};

use crate::math::lanes::{MAX_LANES, get, put, split_delay};
use crate::model::Quantity;
use crate::sensing::errors::{Imperfect, Number, Numbers};
use crate::sensing::memory::Memory;

impl<S: Scalar> Imperfect<S> {
    /// Advances the position of the delay line by one sample, the same in all lanes; at the start of an episode (`start`) it stays. Returns
    /// the addresses of the previous and of the new sample in the sensors' memory. Without a delay line, both are the same address.
    #[inline(always)]
    pub(super) fn advance_delay_line(&self, start: bool, cursors: &mut [u32], index: usize) -> (usize, usize) {
        if self.line == 0 {
            return (self.line_at(), self.line_at());
        }
        let held = self.line_at() + cursors[index] as usize * self.dim;
        if !start {
            let next = cursors[index] + 1;
            cursors[index] = if next as usize == self.line { 0 } else { next };
        }
        (held, self.line_at() + cursors[index] as usize * self.dim)
    }

    /// Writes the delayed reading of the sensor to the observation, in the lanes `lanes`. If `start` is true, it first fills the delay line
    /// with the first sample.
    ///
    /// `chance` is a uniform random number per lane, for the jitter of the delay.
    #[inline(always)]
    pub(super) fn delay<R: Real<Scalar = S>>(
        &self,
        table: &Numbers<'_, S>,
        chance: R,
        lanes: R::Mask,
        start: bool,
        memory: &mut Memory<S>,
        index: usize,
    ) {
        let (dim, line, cursor) = (self.dim, self.line, memory.cursors[index] as usize);
        if start {
            for k in 0..dim * line {
                let first: R = get(&memory.numbers, self.line_at() + cursor * dim + k % dim);
                put(&mut memory.numbers, self.line_at() + k, lanes, first);
            }
        }
        let mut delay: R = table.number(Number::Delay);
        if self.jittery {
            delay += table.number::<R>(Number::Jitter) * (chance + chance - R::one());
        }
        let (whole, part) = split_delay(delay, self.smooth);
        let between = part.gt(R::zero());
        let place = |steps: usize| {
            let steps = steps.min(line - 1);
            self.line_at() + dim * if steps > cursor { cursor + line - steps } else { cursor - steps }
        };
        // Delays differ between lanes by jitter and per-environment parameters. The loop handles one delay at a time, for all lanes that
        // have it.
        let mut asked = [S::default(); MAX_LANES];
        whole.store(&mut asked);
        let mut left = R::Mask::splat(true).bits();
        while left != 0 {
            let steps = asked[left.trailing_zeros() as usize];
            let same = whole.eq(R::splat(steps));
            // A NaN does not equal itself, so that its lane must be removed explicitly.
            left &= (left - 1) & !same.bits();
            let steps = steps.to_f64() as u32 as usize;
            let (new, old) = (place(steps), place(steps + 1));
            for k in 0..dim {
                let mut x: R = get(&memory.numbers, new + k);
                if self.smooth {
                    let before: R = get(&memory.numbers, old + k);
                    x = R::select(between, x + (before - x) * part, x);
                }
                put(&mut memory.observation, self.at + k, lanes.and(same), x);
            }
        }
        if self.smooth && matches!(self.quantity, Quantity::Axis | Quantity::Quaternion) {
            self.normalise::<R>(lanes, &mut memory.observation);
        }
    }

    /// Normalises the reading of the sensor to length 1 in the lanes `lanes`. The reading is a unit vector or a quaternion.
    #[inline(always)]
    fn normalise<R: Real<Scalar = S>>(&self, lanes: R::Mask, observation: &mut [S]) {
        let mut square = R::zero();
        for k in 0..self.dim {
            square += get::<R>(observation, self.at + k).square();
        }
        let there = square.gt(R::zero());
        let factor = R::one() / R::select(there, square, R::one()).sqrt();
        for k in 0..self.dim {
            put(observation, self.at + k, lanes, get::<R>(observation, self.at + k) * factor);
        }
    }
}

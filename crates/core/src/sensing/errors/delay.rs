//! Delay lines: what a sensor sampled some steps ago, or between two of them.

use stepper_real::{Mask, Real, Scalar};

use super::observe::{Slots, Work, get, normalise, put};
use super::{Imperfect, Number};
use crate::contacts::MAX_LANES;
use crate::model::Quantity;

impl<S: Scalar> Imperfect<S> {
    /// Puts the held sample into the delay line and takes out what was there `delay` steps ago, left in `work.sample`.
    #[expect(clippy::too_many_arguments, reason = "what is read, by whom, and what is remembered")]
    pub(super) fn delay<R: Real<Scalar = S>>(
        &self,
        table: &[S],
        chance: R,
        lanes: R::Mask,
        start: bool,
        slots: &mut Slots<'_, S>,
        index: usize,
        work: &mut Work<R>,
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                let (dim, line) = (self.dim, self.line);
                let number = |n: Number| get::<R>(table, n as usize);
                let delay = number(Number::Delay) + number(Number::Jitter) * (chance + chance - R::one());
                // One line for all lanes: its end moves with every step, and a lane that starts fills it with its first sample.
                if !start {
                    slots.cursors[index] = (slots.cursors[index] + 1) % line as u32;
                }
                let cursor = slots.cursors[index] as usize;
                for k in 0..dim {
                    let x: R = get(slots.numbers, self.held_at() + k);
                    for s in if start { 0..line } else { cursor..cursor + 1 } {
                        put(slots.numbers, self.line_at() + s * dim + k, lanes, x);
                    }
                }
                // Staircases and readings that may be absent have no values in between.
                let smooth = !self.sampled && self.quantity != Quantity::Positive;
                // Lane by lane in arrays, without branches, so that the compiler takes all lanes at once.
                let (mut new, mut old, mut parts) = ([0; MAX_LANES], [0; MAX_LANES], [S::default(); MAX_LANES]);
                let mut delays = [S::default(); MAX_LANES];
                delay.store(&mut delays);
                let (here, length) = (cursor as i32, line as i32);
                let back = |steps: i32| {
                    let at = here - steps.min(length - 1);
                    if at < 0 { at + length } else { at }
                };
                for l in 0..R::LANES {
                    let steps = delays[l].to_f64();
                    let steps = if steps > 0.0 { steps } else { 0.0 };
                    // A delay of a whole number of steps, but for rounding, is one.
                    let near = (steps + 0.5).floor();
                    let steps = if (steps - near).abs() < 1e-9 * (1.0 + near) { near } else { steps };
                    let whole = if smooth { steps.floor() } else { steps.ceil() };
                    parts[l] = S::from_f64(steps - whole);
                    (new[l], old[l]) = (back(whole as i32), back(whole as i32 + 1));
                }
                self.recall(&new, slots.numbers, &mut work.sample);
                if smooth {
                    self.recall(&old, slots.numbers, &mut work.mixed);
                    let part = R::load(&parts);
                    let between = part.gt(R::zero());
                    for (x, &old) in work.sample[..dim].iter_mut().zip(&work.mixed) {
                        *x = R::select(between, *x + (old - *x) * part, *x);
                    }
                }
                if smooth && matches!(self.quantity, Quantity::Axis | Quantity::Quaternion) {
                    normalise(&mut work.sample[..dim]);
                }
            },
        )
    }

    /// The samples at the places of the delay line that every lane asks for.
    #[inline(always)]
    fn recall<R: Real<Scalar = S>>(&self, places: &[i32; MAX_LANES], memory: &[S], out: &mut [R]) {
        // Place by place: lanes that differ at all, by jitter or numbers of their own, ask for a few.
        let mut left = (1u32 << R::LANES) - 1;
        while left != 0 {
            let place = places[left.trailing_zeros() as usize];
            let mut bits = 0;
            for (l, &p) in places[..R::LANES].iter().enumerate() {
                bits |= u32::from(p == place) << l;
            }
            left &= !bits;
            let lanes = R::Mask::from_bits(bits);
            for (k, x) in out[..self.dim].iter_mut().enumerate() {
                *x = R::select(lanes, get(memory, self.line_at() + place as usize * self.dim + k), *x);
            }
        }
    }
}

//! Random numbers of the sensor errors: the generator's key and counter identify purpose, environment, episode and step of each draw.

use stepper_real::Real;

use crate::math::lanes::MAX_LANES;
use crate::math::random::{Word, normals, philox4x32_10, uniform};
use crate::sensing::memory::Memory;

/// Purpose of a random number, which is part of the generator's counter.
#[derive(Clone, Copy)]
pub(super) enum Purpose {
    /// Drift, noise, jitter and dropout of one step.
    Step,
    /// Additional bias, drawn at the beginning of an episode.
    Bias,
    /// Scale errors and misalignment, drawn at the beginning of an episode.
    Mixing,
}

/// Seed, environment, episode and step: inputs of the random number generator, for one environment in each lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Keys {
    /// Low and high half of the seed, 32 bits each.
    seed: [Word; 2],
    /// Index of the environment's random stream.
    stream: Word,
    /// Number of earlier episodes of the environment.
    episode: Word,
    /// Step of the episode for which the numbers are drawn: number of steps since the beginning of the episode.
    step: Word,
}

impl Keys {
    /// Inputs of the random number generator for the next step of a group.
    #[inline(always)]
    pub(super) fn of<S>(memory: &Memory<S>) -> Self {
        let lane = |x: &[u32]| {
            let mut word = [0; MAX_LANES];
            word[..x.len()].copy_from_slice(x);
            word
        };
        let mut seed = [[0; MAX_LANES]; 2];
        for (l, &s) in memory.seed.iter().enumerate() {
            (seed[0][l], seed[1][l]) = (s as u32, (s >> 32) as u32);
        }
        Self { seed, stream: lane(&memory.stream), episode: lane(&memory.episode), step: lane(&memory.step) }
    }

    /// Draws random numbers for a purpose and a sensor into `out`: first `normal` standard normal numbers, then uniform ones in (0, 1).
    ///
    /// Normal numbers are made in pairs from pairs of random words.
    #[inline(always)]
    pub(super) fn draw<R: Real>(&self, purpose: Purpose, sensor: usize, normal: usize, out: &mut [R]) {
        for (block, out) in out.chunks_mut(4).enumerate() {
            let words = self.words(purpose, sensor, block, R::LANES);
            for (pair, out) in out.chunks_mut(2).enumerate() {
                let (first, second) = (&words[2 * pair], &words[2 * pair + 1]);
                let two = if 4 * block + 2 * pair < normal { normals(first, second) } else { [uniform(first), uniform(second)] };
                out.copy_from_slice(&two[..out.len()]);
            }
        }
    }

    /// Four random words per lane for one purpose of the sensor with index `sensor`. If four words are not enough, `block` 1, 2, ... gives
    /// further words.
    #[inline(always)]
    fn words(&self, purpose: Purpose, sensor: usize, block: usize, lanes: usize) -> [Word; 4] {
        let label = (purpose as u32) << 29 | (block as u32 & 0x1FFF) << 16 | (sensor as u32 & 0xFFFF);
        // The high bits of the block and of the sensor's index go into the high bits of the episode number. No simulation reaches such an
        // episode number.
        let beyond = ((block >> 13) as u32) << 24 | ((sensor >> 16) as u32) << 16;
        let mut episode = self.episode;
        episode[..lanes].iter_mut().for_each(|e| *e ^= beyond);
        philox4x32_10(&[self.step, self.stream, episode, [label; MAX_LANES]], &self.seed, lanes)
    }
}

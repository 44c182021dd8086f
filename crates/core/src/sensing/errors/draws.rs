//! Who draws random numbers for what.

use stepper_real::Real;

use crate::contacts::MAX_LANES;
use crate::sensing::philox::{Word, normals, philox4x32_10, uniform};

/// What the numbers of a draw are for: part of their counter.
#[derive(Clone, Copy)]
pub(super) enum Purpose {
    Noise,
    Drift,
    Bias,
    Mixing,
    Timing,
}

/// Who draws: part of the counter and the key, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Keys {
    /// Low and high half of the seed.
    pub seed: [Word; 2],
    /// Environment.
    pub stream: Word,
    /// Episodes of the environment before this one.
    pub episode: Word,
    /// Steps since the beginning of the episode.
    pub step: Word,
}

/// The block of random words of a purpose.
#[inline(always)]
fn words(keys: &Keys, purpose: Purpose, sensor: usize, block: usize, lanes: usize) -> [Word; 4] {
    let label = (purpose as u32) << 29 | (block as u32 & 0x1FFF) << 16 | (sensor as u32 & 0xFFFF);
    // The rest of a long label is part of the episode's number, whose upper half is never reached.
    let mut episode = keys.episode;
    let beyond = ((block >> 13) as u32) << 24 | ((sensor >> 16) as u32) << 16;
    episode.iter_mut().for_each(|e| *e ^= beyond);
    philox4x32_10([keys.step, keys.stream, episode, [label; MAX_LANES]], keys.seed, lanes)
}

/// Standard normal numbers, or uniform ones in (-1, 1).
pub(super) fn draw<R: Real>(keys: &Keys, purpose: Purpose, sensor: usize, flat: bool, out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (block, out) in out.chunks_mut(4).enumerate() {
                let w = words(keys, purpose, sensor, block, R::LANES);
                let four = if flat {
                    [0, 1, 2, 3].map(
                        #[inline(always)]
                        |k| {
                            let u: R = uniform(&w[k]);
                            u + u - R::one()
                        },
                    )
                } else if out.len() > 2 {
                    let ([a, b], [c, d]) = (normals(&w[0], &w[1]), normals(&w[2], &w[3]));
                    [a, b, c, d]
                } else {
                    let [a, b] = normals(&w[0], &w[1]);
                    [a, b, a, b]
                };
                out.copy_from_slice(&four[..out.len()]);
            }
        },
    )
}

pub(super) fn draw_uniform<R: Real>(keys: &Keys, purpose: Purpose, sensor: usize, out: &mut [R; 2]) {
    R::vectorize(
        #[inline(always)]
        || {
            let w = words(keys, purpose, sensor, 0, R::LANES);
            *out = [uniform(&w[0]), uniform(&w[1])];
        },
    )
}

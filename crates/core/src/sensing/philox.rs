//! Random numbers without a state: Philox4x32-10 (Salmon, Moraes, Dror and Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3",
//! section 3.3), four 32-bit numbers of a 128-bit counter and a 64-bit key, in which every lane counts for itself.

use stepper_real::{Real, Scalar};

use crate::contacts::MAX_LANES;

const MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
/// The golden ratio and sqrt(3) - 1: the rounds' keys are an arithmetic sequence.
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
const ROUNDS: usize = 10;

/// A 32-bit number in every lane.
pub type Word = [u32; MAX_LANES];

/// Philox4x32-10 of `counter` under `key` in the first `lanes` lanes.
#[inline(always)]
pub fn philox4x32_10(mut counter: [Word; 4], mut key: [Word; 2], lanes: usize) -> [Word; 4] {
    for _ in 0..ROUNDS {
        for l in 0..lanes {
            let [a, b, c, d] = [counter[0][l], counter[1][l], counter[2][l], counter[3][l]];
            let (p, q) = (u64::from(MULTIPLIERS[0]) * u64::from(a), u64::from(MULTIPLIERS[1]) * u64::from(c));
            counter[0][l] = (q >> 32) as u32 ^ b ^ key[0][l];
            counter[1][l] = q as u32;
            counter[2][l] = (p >> 32) as u32 ^ d ^ key[1][l];
            counter[3][l] = p as u32;
            key[0][l] = key[0][l].wrapping_add(WEYL[0]);
            key[1][l] = key[1][l].wrapping_add(WEYL[1]);
        }
    }
    counter
}

/// Uniform numbers in (0, 1), symmetric about 1/2: the middles of 2^32 equal intervals.
#[inline(always)]
pub fn uniform<R: Real>(word: &Word) -> R {
    each(word, unit)
}

/// A number from the word of every lane, computed in f64.
#[inline(always)]
fn each<R: Real>(word: &Word, number: impl Fn(u32) -> f64) -> R {
    // Into an array and from there: lanes set one by one are computed one by one, an array all at once.
    let mut out = [R::Scalar::default(); MAX_LANES];
    for l in 0..R::LANES {
        out[l] = Scalar::from_f64(number(word[l]));
    }
    R::load(&out)
}

#[inline(always)]
fn unit(x: u32) -> f64 {
    (f64::from(x) + 0.5) * (1.0 / 4_294_967_296.0)
}

/// Two independent standard normal numbers of two words (Box and Muller 1958). The largest is 6.7.
#[inline(always)]
pub fn normals<R: Real>(radius: &Word, angle: &Word) -> [R; 2] {
    let square: R = each(
        radius,
        #[inline(always)]
        |x| -2.0 * ln_unit(x),
    );
    let r = square.sqrt();
    let (s, c) = (uniform::<R>(angle) * R::of(std::f64::consts::TAU)).sin_cos();
    [r * c, r * s]
}

/// Coefficients of z^10 to z in artanh(t) / t - 1 at z = t^2.
const ARTANH: [f64; 10] =
    [1.0 / 21.0, 1.0 / 19.0, 1.0 / 17.0, 1.0 / 15.0, 1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0];

/// ln of the middle of interval `x` of (0, 1): the same bits on every machine, within a few ulp.
///
/// u = 2^k m with m in [1/sqrt 2, sqrt 2), ln m = 2 artanh((m - 1) / (m + 1)) by its series, whose first term left out is below 2^-53.
#[inline(always)]
fn ln_unit(x: u32) -> f64 {
    let u = unit(x);
    let bits = u.to_bits();
    // Adding 1/sqrt 2's distance from 1 to the bits carries into the exponent where the fraction is above sqrt 2.
    let shifted = bits + (0x3FF0_0000_0000_0000 - 0x3FE6_A09E_667F_3BCD);
    let k = f64::from((shifted >> 52) as i32) - 1023.0;
    let m = f64::from_bits((shifted & 0x000F_FFFF_FFFF_FFFF) + 0x3FE6_A09E_667F_3BCD);
    let t = (m - 1.0) / (m + 1.0);
    let z = t * t;
    let sum = ARTANH.iter().fold(0.0, |sum, &c| (sum + c) * z);
    k * std::f64::consts::LN_2 + (2.0 * t + 2.0 * t * sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers of the authors' library (Random123, kat_vectors).
    #[test]
    fn known_answers() {
        let all = |x: u32| [x; MAX_LANES];
        let run = |c: [u32; 4], k: [u32; 2]| philox4x32_10(c.map(all), k.map(all), MAX_LANES).map(|w| w[MAX_LANES - 1]);
        assert_eq!(run([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(run([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        let counter = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        assert_eq!(run(counter, [0xa409_3822, 0x299f_31d0]), [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
    }

    #[test]
    fn the_logarithm_is_one() {
        let ends = [0, 1, 2, 1 << 31, (1 << 31) - 1, 3_037_000_499, 3_037_000_500, u32::MAX - 1, u32::MAX];
        for x in ends.into_iter().chain((0..100_000u32).map(|i| i.wrapping_mul(2_654_435_761))) {
            let (found, expected) = (ln_unit(x), unit(x).ln());
            assert!((found - expected).abs() <= 4.0 * f64::EPSILON * expected.abs(), "ln of {x}: {found} for {expected}");
        }
    }
}

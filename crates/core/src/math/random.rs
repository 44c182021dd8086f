//! Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror and Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3", section
//! 3.3).
//!
//! The function maps a 128-bit counter and a 64-bit key to four 32-bit numbers, without a state. Every lane has a separate counter.

use stepper_real::{Real, Scalar};

use crate::math::lanes::MAX_LANES;

const MULTIPLIERS: [u64; 2] = [0xD251_1F53, 0xCD9E_8D57];
/// Increments of the two key words from round to round. As fractions of 2^32 they are (sqrt(5) - 1) / 2, from the golden ratio, and sqrt(3)
/// - 1.
const WEYL: [u64; 2] = [0x9E37_79B9, 0xBB67_AE85];
const ROUNDS: usize = 10;

/// One 32-bit number per lane.
pub type Word = [u32; MAX_LANES];

/// Four random words of Philox4x32-10 for a counter and a key, in the first `lanes` lanes.
#[inline(always)]
pub fn philox4x32_10(counter: &[Word; 4], key: &[Word; 2], lanes: usize) -> [Word; 4] {
    const LOWER: u64 = 0xFFFF_FFFF;
    let mut out = [[0; MAX_LANES]; 4];
    // Lane by lane through all rounds, so that the compiler vectorises over lanes and keeps them in registers. The upper halves are never
    // read.
    for l in 0..lanes {
        let (mut a, mut b) = (u64::from(counter[0][l]), u64::from(counter[1][l]));
        let (mut c, mut d) = (u64::from(counter[2][l]), u64::from(counter[3][l]));
        let (mut k, mut m) = (u64::from(key[0][l]), u64::from(key[1][l]));
        for _ in 0..ROUNDS {
            let (p, q) = (MULTIPLIERS[0] * (a & LOWER), MULTIPLIERS[1] * (c & LOWER));
            (a, b, c, d) = ((q >> 32) ^ b ^ k, q, (p >> 32) ^ d ^ m, p);
            (k, m) = (k + WEYL[0], m + WEYL[1]);
        }
        (out[0][l], out[1][l], out[2][l], out[3][l]) = (a as u32, b as u32, c as u32, d as u32);
    }
    out
}

/// Converts the random words of all lanes to numbers by the function `number`. The numbers go through an array, because the compiler
/// vectorises an array but not lanes that are set one by one.
#[inline(always)]
fn each<R: Real>(word: &Word, number: impl Fn(u32) -> f64) -> R {
    let mut out = [R::Scalar::default(); MAX_LANES];
    for l in 0..R::LANES {
        out[l] = Scalar::from_f64(number(word[l]));
    }
    R::load(&out)
}

/// Uniform random numbers in (0, 1), symmetric about 1/2: the midpoints of 2^32 equal intervals, rounded to the lanes' precision.
#[inline(always)]
pub fn uniform<R: Real>(word: &Word) -> R {
    let x: R = each(word, f64::from);
    x * R::of(1.0 / 4_294_967_296.0) + R::of(0.5 / 4_294_967_296.0)
}

/// Random words shifted to the left by `shift` bits, as signed numbers.
#[inline(always)]
fn signed<R: Real>(word: &Word, shift: u32) -> R {
    each(
        word,
        #[inline(always)]
        |x| f64::from((x << shift) as i32),
    )
}

/// Two independent standard normal numbers from two random words (Box and Muller 1958). Their largest possible absolute value is 6.7.
///
/// Let u be the uniform number from the word `radius`. The two upper bits of the word `angle` give two signs, and the other bits an angle a
/// in (-pi/4, pi/4). The numbers are sqrt(-ln u) (cos a - sin a) and sqrt(-ln u) (cos a + sin a), with these signs. They are the
/// coordinates of the point at the angle pi/4 + a in the first quadrant, mirrored to one of the four quadrants.
#[inline(always)]
pub fn normals<R: Real>(radius: &Word, angle: &Word) -> [R; 2] {
    /// Angle in rad that corresponds to the number 1 in a shifted word: pi/4 divided by 2^31.
    const UNIT: f64 = std::f64::consts::FRAC_PI_4 / 2_147_483_648.0;
    let r = (-uniform::<R>(radius).ln_normal()).sqrt();
    let (a, first, second): (R, R, R) = (signed(angle, 2), signed(angle, 0), signed(angle, 1));
    let (s, c) = (a * R::of(UNIT) + R::of(2.0 * UNIT)).sin_cos_octant();
    [(r * (c - s)).copysign(first), (r * (c + s)).copysign(second)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares random words with the known answers of the authors' library (Random123, kat_vectors).
    #[test]
    fn known_answers() {
        let all = |x: u32| [x; MAX_LANES];
        let run = |c: [u32; 4], k: [u32; 2]| philox4x32_10(&c.map(all), &k.map(all), MAX_LANES).map(|w| w[MAX_LANES - 1]);
        assert_eq!(run([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(run([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        let counter = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        assert_eq!(run(counter, [0xa409_3822, 0x299f_31d0]), [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
    }

    /// Compares the normal numbers of [`normals`] with the Box-Muller formula, computed directly from the two words. In f64 both agree to
    /// rounding.
    ///
    /// In f32 the bound allows five roundings of 6e-8 relative to the radius sqrt(-2 ln u), and one rounding of the uniform number u. A
    /// small radius is about sqrt(2 (1 - u)), so that the rounding of u changes it by 6e-8 divided by the radius.
    #[test]
    fn normals_are_points_in_the_plane() {
        for i in 0..100_000u32 {
            let ends = [0, 1, u32::MAX, u32::MAX - 1, 1 << 31, (1 << 31) - 1, 1 << 30, 3 << 30];
            let [radius, angle] = [i.wrapping_mul(2_654_435_761), i.wrapping_mul(2_246_822_519) ^ 0x55].map(|x| match x % 5 {
                0 => ends[(x / 5 % 8) as usize],
                _ => x,
            });
            let u = (f64::from(radius) + 0.5) / 4_294_967_296.0;
            let theta = (f64::from(angle & 0x3FFF_FFFF) + 0.5) / f64::from(1 << 30) * std::f64::consts::FRAC_PI_2;
            let rho = (-2.0 * u.ln()).sqrt();
            // The upper bit of the quadrant's fraction is inverted, because a is signed.
            let turned = (theta + std::f64::consts::FRAC_PI_4) % std::f64::consts::FRAC_PI_2;
            let sign = |bit: u32| if angle >> bit & 1 == 1 { -1.0 } else { 1.0 };
            let expected = [sign(31) * rho * turned.cos(), sign(30) * rho * turned.sin()];
            let (word, other) = ([radius; MAX_LANES], [angle; MAX_LANES]);
            let (double, single): ([f64; 2], [f32; 2]) = (normals(&word, &other), normals(&word, &other));
            for k in 0..2 {
                assert!((double[k] - expected[k]).abs() < 1e-14, "{radius} {angle}: {} for {}", double[k], expected[k]);
                let bound = 3e-7 * rho + 6e-8 / rho.max(2.4e-4);
                assert!((f64::from(single[k]) - expected[k]).abs() < bound, "{radius} {angle}: {} for {}", single[k], expected[k]);
            }
        }
    }
}

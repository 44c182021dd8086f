//! Tests that masks are sets of lanes at every level: bits outside the lanes are 0, and `and`, `or` and `not` follow the laws of sets.

use stepper_real::{Level, Mask, Real, array, at_level};

/// Number of masks that `algebra` computes, each as the bits of a word.
const WORDS: usize = 14;

#[inline(always)]
fn algebra<R: Real>(x: u32, y: u32) -> [u32; WORDS] {
    let (a, b) = (R::Mask::from_bits(x), R::Mask::from_bits(y));
    // Mask from a comparison. Its representation may differ from that of `from_bits`.
    let compared = R::select(a, R::of(-1.0), R::one()).lt(R::zero());
    [
        a.bits(),
        compared.bits(),
        a.and(b).bits(),
        a.or(b).bits(),
        a.and_not(b).bits(),
        a.not().bits(),
        compared.not().bits(),
        R::Mask::splat(true).bits(),
        R::Mask::splat(false).bits(),
        a.any() as u32,
        a.all() as u32,
        a.none() as u32,
        a.or(a.not()).all() as u32,
        a.and_not(a).none() as u32,
    ]
}

fn vectorized<R: Real>(x: u32, y: u32) -> [u32; WORDS] {
    R::vectorize(
        #[inline(always)]
        || algebra::<R>(x, y),
    )
}

fn expected(lanes: usize, x: u32, y: u32) -> [u32; WORDS] {
    let all = (1u32 << lanes) - 1;
    let (a, b) = (x & all, y & all);
    let flags = [a != 0, a == all, a == 0, true, true].map(u32::from);
    [a, a, a & b, a | b, a & !b, all & !a, all & !a, all, 0, flags[0], flags[1], flags[2], flags[3], flags[4]]
}

fn lanes<R: Real>() -> usize {
    R::LANES
}

#[test]
fn lanes_of_64_bits_exhaustively() {
    for x in 0..16 {
        for y in 0..16 {
            assert_eq!(vectorized::<array::F64x4>(x, y), expected(4, x, y), "{x:#b} {y:#b} in portable lanes");
        }
    }
    for &level in Level::available() {
        let n = at_level!(level, F64Lanes, lanes());
        for x in 0..1 << n {
            for y in 0..1 << n {
                let out = at_level!(level, F64Lanes, vectorized(x, y));
                assert_eq!(out, expected(n, x, y), "{x:#b} {y:#b} at level {level}");
            }
        }
    }
}

#[test]
fn lanes_of_32_bits_with_a_few_partners() {
    for &level in Level::available() {
        let n = at_level!(level, F32Lanes, lanes());
        let all = (1u32 << n) - 1;
        for x in 0..=all {
            for y in [0, all, 0x5555 & all, 0x8001 & all, x.reverse_bits() >> (32 - n), x ^ (0x0ff0 & all)] {
                let out = at_level!(level, F32Lanes, vectorized(x, y));
                assert_eq!(out, expected(n, x, y), "{x:#b} {y:#b} at level {level}");
            }
        }
    }
}

#[test]
fn higher_bits_are_ignored() {
    for &level in Level::available() {
        let [n, m] = [at_level!(level, F64Lanes, lanes()), at_level!(level, F32Lanes, lanes())];
        assert_eq!(at_level!(level, F64Lanes, vectorized(0xffff_ff01, 0xffff_0002)), expected(n, 0x01, 0x02));
        assert_eq!(at_level!(level, F32Lanes, vectorized(0xffff_8001, 0xabcd_0002)), expected(m, 0x8001, 0x0002));
    }
    assert_eq!(algebra::<f64>(0xfffe, 1), expected(1, 0, 1));
    assert_eq!(algebra::<f32>(3, 2), expected(1, 1, 0));
}

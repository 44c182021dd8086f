//! Masks are sets of lanes at every level: nothing outside the lanes, and the laws of sets inside.

use stepper_real::{Level, Mask, Real, array, at_avx512, at_level};

/// Words that `algebra` writes.
const WORDS: usize = 14;

#[inline(always)]
fn algebra<R: Real>(x: u32, y: u32) -> [u32; WORDS] {
    let (a, b) = (R::Mask::from_bits(x), R::Mask::from_bits(y));
    // From a comparison, which need not be represented as from_bits does.
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

#[test]
fn eight_lanes_exhaustively() {
    for x in 0..256 {
        for y in 0..256 {
            assert_eq!(vectorized::<array::F64x8>(x, y), expected(8, x, y), "{x:#b} {y:#b} in portable lanes");
        }
    }
    for &level in Level::available() {
        for x in 0..256 {
            for y in 0..256 {
                let out = at_level!(level, F64x8, vectorized(x, y));
                assert_eq!(out, expected(8, x, y), "{x:#b} {y:#b} at level {level}");
            }
        }
    }
}

#[test]
fn sixteen_lanes_with_a_few_partners() {
    for &level in Level::available() {
        for x in 0..=0xffffu32 {
            for y in [0, 0xffff, 0x5555, 0x8001, x.reverse_bits() >> 16, x ^ 0x0ff0] {
                let out = at_level!(level, F32x16, vectorized(x, y));
                assert_eq!(out, expected(16, x, y), "{x:#b} {y:#b} at level {level}");
                if level == Level::Avx512 {
                    assert_eq!(at_avx512!(F64x16, vectorized(x, y)), out, "{x:#b} {y:#b} in two registers");
                }
            }
        }
    }
}

#[test]
fn higher_bits_are_ignored() {
    for &level in Level::available() {
        assert_eq!(at_level!(level, F64x8, vectorized(0xffff_ff01, 0xffff_0002)), expected(8, 0x01, 0x02));
        assert_eq!(at_level!(level, F32x16, vectorized(0xffff_8001, 0xabcd_0002)), expected(16, 0x8001, 0x0002));
    }
    assert_eq!(algebra::<f64>(0xfffe, 1), expected(1, 0, 1));
    assert_eq!(algebra::<f32>(3, 2), expected(1, 1, 0));
}

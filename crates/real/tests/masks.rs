//! Masks are sets of lanes at every level: nothing outside the lanes, and the laws of sets inside.

use stepper_real::{Level, Mask, Real};

/// Words that `algebra` writes.
const WORDS: usize = 14;

#[inline(always)]
fn algebra<R: Real>(x: u32, y: u32, out: &mut [u32; WORDS]) {
    let (a, b) = (R::Mask::from_bits(x), R::Mask::from_bits(y));
    // From a comparison, which need not be represented as from_bits does.
    let compared = R::select(a, R::of(-1.0), R::one()).lt(R::zero());
    *out = [
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
    ];
}

stepper_real::dispatch! {
    fn algebra_f64(x: u32, y: u32, out: &mut [u32; WORDS]) = algebra::<F64x8>;
    fn algebra_f32(x: u32, y: u32, out: &mut [u32; WORDS]) = algebra::<F32x16>;
}

fn expected(lanes: usize, x: u32, y: u32) -> [u32; WORDS] {
    let all = (1u32 << lanes) - 1;
    let (a, b) = (x & all, y & all);
    let flags = [a != 0, a == all, a == 0, true, true].map(u32::from);
    [a, a, a & b, a | b, a & !b, all & !a, all & !a, all, 0, flags[0], flags[1], flags[2], flags[3], flags[4]]
}

#[test]
fn eight_lanes_exhaustively() {
    for &level in Level::available() {
        for x in 0..256 {
            for y in 0..256 {
                let mut out = [0; WORDS];
                algebra_f64(level, x, y, &mut out);
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
                let mut out = [0; WORDS];
                algebra_f32(level, x, y, &mut out);
                assert_eq!(out, expected(16, x, y), "{x:#b} {y:#b} at level {level}");
            }
        }
    }
}

#[test]
fn higher_bits_are_ignored() {
    for &level in Level::available() {
        let mut out = [0; WORDS];
        algebra_f64(level, 0xffff_ff01, 0xffff_0002, &mut out);
        assert_eq!(out, expected(8, 0x01, 0x02));
        algebra_f32(level, 0xffff_8001, 0xabcd_0002, &mut out);
        assert_eq!(out, expected(16, 0x8001, 0x0002));
    }
    let mut out = [0; WORDS];
    algebra::<f64>(0xfffe, 1, &mut out);
    assert_eq!(out, expected(1, 0, 1));
    algebra::<f32>(3, 2, &mut out);
    assert_eq!(out, expected(1, 1, 0));
}

//! Hashes of results, which must be equal on every CPU and with every compiler.
//!
//! A changed hash is a change of all trajectories. It may be intended (better coefficients), but must be noticed.

use stepper_real::Real;

/// FNV-1a hash of the bits of all results.
struct Hash(u64);

impl Hash {
    fn take(&mut self, bits: u64) {
        for byte in bits.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
}

macro_rules! hash {
    ($scalar:ident) => {{
        let mut hash = Hash(0xcbf2_9ce4_8422_2325);
        for i in -20_000..20_000i32 {
            // Divisions are correctly rounded on every CPU, so that the inputs have the same bits.
            let (x, y) = (i as $scalar / 1024.0, (i % 97) as $scalar / 64.0);
            let (sin, cos) = Real::sin_cos(x * 8.0);
            let results = [sin, cos, Real::exp(x), Real::atan2(x, y), Real::acos(i as $scalar / 20_000.0), Real::round_even(x)];
            for result in results {
                hash.take(result.to_bits().into());
            }
        }
        hash.0
    }};
}

macro_rules! hash_ln {
    ($scalar:ident) => {{
        let mut hash = Hash(0xcbf2_9ce4_8422_2325);
        for i in 1..40_000i32 {
            let (sin, cos) = Real::sin_cos_octant(i as $scalar / 65536.0);
            for result in [sin, cos, Real::ln(i as $scalar / 1024.0), Real::ln(1024.0 / i as $scalar)] {
                hash.take(result.to_bits().into());
            }
        }
        hash.0
    }};
}

#[test]
fn logarithms_have_the_bits_of_the_first_day() {
    assert_eq!((hash_ln!(f64), hash_ln!(f32)), (0x6796fdc6727b13d9, 0xf5afb92f456b3483));
}

#[test]
fn results_have_the_bits_of_the_first_day() {
    assert_eq!((hash!(f64), hash!(f32)), (0x0366_ab7b_c71f_33ea, 0x8482_9753_bbdf_928d));
}

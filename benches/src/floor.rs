//! Floor of a step: the least time of its operations at the measured rates of a core.

use std::hint::black_box;
use std::time::Duration;

use stepper_core::{Level, Precision};
use stepper_real::{Real, at_level};

use crate::clock::thread_time;
use crate::recorder::READINGS;

/// Number of runs of each measurement. The fastest run counts.
const ROUNDS: usize = 15;

/// Measured rates of this core, operations per second. An operation on n SIMD lanes counts as n operations.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// Additions, subtractions and multiplications per second.
    pub sums: f64,
    /// Divisions per second.
    pub divisions: f64,
}

impl Rates {
    /// Measures the rates of this core with the SIMD lanes of a precision and CPU level.
    pub fn measure(precision: Precision, level: Level) -> Self {
        fn both<R: Real>() -> Rates {
            Rates { sums: per_second::<R>(false), divisions: per_second::<R>(true) }
        }
        match precision {
            Precision::F64 => at_level!(level, F64Lanes, both()),
            Precision::F32 => at_level!(level, F32Lanes, both()),
        }
    }

    /// Least time of operations at these rates, us. The argument has the numbers of sums, divisions and other operations.
    pub fn micros(&self, [sums, divisions, others]: [f64; READINGS]) -> f64 {
        // Additions and other operations share the vector pipes. Divisions and square roots have separate pipes.
        1e6 * ((sums + others) / self.sums).max(divisions / self.divisions)
    }
}

/// Measured rate of divisions (if `divide`), or of sums and products, in operations per second.
///
/// The operations form independent chains: enough to hide the latency of an operation, and few enough to stay in registers.
fn per_second<R: Real>(divide: bool) -> f64 {
    const CHAINS: usize = 12;
    const STEPS: usize = 100_000;
    let run = || {
        R::vectorize(
            #[inline(always)]
            || {
                let mut x = [R::one(); CHAINS];
                let (a, b) = (black_box(R::of(0.999)), black_box(R::of(1e-3)));
                for _ in 0..STEPS {
                    for x in &mut x {
                        *x = if divide { *x / a } else { *x * a + b };
                    }
                }
                black_box(x);
            },
        );
    };
    run();
    let fastest = (0..ROUNDS).map(|_| timed(run)).min().expect("there are rounds");
    (STEPS * CHAINS * R::LANES * if divide { 1 } else { 2 }) as f64 / fastest.as_secs_f64()
}

/// Measured rate of copying in main memory, bytes per second.
pub fn copied() -> f64 {
    let (from, mut to) = (vec![1u8; 1 << 28], vec![0u8; 1 << 28]);
    let fastest = (0..ROUNDS).map(|_| timed(|| to.copy_from_slice(black_box(&from)))).min().expect("there are rounds");
    black_box(&to);
    (1u64 << 28) as f64 / fastest.as_secs_f64()
}

fn timed(work: impl FnOnce()) -> Duration {
    let start = thread_time();
    work();
    thread_time() - start
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_and_comparisons_share_pipes_and_divisions_have_their_own() {
        let rates = Rates { sums: 2e6, divisions: 1e6 };
        assert_eq!(rates.micros([4.0, 1.0, 2.0]), 3.0);
        assert_eq!(rates.micros([4.0, 5.0, 2.0]), 5.0);
    }
}

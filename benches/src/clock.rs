//! Processor time of a thread on one core, and medians over runs that take turns.

use std::time::Duration;

/// Benchmark run: a fixed sequence of steps, which can be timed and repeated from the same initial state.
pub trait Run {
    /// Restores the initial state. This is not timed.
    fn rewind(&mut self);
    /// Runs all steps once. This is timed.
    fn run(&mut self);
    /// Number of environment steps in a run.
    fn environment_steps(&self) -> u64;

    /// Processor time of `times` runs, without the restores of the initial state.
    fn time(&mut self, times: u64) -> Duration {
        let mut total = Duration::ZERO;
        for _ in 0..times {
            self.rewind();
            let start = thread_time();
            self.run();
            total += thread_time() - start;
        }
        total
    }
}

/// Median time per environment step of each run, us, over `rounds` repeats. The runs take turns, so that other load of the machine affects
/// all equally.
pub fn medians(runs: &mut [&mut dyn Run], rounds: usize) -> Vec<f64> {
    let mut times = vec![Vec::with_capacity(rounds); runs.len()];
    for run in runs.iter_mut() {
        run.time(1);
    }
    for _ in 0..rounds {
        for (run, times) in runs.iter_mut().zip(&mut times) {
            times.push(1e6 * run.time(1).as_secs_f64() / run.environment_steps() as f64);
        }
    }
    times.into_iter().map(median).collect()
}

/// Median of some values.
fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    0.5 * (x[(x.len() - 1) / 2] + x[x.len() / 2])
}

/// Processor time that the calling thread has used.
#[cfg(target_os = "linux")]
pub fn thread_time() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
}

/// Wall-clock time since the first call. The processor time of a thread is not implemented for this system.
#[cfg(not(target_os = "linux"))]
pub fn thread_time() -> Duration {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed()
}

/// Pins the calling thread to the last core that it may use, and returns the index of the core. New threads of this thread inherit the
/// pinning.
#[cfg(target_os = "linux")]
pub fn pin() -> Option<usize> {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
    let may = sched_getaffinity(None).ok()?;
    let core = (0..CpuSet::MAX_CPU).rev().find(|&c| may.is_set(c))?;
    let mut one = CpuSet::new();
    one.set(core);
    sched_setaffinity(None, &one).ok()?;
    Some(core)
}

/// Does nothing, because pinning is not implemented for this system.
#[cfg(not(target_os = "linux"))]
pub fn pin() -> Option<usize> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Count(u64);

    impl Run for Count {
        fn rewind(&mut self) {}
        fn run(&mut self) {
            self.0 += 1;
        }
        fn environment_steps(&self) -> u64 {
            4
        }
    }

    #[test]
    fn runs_take_turns_and_have_medians() {
        assert_eq!((median(vec![3.0, 1.0, 2.0]), median(vec![4.0, 1.0])), (2.0, 2.5));
        let (mut a, mut b) = (Count(0), Count(0));
        assert_eq!(medians(&mut [&mut a, &mut b], 5).len(), 2);
        assert_eq!((a.0, b.0), (6, 6));
    }
}

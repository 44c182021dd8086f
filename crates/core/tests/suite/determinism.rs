//! Tests that results have the same bits for any batch size, position in the batch, number of threads, lane type and CPU level.

use crate::common::{run, walker};
use stepper_core::{Integrator, Level, Options, Precision, Solver, Stabilization};

/// Number of calls of `step`, with two steps of 4 ms each. Afterwards all robots have fallen, and lie or move on the floor.
const CALLS: usize = 100;

fn settings() -> [Options; 7] {
    let base = Options { timestep: Some(0.004), ..Options::default() };
    [
        base,
        Options { integrator: Some(Integrator::Euler), stabilization: Stabilization::Split, ..base },
        Options { integrator: Some(Integrator::Rk4), ..base },
        Options { integrator: Some(Integrator::Implicit), ..base },
        // The time step is too long for the motion and for the solver in many lanes. `calls_of` therefore reduces the number of calls.
        Options { timestep: Some(0.08), ..base },
        // Most lanes reach this limit on Gauss-Seidel iterations, in different steps.
        Options { iterations: 4, ..base },
        Options { solver: Solver::Newton, ..base },
    ]
}

/// Number of calls of `step` with the given options. Long steps get a fifth of the calls, because each takes as long as five others.
fn calls_of(options: &Options) -> usize {
    if options.timestep == Some(0.08) { CALLS / 5 } else { CALLS }
}

/// Asserts that the environments `envs` have the same bits: `expected` has an entry for every environment, `found` one for each of `envs`.
fn assert_same(expected: &[Vec<u64>], found: &[Vec<u64>], envs: &[usize], what: &str) {
    for (place, &env) in envs.iter().enumerate() {
        let differ = expected[env].iter().zip(&found[place]).position(|(a, b)| a != b);
        assert!(differ.is_none() && expected[env].len() == found[place].len(), "environment {env} differs in number {differ:?}: {what}");
    }
}

#[test]
fn an_environment_alone_in_lanes_and_anywhere_in_a_batch_has_the_same_bits() {
    let model = walker();
    let best = *Level::available().last().unwrap();
    let differs = |options: Options| {
        let calls = calls_of(&options);
        // Each environment alone in a batch: one lane, with the instructions of the best CPU level.
        let alone: Vec<_> = (0..13).map(|env| run(&model, options, &[env], Precision::F64, 1, best, calls).remove(0)).collect();
        let batches: [&[usize]; 4] = [&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], &[12, 3, 3, 0, 7, 9, 1, 5, 2], &[4, 11], &[6]];
        for envs in batches {
            for &level in Level::available() {
                let found = run(&model, options, envs, Precision::F64, 1, level, calls);
                assert_same(&alone, &found, envs, &format!("batch of {}, {level}, {:?}", envs.len(), options.integrator));
            }
        }
        alone.iter().any(|bits| bits.len() != alone[0].len())
    };
    // One thread for each set of options.
    let differ = std::thread::scope(|scope| {
        let threads = settings().map(|options| scope.spawn(move || differs(options)));
        threads.map(|thread| thread.join().unwrap()).contains(&true)
    });
    assert!(differ, "the scene must have environments with different numbers of contacts");
}

#[test]
fn f32_lanes_have_the_same_bits_at_every_level_and_place() {
    let model = walker();
    let options = Options { timestep: Some(0.004), tolerance: Some(1e-4), ..Options::default() };
    let all: Vec<usize> = (0..20).collect();
    let expected = run(&model, options, &all, Precision::F32, 1, Level::Baseline, CALLS);
    for &level in Level::available() {
        let envs = [19, 4, 4, 0, 17];
        assert_same(&expected, &run(&model, options, &envs, Precision::F32, 1, level, CALLS), &envs, &format!("f32, {level}"));
    }
}

#[test]
fn threads_do_not_change_bits() {
    let model = walker();
    let best = *Level::available().last().unwrap();
    let envs: Vec<usize> = (0..50).collect();
    let options = settings()[0];
    let one = run(&model, options, &envs, Precision::F64, 1, best, 40);
    for threads in [2, 3, 7] {
        assert_same(&one, &run(&model, options, &envs, Precision::F64, threads, best, 40), &envs, &format!("{threads} threads"));
    }
}

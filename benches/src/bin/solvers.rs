//! Sweeps, accelerated sweeps and Newton's method on problems of boxes: iterations and milliseconds to the tolerance, as a table.

use stepper_benches::boxes::{FRICTION, Heap, STEP};
use stepper_benches::clock::{pin, thread_time};
use stepper_solve::newton::Newton;
use stepper_solve::{Iterate, Problem, pgs, residual};

/// Residual to be reached, m/s.
const TOLERANCE: f64 = 1e-6;
/// Sweeps at the most.
const SWEEPS: u32 = 20_000;
/// Newton steps at the most.
const STEPS: u32 = 2_000;
/// Repeats; the fastest counts.
const REPEATS: usize = 5;

fn main() {
    pin();
    println!("# Solvers\n");
    println!("Made by `cargo run --release -p stepper-benches --bin solvers > docs/solvers.md`.\n");
    println!(
        "Iterations / ms until the residual is {TOLERANCE:e} m/s, from a cold start: one step of {STEP} s from rest, friction {FRICTION}."
    );
    println!(
        "PGS: sweeps with the exact solution of every contact; PGS+AA: the same with Anderson's acceleration, both at most {SWEEPS}; Newton: the"
    );
    println!(
        "second tier alone, at most {STEPS} steps. An x is a residual that was not brought down. PGS takes the residual after every sweep,"
    );
    println!("the others when little changes.\n");
    println!("| problem | contacts | PGS | PGS+AA | AL-Newton |");
    println!("|---|---|---|---|---|");
    for heap in Heap::all() {
        let cells = [plain, accelerated, newton].map(|method| cell(&heap, method));
        println!("| {} | {} | {} |", heap.name, heap.len(), cells.join(" | "));
    }
}

type Method = fn(&Problem<f64>, &mut Iterate<f64>) -> (f64, f64);

/// "iterations / ms", or the residual where it stopped.
fn cell(heap: &Heap, method: Method) -> String {
    let (problem, cold) = heap.problem();
    let mut best = f64::INFINITY;
    let mut outcome = (0.0, 0.0);
    for repeat in 0..REPEATS {
        let mut iterate = cold.clone();
        let start = thread_time();
        outcome = method(&problem, &mut iterate);
        let time = 1e3 * (thread_time() - start).as_secs_f64();
        best = best.min(time);
        if repeat == 0 && time > 500.0 {
            break;
        }
    }
    let (left, iterations) = outcome;
    if left <= TOLERANCE { format!("{iterations} / {best:.2}") } else { format!("x {left:.0e} / {best:.1}") }
}

/// Sweeps without acceleration: one at a time.
fn plain(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let mut left = f64::INFINITY;
    for sweep in 1..=SWEEPS {
        left = pgs::solve(problem, iterate, pgs::Settings { sweeps: 1, tolerance: TOLERANCE }, true).residual;
        if left <= TOLERANCE {
            return (left, f64::from(sweep));
        }
    }
    (left, f64::from(SWEEPS))
}

fn accelerated(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let outcome = pgs::solve(problem, iterate, pgs::Settings { sweeps: SWEEPS, tolerance: TOLERANCE }, true);
    (outcome.residual, outcome.sweeps)
}

fn newton(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let (mut left, mut taken) = (residual(problem, iterate), 0.0);
    Newton::default().solve(problem, iterate, STEPS, TOLERANCE, true, [&mut left, &mut taken]);
    (left, taken)
}

//! Table of solver iterations and times, ms, on problems of boxes. The solvers are Gauss-Seidel, accelerated Gauss-Seidel, and Newton's
//! method.

use stepper_benches::boxes::{FRICTION, Heap, STEP};
use stepper_benches::clock::{pin, thread_time};
use stepper_benches::report::{cpu, rustc};
use stepper_solve::gauss_seidel::{self, SweepSettings};
use stepper_solve::newton::{Newton, Search};
use stepper_solve::{Iterate, Problem, residual};

/// Residual at which the solver stops, m/s.
const TOLERANCE: f64 = 1e-6;
/// Largest number of iterations of the two Gauss-Seidel solvers.
const SWEEPS: u32 = 20_000;
/// Largest number of steps of Newton's method.
const STEPS: u32 = 2_000;
/// Number of runs of each solver. The fastest run counts.
const REPEATS: usize = 5;

fn main() {
    pin();
    println!("# Solvers\n\n{}\n", setting());
    println!("{}, one core; {}.\n", cpu(), rustc());
    println!("| problem | contacts | PGS | PGS+AA | Newton |");
    println!("|---|---|---|---|---|");
    for heap in Heap::all() {
        let cells = [plain, accelerated, newton].map(|method| cell(&heap, method));
        println!("| {} | {} | {} |", heap.name, heap.len(), cells.join(" | "));
    }
    println!("\n{}", MEANING.trim());
}

/// Text above the table: the problems, the solvers, and their settings.
fn setting() -> String {
    format!(
        "Solvers of the contact problem on heaps of boxes. This command writes the page:

    cargo run --release -p stepper-benches --bin solvers > docs/benchmarks/solvers.md

Each cell shows iterations / ms of processor time until the residual (the natural map of the exact Coulomb problem) is {TOLERANCE:e} m/s, from a cold
start, in one environment in f64: one step of {STEP} s from rest, friction {FRICTION}, six coordinates a box, four contacts where two faces meet. An x
marks a residual that did not reach the tolerance, with its last value in m/s.

* **PGS**: sweeps with the exact solution of every contact, at most {SWEEPS}; the residual is taken after every sweep.
* **PGS+AA**: the same with Anderson's acceleration (1965; Walker and Ni 2011), at most {SWEEPS}. `solver=\"pgs\"` is this.
* **Newton**: proximal Newton steps island by island, at most {STEPS} steps. `solver=\"newton\"` is this
  after two sweeps.",
    )
}

/// Explanation of the results, printed below the table.
const MEANING: &str = "
## What they mean

* Sweeps carry a weight through one contact at a time. Their number grows with the height of a stack and with the ratio of masses that press on
  each other: a top box a hundred times heavier is beyond plain sweeps, a gram under a ton beyond accelerated ones. Anderson's acceleration
  saves a factor of 6 to 90 where plain sweeps converge at all.
* Newton's method needs 5 to 30 steps on every stack and pinch, whatever the masses, and some three to six times as many in a wall, where many
  contacts share the load and which of them slide has to be found. A step factorises a matrix, so it costs as much as three to ten sweeps.
* So neither is enough alone: robots on legs and light contacts converge in a few warm-started sweeps, over eight environments at a time; stacks,
  pinches and mass ratios need Newton's method. `solver=\"auto\"`, the default, sweeps at most 25 times, and sends the environments whose
  residual is then above `tolerance` to Newton's method, one by one. `sim.residual` says what either left.
* In steps of a simulation both begin with the impulses of the step before: these are the costs of a blow, not of rest.
";

type Method = fn(&Problem<f64>, &mut Iterate<f64>) -> (f64, f64);

/// Table cell with the result of a solver on a problem: "iterations / ms", or the residual if the solver did not reach the tolerance.
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

/// Iterates with Gauss-Seidel without acceleration, up to the tolerance. The result is the residual, m/s, and the number of iterations.
fn plain(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let mut left = f64::INFINITY;
    for sweep in 1..=SWEEPS {
        left = gauss_seidel::solve(problem, iterate, SweepSettings { sweeps: 1, tolerance: TOLERANCE }, true).residual;
        if left <= TOLERANCE {
            return (left, f64::from(sweep));
        }
    }
    (left, f64::from(SWEEPS))
}

fn accelerated(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let outcome = gauss_seidel::solve(problem, iterate, SweepSettings { sweeps: SWEEPS, tolerance: TOLERANCE }, true);
    (outcome.residual, outcome.sweeps)
}

fn newton(problem: &Problem<f64>, iterate: &mut Iterate<f64>) -> (f64, f64) {
    let (mut left, mut taken) = (residual(problem, iterate), 0.0);
    let search = Search { steps: STEPS, tolerance: TOLERANCE, least_norm: false };
    Newton::default().solve(problem, iterate, search, true, [&mut left, &mut taken]);
    (left, taken)
}

//! Test that a step allocates no memory.

#[path = "suite/common.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{action, errors, start, trains, walker};
use stepper_core::{ContactLaw, Field, Integrator, Level, Options, Precision, Simulation, Solver, Stabilization, StepInputs};

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// Allocator that calls the system's allocator and counts the allocations of each thread.
struct Counting;

// SAFETY: all calls are forwarded to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing_the_second_time() {
    // Only MuJoCo's contact law has noslip iterations.
    let fields: [(&str, &[f64]); 2] = [("noslip_iterations", &[8.0]), ("noslip_tolerance", &[0.0])];
    let model = walker().replace_all(&fields).unwrap();
    let model = std::sync::Arc::new(model);
    let level = *Level::available().last().unwrap();
    let base = Options { timestep: Some(0.004), ..Options::default() };
    let settings = [
        base,
        Options { integrator: Some(Integrator::Rk4), ..base },
        Options { integrator: Some(Integrator::Implicit), ..base },
        Options { timestep: Some(0.08), ..base },
        Options { integrator: Some(Integrator::Euler), stabilization: Stabilization::Split, ..base },
        Options { solver: Solver::Newton, ..base },
        Options { contact: ContactLaw::Mujoco, ..base },
    ];
    for options in settings {
        for (n, precision) in [(1, Precision::F64), (20, Precision::F64), (20, Precision::F32)] {
            let mut sim = Simulation::at_level(model.clone(), options, Some(n), precision, 1, level);
            sim.set_actuator_models(&trains(&model)).unwrap();
            sim.set_sensor_models(&errors(&model)).unwrap();
            for env in 0..n {
                let (q, v) = start(&model, env);
                sim.set(Field::Qpos, env, &q).unwrap();
                sim.set(Field::Qvel, env, &v).unwrap();
            }
            let qfrc = vec![0.1; n * model.nv()];
            let xfrc = vec![0.1; n * 6 * model.bodies.len()];
            let calls: Vec<Vec<f64>> = (0..12).map(|call| (0..n).flat_map(|env| action(&model, env, call)).collect()).collect();
            let (mut truth, mut seen) = (vec![0.0; n * model.nsensordata()], vec![0.0; n * model.nsensordata()]);
            let mut run = |sim: &mut Simulation| {
                for ctrl in &calls {
                    sim.step(&StepInputs { ctrl, qfrc: &qfrc, xfrc: &xfrc, ..StepInputs::default() }, 3).unwrap();
                    sim.sense(true, &mut truth).unwrap();
                    sim.sense(false, &mut seen).unwrap();
                }
            };
            // The first run creates the worker, and the Newton solver's buffers for the largest problem.
            let begin = sim.save_state();
            run(&mut sim);
            sim.restore_state(&begin).unwrap();
            let before = COUNT.get();
            run(&mut sim);
            assert_eq!(COUNT.get() - before, 0, "{n} environments, {precision:?}, {:?}", options.integrator);
        }
    }
}

#[test]
fn the_count_counts() {
    let before = COUNT.get();
    std::hint::black_box(vec![1u8; 100]);
    assert!(COUNT.get() > before);
}

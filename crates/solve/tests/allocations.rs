//! Test that a solve allocates no memory once its workspace has seen the problem.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use stepper_solve::newton::Newton;
use stepper_solve::{Capacity, Iterate, Problem, Settings, solve};

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// System allocator that counts the allocations of each thread.
struct Counting;

// SAFETY: every call is forwarded to the system allocator.
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

/// Chain of contacts: each has entries at three coordinates and shares one of them with the next contact, so that sweeps alone are slow.
fn chain(contacts: usize) -> (Problem<f64>, Iterate<f64>) {
    let n = 2 * contacts + 1;
    let capacity = Capacity { contacts, columns_per_contact: n, ..Capacity::of_coordinates(n) };
    let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
    iterate.clear();
    for k in 0..contacts {
        let at = 2 * k;
        let columns = [at as u32, at as u32 + 1, at as u32 + 2];
        let y = move |c: usize| [[1.0, 0.3, 0.0], [0.2, 1.0, 0.1], [-0.9, 0.1, 1.0]][c - at];
        problem.push_contact(&columns, y, true, 0.3, [-1.0, 0.4, 0.1 * k as f64]);
        iterate.contacts.extend([0.0; 3]);
    }
    iterate.compute_w(&problem);
    (problem, iterate)
}

#[test]
fn a_solve_allocates_nothing_the_second_time() {
    let settings = Settings::new(1, 50, 1e-10);
    let mut newton = Newton::default();
    let mut all = [chain(30), chain(7), chain(12)];
    for pass in 0..2 {
        for (problem, iterate) in &mut all {
            iterate.contacts.fill(0.0);
            iterate.compute_w(problem);
            let before = COUNT.get();
            let outcome = solve(&*problem, iterate, settings, true, &mut newton);
            assert!(pass == 0 || COUNT.get() == before, "{} allocations", COUNT.get() - before);
            assert!(outcome.newton_steps > 0.0);
        }
    }
}

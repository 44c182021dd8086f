//! `Stepper.memory`: what a batch holds, in bytes.
//!
//! What a thread holds is counted by the allocator while its room is made, so that no sum of sizes can go stale.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::stepper::Stepper;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
}

/// The system's allocator, which counts the bytes that each thread takes less those that it gives back.
struct Counting;

fn count(bytes: isize) {
    HELD.with(|held| held.set(held.get() + bytes));
}

// SAFETY: everything is the system allocator's; counting touches a thread-local number without a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(ptr, layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes that what `make` returns holds on the heap.
fn heap_of<T>(make: impl FnOnce() -> T) -> usize {
    let before = HELD.get();
    let made = make();
    let after = HELD.get();
    drop(made);
    usize::try_from(after - before).unwrap_or(0)
}

impl Stepper {
    /// See `_stepper.pyi`.
    pub(crate) fn memory_report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let n = self.simulation.num_envs();
        let state = self.simulation.bytes();
        let parameters = self.simulation.parameter_bytes();
        let inputs = 8 * (self.simulation.ctrl().len() + self.applied_len(py));
        let thread = heap_of(|| self.simulation.worker());
        let threads = self.simulation.threads();
        let report = PyDict::new(py);
        report.set_item("per_env", (state + parameters + inputs).div_ceil(n))?;
        report.set_item("per_thread", thread)?;
        report.set_item("state", state)?;
        report.set_item("parameters", parameters)?;
        report.set_item("inputs", inputs)?;
        report.set_item("threads", threads)?;
        report.set_item("total", state + parameters + inputs + threads * thread)?;
        Ok(report)
    }
}

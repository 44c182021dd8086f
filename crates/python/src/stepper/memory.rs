//! `Stepper.memory`: memory of a batch, in bytes.
//!
//! The allocator counts the memory of a thread's workspace while the workspace is created, which is more reliable than a sum of sizes.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::stepper::{Reading, Stepper};

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
}

/// Allocator that uses the system allocator and counts the allocated bytes of each thread.
struct Counting;

fn count(bytes: isize) {
    HELD.with(|held| held.set(held.get() + bytes));
}

// SAFETY: all calls go to the system allocator; counting only changes a thread-local number without a destructor.
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

impl Stepper {
    /// Heap memory of the workspace of one worker thread, bytes. It is measured by creating a workspace.
    fn bytes_per_thread(&self) -> usize {
        let before = HELD.get();
        let mut after = before;
        self.simulation.with_worker(|| after = HELD.get());
        usize::try_from(after - before).unwrap_or(0)
    }

    /// Memory of the NumPy arrays of applied inputs, bytes.
    fn applied_bytes(&self, py: Python<'_>) -> usize {
        self.applied.iter().flatten().map(|array| array.bind(py).len() * size_of::<f64>()).sum()
    }
}

#[pymethods]
impl Stepper {
    /// Memory of the stepper in bytes, without NumPy arrays that it has returned.
    ///
    /// Returns:
    ///     Dictionary of bytes, except for "threads". "state": states of all environments. "parameters": parameters of all environments,
    ///     from `randomize` and drives. "inputs": controls, applied forces and mocap poses of all environments. "per_env": these three
    ///     together, divided by the number of environments. "per_thread": workspace of each thread. "threads": number of threads with a
    ///     workspace. "total": "state" + "parameters" + "inputs" + "threads" x "per_thread".
    fn memory<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let simulation = &slf.simulation;
        let (state, parameters) = (simulation.bytes(), simulation.parameter_bytes());
        let inputs = simulation.input_bytes() + slf.applied_bytes(py);
        let (threads, per_thread) = (simulation.threads(), slf.bytes_per_thread());
        let report = [
            ("per_env", (state + parameters + inputs).div_ceil(slf.n())),
            ("per_thread", per_thread),
            ("state", state),
            ("parameters", parameters),
            ("inputs", inputs),
            ("threads", threads),
            ("total", state + parameters + inputs + threads * per_thread),
        ];
        report.into_py_dict(py)
    }
}

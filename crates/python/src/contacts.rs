//! Conversion of contacts to a NumPy structured array.

use numpy::PyArrayDescr;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyByteArray, PyDict, PyTuple};
use stepper_core::Contact;

/// Contact as a row of the structured array of contacts, with the memory layout of its dtype.
#[repr(C)]
#[derive(Clone, Copy)]
struct Row {
    env: i32,
    geom: [i32; 2],
    body: [i32; 2],
    /// Padding that aligns the following numbers.
    unused: i32,
    pos: [f64; 3],
    normal: [f64; 3],
    distance: f64,
    force: [f64; 3],
    torque: [f64; 3],
    frame: [[f64; 3]; 3],
}

/// Names, NumPy types and shapes of the fields of the structured array, as in [`Row`].
const FIELDS: [(&str, &str, &[usize]); 9] = [
    ("env", "i4", &[]),
    ("geom", "i4", &[2]),
    ("body", "i4", &[2]),
    ("pos", "f8", &[3]),
    ("normal", "f8", &[3]),
    ("distance", "f8", &[]),
    ("force", "f8", &[3]),
    ("torque", "f8", &[3]),
    ("frame", "f8", &[3, 3]),
];

fn dtype(py: Python<'_>) -> PyResult<Py<PyArrayDescr>> {
    let fields: Vec<_> =
        FIELDS.iter().map(|(name, kind, shape)| PyTuple::new(py, *shape).map(|s| (*name, *kind, s))).collect::<PyResult<_>>()?;
    let aligned = PyDict::new(py);
    aligned.set_item("align", true)?;
    let made = py.import("numpy")?.getattr("dtype")?.call((fields,), Some(&aligned))?;
    assert_eq!(made.getattr("itemsize")?.extract::<usize>()?, size_of::<Row>(), "NumPy aligns as C does");
    Ok(made.cast_into::<PyArrayDescr>()?.unbind())
}

/// Structured array for `Stepper.contacts`: the contacts `contacts` of each of the environments `envs`, one environment after the other.
pub(crate) fn structured<'py>(py: Python<'py>, envs: &[usize], contacts: &[Vec<Contact>]) -> PyResult<Bound<'py, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
    let dtype = DTYPE.get_or_try_init(py, || dtype(py))?;
    let mut rows = Vec::new();
    for (env, contacts) in envs.iter().zip(contacts) {
        rows.extend(contacts.iter().map(|c| Row {
            env: *env as i32,
            geom: c.geoms.map(|g| g as i32),
            body: c.bodies.map(|b| b as i32),
            unused: 0,
            pos: c.pos,
            normal: c.normal,
            distance: c.distance,
            force: c.force,
            torque: c.torque,
            frame: c.frame(),
        }));
    }
    // SAFETY: rows are plain numbers without a gap between them.
    let bytes = unsafe { std::slice::from_raw_parts(rows.as_ptr().cast::<u8>(), size_of_val(&rows[..])) };
    let numpy = py.import("numpy")?;
    match rows.is_empty() {
        true => numpy.call_method1("empty", (0, dtype)),
        false => numpy.call_method1("frombuffer", (PyByteArray::new(py, bytes), dtype)),
    }
}

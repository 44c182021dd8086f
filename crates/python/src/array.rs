//! NumPy arrays in and out: shapes are checked here, and both are named when they differ.

use std::sync::atomic::{AtomicUsize, Ordering};

use numpy::{
    IntoPyArray, PyArrayDescr, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods, dtype,
    ndarray::ArrayD,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::marker::Ungil;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use stepper_core::Precision;

/// An array of the given shape; float32 in that precision.
pub(crate) fn array<'py>(py: Python<'py>, shape: &[usize], data: Vec<f64>, precision: Precision) -> PyResult<Bound<'py, PyAny>> {
    let shaped = ArrayD::from_shape_vec(shape, data).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(match precision {
        Precision::F64 => shaped.into_pyarray(py).into_any(),
        Precision::F32 => shaped.mapv(|x| x as f32).into_pyarray(py).into_any(),
    })
}

/// "(2, 3)"
pub(crate) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// A C-contiguous float64 array; what is not one already is converted, which copies.
pub(crate) fn readonly<'py>(given: &Bound<'py, PyAny>, name: &str) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    if let Ok(exact) = given.cast::<PyArrayDyn<f64>>()
        && exact.is_c_contiguous()
    {
        return exact.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: {e}")));
    }
    let numpy = given.py().import("numpy")?;
    let converted = numpy.call_method1("ascontiguousarray", (given, "float64"));
    let converted = converted.map_err(|e| PyValueError::new_err(format!("{name} is not an array of numbers: {e}")))?;
    let array = converted.cast_into::<PyArrayDyn<f64>>().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))?;
    array.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))
}

/// Calls that write to arrays of Python's while their threads are detached from the interpreter. Changed and read by attached threads alone.
static WRITING: AtomicUsize = AtomicUsize::new(0);

/// Lets other threads of Python run during `work`, which may write to arrays that they have too.
pub(crate) fn write_detached<T: Ungil>(py: Python<'_>, work: impl FnOnce() -> T + Ungil) -> T {
    WRITING.fetch_add(1, Ordering::Relaxed);
    let done = py.detach(work);
    // Not after a panic: then only what is slower is left.
    WRITING.fetch_sub(1, Ordering::Relaxed);
    done
}

/// What `read` makes of shape and numbers of a C-contiguous float64 array; nothing of anything else, or while some array is written to.
///
/// Without the account that [`PyReadonlyArrayDyn`] keeps of who reads and writes, which costs as much as the rest of a call, and with a dtype
/// compared by its address: NumPy has one of each of its own.
pub(crate) fn with_numbers<T>(given: &Bound<'_, PyAny>, read: impl FnOnce(&[usize], &[f64]) -> T) -> Option<T> {
    static FLOAT64: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
    if WRITING.load(Ordering::Relaxed) > 0 {
        return None;
    }
    let array = given.cast::<PyUntypedArray>().ok()?;
    let float64 = FLOAT64.get_or_init(given.py(), || dtype::<f64>(given.py()).unbind());
    // SAFETY: an array has a dtype, whose address is only compared.
    let found = unsafe { (*array.as_array_ptr()).descr };
    if found.cast() != float64.as_ptr() || !array.is_c_contiguous() {
        return None;
    }
    // SAFETY: its dtype is that of f64, and this type says nothing of its axes.
    let array = unsafe { array.cast_unchecked::<PyArrayDyn<f64>>() };
    // SAFETY: the numbers are looked at here only, while this thread is attached to the interpreter. Nothing in this crate writes to them
    // meanwhile: attached, no other thread can, and detached none does. Of Python's other threads that is what pyo3's safe
    // `PyBuffer::copy_to_slice` relies on as well.
    let numbers = unsafe { array.as_slice() }.ok()?;
    Some(read(array.shape(), numbers))
}

/// Refuses a shape that is none of `allowed`, naming both.
pub(crate) fn check_shape(name: &str, found: &[usize], allowed: &[&[usize]]) -> PyResult<()> {
    if allowed.contains(&found) {
        return Ok(());
    }
    let must: Vec<String> = allowed.iter().map(|s| shape_text(s)).collect();
    Err(PyValueError::new_err(format!("{name} has shape {}, must be {}", shape_text(found), must.join(" or "))))
}

/// A whole number from `least` on, as Python's own or NumPy's integer.
pub(crate) fn whole(given: &Bound<'_, PyAny>, name: &str, least: u64) -> PyResult<u64> {
    let index = given.py().import("operator")?.call_method1("index", (given,));
    let index = index.map_err(|_| PyTypeError::new_err(format!("{name} is {}, must be a whole number", described(given))))?;
    match index.extract::<u64>() {
        Ok(number) if number >= least && usize::try_from(number).is_ok() => Ok(number),
        _ => Err(PyValueError::new_err(format!("{name} is {index}, must be a whole number, {least} or more, in {} bits", usize::BITS))),
    }
}

/// "'five' (str)", for messages about values of the wrong type.
pub(crate) fn described(given: &Bound<'_, PyAny>) -> String {
    let kind = given.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    given.repr().map_or_else(|_| kind.clone(), |text| format!("{text} ({kind})"))
}

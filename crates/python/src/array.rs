//! NumPy arrays in and out: shapes are checked here, and both are named when they differ.

use numpy::npyffi::{NPY_ARRAY_WRITEABLE, PY_ARRAY_API};
use numpy::{
    IntoPyArray, PyArrayDescr, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods, dtype,
    ndarray::ArrayD,
};
use pyo3::exceptions::{PyAttributeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use stepper_core::Precision;
use stepper_core::rollout::Numbers;

use crate::error::ModelError;

/// An array of the given shape; float32 in that precision.
pub(crate) fn array<'py>(py: Python<'py>, shape: &[usize], data: Vec<f64>, precision: Precision) -> PyResult<Bound<'py, PyAny>> {
    let shaped = ArrayD::from_shape_vec(shape, data).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(match precision {
        Precision::F64 => shaped.into_pyarray(py).into_any(),
        Precision::F32 => shaped.mapv(|x| x as f32).into_pyarray(py).into_any(),
    })
}

/// Numbers in one of the two precisions, to become an array.
pub(crate) enum OwnNumbers {
    F64(Vec<f64>),
    F32(Vec<f32>),
}

impl OwnNumbers {
    /// So many zeros.
    pub(crate) fn new(count: usize, precision: Precision) -> Self {
        match precision {
            Precision::F64 => Self::F64(vec![0.0; count]),
            Precision::F32 => Self::F32(vec![0.0; count]),
        }
    }

    /// The numbers, to be written.
    pub(crate) fn numbers(&mut self) -> Numbers<'_> {
        match self {
            Self::F64(x) => Numbers::F64(x),
            Self::F32(x) => Numbers::F32(x),
        }
    }

    /// The array of this shape.
    pub(crate) fn into_array<'py>(self, py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
        fn shaped<T>(shape: &[usize], data: Vec<T>) -> PyResult<ArrayD<T>> {
            ArrayD::from_shape_vec(shape, data).map_err(|e| PyValueError::new_err(e.to_string()))
        }
        Ok(match self {
            Self::F64(x) => shaped(shape, x)?.into_pyarray(py).into_any(),
            Self::F32(x) => shaped(shape, x)?.into_pyarray(py).into_any(),
        })
    }
}

/// Seeds: one for all environments, or one for each of `count`.
pub(crate) fn seeds(given: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<u64>> {
    let numpy = given.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (given,))?;
    if array.getattr("ndim")?.extract::<usize>()? == 0 {
        return Ok(vec![whole(given, "seed", 0)?]);
    }
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    check_shape("seed", &shape, &[&[count], &[]])?;
    if !matches!(kind.as_str(), "i" | "u") {
        return Err(PyTypeError::new_err(format!(
            "seed has type {}, must be of whole numbers, 0 or more, in 64 bits",
            array.getattr("dtype")?
        )));
    }
    if kind == "i"
        && let Some(env) = array.call_method1("tolist", ())?.extract::<Vec<i64>>()?.iter().position(|&seed| seed < 0)
    {
        return Err(PyValueError::new_err(format!("the seed of environment {env} is negative, must be a whole number, 0 or more")));
    }
    let words = numpy.call_method1("ascontiguousarray", (array, "uint64"))?.cast_into::<PyArrayDyn<u64>>()?;
    let words = words.try_readonly().map_err(|e| PyValueError::new_err(format!("seed: {e}")))?;
    words.as_slice().map(<[u64]>::to_vec).map_err(|e| PyValueError::new_err(format!("seed: {e}")))
}

/// A read-only array that an attribute is read as, which names the call that sets `field` to whoever writes to it (`stepper._hints`).
pub(crate) fn read_only<'py>(array: Bound<'py, PyAny>, field: &str) -> PyResult<Bound<'py, PyAny>> {
    static KINDS: PyOnceLock<Py<PyDict>> = PyOnceLock::new();
    read_only_as(array, field, "kind", &KINDS)
}

/// The same of what environments have of their own.
pub(crate) fn read_only_of_environments<'py>(array: Bound<'py, PyAny>, field: &str) -> PyResult<Bound<'py, PyAny>> {
    static KINDS: PyOnceLock<Py<PyDict>> = PyOnceLock::new();
    read_only_as(array, field, "kind_of_environments", &KINDS)
}

fn read_only_as<'py>(array: Bound<'py, PyAny>, field: &str, make: &str, kinds: &PyOnceLock<Py<PyDict>>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let kinds = kinds.get_or_init(py, || PyDict::new(py).unbind()).bind(py);
    let kind = match kinds.get_item(field)? {
        Some(kind) => kind,
        None => {
            let kind = py.import("stepper._hints")?.call_method1(make, (field,))?;
            kinds.set_item(field, &kind)?;
            kind
        }
    };
    let array = array.cast_into::<PyUntypedArray>()?;
    // SAFETY: the array was made here, like the one that it may be a view of, and nobody else has them; the kind is a subclass of ndarray,
    // and without a dtype it keeps its own.
    unsafe {
        let mut part = array.as_array_ptr();
        while !part.is_null() && numpy::npyffi::PyArray_Check(py, part.cast()) != 0 {
            (*part).flags &= !NPY_ARRAY_WRITEABLE;
            part = (*part).base.cast();
        }
        let view = PY_ARRAY_API.PyArray_View(py, array.as_array_ptr(), std::ptr::null_mut(), kind.as_ptr().cast());
        Bound::from_owned_ptr_or_err(py, view)
    }
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

/// What `read` makes of shape and numbers of a C-contiguous float64 array; nothing of anything else.
///
/// Without the account that [`PyReadonlyArrayDyn`] keeps of who reads and writes, which costs as much as the rest of a call, and with a
/// dtype compared by its address: NumPy has one of each of its own.
pub(crate) fn with_numbers<T>(given: &Bound<'_, PyAny>, read: impl FnOnce(&[usize], &[f64]) -> T) -> Option<T> {
    static FLOAT64: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
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
    // meanwhile: it touches arrays of Python's only while attached, and detached it has copies. Of Python's other threads that is what
    // pyo3's safe `PyBuffer::copy_to_slice` relies on as well.
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

/// As [`check_shape`] of an array that was converted from `given`, so that a single number is named as one.
pub(crate) fn check_shape_of(given: &Bound<'_, PyAny>, name: &str, found: &[usize], allowed: &[&[usize]]) -> PyResult<()> {
    if found != [1] || allowed.contains(&found) || given.py().import("numpy")?.call_method1("ndim", (given,))?.extract::<usize>()? > 0 {
        return check_shape(name, found, allowed);
    }
    let must: Vec<String> = allowed.iter().map(|s| shape_text(s)).collect();
    let must = must.join(" or ");
    Err(PyValueError::new_err(format!("{name} is {}, a single number, must be an array of shape {must}", described(given))))
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

/// Assigns an attribute as Python does; where it takes none, the error says which call does (`stepper._hints`).
pub(crate) fn assign_attribute(owner: &Bound<'_, PyAny>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let py = owner.py();
    // SAFETY: three objects that live as long as the call.
    match unsafe { pyo3::ffi::PyObject_GenericSetAttr(owner.as_ptr(), name.as_ptr(), value.as_ptr()) } {
        0 => Ok(()),
        _ => {
            let error = PyErr::fetch(py);
            if error.is_instance_of::<PyAttributeError>(py) { Err(hint(owner, "not_assigned", name)?) } else { Err(error) }
        }
    }
}

/// What to say of an attribute that is not there, or takes no assignment.
pub(crate) fn hint(owner: &Bound<'_, PyAny>, which: &str, name: &Bound<'_, PyAny>) -> PyResult<PyErr> {
    let class = owner.get_type();
    let error = owner.py().import("stepper._hints")?.call_method1(which, (class, name))?;
    Ok(PyErr::from_value(error))
}

/// Error for the name of a field that is none of those `known` to a call and `listed` in its help, with similar names (`stepper._hints`).
pub(crate) fn unknown_field(py: Python<'_>, call: &str, name: &str, known: Vec<&str>, listed: &str) -> PyResult<PyErr> {
    let text: String = py.import("stepper._hints")?.call_method1("unknown_field", (call, name, known, listed))?.extract()?;
    Ok(ModelError::new_err(text))
}

/// "'five' (str)", for messages about values of the wrong type.
pub(crate) fn described(given: &Bound<'_, PyAny>) -> String {
    let kind = given.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    given.repr().map_or_else(|_| kind.clone(), |text| format!("{text} ({kind})"))
}

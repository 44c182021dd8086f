//! Conversion of NumPy arrays, with checks of their shapes.

use numpy::npyffi::NPY_ARRAY_WRITEABLE;
use numpy::{
    Element, IntoPyArray, PyArrayDescr, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods, dtype,
    ndarray::ArrayD,
};
use pyo3::exceptions::{PyAttributeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use stepper_core::Precision;
use stepper_core::rollout::Numbers;

use crate::error::ModelError;

/// New NumPy array with the given shape and numbers. Its dtype is float64 or float32, by `precision`.
pub(crate) fn array<'py>(py: Python<'py>, shape: &[usize], data: Vec<f64>, precision: Precision) -> PyResult<Bound<'py, PyAny>> {
    match precision {
        Precision::F64 => shaped(py, shape, data),
        Precision::F32 => shaped(py, shape, data.into_iter().map(|x| x as f32).collect()),
    }
}

/// New NumPy array with the given numbers.
pub(crate) fn shaped<'py, T: Element>(py: Python<'py>, shape: &[usize], data: Vec<T>) -> PyResult<Bound<'py, PyAny>> {
    let array = ArrayD::from_shape_vec(shape, data).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py).into_any())
}

/// Buffer of f64 or f32 numbers, for a new NumPy array.
pub(crate) enum OwnNumbers {
    F64(Vec<f64>),
    F32(Vec<f32>),
}

impl OwnNumbers {
    /// Buffer of `count` zeros.
    pub(crate) fn new(count: usize, precision: Precision) -> Self {
        match precision {
            Precision::F64 => Self::F64(vec![0.0; count]),
            Precision::F32 => Self::F32(vec![0.0; count]),
        }
    }

    /// Mutable view of the numbers.
    pub(crate) fn numbers(&mut self) -> Numbers<'_> {
        match self {
            Self::F64(x) => Numbers::F64(x),
            Self::F32(x) => Numbers::F32(x),
        }
    }

    /// NumPy array of the given shape with the numbers of this buffer.
    pub(crate) fn into_array<'py>(self, py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
        match self {
            Self::F64(x) => shaped(py, shape, x),
            Self::F32(x) => shaped(py, shape, x),
        }
    }
}

/// Seeds from the argument `seed`: a single integer gives a list of one seed for all environments, and an array (count,) gives a list of
/// `count` seeds.
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
        return Err(PyTypeError::new_err(format!("seed has type {}, must be whole numbers from 0 to 2^64 - 1", array.getattr("dtype")?)));
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

/// Makes the array of a Python attribute read-only, and returns the array.
pub(crate) fn read_only(array: Bound<'_, PyAny>) -> PyResult<Bound<'_, PyAny>> {
    let array = array.cast_into::<PyUntypedArray>()?;
    // SAFETY: this crate has just created the array and its possible base, and no other code has a reference.
    unsafe {
        let mut part = array.as_array_ptr();
        while !part.is_null() && numpy::npyffi::PyArray_Check(array.py(), part.cast()) != 0 {
            (*part).flags &= !NPY_ARRAY_WRITEABLE;
            part = (*part).base.cast();
        }
    }
    Ok(array.into_any())
}

/// Text of a shape, "(2, 3)".
pub(crate) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// C-contiguous float64 array from the argument `name`. Arguments with other types and layouts are converted, which copies.
///
/// # Errors
/// `TypeError` for a masked array, and for entries that are no real numbers (`stepper._arrays`).
pub(crate) fn float64_array<'py>(given: &Bound<'py, PyAny>, name: &str) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    if given.is_exact_instance_of::<PyUntypedArray>()
        && let Ok(exact) = given.cast::<PyArrayDyn<f64>>()
        && exact.is_c_contiguous()
    {
        return exact.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: {e}")));
    }
    let numbers = given.py().import("stepper._arrays")?.call_method1("array_of", (name, given))?;
    let converted = given.py().import("numpy")?.call_method1("ascontiguousarray", (numbers,))?;
    let array = converted.cast_into::<PyArrayDyn<f64>>().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))?;
    array.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))
}

/// Checks that the value of the field `name` in the Python call `call` is no dict.
///
/// # Errors
/// `TypeError` for a dict, with the form in which values are given by the names of elements.
pub(crate) fn no_mapping(call: &str, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    if !value.is_instance_of::<PyDict>() {
        return Ok(());
    }
    Err(PyTypeError::new_err(format!(
        "{call}: {name} is a dict, must be an array; values by name are {{'{name}[element]': value}}, as the first argument"
    )))
}

/// Calls `read` with the shape and the numbers of an argument, and returns its result. If the argument is no C-contiguous float64 array,
/// or of a subclass such as a masked array, the function returns None.
///
/// This function avoids the run-time borrow tracking of [`PyReadonlyArrayDyn`], which takes as long as the rest of a call. It compares
/// dtypes by address, as NumPy has one object for each built-in dtype.
pub(crate) fn with_numbers<T>(given: &Bound<'_, PyAny>, read: impl FnOnce(&[usize], &[f64]) -> T) -> Option<T> {
    static FLOAT64: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
    if !given.is_exact_instance_of::<PyUntypedArray>() {
        return None;
    }
    let array = given.cast::<PyUntypedArray>().ok()?;
    let float64 = FLOAT64.get_or_init(given.py(), || dtype::<f64>(given.py()).unbind());
    // SAFETY: an array has a dtype, whose address is only compared.
    let found = unsafe { (*array.as_array_ptr()).descr };
    if found.cast() != float64.as_ptr() || !array.is_c_contiguous() {
        return None;
    }
    // SAFETY: the dtype of the array is float64, and the type `PyArrayDyn` accepts any number of axes.
    let array = unsafe { array.cast_unchecked::<PyArrayDyn<f64>>() };
    // SAFETY: the slice is used only here, while this thread is attached to the interpreter. This crate does not write to it meanwhile: it
    // accesses arrays of Python only while attached, and uses copies while detached. For other Python threads, pyo3's safe
    // `PyBuffer::copy_to_slice` makes the same assumption.
    let numbers = unsafe { array.as_slice() }.ok()?;
    Some(read(array.shape(), numbers))
}

/// Checks that the shape `found` of the argument `name` is one of `allowed`. The message of the error contains the found and the allowed
/// shapes.
pub(crate) fn check_shape(name: &str, found: &[usize], allowed: &[&[usize]]) -> PyResult<()> {
    if allowed.contains(&found) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name} has shape {}, must be {}", shape_text(found), any_of(allowed))))
}

/// Text of the allowed shapes, such as "(4, 3) or (3,)".
fn any_of(allowed: &[&[usize]]) -> String {
    allowed.iter().map(|shape| shape_text(shape)).collect::<Vec<_>>().join(" or ")
}

/// Whether the argument `given` is a single number instead of an array. `found` is the shape after its conversion to an array: (1,) for
/// single numbers.
pub(crate) fn is_single_number(given: &Bound<'_, PyAny>, found: &[usize]) -> PyResult<bool> {
    Ok(found == [1] && given.py().import("numpy")?.call_method1("ndim", (given,))?.extract::<usize>()? == 0)
}

/// Checks that the shape `found` of an argument is one of `allowed`, like [`check_shape`]. For an argument that is a single number, the
/// error contains the number.
pub(crate) fn check_shape_of(given: &Bound<'_, PyAny>, name: &str, found: &[usize], allowed: &[&[usize]]) -> PyResult<()> {
    if allowed.contains(&found) || !is_single_number(given, found)? {
        return check_shape(name, found, allowed);
    }
    let must = any_of(allowed);
    Err(PyValueError::new_err(format!("{name} is {}, a single number, must be an array of shape {must}", described(given))))
}

/// Value of the integer argument `name`, a Python or NumPy integer. A value below `least` is an error.
pub(crate) fn whole(given: &Bound<'_, PyAny>, name: &str, least: u64) -> PyResult<u64> {
    let index = given.py().import("operator")?.call_method1("index", (given,));
    let index = index.map_err(|_| PyTypeError::new_err(format!("{name} is {}, must be a whole number", described(given))))?;
    match index.extract::<u64>() {
        Ok(number) if number >= least && usize::try_from(number).is_ok() => Ok(number),
        _ => Err(PyValueError::new_err(format!(
            "{name} is {index}, must be a whole number of at least {least}, and fit into {} bits",
            usize::BITS
        ))),
    }
}

/// Assigns an attribute of the Python object `owner`. If the attribute is read-only, the error names the call that sets it
/// (`stepper._hints`).
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

/// Exception for an attribute `name` of the Python object `owner` that does not exist or is read-only. The function of `stepper._hints`
/// with the name `which` writes its message.
pub(crate) fn hint(owner: &Bound<'_, PyAny>, which: &str, name: &Bound<'_, PyAny>) -> PyResult<PyErr> {
    let class = owner.get_type();
    let error = owner.py().import("stepper._hints")?.call_method1(which, (class, name))?;
    Ok(PyErr::from_value(error))
}

/// `ModelError` of the Python call `call` for an unknown field `name`. The message has a hint, such as similar names among `known`, or
/// otherwise `listed`: the command or page that lists the fields.
pub(crate) fn unknown_field(py: Python<'_>, call: &str, name: &str, known: Vec<&str>, listed: &str) -> PyResult<PyErr> {
    let text: String = py.import("stepper._hints")?.call_method1("unknown_field", (call, name, known, listed))?.extract()?;
    Ok(ModelError::new_err(text))
}

/// Text of a Python object with its type, such as "'five' (str)", for messages about arguments with a wrong type.
pub(crate) fn described(given: &Bound<'_, PyAny>) -> String {
    let kind = given.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    given.repr().map_or_else(|_| kind.clone(), |text| format!("{text} ({kind})"))
}

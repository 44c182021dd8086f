//! Conversion of contacts to a NumPy structured array.

use numpy::PyArrayDescr;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};
use stepper_core::Contact;

use crate::array::shaped;

/// Function that appends the numbers of a field of a contact in an environment to a list.
type Read = fn(usize, &Contact, &mut Vec<f64>);

/// Names, NumPy types, shapes and values of the fields of the structured array.
const FIELDS: [(&str, &str, &[usize], Read); 9] = [
    ("env", "i4", &[], |env, _, out| out.push(env as f64)),
    ("geom", "i4", &[2], |_, contact, out| out.extend(contact.geoms.map(|geom| geom as f64))),
    ("body", "i4", &[2], |_, contact, out| out.extend(contact.bodies.map(|body| body as f64))),
    ("pos", "f8", &[3], |_, contact, out| out.extend(contact.pos)),
    ("normal", "f8", &[3], |_, contact, out| out.extend(contact.normal)),
    ("distance", "f8", &[], |_, contact, out| out.push(contact.distance)),
    ("force", "f8", &[3], |_, contact, out| out.extend(contact.force)),
    ("torque", "f8", &[3], |_, contact, out| out.extend(contact.torque)),
    ("frame", "f8", &[3, 3], |_, contact, out| out.extend(contact.frame().as_flattened())),
];

fn dtype(py: Python<'_>) -> PyResult<Py<PyArrayDescr>> {
    let fields: Vec<_> =
        FIELDS.iter().map(|(name, kind, shape, _)| PyTuple::new(py, *shape).map(|s| (*name, *kind, s))).collect::<PyResult<_>>()?;
    let aligned = PyDict::new(py);
    aligned.set_item("align", true)?;
    let made = py.import("numpy")?.getattr("dtype")?.call((fields,), Some(&aligned))?;
    Ok(made.cast_into::<PyArrayDescr>()?.unbind())
}

/// Structured array for `Stepper.contacts`: the contacts `contacts` of each of the environments `envs`, one environment after the other.
pub(crate) fn structured<'py>(py: Python<'py>, envs: &[usize], contacts: &[Vec<Contact>]) -> PyResult<Bound<'py, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
    let dtype = DTYPE.get_or_try_init(py, || dtype(py))?;
    let count = contacts.iter().map(Vec::len).sum::<usize>();
    let array = py.import("numpy")?.call_method1("zeros", (count, dtype))?;
    for (name, _, shape, read) in FIELDS {
        let mut numbers = Vec::new();
        for (&env, contacts) in envs.iter().zip(contacts) {
            contacts.iter().for_each(|contact| read(env, contact, &mut numbers));
        }
        array.set_item(name, shaped(py, &[&[count], shape].concat(), numbers)?)?;
    }
    Ok(array)
}

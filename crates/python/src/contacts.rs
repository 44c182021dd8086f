//! Contacts as a structured array.

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use stepper_core::Model;
use stepper_core::state::StoredContact;

/// The array that `Stepper.contacts` returns.
pub(crate) fn structured<'py>(py: Python<'py>, model: &Model, contacts: &[([usize; 2], StoredContact)]) -> PyResult<Bound<'py, PyAny>> {
    let numpy = py.import("numpy")?;
    let fields: [(&str, &str, Vec<usize>); 8] = [
        ("geom", "i4", vec![2]),
        ("body", "i4", vec![2]),
        ("pos", "f8", vec![3]),
        ("normal", "f8", vec![3]),
        ("distance", "f8", vec![]),
        ("force", "f8", vec![3]),
        ("torque", "f8", vec![3]),
        ("frame", "f8", vec![3, 3]),
    ];
    let dtype: Vec<_> =
        fields.iter().map(|(name, kind, shape)| PyTuple::new(py, shape).map(|s| (*name, *kind, s))).collect::<PyResult<_>>()?;
    let out = numpy.call_method1("zeros", (contacts.len(), dtype))?;
    if contacts.is_empty() {
        return Ok(out);
    }
    let column = |f: &dyn Fn(usize) -> Vec<f64>| (0..contacts.len()).map(f).collect::<Vec<_>>();
    let bodies = |k: usize| contacts[k].0.iter().map(|&g| model.geoms[g].body as f64).collect();
    out.set_item("geom", column(&|k| contacts[k].0.iter().map(|&g| g as f64).collect()))?;
    out.set_item("body", column(&bodies))?;
    out.set_item("pos", column(&|k| contacts[k].1.pos.to_vec()))?;
    out.set_item("normal", column(&|k| contacts[k].1.normal.to_vec()))?;
    out.set_item("distance", contacts.iter().map(|c| c.1.distance).collect::<Vec<_>>())?;
    out.set_item("force", column(&|k| contacts[k].1.impulse.to_vec()))?;
    out.set_item("torque", column(&|k| contacts[k].1.torque.to_vec()))?;
    out.set_item(
        "frame",
        contacts.iter().map(|c| stepper_core::contacts::frame(c.1.normal).map(|r| r.to_vec()).to_vec()).collect::<Vec<_>>(),
    )?;
    Ok(out)
}

//! `stepper.Model`.

use std::path::PathBuf;

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::{PyAttributeError, PyIndexError, PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use stepper_core::Precision;
use stepper_core::model::{Keyframe, Model as Core, Sensor};

use crate::array::{array, readonly, shape_text};
use crate::stepper::SharedModel;

pyo3::create_exception!(
    stepper._stepper,
    ModelError,
    PyValueError,
    "A model that cannot be simulated: what is wrong, where, and what to do."
);

pub(crate) fn to_py(error: stepper_core::ModelError) -> PyErr {
    ModelError::new_err(error.to_string())
}

/// A scene, immutable.
#[pyclass(module = "stepper._stepper", frozen)]
pub(crate) struct Model {
    pub(crate) core: SharedModel,
}

impl Model {
    fn of(core: Core) -> Self {
        Self { core: core.into() }
    }

    pub(crate) fn find_keyframe(&self, name: &str) -> PyResult<Keyframe> {
        let found = self.core.keyframes.iter().find(|k| k.name == name);
        let known: Vec<&str> = self.core.keyframes.iter().map(|k| k.name.as_str()).collect();
        found.cloned().ok_or_else(|| PyKeyError::new_err(format!("no keyframe \"{name}\", there are: {}", known.join(", "))))
    }
}

#[pymethods]
impl Model {
    #[staticmethod]
    fn from_description(description: &Bound<'_, PyAny>, strict: bool) -> PyResult<Self> {
        let core: Core = pythonize::depythonize(description).map_err(|e| ModelError::new_err(format!("not a model description: {e}")))?;
        core.finish(strict).map(Self::of).map_err(to_py)
    }

    #[staticmethod]
    fn from_bytes(bytes: &[u8]) -> PyResult<Self> {
        Core::from_bytes(bytes).map(Self::of).map_err(to_py)
    }

    #[staticmethod]
    fn from_file(path: PathBuf) -> PyResult<Self> {
        Core::load(&path).map(Self::of).map_err(to_py)
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.core.to_bytes())
    }

    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.core.save(&path).map_err(to_py)
    }

    fn explain(&self) -> String {
        self.core.explain()
    }

    #[pyo3(signature = (**fields))]
    fn replace(&self, fields: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut values = Vec::new();
        for (name, given) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            let given = readonly(&given, &name)?;
            if let Some((shape, _)) = self.core.field(&name) {
                let scalar = shape.is_empty() && given.shape() == [1];
                if given.shape() != shape && !scalar {
                    let (found, must) = (shape_text(given.shape()), shape_text(&shape));
                    return Err(PyValueError::new_err(format!("{name} has shape {found}, must be {must}")));
                }
            }
            values.push((name, given.as_slice()?.to_vec()));
        }
        // Together, because fields need only fit each other in the end.
        let values: Vec<(&str, &[f64])> = values.iter().map(|(name, x)| (name.as_str(), x.as_slice())).collect();
        let core = self.core.replace_all(&values).map_err(to_py)?;
        Ok(Self::of(core))
    }

    fn with_sensors(slf: &Bound<'_, Self>, sensors: &Bound<'_, PyAny>) -> PyResult<Self> {
        let described = slf.py().import("stepper._readings")?.getattr("describe")?.call1((slf, sensors))?;
        let more: Vec<Sensor> = pythonize::depythonize(&described)?;
        slf.get().core.with_sensors(more).map(Self::of).map_err(to_py)
    }

    fn geoms_seen_from(&self, site: usize) -> PyResult<Vec<usize>> {
        let count = self.core.sites.len();
        if site >= count {
            return Err(PyIndexError::new_err(format!("site {site} of {count}")));
        }
        Ok(self.core.geoms_seen_from(site))
    }

    /// Any field that `replace` takes.
    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        match self.core.field(name) {
            Some((shape, values)) => array(py, &shape, values, Precision::F64),
            None => Err(PyAttributeError::new_err(format!("'Model' object has no attribute '{name}'"))),
        }
    }

    #[getter]
    fn name(&self) -> &str {
        &self.core.name
    }

    #[getter]
    fn nq(&self) -> usize {
        self.core.nq()
    }

    #[getter]
    fn nv(&self) -> usize {
        self.core.nv()
    }

    #[getter]
    fn nu(&self) -> usize {
        self.core.nu()
    }

    #[getter]
    fn na(&self) -> usize {
        self.core.na()
    }

    #[getter]
    fn nbody(&self) -> usize {
        self.core.bodies.len()
    }

    #[getter]
    fn njnt(&self) -> usize {
        self.core.joints.len()
    }

    #[getter]
    fn ngeom(&self) -> usize {
        self.core.geoms.len()
    }

    #[getter]
    fn nsensordata(&self) -> usize {
        self.core.nsensordata()
    }

    #[getter]
    fn body_names(&self) -> Vec<&str> {
        self.core.bodies.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.core.joints.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn geom_names(&self) -> Vec<&str> {
        self.core.geoms.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn actuator_names(&self) -> Vec<&str> {
        self.core.actuators.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn sensor_names(&self) -> Vec<&str> {
        self.core.sensors.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn site_names(&self) -> Vec<&str> {
        self.core.sites.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn sensors<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let one = |(sensor, at): (&Sensor, usize)| {
            let out = PyDict::new(py);
            out.set_item("name", &sensor.name)?;
            out.set_item("type", sensor.word())?;
            out.set_item("adr", at)?;
            out.set_item("dim", sensor.dim(&self.core.sensors))?;
            out.set_item("datatype", format!("{:?}", sensor.quantity()).to_lowercase())?;
            for (name, x) in [("noise", sensor.noise), ("cutoff", sensor.cutoff), ("delay", sensor.delay), ("interval", sensor.interval)] {
                out.set_item(name, x)?;
            }
            Ok(out)
        };
        self.core.sensors.iter().zip(self.core.sensor_addresses()).map(one).collect()
    }

    #[getter]
    fn keyframe_names(&self) -> Vec<&str> {
        self.core.keyframes.iter().map(|x| x.name.as_str()).collect()
    }

    #[getter]
    fn omitted(&self) -> Vec<(&str, &str, &str)> {
        self.core.omitted.iter().map(|o| (o.kind.as_str(), o.name.as_str(), o.reason.as_str())).collect()
    }

    #[getter]
    fn digest(&self) -> String {
        self.core.digest().iter().map(|b| format!("{b:02x}")).collect()
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.core == other.core
    }

    fn __hash__(&self) -> u64 {
        u64::from_le_bytes(self.core.digest()[..8].try_into().expect("32 bytes"))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let args = (slf.get().to_bytes(slf.py()),).into_pyobject(slf.py())?;
        Ok((slf.get_type().getattr("from_bytes")?, args))
    }

    fn __repr__(&self) -> String {
        format!("<stepper.Model \"{}\": nq {}, nv {}, nu {}, {} bodies>", self.core.name, self.nq(), self.nv(), self.nu(), self.nbody())
    }
}

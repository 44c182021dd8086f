//! `stepper.Model`.

use std::path::PathBuf;

use numpy::{Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use std::sync::Arc;

use pyo3::exceptions::{PyIndexError, PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCFunction, PyDict, PyList, PyTuple, PyType};
use serde::de::DeserializeOwned;
use stepper_core::analysis::contact_stiffness::{EquivalentSpring, equivalent_springs};
use stepper_core::analysis::overlaps;
use stepper_core::model::{Description, Field, HeightField, Mesh, Model as Core, Omission, Overlap, REPLACEABLE, Sensor};
use stepper_core::{Integrator, Options, Parameter, Precision};

use crate::array::{
    array, assign_attribute, check_shape, check_shape_of, float64_array, hint, no_mapping, read_only, unknown_field, whole,
};
use crate::error::{ModelError, to_py, value_error};
use crate::getters::getters;
use crate::phrases::in_python;

/// Immutable model of a scene: bodies, joints, geoms, actuators, sensors.
///
/// Each field of `replace` is also an attribute, a read-only copy: `model.geom_friction` has shape (ngeom, 3). Models compare by value and
/// can be pickled.
#[pyclass(module = "stepper._stepper", frozen, weakref)]
pub(crate) struct Model {
    pub(crate) core: Arc<stepper_core::Model>,
}

/// Documentation text of the Python attribute for a model field, such as "Mass, kg: (nbody,)."
fn describe(field: &Field) -> String {
    let meaning = field.meaning();
    let mut letters = meaning.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    let axes = field.axes();
    let end = if axes.is_empty() { String::new() } else { format!(": {axes}") };
    first.chain(letters).collect::<String>() + &end + "."
}

/// Fields of `Model.replace`, as tuples (name, shape as text, quantity, unit, whether `Stepper.randomize` accepts the field).
#[pyfunction]
pub(crate) fn fields() -> Vec<(&'static str, String, &'static str, &'static str, bool)> {
    let row = |field: &Field| (field.name, field.axes(), field.what, field.unit, field.name.parse::<Parameter>().is_ok());
    REPLACEABLE.iter().map(row).collect()
}

/// Adds read-only attributes to the Python class `Model`: one for each field that `Model.replace` accepts, such as `body_mass`.
pub(crate) fn add_fields(class: &Bound<'_, PyType>) -> PyResult<()> {
    let py = class.py();
    let property = py.import("builtins")?.getattr("property")?;
    for field in REPLACEABLE {
        let read = move |args: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
            let model = args.get_item(0)?;
            let (shape, values) = model.cast::<Model>()?.get().core.field(field.name).expect("a field of every model");
            Ok::<_, PyErr>(read_only(array(args.py(), &shape, values, Precision::F64)?)?.unbind())
        };
        let getter = PyCFunction::new_closure(py, None, None, read)?;
        class.setattr(field.name, property.call1((getter, py.None(), py.None(), describe(field)))?)?;
    }
    Ok(())
}

/// Model description from a Python dictionary. The arrays of assets are converted as a whole, because large meshes have millions of
/// numbers.
fn described(given: &Bound<'_, PyAny>) -> PyResult<Description> {
    let given = given.cast::<PyDict>()?.copy()?;
    let meshes = assets(&given, "meshes", &["vertices", "faces"], |mesh: &mut Mesh, [vertices, faces]| {
        mesh.vertices = rows(&float64_array(&vertices, "vertices")?, "vertices")?;
        let faces = given.py().import("numpy")?.call_method1("ascontiguousarray", (faces, "uint32"))?;
        mesh.faces = rows(&faces.cast::<PyArrayDyn<u32>>()?.readonly(), "faces")?;
        Ok(())
    })?;
    let height_fields = assets(&given, "height_fields", &["elevation"], |field: &mut HeightField, [elevation]| {
        field.elevation = float64_array(&elevation, "elevation")?.as_slice()?.to_vec();
        Ok(())
    })?;
    Ok(Description { meshes, height_fields, ..pythonize::depythonize(&given)? })
}

/// Removes the assets of one kind, such as "meshes", from a description, and returns them.
///
/// `arrays` lists the fields of an asset that may be arrays. `fill` sets these fields of an asset from their Python objects.
fn assets<'py, T: DeserializeOwned, const N: usize>(
    description: &Bound<'py, PyDict>,
    kind: &str,
    arrays: &[&str; N],
    fill: impl Fn(&mut T, [Bound<'py, PyAny>; N]) -> PyResult<()>,
) -> PyResult<Vec<T>> {
    let (py, mut found) = (description.py(), Vec::new());
    let given = description.get_item(kind)?.ok_or_else(|| PyKeyError::new_err(kind.to_owned()))?;
    description.set_item(kind, PyList::empty(py))?;
    for asset in given.try_iter()? {
        let asset = asset?.cast::<PyDict>()?.copy()?;
        let mut taken = Vec::with_capacity(N);
        for name in arrays {
            taken.push(asset.get_item(name)?.ok_or_else(|| PyKeyError::new_err((*name).to_owned()))?);
            asset.set_item(name, PyList::empty(py))?;
        }
        let mut made = pythonize::depythonize(&asset)?;
        fill(&mut made, taken.try_into().expect("one of each"))?;
        found.push(made);
    }
    Ok(found)
}

/// Rows of the array argument `name`, (n, 3). An empty array gives an empty list; any other shape is an error.
fn rows<T: Element + Copy>(array: &PyReadonlyArrayDyn<'_, T>, name: &str) -> PyResult<Vec<[T; 3]>> {
    if array.len() > 0 {
        check_shape(name, array.shape(), &[&[array.len() / 3, 3]])?;
    }
    Ok(array.as_slice()?.as_chunks().0.to_vec())
}

impl Model {
    fn of(core: Core) -> Self {
        Self { core: core.into() }
    }

    fn named(&self, overlap: &Overlap) -> (String, String, f64) {
        let [a, b] = overlap.geoms.map(|g| self.core.geom_label_with_body(g));
        (a, b, overlap.depth)
    }
}

#[pymethods]
impl Model {
    /// Model from a description, a dictionary with the fields of the Rust crate's `Description`. The description is checked.
    ///
    /// Vertices and faces of meshes and elevations of height fields may be arrays.
    ///
    /// Raises:
    ///     ModelError: The description is not valid, or `strict` is set and it has unsupported elements.
    #[staticmethod]
    fn from_description(description: &Bound<'_, PyAny>, strict: bool) -> PyResult<Self> {
        let not_one = |e: PyErr| ModelError::new_err(format!("not a model description: {e}"));
        described(description).map_err(not_one)?.finish(strict).map(Self::of).map_err(to_py)
    }

    /// Model from the bytes of `to_bytes`.
    #[staticmethod]
    fn from_bytes(bytes: &[u8]) -> PyResult<Self> {
        Core::from_bytes(bytes).map(Self::of).map_err(to_py)
    }

    /// Model from a file that `save` wrote.
    #[staticmethod]
    fn from_file(path: PathBuf) -> PyResult<Self> {
        Core::load(&path).map(Self::of).map_err(to_py)
    }

    /// Bytes of the file that `save` writes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.core.to_bytes())
    }

    /// Writes the model to a file in stepper's own format. `stepper.load(path)` reads the same model, bit for bit, without MuJoCo.
    ///
    /// Raises:
    ///     ValueError: The file has the ending of another format: .xml, .mjb or .urdf.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        if ["xml", "mjb", "urdf"].contains(&ending.as_str()) {
            let (path, right) = (path.display(), path.with_extension("stepper"));
            let message =
                format!("path is '{path}', and a saved model has stepper's own format: use the ending .stepper, as '{}'", right.display());
            return Err(PyValueError::new_err(message));
        }
        self.core.save(&path).map_err(to_py)
    }

    /// Report on the model as text.
    ///
    /// Sections of the report:
    ///
    /// * settings of the source file that the default options replace
    /// * simulated elements; omitted elements, with reasons; features that the scene does not use, and that cost no time
    /// * phenomena that rigid-body simulation does not cover
    /// * overlapping geoms whose contacts are disabled; convex hulls much larger than their mesh
    /// * other overlaps, and violated joint limits, in the reference pose
    fn explain(&self) -> String {
        in_python(overlaps::explain(&self.core))
    }

    /// New model with other values in some fields. Quantities that depend on these fields are recomputed.
    ///
    ///     model.replace(geom_restitution=[0.2, 0.8])  # (ngeom,)
    ///     model.replace({"geom_friction[floor,box][0]": 0.5})
    ///
    /// With a new `actuator_gear`, joints keep the armature and damping that MJCF's actuators gave them with the old gear.
    ///
    /// Args:
    ///     values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md). Other entries of these fields keep their
    ///         values. Each array has an axis for the selected elements and one for the selected columns, as in NumPy's indexing. A single
    ///         name, index or column has no axis. A scalar sets all selected entries.
    ///     **fields: Values of whole fields, in the shape of the model's attribute.
    ///
    /// Contacts of an explicit pair use the fields of the pair (pair_friction, pair_restitution, ...) and ignore the fields of its geoms.
    /// If you change a geom of a pair, also give the pair's field in the same call, even if its values stay the same. This holds for
    /// geom_friction, geom_restitution, geom_margin, geom_gap, geom_condim, geom_solref, geom_solimp, geom_solmix, geom_stiffness and
    /// geom_damping. The field of the pair for geom_condim is pair_dim, and for geom_solmix it is pair_solref.
    ///
    /// Raises:
    ///     ValueError: A shape is wrong.
    ///     ModelError: A field is unknown, a value is invalid, or an explicit pair, which the message names, overrides the value of a
    ///         geom.
    #[pyo3(signature = (values=None, /, **fields))]
    fn replace(slf: &Bound<'_, Self>, values: Option<Bound<'_, PyAny>>, fields: Option<Bound<'_, PyDict>>) -> PyResult<Self> {
        let fields = match values {
            None => fields,
            Some(values) => {
                let selectors = slf.py().import("stepper.shared.selectors")?;
                Some(selectors.call_method1("replaced_fields", (slf, values, fields))?.cast_into::<PyDict>()?)
            }
        };
        let this = slf.get();
        let mut values = Vec::new();
        for (name, given) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            let Some((shape, _)) = this.core.field(&name) else {
                let known = REPLACEABLE.iter().map(|field| field.name).collect();
                return Err(unknown_field(given.py(), "Model.replace", &name, known, "help(stepper.Model)")?);
            };
            no_mapping("Model.replace", &name, &given)?;
            let numbers = float64_array(&given, &name)?;
            // The conversion to an array gives a scalar the shape (1,).
            let scalar = shape.is_empty() && numbers.shape() == [1];
            if !scalar {
                check_shape_of(&given, &name, numbers.shape(), &[&shape])?;
            }
            values.push((name, numbers.as_slice()?.to_vec()));
        }
        // All fields are replaced in one call, because only the resulting model must be valid.
        let values: Vec<(&str, &[f64])> = values.iter().map(|(name, x)| (name.as_str(), x.as_slice())).collect();
        let core = this.core.replace_all(&values).map_err(to_py)?;
        Ok(Self::of(core))
    }

    /// New model without contacts between bodies that overlap in the reference pose, as by `stepper.load(..., overlaps="exclude")`.
    ///
    /// Overlaps count if they are deeper than 0.01 mm; `excluded_overlaps` lists them. All contacts between the two bodies of an overlap
    /// are disabled. If a body is the world, only contacts between the two overlapping geoms are disabled. Overlaps with the ground are
    /// kept, and `overlaps()` lists them. Ground means planes, height fields and, for bodies with a free joint, all fixed geoms.
    fn exclude_overlaps(&self) -> Self {
        Self::of(overlaps::exclude(&self.core))
    }

    /// Pairs of geoms that can collide and overlap by more than 0.01 mm in the reference pose, the deepest first.
    ///
    /// Returns:
    ///     Tuples (name of the first geom, name of the second, depth in m). Geoms without a name are listed as "#3 of body arm".
    fn overlaps(&self) -> Vec<(String, String, f64)> {
        overlaps::overlaps(&self.core).iter().map(|overlap| self.named(overlap)).collect()
    }

    /// New model with additional sensors, after the existing ones.
    ///
    /// Args:
    ///     sensors: Additional sensors by name: each is a `SensorSpec`, a `RayFan` or a `Combination` of `stepper.sensors`.
    ///
    /// Raises:
    ///     ValueError: An element does not exist, or a direction has length 0.
    ///     ModelError: The model cannot have a sensor.
    fn with_sensors(slf: &Bound<'_, Self>, sensors: &Bound<'_, PyAny>) -> PyResult<Self> {
        let described = slf.py().import("stepper.sensors.readings")?.getattr("describe")?.call1((slf, sensors))?;
        let more: Vec<Sensor> = pythonize::depythonize(&described)?;
        slf.get().core.with_sensors(more).map(Self::of).map_err(to_py)
    }

    /// Stiffness and damping of the contacts under MuJoCo's contact law, from solref and solimp at the time step of the model.
    ///
    /// Returns:
    ///     Dictionary of arrays with a row for each of the n pairs of geoms that can collide: "geoms" (n, 2), indices; "stiffness" (n, 2),
    ///     N/m; and "damping" (n, 2), N s/m. Stiffness and damping are those of a contact whose geoms do not accelerate: in column 0 at
    ///     first touch, in column 1 at the depth of the largest impedance. In large scenes, some pairs are found only during the
    ///     simulation; these are not listed.
    fn equivalent_springs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let springs = equivalent_springs(&self.core);
        let rows = |of: &dyn Fn(&EquivalentSpring) -> [f64; 2]| {
            array(py, &[springs.len(), 2], springs.iter().flat_map(of).collect(), Precision::F64)
        };
        let table = PyDict::new(py);
        let geoms: Vec<i64> = springs.iter().flat_map(|s| s.geoms).map(|g| g as i64).collect();
        table.set_item("geoms", geoms.into_pyarray(py).reshape([springs.len(), 2])?)?;
        table.set_item("stiffness", rows(&|s| s.stiffness)?)?;
        table.set_item("damping", rows(&|s| s.damping)?)?;
        Ok(table)
    }

    /// Indices of the geoms that rays from the site with index `site` can hit: geoms of other bodies with a shape in the model.
    fn geoms_seen_from(&self, site: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
        let (site, count) = (whole(site, "site", 0)? as usize, self.core.sites.len());
        if site >= count {
            return Err(PyIndexError::new_err(format!("site {site} of {count}")));
        }
        Ok(self.core.geoms_seen_from(site))
    }

    fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        Err(hint(slf, "no_attribute", name)?)
    }

    fn __setattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign_attribute(slf, name, value)
    }

    /// Dictionary of the options `contact`, `integrator` and `iterations` that the source file implies.
    ///
    /// The dictionary is empty for models made in code. `Options.from_model` reads it.
    fn _requested_options<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let settings = PyDict::new(py);
        if self.core.requested.is_some() {
            let options = Options::from_model(&self.core).map_err(value_error)?;
            settings.set_item("contact", "mujoco")?;
            settings.set_item("integrator", options.integrator.map(Integrator::name))?;
            settings.set_item("iterations", options.iterations)?;
        }
        Ok(settings)
    }

    /// Dictionary of the settings of the source file that default options replace: integrator, solver, iterations, cone, constrained
    /// (whether the model has constraints, which are soft in MuJoCo), and soft (elements with non-default solref or solimp). The attribute
    /// is None for models made in code.
    #[getter]
    fn requested<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let asked = self.core.requested.as_ref().map(|asked| pythonize::pythonize(py, asked));
        asked.transpose().map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// Sensors as dictionaries with the keys name, type, adr (index of the first reading), dim, datatype, noise, cutoff, delay and
    /// interval. The datatype is "real", "positive", "axis" or "quaternion". The last four are properties from the source file, and 0 if
    /// the file does not specify them.
    #[getter]
    fn sensors<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let one = |(sensor, at): (&Sensor, usize)| {
            let out = PyDict::new(py);
            out.set_item("name", &sensor.name)?;
            out.set_item("type", sensor.word())?;
            out.set_item("adr", at)?;
            out.set_item("dim", sensor.dim(&self.core.sensors))?;
            out.set_item("datatype", sensor.quantity().name())?;
            for (name, x) in [("noise", sensor.noise), ("cutoff", sensor.cutoff), ("delay", sensor.delay), ("interval", sensor.interval)] {
                out.set_item(name, x)?;
            }
            Ok(out)
        };
        self.core.sensors.iter().zip(self.core.sensor_addresses()).map(one).collect()
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
        let core = &self.core;
        format!("<stepper.Model \"{}\": nq {}, nv {}, nu {}, {} bodies>", core.name, core.nq(), core.nv(), core.nu(), core.bodies.len())
    }
}

getters! { Model, |slf, _py| (PyRef<'py, Self>) -> usize;
    /// Number of position coordinates, the length of qpos.
    nq: slf.core.nq(),
    /// Number of degrees of freedom, the length of qvel.
    nv: slf.core.nv(),
    /// Number of controls.
    nu: slf.core.nu(),
    /// Number of actuator activations.
    na: slf.core.na(),
    /// Number of bodies, including the world, which is body 0.
    nbody: slf.core.bodies.len(),
    /// Number of joints.
    njnt: slf.core.joints.len(),
    /// Number of sites.
    nsite: slf.core.sites.len(),
    /// Number of geoms.
    ngeom: slf.core.geoms.len(),
    /// Number of explicit pairs of geoms.
    npair: slf.core.pairs.len(),
    /// Number of readings of all sensors.
    nsensordata: slf.core.nsensordata(),
}

getters! { Model, |slf, _py| (PyRef<'py, Self>);
    /// Name of the scene; may be empty.
    name -> String { slf.core.name.clone() }
    /// Elements of the source file that this model omits, as tuples (kind of element, name, reason).
    omitted -> Vec<(String, String, String)> {
        slf.core.omitted.iter().cloned().map(|Omission { kind, name, reason, .. }| (kind, name, reason)).collect()
    }
    /// Settings that the source file contains explicitly and that the default options replace, such as an integrator other than Euler's.
    /// Each is a line of text.
    deviations -> Vec<String> { slf.core.deviations(false).into_iter().map(in_python).collect() }
    /// Pairs of geoms that overlap in the reference pose, whose contacts `exclude_overlaps` has disabled. The list has the format of
    /// `overlaps()`.
    excluded_overlaps -> Vec<(String, String, f64)> { slf.core.excluded_overlaps.iter().map(|overlap| slf.named(overlap)).collect() }
    /// Mesh geoms that collide as a much larger convex hull, as tuples (index of the geom, hull volume / mesh volume).
    ///
    /// The list has geoms with a ratio of 2 or more, and fixed geoms with a ratio of 1.25 or more. The mesh volume is the space that the
    /// mesh encloses. The ratio is infinite for a mesh that encloses no space, such as an open surface.
    wide_hulls -> Vec<(usize, f64)> { slf.core.wide_hulls().iter().map(|hull| (hull.geom, hull.ratio)).collect() }
    /// SHA-256 of the model's description, in hexadecimal. Equal models have equal digests.
    digest -> String { slf.core.digest().iter().map(|b| format!("{b:02x}")).collect() }
}

//! Elements of a model by name or index, with attributes named as in MuJoCo.

use numpy::IntoPyArray;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyIndexError, PyKeyError};
use pyo3::prelude::*;
use pyo3::types::PyString;
use stepper_core::Precision;
use stepper_core::model::{
    Activation, Actuator as CoreActuator, ElementKind, Keyframe as CoreKeyframe, Model as Core, Shape, Transmission,
};

use crate::arguments::index_of;
use crate::array::{array, assign_attribute, hint, read_only};
use crate::model::Model;

/// Declares the kinds of elements, such as `Body`. Each kind is a Python class with a read-only attribute for each field. `Model` gets a
/// method that returns an element of this kind, and an attribute with the names of all. Doc comments become the documentation in Python.
///
/// An entry begins with the class, the names of this method and attribute, and the list of the elements in the model. The closure before
/// the fields names the converter of values, the model and the element's index. Its body computes values that several fields use. There and
/// in the fields, the element has the name of the method.
macro_rules! elements {
    ($(
        $(#[$doc:meta])*
        $class:ident: $kind:ident, $names:ident in $list:ident, |$v:ident, $model:ident, $i:ident| { $($shared:tt)* }
        { $($(#[$what:meta])* $field:ident: $value:expr,)* }
    )*) => {
        $(
            $(#[$doc])*
            #[pyclass(module = "stepper._stepper", frozen, get_all)]
            pub(crate) struct $class {
                $($(#[$what])* $field: Py<PyAny>,)*
            }

            impl $class {
                fn of(py: Python<'_>, $model: &Core, $i: usize) -> PyResult<Self> {
                    let ($v, $kind) = (Values { py }, &$model.$list[$i]);
                    $($shared)*
                    Ok(Self { $($field: $value?,)* })
                }
            }

            #[pymethods]
            impl $class {
                fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
                    Err(hint(slf, "no_attribute", name)?)
                }

                fn __setattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
                    assign_attribute(slf, name, value)
                }

                fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
                    let fields: Vec<String> = [$((stringify!($field), &self.$field)),*]
                        .into_iter()
                        .map(|(name, value)| Ok(format!("{}={}", name.trim_start_matches("r#"), value.bind(py).repr()?)))
                        .collect::<PyResult<_>>()?;
                    Ok(format!("<stepper {}: {}>", stringify!($class), fields.join(", ")))
                }
            }
        )*

        #[pymethods]
        impl Model {
            $(
                #[doc = concat!(stringify!($class), " by name or index (negative from the end).")]
                ///
                /// Raises:
                #[doc = concat!("    KeyError: The model has no ", stringify!($kind), " of that name; the message has similar names.")]
                #[doc = concat!("    IndexError: The model has no ", stringify!($kind), " of that index.")]
                fn $kind(&self, py: Python<'_>, key: &Bound<'_, PyAny>) -> PyResult<$class> {
                    $class::of(py, &self.core, index_of(&self.core, ElementKind::$class, key)?)
                }

                #[doc = concat!("Names of the ", stringify!($list), " in order. The name of an unnamed ", stringify!($kind), " is empty.")]
                #[getter]
                fn $names(&self) -> Vec<&str> {
                    ElementKind::$class.names(&self.core)
                }
            )*
        }

        /// Adds the classes of elements to the Python module.
        pub(crate) fn add_classes(module: &Bound<'_, PyModule>) -> PyResult<()> {
            $(module.add_class::<$class>()?;)*
            Ok(())
        }
    };
}

elements! {
    /// Body of a model.
    Body: body, body_names in bodies, |v, model, i| {
        let (jntadr, jntnum) = span(model.joints.iter().map(|j| j.body == i));
        let (geomadr, geomnum) = span(model.geoms.iter().map(|g| g.body == i));
        let own = usize::try_from(jntadr).map_or(0..0, |first| first..first + jntnum);
        let mocapid = if body.mocap { model.bodies[..i].iter().filter(|b| b.mocap).count() as i64 } else { -1 };
    } {
        /// Index of the body; 0 is the world.
        id: v.of(i),
        /// Name of the body; may be empty.
        name: v.of(&body.name),
        /// Index of the parent body; 0 for the world.
        parentid: v.of(body.parent),
        /// Mass of the body, kg.
        mass: v.of(body.mass),
        /// Principal moments of inertia, kg m^2: (3,).
        inertia: v.row(&body.inertia),
        /// Position of the body in the parent's frame, m: (3,).
        pos: v.row(&body.pos),
        /// Orientation of the body in the parent's frame, quaternion (w, x, y, z): (4,).
        quat: v.row(&body.quat),
        /// Centre of mass in the body's frame, m: (3,).
        ipos: v.row(&body.ipos),
        /// Orientation of the principal axes in the body's frame, quaternion (w, x, y, z): (4,).
        iquat: v.row(&body.iquat),
        /// Row in `mocap_pos` and `mocap_quat`; -1 for bodies that are not mocap bodies.
        mocapid: v.of(mocapid),
        /// Index of the body's first joint; -1 for a body without joints.
        jntadr: v.of(jntadr),
        /// Number of the body's joints.
        jntnum: v.of(jntnum),
        /// Address of the body's first degree of freedom in qvel; -1 for a body without degrees of freedom.
        dofadr: v.of(own.clone().next().map_or(-1, |j| model.joint_addresses()[j].1 as i64)),
        /// Number of the body's degrees of freedom.
        dofnum: v.of(own.map(|j| model.joints[j].kind.nv()).sum::<usize>()),
        /// Index of the body's first geom; -1 for a body without geoms.
        geomadr: v.of(geomadr),
        /// Number of the body's geoms.
        geomnum: v.of(geomnum),
    }

    /// Joint of a model, which `model.joint("hip")` returns.
    Joint: joint, joint_names in joints, |v, model, i| {
        let (qposadr, dofadr) = model.joint_addresses()[i];
    } {
        /// Index of the joint.
        id: v.of(i),
        /// Name of the joint; may be empty.
        name: v.of(&joint.name),
        /// Type: "free", "ball", "slide" or "hinge".
        r#type: v.of(joint.kind.name()),
        /// Index of the body that the joint moves.
        bodyid: v.of(joint.body),
        /// Address of the joint's first coordinate in qpos.
        qposadr: v.of(qposadr),
        /// Address of the joint's first degree of freedom in qvel.
        dofadr: v.of(dofadr),
        /// Number of the joint's coordinates in qpos.
        nq: v.of(joint.kind.nq()),
        /// Number of the joint's degrees of freedom in qvel.
        nv: v.of(joint.kind.nv()),
        /// Whether the joint position has bounds.
        limited: v.of(joint.range.is_some()),
        /// Lowest and highest joint position, m or rad: (2,). A missing bound is infinite.
        range: v.bounds(joint.range),
        /// Anchor of the joint in the body's frame, m: (3,).
        pos: v.row(&joint.pos),
        /// Unit axis of a slide or hinge in the body's frame: (3,).
        axis: v.row(&joint.axis),
        /// Stiffness of the joint spring, N/m or N m/rad.
        stiffness: v.of(joint.stiffness),
        /// Viscous damping of the joint, N s/m or N m s/rad.
        damping: v.of(joint.damping),
        /// Armature of the joint (added inertia), kg or kg m^2.
        armature: v.of(joint.armature),
        /// Dry friction of the joint (frictionloss), N or N m.
        frictionloss: v.of(joint.frictionloss),
        /// Speed limit of the joint in the source, rad/s or m/s; infinite if the source has no limit. The simulation does not enforce it.
        velocity_limit: v.of(joint.velocity_limit.unwrap_or(f64::INFINITY)),
    }

    /// Geom of a model.
    Geom: geom, geom_names in geoms, |v, model, i| {
        let sizes = model.field("geom_size").expect("a field of every model").1;
    } {
        /// Index of the geom.
        id: v.of(i),
        /// Name of the geom; may be empty.
        name: v.of(&geom.name),
        /// Index of the body to which the geom belongs.
        bodyid: v.of(geom.body),
        /// Type: "plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield".
        r#type: v.of(if let Shape::HeightField { .. } = geom.shape { "hfield" } else { geom.shape.name() }),
        /// Sizes of the geom, m: (3,). They are radius and half length, half sizes, or semi-axes; unused entries are 0.
        size: v.row(&sizes[3 * i..3 * i + 3]),
        /// Position of the geom in the body's frame, m: (3,).
        pos: v.row(&geom.pos),
        /// Orientation of the geom in the body's frame, quaternion (w, x, y, z): (4,).
        quat: v.row(&geom.quat),
        /// Bit mask: two geoms may collide if the contype of one has a common bit with the conaffinity of the other.
        contype: v.of(geom.contype),
        /// Bit mask: this geom may collide with geoms whose contype has a common bit with it.
        conaffinity: v.of(geom.conaffinity),
        /// Dimension of the geom's contacts as in MuJoCo: 1 frictionless, 3 sliding, 4 also torsional, 6 also rolling friction.
        condim: v.of(geom.condim),
        /// Priority of the geom: a contact uses the friction and condim of its geom with the higher priority.
        priority: v.of(geom.priority),
        /// Sliding (1), torsional (m) and rolling (m) friction of the geom: (3,).
        friction: v.row(&geom.friction),
        /// Newton's coefficient of restitution, 0 to 1.
        restitution: v.of(geom.restitution),
        /// Distance from the geom at which a contact begins to push, m. A contact has the sum of the margins of its two geoms.
        margin: v.of(geom.margin),
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap: v.of(geom.gap),
    }

    /// Explicit pair of geoms of a model. The geoms collide independent of filters, with the parameters of the pair.
    Pair: pair, pair_names in pairs, |v, model, i| {} {
        /// Index of the pair.
        id: v.of(i),
        /// Name of the pair; may be empty.
        name: v.of(&pair.name),
        /// Index of the first geom.
        geom1: v.of(pair.geoms[0]),
        /// Index of the second geom.
        geom2: v.of(pair.geoms[1]),
        /// Dimension of the pair's contacts as in MuJoCo: 1 frictionless, 3 sliding, 4 also torsional, 6 also rolling friction.
        dim: v.of(pair.condim),
        /// Sliding (1), torsional (m) and rolling (m) friction of the pair: (3,).
        friction: v.row(&pair.friction),
        /// Newton's coefficient of restitution, 0 to 1.
        restitution: v.of(pair.restitution),
        /// Distance between the geoms at which a contact begins to push, m.
        margin: v.of(pair.margin),
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap: v.of(pair.gap),
    }

    /// Site of a model.
    Site: site, site_names in sites, |v, model, i| {} {
        /// Index of the site.
        id: v.of(i),
        /// Name of the site; may be empty.
        name: v.of(&site.name),
        /// Index of the body to which the site belongs.
        bodyid: v.of(site.body),
        /// Type: "sphere", "capsule", "cylinder", "ellipsoid" or "box".
        r#type: v.of(site.shape.name()),
        /// Position of the site in the body's frame, m: (3,).
        pos: v.row(&site.pos),
        /// Orientation of the site in the body's frame, quaternion (w, x, y, z): (4,).
        quat: v.row(&site.quat),
    }

    /// Actuator of a model.
    Actuator: actuator, actuator_names in actuators, |v, model, i| {
        let (trntype, trnid) = match actuator.transmission {
            Transmission::Joint(j) => ("joint", j),
            Transmission::Tendon(t) => ("tendon", t),
            Transmission::Site { site, .. } => ("site", site),
            Transmission::JointWrench { joint, in_parent, .. } => (if in_parent { "jointinparent" } else { "joint" }, joint),
            Transmission::Body(b) => ("body", b),
            Transmission::SliderCrank { crank, .. } => ("slidercrank", crank),
        };
        let has_activation = |a: &CoreActuator| a.activation != Activation::None;
        let before = model.actuators[..i].iter().filter(|a| has_activation(a)).count() as i64;
    } {
        /// Index of the actuator, and of its control in ctrl.
        id: v.of(i),
        /// Name of the actuator; may be empty.
        name: v.of(&actuator.name),
        /// Kind of element on which the actuator acts: "joint", "tendon", "site" or "slidercrank".
        trntype: v.of(trntype),
        /// Index of the joint, tendon or site on which the actuator acts. For a slider-crank it is the site of the crank.
        trnid: v.of(trnid),
        /// Address of the actuator's activation in act; -1 if the actuator has no activation.
        actadr: v.of(if has_activation(actuator) { before } else { -1 }),
        /// Lowest and highest control: (2,). A missing bound is infinite.
        ctrlrange: v.bounds(actuator.ctrl_range),
        /// Lowest and highest force, N or N m: (2,). A missing bound is infinite.
        forcerange: v.bounds(actuator.force_range),
        /// Lowest and highest activation: (2,). A missing bound is infinite.
        actrange: v.bounds(actuator.act_range),
        /// Gear: (6,). For a site, the entries are force and torque per unit of actuator force. Otherwise entry 0 scales length, velocity
        /// and force.
        gear: v.row(&actuator.gear_row()),
        /// Type of the gain: "fixed", "affine", "dcmotor", "pid" or "muscle".
        gaintype: v.of(actuator.force_model.gain.name()),
        /// Parameters of the gain: (10,). For the types "fixed" and "affine" they begin with constant, factor of length and factor of
        /// velocity. Unused entries are 0.
        gainprm: v.row(&actuator.parameter_row(CoreActuator::gain_parameters)),
        /// Type of the bias: "none", "affine", "dcmotor" or "muscle".
        biastype: v.of(actuator.force_model.bias.name()),
        /// Parameters of the bias: (10,). For the type "affine" they begin with constant, factor of length and factor of velocity. Unused
        /// entries are 0.
        biasprm: v.row(&actuator.parameter_row(CoreActuator::bias_parameters)),
    }

    /// Sensor of a model.
    Sensor: sensor, sensor_names in sensors, |v, model, i| {} {
        /// Index of the sensor.
        id: v.of(i),
        /// Name of the sensor; may be empty.
        name: v.of(&sensor.name),
        /// Type of the sensor as in MJCF, such as "gyro".
        r#type: v.of(sensor.word()),
        /// Address of the sensor's first reading in sensordata.
        adr: v.of(model.sensor_addresses()[i]),
        /// Number of readings of the sensor.
        dim: v.of(sensor.dim(&model.sensors)),
        /// Standard deviation of the sensor noise in the source file, `noise` in MJCF.
        noise: v.of(sensor.noise),
        /// Largest magnitude of a reading in the source file, `cutoff` in MJCF; 0 if readings have no limit.
        cutoff: v.of(sensor.cutoff),
    }

    /// Tendon of a model: a linear combination of joint positions (fixed), or a path through sites and around geoms (spatial).
    Tendon: tendon, tendon_names in tendons, |v, model, i| {
        let joints: Vec<i64> = tendon.joints.iter().map(|&(j, _)| j as i64).collect();
        let jntid = read_only(joints.into_pyarray(v.py).into_any())?;
        let coefficients: Vec<f64> = tendon.joints.iter().map(|&(_, c)| c).collect();
    } {
        /// Index of the tendon.
        id: v.of(i),
        /// Name of the tendon; may be empty.
        name: v.of(&tendon.name),
        /// Whether the tendon is spatial: a path through sites and around geoms.
        spatial: v.of(!tendon.path.is_empty()),
        /// Indices of the n joints of a fixed tendon: (n,) int64.
        jntid: v.of(jntid),
        /// Coefficients of the n joints in the tendon length: (n,).
        coef: v.row(&coefficients),
        /// Whether the tendon length has bounds.
        limited: v.of(tendon.range.is_some()),
        /// Lowest and highest tendon length, m or rad: (2,). A missing bound is infinite.
        range: v.bounds(tendon.range),
        /// Stiffness of the tendon spring, N per unit of tendon length (m or rad).
        stiffness: v.of(tendon.stiffness),
        /// Viscous damping of the tendon, N s per unit of tendon length (m or rad).
        damping: v.of(tendon.damping),
        /// Added inertia of the tendon, N s^2 per unit of tendon length (m or rad).
        armature: v.of(tendon.armature),
        /// Dry friction of the tendon, N.
        frictionloss: v.of(tendon.frictionloss),
    }

    /// Equality of a model: it connects or welds two bodies, or couples joints or tendons.
    Equality: equality, equality_names in equalities, |v, model, i| {
        let (first, second) = equality.kind.objects();
        let other = second.map_or(-1, |id| id as i64);
    } {
        /// Index of the equality, and of its column in `eq_active` and `eq_data`.
        id: v.of(i),
        /// Name of the equality; may be empty.
        name: v.of(&equality.name),
        /// Type: "connect", "weld", "joint" or "tendon".
        r#type: v.of(equality.kind.name()),
        /// Index of the first body, joint or tendon.
        obj1id: v.of(first),
        /// Index of the second body, joint or tendon; -1 for a coupling of one.
        obj2id: v.of(other),
        /// Whether the equality is active after a reset.
        active0: v.of(equality.active),
        /// Anchors, relative pose and torquescale, or polynomial, in the layout of MuJoCo's `eq_data`: (11,).
        data: v.row(&equality.data()),
    }

    /// Keyframe of a model: a named state for `Stepper.reset(keyframe=)`.
    Keyframe: keyframe, keyframe_names in keyframes, |v, model, i| {} {
        /// Index of the keyframe.
        id: v.of(i),
        /// Name of the keyframe; may be empty.
        name: v.of(&keyframe.name),
        /// Time of the keyframe, s.
        time: v.of(keyframe.time),
        /// Configuration of the keyframe: (nq,).
        qpos: v.row(&keyframe.qpos),
        /// Velocity of the keyframe: (nv,).
        qvel: v.row(&keyframe.qvel),
        /// Activations of the keyframe: (na,).
        act: v.row(&keyframe.act),
        /// Controls of the keyframe: (nu,).
        ctrl: v.row(&keyframe.ctrl),
    }
}

impl Model {
    /// Keyframe from its name or index in a Python argument.
    pub(crate) fn find_keyframe(&self, given: &Bound<'_, PyAny>) -> PyResult<CoreKeyframe> {
        let all = &self.core.keyframes;
        let none = || PyKeyError::new_err(format!("no keyframe {given:?}: this model has none; give reset(qpos=..., qvel=...)"));
        if all.is_empty() && given.is_instance_of::<PyString>() {
            return Err(none());
        }
        match index_of(&self.core, ElementKind::Keyframe, given) {
            Ok(index) => Ok(all[index].clone()),
            Err(error) if all.is_empty() && error.is_instance_of::<PyIndexError>(given.py()) => Err(none()),
            // An index out of range raises the same error as an unknown name.
            Err(error) if error.is_instance_of::<PyIndexError>(given.py()) => {
                let known = all.iter().enumerate().map(|(i, k)| if k.name.is_empty() { i.to_string() } else { k.name.clone() });
                Err(PyKeyError::new_err(format!("no keyframe {given}, there are: {}", known.collect::<Vec<_>>().join(", "))))
            }
            Err(error) => Err(error),
        }
    }
}

/// Converter of model values to Python objects.
#[derive(Clone, Copy)]
struct Values<'py> {
    py: Python<'py>,
}

impl<'py> Values<'py> {
    fn of(self, value: impl IntoPyObject<'py>) -> PyResult<Py<PyAny>> {
        value.into_py_any(self.py)
    }

    /// Read-only NumPy array with the numbers of one element in a field of the model.
    fn row(self, numbers: &[f64]) -> PyResult<Py<PyAny>> {
        Ok(read_only(array(self.py, &[numbers.len()], numbers.to_vec(), Precision::F64)?)?.unbind())
    }

    fn bounds(self, range: Option<[f64; 2]>) -> PyResult<Py<PyAny>> {
        self.row(&range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]))
    }
}

/// Index of the first true value of an iterator, and number of true values. If no value is true, the index is -1.
fn span(mut among: impl Iterator<Item = bool>) -> (i64, usize) {
    match among.by_ref().position(|is| is) {
        Some(first) => (first as i64, 1 + among.filter(|&is| is).count()),
        None => (-1, 0),
    }
}

//! Elements of a model by name or index, with attributes named as in MuJoCo.

mod lookup;
mod values;

pub(crate) use lookup::Kind;

use pyo3::prelude::*;

/// Declares a Python class for each kind of element, such as `Body`, with a read-only attribute for each field. The doc comment of a field
/// becomes the documentation of the attribute.
macro_rules! elements {
    ($($(#[$doc:meta])* $class:ident { $($(#[$what:meta])* $field:ident,)* })*) => {
        $(
            $(#[$doc])*
            #[pyclass(module = "stepper._stepper", frozen, get_all)]
            pub(crate) struct $class {
                $($(#[$what])* $field: Py<PyAny>,)*
            }

            #[pymethods]
            impl $class {
                fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
                    let fields: Vec<String> = [$((stringify!($field), &self.$field)),*]
                        .into_iter()
                        .map(|(name, value)| Ok(format!("{}={}", name.trim_start_matches("r#"), value.bind(py).repr()?)))
                        .collect::<PyResult<_>>()?;
                    Ok(format!("<stepper {}: {}>", stringify!($class), fields.join(", ")))
                }
            }
        )*

        /// Adds the classes of elements to the Python module.
        pub(crate) fn add_classes(module: &Bound<'_, PyModule>) -> PyResult<()> {
            $(module.add_class::<$class>()?;)*
            Ok(())
        }
    };
}

elements! {
    /// Body of a model.
    Body {
        /// Index of the body; 0 is the world.
        id,
        /// Name of the body; may be empty.
        name,
        /// Index of the parent body; 0 for the world.
        parentid,
        /// Mass of the body, kg.
        mass,
        /// Principal moments of inertia, kg m^2: (3,).
        inertia,
        /// Position of the body in the parent's frame, m: (3,).
        pos,
        /// Orientation of the body in the parent's frame, quaternion (w, x, y, z): (4,).
        quat,
        /// Centre of mass in the body's frame, m: (3,).
        ipos,
        /// Orientation of the principal axes in the body's frame, quaternion (w, x, y, z): (4,).
        iquat,
        /// Row in `mocap_pos` and `mocap_quat`; -1 for bodies that are not mocap bodies.
        mocapid,
        /// Index of the body's first joint; -1 for a body without joints.
        jntadr,
        /// Number of the body's joints.
        jntnum,
        /// Address of the body's first degree of freedom in qvel; -1 for a body without degrees of freedom.
        dofadr,
        /// Number of the body's degrees of freedom.
        dofnum,
        /// Index of the body's first geom; -1 for a body without geoms.
        geomadr,
        /// Number of the body's geoms.
        geomnum,
    }

    /// Joint of a model.
    Joint {
        /// Index of the joint.
        id,
        /// Name of the joint; may be empty.
        name,
        /// Type: "free", "ball", "slide" or "hinge".
        r#type,
        /// Index of the body that the joint moves.
        bodyid,
        /// Address of the joint's first coordinate in qpos.
        qposadr,
        /// Address of the joint's first degree of freedom in qvel.
        dofadr,
        /// Number of the joint's coordinates in qpos.
        nq,
        /// Number of the joint's degrees of freedom in qvel.
        nv,
        /// Whether the joint position has bounds.
        limited,
        /// Lowest and highest joint position, m or rad: (2,). A missing bound is infinite.
        range,
        /// Anchor of the joint in the body's frame, m: (3,).
        pos,
        /// Unit axis of a slide or hinge in the body's frame: (3,).
        axis,
        /// Stiffness of the joint spring, N/m or N m/rad.
        stiffness,
        /// Viscous damping of the joint, N s/m or N m s/rad.
        damping,
        /// Armature of the joint (added inertia), kg or kg m^2.
        armature,
        /// Dry friction of the joint (frictionloss), N or N m.
        frictionloss,
        /// Speed limit of the joint in the source, rad/s or m/s; infinite if the source has no limit. The simulation does not enforce it.
        velocity_limit,
    }

    /// Geom of a model.
    Geom {
        /// Index of the geom.
        id,
        /// Name of the geom; may be empty.
        name,
        /// Index of the body to which the geom belongs.
        bodyid,
        /// Type: "plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield".
        r#type,
        /// Sizes of the geom, m: (3,). They are radius and half length, half sizes, or semi-axes; unused entries are 0.
        size,
        /// Position of the geom in the body's frame, m: (3,).
        pos,
        /// Orientation of the geom in the body's frame, quaternion (w, x, y, z): (4,).
        quat,
        /// Bit mask: two geoms may collide if the contype of one has a common bit with the conaffinity of the other.
        contype,
        /// Bit mask: this geom may collide with geoms whose contype has a common bit with it.
        conaffinity,
        /// Dimension of the geom's contacts: 1, 3, 4 or 6, as in MuJoCo.
        condim,
        /// Priority of the geom: a contact uses the friction and condim of its geom with the higher priority.
        priority,
        /// Sliding (1), torsional (m) and rolling (m) friction of the geom: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance from the geom at which a contact begins to push, m.
        margin,
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap,
    }

    /// Explicit pair of geoms of a model. The geoms collide independent of filters, with the parameters of the pair.
    Pair {
        /// Index of the pair.
        id,
        /// Name of the pair; may be empty.
        name,
        /// Index of the first geom.
        geom1,
        /// Index of the second geom.
        geom2,
        /// Dimension of the pair's contacts: 1, 3, 4 or 6, as in MuJoCo.
        dim,
        /// Sliding (1), torsional (m) and rolling (m) friction of the pair: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance between the geoms at which a contact begins to push, m.
        margin,
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap,
    }

    /// Site of a model.
    Site {
        /// Index of the site.
        id,
        /// Name of the site; may be empty.
        name,
        /// Index of the body to which the site belongs.
        bodyid,
        /// Type: "sphere", "capsule", "cylinder", "ellipsoid" or "box".
        r#type,
        /// Position of the site in the body's frame, m: (3,).
        pos,
        /// Orientation of the site in the body's frame, quaternion (w, x, y, z): (4,).
        quat,
    }

    /// Actuator of a model.
    Actuator {
        /// Index of the actuator, and of its control in ctrl.
        id,
        /// Name of the actuator; may be empty.
        name,
        /// Kind of element on which the actuator acts: "joint", "tendon" or "site".
        trntype,
        /// Index of the joint, tendon or site on which the actuator acts.
        trnid,
        /// Address of the actuator's activation in act; -1 if the actuator has no activation.
        actadr,
        /// Lowest and highest control: (2,). A missing bound is infinite.
        ctrlrange,
        /// Lowest and highest force, N or N m: (2,). A missing bound is infinite.
        forcerange,
        /// Lowest and highest activation: (2,). A missing bound is infinite.
        actrange,
        /// Gear: (6,). For a joint or tendon, entry 0 scales length, velocity and force. For a site, the entries are force and torque per
        /// unit of actuator force.
        gear,
        /// Type of the gain: "fixed", "affine", "dcmotor" or "pid".
        gaintype,
        /// Parameters of the gain: (10,). For the types "fixed" and "affine" they begin with constant, factor of length and factor of
        /// velocity. Unused entries are 0.
        gainprm,
        /// Type of the bias: "none", "affine" or "dcmotor".
        biastype,
        /// Parameters of the bias: (10,). For the type "affine" they begin with constant, factor of length and factor of velocity. Unused
        /// entries are 0.
        biasprm,
    }

    /// Sensor of a model.
    Sensor {
        /// Index of the sensor.
        id,
        /// Name of the sensor; may be empty.
        name,
        /// Type of the sensor as in MJCF, such as "gyro".
        r#type,
        /// Address of the sensor's first reading in sensordata.
        adr,
        /// Number of readings of the sensor.
        dim,
        /// Standard deviation of the sensor noise in the source file, `noise` in MJCF.
        noise,
        /// Largest magnitude of a reading in the source file, `cutoff` in MJCF; 0 if readings have no limit.
        cutoff,
    }

    /// Fixed tendon of a model, whose length is a linear combination of joint positions.
    Tendon {
        /// Index of the tendon.
        id,
        /// Name of the tendon; may be empty.
        name,
        /// Indices of the joints of the tendon: (n,) int64.
        jntid,
        /// Coefficients of the joints in the tendon length: (n,).
        coef,
        /// Whether the tendon length has bounds.
        limited,
        /// Lowest and highest tendon length, m or rad: (2,). A missing bound is infinite.
        range,
        /// Stiffness of the tendon spring, N per unit of tendon length (m or rad).
        stiffness,
        /// Viscous damping of the tendon, N s per unit of tendon length (m or rad).
        damping,
        /// Added inertia of the tendon, N s^2 per unit of tendon length (m or rad).
        armature,
        /// Dry friction of the tendon, N.
        frictionloss,
    }

    /// Keyframe of a model: a named state for `Stepper.reset(keyframe=)`.
    Keyframe {
        /// Index of the keyframe.
        id,
        /// Name of the keyframe; may be empty.
        name,
        /// Time of the keyframe, s.
        time,
        /// Configuration of the keyframe: (nq,).
        qpos,
        /// Velocity of the keyframe: (nv,).
        qvel,
        /// Activations of the keyframe: (na,).
        act,
        /// Controls of the keyframe: (nu,).
        ctrl,
    }
}

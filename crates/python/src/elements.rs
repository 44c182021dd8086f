//! Elements of a model by name or index, with attributes named as in MuJoCo.

mod lookup;
mod values;

pub(crate) use lookup::Kind;

use pyo3::prelude::*;

/// Declares a Python class for each kind of element, with an attribute for each field. The documentation of a field is that of the
/// attribute.
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

        /// Adds the classes to the module.
        pub(crate) fn add_classes(module: &Bound<'_, PyModule>) -> PyResult<()> {
            $(module.add_class::<$class>()?;)*
            Ok(())
        }
    };
}

elements! {
    /// Body of a model.
    Body {
        /// Index; that of the world is 0.
        id,
        /// Name; may be empty.
        name,
        /// Index of the parent body; 0 for the world.
        parentid,
        /// Mass, kg.
        mass,
        /// Principal moments of inertia, kg m^2: (3,).
        inertia,
        /// Position in the parent's frame, m: (3,).
        pos,
        /// Orientation in the parent's frame, quaternion (w, x, y, z): (4,).
        quat,
        /// Centre of mass in the body's frame, m: (3,).
        ipos,
        /// Orientation of the principal axes in the body's frame, quaternion (w, x, y, z): (4,).
        iquat,
        /// Row in `mocap_pos` and `mocap_quat`; -1 for bodies that are not mocap bodies.
        mocapid,
        /// Index of the body's first joint; -1 without joints.
        jntadr,
        /// Number of the body's joints.
        jntnum,
        /// Address of the body's first degree of freedom in qvel; -1 without degrees of freedom.
        dofadr,
        /// Number of the body's degrees of freedom.
        dofnum,
        /// Index of the body's first geom; -1 without geoms.
        geomadr,
        /// Number of the body's geoms.
        geomnum,
    }

    /// Joint of a model.
    Joint {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Type: "free", "ball", "slide" or "hinge".
        r#type,
        /// Index of its body.
        bodyid,
        /// Address of its first coordinate in qpos.
        qposadr,
        /// Address of its first degree of freedom in qvel.
        dofadr,
        /// Number of its coordinates in qpos.
        nq,
        /// Number of its degrees of freedom in qvel.
        nv,
        /// Whether its position has bounds.
        limited,
        /// Lowest and highest position, m or rad: (2,), infinite without a bound.
        range,
        /// Anchor in the body's frame, m: (3,).
        pos,
        /// Unit axis of a slide or hinge in the body's frame: (3,).
        axis,
        /// Spring stiffness, N/m or N m/rad.
        stiffness,
        /// Viscous damping, N s/m or N m s/rad.
        damping,
        /// Armature (added inertia), kg or kg m^2.
        armature,
        /// Dry friction (frictionloss), N or N m.
        frictionloss,
        /// Speed limit in the source, rad/s or m/s, not enforced; infinite without one.
        velocity_limit,
    }

    /// Geom of a model.
    Geom {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of its body.
        bodyid,
        /// Type: "plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield".
        r#type,
        /// Sizes, m: (3,). They are radius and half length, half sizes, or semi-axes; unused entries are 0.
        size,
        /// Position in the body's frame, m: (3,).
        pos,
        /// Orientation in the body's frame, quaternion (w, x, y, z): (4,).
        quat,
        /// Bit mask: two geoms may collide if the contype of one has a common bit with the conaffinity of the other.
        contype,
        /// Bit mask of the contypes of other geoms with which this one may collide.
        conaffinity,
        /// Dimension of a contact: 1, 3, 4 or 6, as in MuJoCo.
        condim,
        /// Priority: a contact uses the friction and condim of its geom with the higher one.
        priority,
        /// Sliding (1), torsional (m), rolling (m) friction: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance at which a contact begins to push, m.
        margin,
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap,
    }

    /// Explicit pair of geoms of a model. The geoms collide independent of filters, with the parameters of the pair.
    Pair {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of the first geom.
        geom1,
        /// Index of the second geom.
        geom2,
        /// Dimension of a contact: 1, 3, 4 or 6, as in MuJoCo.
        dim,
        /// Sliding (1), torsional (m), rolling (m) friction: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance at which a contact begins to push, m.
        margin,
        /// Distance beyond the margin up to which MuJoCo reports contacts without force, m.
        gap,
    }

    /// Site of a model.
    Site {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of its body.
        bodyid,
        /// Type: "sphere", "capsule", "cylinder", "ellipsoid" or "box".
        r#type,
        /// Position in the body's frame, m: (3,).
        pos,
        /// Orientation in the body's frame, quaternion (w, x, y, z): (4,).
        quat,
    }

    /// Actuator of a model.
    Actuator {
        /// Index, also of its control in ctrl.
        id,
        /// Name; may be empty.
        name,
        /// Type of its transmission target: "joint", "tendon" or "site".
        trntype,
        /// Index of the transmission target.
        trnid,
        /// Address of its activation in act; -1 without one.
        actadr,
        /// Bounds of the control: (2,), infinite without a bound.
        ctrlrange,
        /// Bounds of the force, N or N m: (2,), infinite without a bound.
        forcerange,
        /// Bounds of the activation: (2,), infinite without a bound.
        actrange,
        /// Gear: (6,). Entry 0 scales length, velocity and force. For a site, the entries are force and torque directions.
        gear,
        /// Type of the gain: "fixed", "affine", "dcmotor" or "pid".
        gaintype,
        /// Parameters of the gain: constant, factor of length, factor of velocity; others are 0: (10,).
        gainprm,
        /// Type of the bias: "none", "affine" or "dcmotor".
        biastype,
        /// Parameters of the bias: constant, factor of length, factor of velocity; others are 0: (10,).
        biasprm,
    }

    /// Sensor of a model.
    Sensor {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Type as in MJCF, such as "gyro".
        r#type,
        /// Address of its first reading.
        adr,
        /// Number of its readings.
        dim,
        /// Noise in the source.
        noise,
        /// Cutoff in the source.
        cutoff,
    }

    /// Fixed tendon of a model, whose length is a linear combination of joint positions.
    Tendon {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Indices of its joints: (n,) int64.
        jntid,
        /// Coefficients of the joints: (n,).
        coef,
        /// Whether its length has bounds.
        limited,
        /// Lowest and highest length: (2,), infinite without a bound.
        range,
        /// Spring stiffness.
        stiffness,
        /// Viscous damping.
        damping,
        /// Added inertia.
        armature,
        /// Dry friction.
        frictionloss,
    }

    /// Keyframe of a model: a named state for `Stepper.reset(keyframe=)`.
    Keyframe {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Time, s.
        time,
        /// Configuration: (nq,).
        qpos,
        /// Velocity: (nv,).
        qvel,
        /// Activations: (na,).
        act,
        /// Controls: (nu,).
        ctrl,
    }
}

//! Elements of a model by name or index, and their rows of its tables, in MuJoCo's words.

mod lookup;
mod values;

pub(crate) use lookup::Kind;

use pyo3::prelude::*;

/// Declares what is said of each kind of element: a class with an attribute for each field, whose documentation is that of the field.
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
    /// A body of a model.
    Body {
        /// Index; the world's is 0.
        id,
        /// Name; may be empty.
        name,
        /// Index of the parent; the world's is 0.
        parentid,
        /// Mass, kg.
        mass,
        /// Principal moments of inertia, kg m^2: (3,).
        inertia,
        /// Position in the parent's frame, m: (3,).
        pos,
        /// Orientation in the parent's frame: (4,).
        quat,
        /// Centre of mass in the body's frame, m: (3,).
        ipos,
        /// Orientation of the principal axes in the body's frame: (4,).
        iquat,
        /// Row of `mocap_pos` and `mocap_quat` of a body that the user poses, else -1.
        mocapid,
        /// Index of its first joint; -1 without one.
        jntadr,
        /// Number of its joints.
        jntnum,
        /// Address of its first degree of freedom in qvel; -1 without one.
        dofadr,
        /// Number of its degrees of freedom.
        dofnum,
        /// Index of its first geom; -1 without one.
        geomadr,
        /// Number of its geoms.
        geomnum,
    }

    /// A joint of a model.
    Joint {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// "free", "ball", "slide" or "hinge".
        r#type,
        /// Index of the body that it moves.
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
        /// Lowest and highest position, m or rad: (2,), infinite where there is no bound.
        range,
        /// Anchor in the body's frame, m: (3,).
        pos,
        /// Unit axis of a slide or hinge in the body's frame: (3,).
        axis,
        /// Spring stiffness, N/m or N m/rad.
        stiffness,
        /// Viscous damping, N s/m or N m s/rad.
        damping,
        /// Added inertia, kg or kg m^2.
        armature,
        /// Dry friction, N or N m.
        frictionloss,
        /// Highest speed that the source allows, rad/s or m/s, not enforced; infinite where there is none.
        velocity_limit,
    }

    /// A geom of a model.
    Geom {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of the body that it is fixed to.
        bodyid,
        /// "plane", "sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh" or "hfield".
        r#type,
        /// Radius, half length; or half sizes; or semi-axes; 0 where the shape has no number; m: (3,).
        size,
        /// Position in the body's frame, m: (3,).
        pos,
        /// Orientation in the body's frame: (4,).
        quat,
        /// Bit mask: two geoms may collide if one's contype meets the other's conaffinity.
        contype,
        /// Bit mask, see `contype`.
        conaffinity,
        /// Rows of a contact: 1, 3, 4 or 6.
        condim,
        /// The pair takes the friction and condim of the geom with the higher priority.
        priority,
        /// Sliding (1), torsional (m), rolling (m) friction: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance at which a contact pushes, m.
        margin,
        /// Distance beyond the margin that is reported, m.
        gap,
    }

    /// An explicit pair of geoms of a model: they collide whatever filters say, with the pair's own numbers.
    Pair {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of the first geom.
        geom1,
        /// Index of the second geom.
        geom2,
        /// Rows of a contact: 1, 3, 4 or 6.
        dim,
        /// Sliding (1), torsional (m), rolling (m) friction: (3,).
        friction,
        /// Newton's coefficient of restitution, 0 to 1.
        restitution,
        /// Distance at which a contact pushes, m.
        margin,
        /// Distance beyond the margin that is reported, m.
        gap,
    }

    /// A site of a model.
    Site {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Index of the body that it is fixed to.
        bodyid,
        /// "sphere", "capsule", "cylinder", "ellipsoid" or "box".
        r#type,
        /// Position in the body's frame, m: (3,).
        pos,
        /// Orientation in the body's frame: (4,).
        quat,
    }

    /// An actuator of a model.
    Actuator {
        /// Index: its place in ctrl.
        id,
        /// Name; may be empty.
        name,
        /// What it pulls on: "joint", "tendon" or "site".
        trntype,
        /// Index of that.
        trnid,
        /// Address of its activation in act; -1 without one.
        actadr,
        /// Bounds of the control: (2,), infinite where there is none.
        ctrlrange,
        /// Bounds of the force, N or N m: (2,), infinite where there is none.
        forcerange,
        /// Bounds of the activation: (2,), infinite where there is none.
        actrange,
        /// Scale of length, velocity and force, in column 0; force and torque on a site: (6,).
        gear,
        /// Type of the gain: "fixed", "affine", "dcmotor" or "pid".
        gaintype,
        /// Parameters of the gain: constant, per length, per velocity; others are 0: (10,).
        gainprm,
        /// Type of the bias: "none", "affine" or "dcmotor".
        biastype,
        /// Parameters of the bias: constant, per length, per velocity; others are 0: (10,).
        biasprm,
    }

    /// A sensor of a model.
    Sensor {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Kind, as MJCF calls it: "gyro".
        r#type,
        /// Address of its first reading.
        adr,
        /// Number of its readings.
        dim,
        /// Noise that the source declares.
        noise,
        /// Cutoff that the source declares.
        cutoff,
    }

    /// A fixed tendon of a model: its length is a linear combination of joint positions.
    Tendon {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// Indices of its joints: (n,) int64.
        jntid,
        /// Their coefficients: (n,).
        coef,
        /// Whether its length has bounds.
        limited,
        /// Lowest and highest length: (2,), infinite where there is no bound.
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

    /// A keyframe of a model: a named state, which `Stepper.reset(keyframe=)` starts from.
    Keyframe {
        /// Index.
        id,
        /// Name; may be empty.
        name,
        /// s
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

//! Models: scenes of bodies, joints, geoms, actuators and sensors, in the terms of MJCF and in SI units.
//!
//! A [`Description`] is a scene whose fields can be edited. [`Description::finish`] checks it and returns a [`Model`], which can be read
//! but not edited, so that every model is valid. Elements keep the indices of the source file. `stepper-core` compiles a model for the
//! step, and simulates it.
//!
//! ```
//! use stepper_model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
//!
//! let mut scene = Model::builder("pendulum");
//! scene.geom(WORLD, GeomBuilder::plane("floor").pos([0.0, 0.0, -1.0]));
//! let rod = BodyBuilder::new("rod").joint(JointBuilder::hinge("pivot", [0.0, 1.0, 0.0]).damping(0.1));
//! scene.body(WORLD, rod.geom(GeomBuilder::capsule("rod", 0.02, 0.2).pos([0.0, 0.0, -0.2])));
//! let model = scene.finish()?;
//! assert_eq!((model.nq(), model.nv()), (1, 1));
//!
//! // Checks name the element, the value and the remedy.
//! let mut description = model.clone().into_description();
//! description.joints[0].damping = -0.1;
//! println!("{}", description.finish(true).unwrap_err());
//!
//! // A saved model is read back bit for bit.
//! let read = Model::from_bytes(&model.to_bytes())?;
//! assert_eq!(read.digest(), model.digest());
//!
//! // New values are checked like those of any other model.
//! let heavy = model.replace("body_mass", &[0.0, 2.0])?;
//! assert_eq!(heavy.bodies[1].mass, 2.0);
//! println!("{}", heavy.explain());
//! # Ok::<(), stepper_model::ModelError>(())
//! ```
//!
//! | to do | see |
//! |---|---|
//! | write a scene in Rust | [`Model::builder`], [`ModelBuilder`] |
//! | edit the fields of a scene | [`Description`], [`Model::into_description`] |
//! | check a scene | [`Description::finish`], [`ModelError`] |
//! | save and read a model | [`Model::save`], [`Model::load`], [`FORMAT_VERSION`] |
//! | replace values of a model | [`Model::replace`], [`REPLACEABLE`], [`Variants`] |
//! | find an element by its name | [`Description::joint`] and the like |
//! | get a report of a model's elements | [`Model::explain`] |
//! | find out whether two geoms collide | [`Filter`], [`Description::collision_pairs`] |
//!
//! A model stores the convex hulls of its meshes, which `stepper-geometry` computes once. A saved model contains them too.
//!
//! Frames: a body's `pos`, `quat` place it in its parent; a joint's `pos`, `axis` and a geom's `pos`, `quat` are in their body's frame.
//! Quaternions are (w, x, y, z). Lengths in m, masses in kg, angles in rad.

/// Declares an enumeration whose variants have names, and the function `name`. Without values in the variants, `ALL` lists them.
#[doc(hidden)]
#[macro_export]
macro_rules! named {
    ($(#[$about:meta])* $vis:vis enum $name:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $name {
            $($(#[$doc])* $variant,)+
        }

        // Nothing calls the functions of some enumerations.
        #[allow(dead_code)]
        impl $name {
            /// All variants, in the order of their declaration.
            $vis const ALL: [Self; [$($text,)+].len()] = [$(Self::$variant,)+];

            /// Name of the variant in messages and reports, and of most enumerations in Python.
            $vis const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)+
                }
            }
        }
    };
    ($(#[$about:meta])* $vis:vis enum $name:ident {
        $($(#[$doc:meta])* $variant:ident $(($($tuple:tt)*))? $({ $($fields:tt)* })? = $text:literal,)+
    }) => {
        $(#[$about])*
        $vis enum $name {
            $($(#[$doc])* $variant $(($($tuple)*))? $({ $($fields)* })?,)+
        }

        impl $name {
            /// Name of the variant in messages and reports, and of most enumerations in Python.
            $vis const fn name(&self) -> &'static str {
                match self {
                    $(Self::$variant { .. } => $text,)+
                }
            }
        }
    };
}

mod actuator_fields;
pub mod actuator_spec;
mod asset;
mod builder;
mod description;
mod device_error;
mod equality;
mod error;
mod explain;
mod file;
mod finish;
mod finished;
mod fluid;
mod force_model;
mod hull_volume;
mod hulls;
mod kernel;
mod lookup;
mod mass;
mod muscle;
mod orientation;
mod overridden_geom_fields;
mod pairs;
mod replace;
mod sensor;
mod shape;
mod simple_bodies;
mod softness;
mod tendon;
mod variant;

pub use actuator_fields::AffineForce;
pub use asset::{HeightField, Mesh};
pub use builder::{ActuatorBuilder, BodyBuilder, EqualityBuilder, GeomBuilder, JointBuilder, ModelBuilder, TendonBuilder, WORLD};
pub use description::{
    Activation, Actuator, Body, Description, Geom, Joint, JointKind, Keyframe, Omission, Overlap, Pair, Requested, Transmission, label,
};
pub use device_error::{ActuatorError, DeviceError, SensorError};
pub use equality::{Equality, EqualityKind};
pub use error::ModelError;
pub use file::{FORMAT_VERSION, write_whole};
pub use finished::Model;
pub use fluid::{Ellipsoid, Medium};
pub use force_model::{BiasType, ForceModel, GainType};
pub use hull_volume::WideHull;
pub use kernel::Kernel;
pub use lookup::{ElementKind, JointPlace, SensorPlace};
pub use mass::MassProperties;
pub use muscle::{MUSCLE_PARAMETERS, Muscle};
pub use orientation::Orientation;
pub use pairs::{Filter, weld_groups};
pub use replace::{Field, REPLACEABLE};
pub use sensor::{
    ContactField, ContactReduction, ContactSide, FrameReading, Object, ProximityReading, Quantity, RayField, Sensor, SensorKind, Site,
};
pub use shape::Shape;
pub use simple_bodies::simple_bodies;
pub use softness::{Cone, ContactSpring, InverseWeights, MIN_VALUE, NoSlip, SoftSettings, Softness};
pub use tendon::{PathElement, PathSegment, Tendon, round};
pub use variant::{Parameter, Variants};

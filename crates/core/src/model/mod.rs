//! The model: what the scene is made of, as its author sees it.
//!
//! A [`Description`] is a scene whose fields anybody may edit. [`Description::finish`] checks it and makes a [`Model`] of it, which can be
//! read and no longer edited, so that every model is valid. Both keep the vocabulary of MJCF (bodies, joints, geoms, actuators, sensors,
//! keyframes) and every index a user knows, in SI units; what the step needs of a model is compiled into a `compile::ModelStructure`.
//!
//! Frames: a body's `pos`, `quat` place it in its parent; a joint's `pos`, `axis` and a geom's `pos`, `quat` are in their body's frame.
//! Quaternions are (w, x, y, z). Lengths in m, masses in kg, angles in rad.

pub mod actuator_spec;
mod added_fields;
mod asset;
mod builder;
mod description;
mod device_error;
mod equality;
mod error;
mod explain;
pub(crate) mod file;
mod finish;
mod finished;
mod fluid;
mod hull_volume;
mod hulls;
mod kernel;
mod lookup;
mod mass;
mod orientation;
mod pair_overrides;
mod pairs;
mod replace;
mod sensor;
mod shape;
mod softness;
mod tendon;
mod variant;

pub use asset::{HeightField, Mesh};
pub use builder::{ActuatorBuilder, BodyBuilder, EqualityBuilder, GeomBuilder, JointBuilder, ModelBuilder, TendonBuilder, WORLD};
pub(crate) use description::label;
pub use description::{
    Activation, Actuator, Body, Description, Geom, Joint, JointKind, Keyframe, Omission, Overlap, Pair, Requested, Transmission,
};
pub use device_error::{ActuatorError, DeviceError, SensorError};
pub use equality::{Equality, EqualityKind};
pub use error::ModelError;
pub use file::FORMAT_VERSION;
pub use finished::Model;
pub use fluid::{Ellipsoid, Medium};
pub use hull_volume::WideHull;
pub use kernel::Kernel;
pub use lookup::{JointPlace, SensorPlace};
pub use mass::MassProperties;
pub use orientation::Orientation;
pub use pairs::GeomPair;
pub(crate) use pairs::{Filter, weld_groups};
pub use replace::{Field, REPLACEABLE};
pub use sensor::{
    ContactField, ContactReduction, ContactSide, FrameReading, Object, ProximityReading, Quantity, RayField, Sensor, SensorKind, Site,
};
pub use shape::Shape;
pub(crate) use softness::MIN_VALUE;
pub use softness::{Cone, ContactSpring, InverseWeights, NoSlip, SoftSettings, Softness};
pub use tendon::Tendon;
pub use variant::Parameter;
pub(crate) use variant::Variants;

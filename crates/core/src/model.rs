//! Models of scenes, from the crate `stepper-model`.
//!
//! A [`Description`] is a scene with editable fields. [`Description::finish`] checks it and makes a read-only [`Model`] of it, so that
//! every model is valid.

pub use stepper_model::actuator_spec;
pub(crate) use stepper_model::round;
pub use stepper_model::{
    Activation, Actuator, ActuatorBuilder, ActuatorError, BiasType, Body, BodyBuilder, Cone, ContactField, ContactReduction, ContactSide,
    ContactSpring, Description, DeviceError, ElementKind, Ellipsoid, Equality, EqualityBuilder, EqualityKind, FORMAT_VERSION, Field,
    ForceModel, FrameReading, GainType, Geom, GeomBuilder, HeightField, InverseWeights, Joint, JointBuilder, JointKind, JointPlace, Kernel,
    Keyframe, MUSCLE_PARAMETERS, MassProperties, Medium, Mesh, Model, ModelBuilder, ModelError, Muscle, NoSlip, Object, Omission,
    Orientation, Overlap, Pair, Parameter, PathElement, PathSegment, ProximityReading, Quantity, REPLACEABLE, RayField, Requested, Sensor,
    SensorError, SensorKind, SensorPlace, Shape, Site, SoftSettings, Softness, Tendon, TendonBuilder, Transmission, WORLD, WideHull,
};
pub(crate) use stepper_model::{Filter, MIN_VALUE, Variants, label, simple_bodies, weld_groups, write_whole};

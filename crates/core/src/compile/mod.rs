//! The compiled model: from the scene as its author sees it to what the step reads, and no more than the scene needs.

mod actuators;
mod collision;
mod compiled_model;
mod compiler;
mod equality;
mod lane_model;
mod limits;
mod merging;
mod parameter_layout;
mod parameter_row;
mod parameters;
mod passive;
pub mod sensing;
mod tree;

pub use crate::model::Kernel;
pub use actuators::{CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, CompiledServo, CompiledWrench, Spot};
pub use collision::{CompiledGeom, CompiledPair, Crowd, Member};
pub use compiled_model::{CompiledModel, ModelStructure};
pub use equality::{Combination, CompiledEquality, CompiledTendon, EqualityBlock, EqualityRows, Spring};
pub use lane_model::LaneModel;
pub use parameters::{ActuatorParams, CompensationParams, ContactParams, DofParams, FluidParams, GeomParams, Inertial, Params};
pub use passive::{CompiledEllipsoid, CompiledFluid, CompiledSurface, FluidShape, GravityCompensation};
pub use sensing::CompiledSensing;
pub use tree::{
    CompiledBallLimit, CompiledBody, CompiledFriction, CompiledJoint, CompiledLimit, CompiledMocap, CompiledSpinner, Descendant, Dof, Link,
};

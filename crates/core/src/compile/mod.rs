//! Compiler: converts the user's model to a compiled model, the numbers that a step reads.

mod actuators;
mod adhesion;
mod collision;
mod compiled_model;
mod compiler;
mod equality;
mod lane_model;
mod limits;
mod mechanisms;
mod merging;
mod parameter_layout;
mod parameter_row;
mod parameters;
mod passive;
mod paths;
mod ray_surfaces;
pub mod sensing;
mod soften;
mod softness;
mod static_pairs;
mod tree;

pub use crate::model::Kernel;
pub(crate) use actuators::SMALLEST;
pub use actuators::{
    CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, CompiledMuscle, MomentKind, MotorControl, MuscleCurve, VariableMoment,
};
pub(crate) use adhesion::ADHESION_REACH;
pub use adhesion::CompiledAdhesion;
pub(crate) use collision::Symmetry;
pub use collision::{CompiledPair, DynamicPairs, NO_PAIR_GROUP};
pub use compiled_model::{CompiledModel, ModelStructure};
pub(crate) use equality::coupling_error;
pub use equality::{Combination, CompiledEquality, CompiledTendon, EqualityBlock, EqualityRows, FramePath, Spring};
pub use lane_model::LaneModel;
pub use parameters::{ActuatorParams, CompensationParams, DofParams, FluidParams, Inertial, Params};
pub use passive::{CompiledEllipsoid, FluidShape};
pub(crate) use paths::obstacle_count;
pub use paths::{CompiledObstacle, CompiledPath, CompiledSegment, PathLengths, PathTerm, Spot};
pub use ray_surfaces::RaySurfaces;
pub(crate) use softness::MIN_FRICTION;
pub use softness::{CompiledSoftness, SoftContactLaw, SoftLaw};
pub use static_pairs::StaticPairs;
pub use tree::{CompiledJoint, CompiledSingleBody, Descendant, Dof, Link, MechanismPart};

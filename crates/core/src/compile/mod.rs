//! The compiled model: from the scene as its author sees it to what the step reads, and no more than the scene needs.

mod actuators;
mod collision;
mod compiled_model;
mod compiler;
mod equality;
mod limits;
mod merging;
mod parameter_layout;
mod parameters;
mod passive;
pub mod sensing;

pub use crate::model::Kernel;
pub use actuators::{ActuatorPlan, ForceRangePlan, ServoPlan, Spot, TrainPlan, WrenchPlan};
pub use collision::{Crowd, GeomPlan, Member, PairPlan};
pub use compiled_model::*;
pub use equality::{Combination, EqualityBlock, EqualityPlan, EqualityRows, Spring, TendonPlan};
pub(crate) use merging::matrix;
pub use parameters::{ContactParams, DofParams, Inertial, LanePlan, Params};
pub use passive::{EllipsoidPlan, FluidPlan, FluidShape, GravityCompensation, SurfacePlan};
pub use sensing::SensingPlan;

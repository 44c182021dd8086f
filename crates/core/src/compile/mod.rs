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
mod parameters;
mod passive;
pub mod sensing;
mod tree;

pub use crate::model::Kernel;
pub use actuators::{ActuatorPlan, ForceRangePlan, ServoPlan, Spot, TrainPlan, WrenchPlan};
pub use collision::{Crowd, GeomPlan, Member, PairPlan};
pub use compiled_model::Plan;
pub use equality::{Combination, EqualityBlock, EqualityPlan, EqualityRows, Spring, TendonPlan};
pub use lane_model::LanePlan;
pub use parameters::{ContactParams, DofParams, Inertial, Params};
pub use passive::{EllipsoidPlan, FluidPlan, FluidShape, GravityCompensation, SurfacePlan};
pub use sensing::SensingPlan;
pub use tree::{BallLimitPlan, Below, BodyPlan, Dof, FrictionPlan, JointPlan, LimitPlan, Link, MocapPlan, SpinnerPlan};

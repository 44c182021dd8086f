//! The tests of this crate in one binary: the generic code that they call is compiled once for all of them. `cargo test --test suite NAME`
//! runs those of a module. What counts allocations has a binary of its own.

mod common;
mod containment;
mod determinism;
mod examples;
mod geometry_stage;
mod going_on;
mod inputs;
#[cfg(feature = "nalgebra")]
mod matrices;
mod parameters;
mod public_face;
mod scratch;
#[path = "../../../geometry/tests/suite/shapes.rs"]
mod shapes;
mod static_geoms;
mod terrain;

//! Tests of this crate in one binary, so that the generic code that they call is compiled only once. `cargo test --test suite NAME` runs
//! the tests of one module. Tests that count allocations are in a separate binary.

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

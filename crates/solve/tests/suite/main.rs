//! Tests of this crate in one binary: the generic code that they call is compiled once for all of them. `cargo test --test suite NAME` runs
//! those of a module. The test that counts allocations has a separate binary.

mod bounds;
mod common;
mod compliance;
mod file;
mod lanes;
mod newton;
mod rolling;
mod rows;
mod soft;
mod solver;

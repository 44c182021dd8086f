//! The tests of this crate in one binary. `cargo test --test suite NAME` runs those of a module.

mod convex;
mod hulls;
mod pairs;
mod parry;
mod passing;
mod reuse;
mod sampling;
mod shapes;
mod surfaces;
mod tilted;

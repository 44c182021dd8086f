//! Derivatives of a step with contact, and its kinks, at which it is not differentiable.
//!
//! [`differentiate`] computes the derivatives of a step of a [`Simulation`](stepper_core::Simulation) with respect to the state and the
//! controls, in all environments. It solves the step once. All contacts then keep their modes (open, sticking, slipping). The implicit
//! function theorem gives the response of the impulses: their first-order change with the state and the controls. Each coordinate is
//! displaced in turn. Stages 1 to 8 of the step are evaluated at the displaced state, with this response in place of the solver
//! ([`stepper_core::group_step`]). Differences of these evaluations are the derivatives. The evaluations include the changes of geometry,
//! forces and inertia. They have no kinks, because the contact modes are fixed.
//!
//! ```
//! use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, WORLD};
//! use stepper_core::{Model, Simulation};
//! use stepper_derivative::{DerivativeQuery, StatePart, differentiate};
//!
//! // A cart of 2 kg on a rail with a damper.
//! let mut scene = Model::builder("cart");
//! scene.timestep(0.01);
//! let cart = BodyBuilder::new("cart").joint(JointBuilder::slide("rail", [1.0, 0.0, 0.0]).damping(3.0));
//! scene.body(WORLD, cart.geom(GeomBuilder::sphere("cart", 0.1).mass(2.0)));
//! let mut sim = Simulation::single(scene.finish()?)?;
//!
//! // Columns are the position and the velocity, each displaced by 1e-6.
//! let query = DerivativeQuery { parts: &[StatePart::Qpos, StatePart::Qvel], offsets: &[1e-6; 2], points: 1, tolerance: 1e-9 };
//! let derivative = &differentiate(&mut sim, &[], &query)?[0];
//!
//! // The rows are the position and the velocity after the step. The damper is implicit, by Radau's method; x = h b / m.
//! let x: f64 = 0.01 * 3.0 / 2.0;
//! let decay = (1.0 - x / 3.0) / (1.0 + 2.0 * x / 3.0 + x * x / 6.0);
//! assert!((derivative.slopes[0] - 1.0).abs() < 1e-9); // rounding of differences of 1e-6
//! assert!((derivative.slopes[3] - decay).abs() < 1e-9);
//! assert!(derivative.sound && derivative.causes == [0; 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`find_kinks`] is for finite differences. It compares perturbed copies of environments after a step. Contacts, limits and actuators may
//! change their mode between the copies. The result contains these kinks and the distance to the nearest kink.
//!
//! | to do | see |
//! |---|---|
//! | differentiate a step | [`differentiate`], [`DerivativeQuery`], [`Derivative`] |
//! | know where a derivative is valid | [`Derivative::sound`], [`Derivative::distance`], [`kink`] |
//! | find kinks between copies of environments | [`find_kinks`], [`PerturbedCopies`], [`Kinks`] |
//!
//! Steps in 32 bits, with the integrator rk4 or with actuator dynamics have no implicit derivatives: [`differentiate`] returns an error.
//!
//! # Features
//!
//! `avx2` and `avx512` (on by default) compile the kernels for these CPU levels, in addition to the baseline.

mod differentiate;
pub mod kink;
mod kinks;
mod response;
mod rows;
mod step_derivative;

pub use differentiate::differentiate;
pub use kinks::{Kinks, PerturbedCopies, find_kinks};
pub use rows::{Derivative, DerivativeQuery};
pub use stepper_core::group_step::StatePart;

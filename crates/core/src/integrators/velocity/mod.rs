//! Stages 4 to 6: the loop that solves for the velocity after a step.

mod ambiguous_energy;
pub(crate) mod collision_search;
pub(crate) mod contact_activation;
pub(crate) mod impact;
pub(crate) mod predict;
pub(crate) mod solve_velocities;
pub(crate) mod velocity_loop;

//! Part of a state that changed since stages 1 to 4 were last computed, as in MuJoCo's mj_forwardSkip.

/// Part of the state that changed, which determines the stages to recompute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recomputed {
    /// Configuration changed: recompute everything.
    Configuration,
    /// Velocities changed: recompute forces and the velocities of rows.
    Velocity,
    /// Activations or controls changed: recompute forces.
    Forces,
}

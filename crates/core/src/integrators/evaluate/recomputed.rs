//! Part of a state that changed since stages 1 to 4 were last computed, as in MuJoCo's mj_forwardSkip.

/// Part of the state that changed since the last evaluation, which determines the stages to recompute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recomputed {
    /// The configuration changed: all stages are recomputed.
    Configuration,
    /// The velocities changed: forces and the velocities of rows are recomputed.
    Velocity,
    /// The activations or controls changed: only forces are recomputed.
    Forces,
}

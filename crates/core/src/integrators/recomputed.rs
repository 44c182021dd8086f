//! Part of a state that changed since stages 1 to 4 were last computed, as in mj_forwardSkip of MuJoCo.

/// Part of the state from which on everything is recomputed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Recomputed {
    /// The configuration: everything.
    Configuration,
    /// Velocities: forces, and the velocities of rows.
    Velocity,
    /// Activations or controls: forces alone.
    Forces,
}

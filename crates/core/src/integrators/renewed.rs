//! What of a state is another than when stages 1 to 4 were last taken at it.

/// What is renewed, with all that follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Renewed {
    /// The configuration: everything.
    Configuration,
    /// Velocities: forces, and the velocities of rows.
    Velocity,
    /// Activations or controls: forces alone.
    Forces,
}

//! Reference solution of the position solve: the impulses of the velocity solve, at which the damping of rows has no effect.

use crate::capacity::Capacity;

/// Reference solution of the position solve: the solution of the velocity solve. The damping of rows acts on the difference from the
/// impulses of the reference. A proof of infeasibility starts from the motion by these impulses.
#[derive(Clone, Debug, Default)]
pub struct Reference<R> {
    /// Scaled velocity change w by all impulses of the reference, in coordinates in which its kinetic energy is |w|^2 / 2.
    pub(crate) w: Vec<R>,
    /// Normal impulse of each scalar row, then of each contact, in the reference, N s or N m s.
    pub(crate) lambda: Vec<R>,
    /// Velocity of each scalar row, then of each contact's normal row, before any impulse, m/s or rad/s. It includes the bias (minus the
    /// target velocity) and no damping.
    pub(crate) g: Vec<R>,
    /// Scaled generalized momentum J^T z by the impulses z of the last proof of infeasibility, see
    /// [`System::witness`](crate::System::witness).
    pub(crate) momentum: Vec<R>,
}

impl<R> Reference<R> {
    /// Empty reference, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let rows = capacity.scalars + capacity.all_contacts();
        let reserve = |n: usize| Vec::with_capacity(n);
        Self { w: reserve(capacity.dimension), lambda: reserve(rows), g: reserve(rows), momentum: reserve(capacity.dimension) }
    }

    /// Scaled generalized momentum J^T z by the impulses z of the last proof of infeasibility, see
    /// [`System::witness`](crate::System::witness).
    pub fn momentum(&mut self) -> &mut [R] {
        &mut self.momentum
    }
}

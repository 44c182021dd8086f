//! Reference solution of the position solve: the impulses of the velocity solve, at which the damping of rows has no effect.

use crate::capacity::Capacity;

/// Reference solution of the position solve: the solution of the velocity solve. The damping of rows acts on the difference from the
/// impulses of the reference. A proof of infeasibility starts from the motion by these impulses.
#[derive(Clone, Debug, Default)]
pub struct Reference<R> {
    /// Scaled velocity change w by all impulses of the reference, in coordinates in which its kinetic energy is |w|^2 / 2.
    pub(crate) w: Vec<R>,
    /// Normal rows in the reference: the scalar rows, then the first row of each contact.
    pub(crate) rows: Vec<ReferenceRow<R>>,
    /// Scaled generalized momentum J^T z by the impulses z of the last proof of infeasibility, see
    /// [`System::witness`](crate::System::witness).
    pub momentum: Vec<R>,
}

/// Scalar row, or normal row of a contact, in the reference solution.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferenceRow<R> {
    /// Impulse of the row, N s or N m s.
    pub(crate) lambda: R,
    /// Velocity of the row before any impulse, m/s or rad/s. It includes the bias (minus the target velocity) and no damping.
    pub(crate) g: R,
}

impl<R> Reference<R> {
    /// Empty reference, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let rows = capacity.scalars + capacity.all_contacts();
        let [w, momentum] = [capacity.dimension; 2].map(Vec::with_capacity);
        Self { w, rows: Vec::with_capacity(rows), momentum }
    }
}

//! Reference solution from which damped targets are counted.

use crate::capacity::Capacity;

/// Solution from which a second one starts. The compliance of damped rows counts from its impulses, and the witness of infeasibility is
/// added to it.
#[derive(Clone, Debug, Default)]
pub struct Reference<R> {
    /// Scaled velocity change w.
    pub(crate) w: Vec<R>,
    /// Normal impulse of every scalar row, then of every contact, N s or N m s.
    pub(crate) lambda: Vec<R>,
    /// Right-hand side g of these rows (free velocity plus bias), undamped, m/s or rad/s.
    pub(crate) g: Vec<R>,
    /// Scaled generalized momentum J^T z of the last witness.
    pub(crate) momentum: Vec<R>,
}

impl<R> Reference<R> {
    /// Reserves memory for the solution of a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let rows = capacity.constraints();
        let reserve = |n: usize| Vec::with_capacity(n);
        Self { w: reserve(capacity.dimension), lambda: reserve(rows), g: reserve(rows), momentum: reserve(capacity.dimension) }
    }

    /// Scaled generalized momentum of the last witness, see [`System::witness`](crate::System::witness).
    pub fn momentum(&mut self) -> &mut [R] {
        &mut self.momentum
    }
}

//! Contact of two shapes, one in each lane.

use crate::linear_algebra::V3;

/// Contact of two shapes, one in each lane.
#[derive(Clone, Copy, Debug)]
pub struct ContactPoint<R> {
    /// Signed distance, negative where the shapes overlap, m.
    pub distance: R,
    /// Halfway between the surfaces, m.
    pub pos: V3<R>,
    /// Unit normal from the first shape to the second.
    pub normal: V3<R>,
}

//! Contact normal of two polyhedra in the previous step, from which the next search starts.

use crate::vectors::V;

/// Contact normal of two polyhedra in the previous step, from which the next search starts. This normal saves time, and changes the result
/// by rounding errors at most.
#[derive(Clone, Copy, Debug)]
pub struct CachedNormal {
    /// Unit normal from the first polyhedron to the second, in the frame of the first.
    pub(super) normal: V,
    /// Edge of each polyhedron to which the normal was perpendicular, as the indices of its two vertices. If both indices are equal, the
    /// normal was found at this vertex. `None` if only the normal is known.
    pub(super) edges: Option<[[u32; 2]; 2]>,
}

impl From<V> for CachedNormal {
    fn from(normal: V) -> Self {
        Self { normal, edges: None }
    }
}

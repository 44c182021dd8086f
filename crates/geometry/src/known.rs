//! Normal and features of two hulls in the last step, at which a search starts.

use crate::vectors::V;

/// Normal and features of two hulls in the last step, at which a search starts.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Unit normal from the first hull to the second, in the frame of the first.
    pub(super) normal: V,
    /// Corner numbers of both ends of an edge of each hull, if the normal was perpendicular to two edges. Both ends of a single corner are
    /// equal.
    pub(super) edges: Option<[[u32; 2]; 2]>,
}

impl From<V> for Known {
    fn from(normal: V) -> Self {
        Self { normal, edges: None }
    }
}

//! What is known of two hulls from the last step.

use crate::vectors::V;

/// What is known of two hulls from the last step.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// The normal, from the first to the second, unit, in the first's frame.
    pub(super) normal: V,
    /// The ends of an edge of each across which it was; corners, if it was none, or nothing.
    pub(super) edges: Option<[[u32; 2]; 2]>,
}

impl From<V> for Known {
    fn from(normal: V) -> Self {
        Self { normal, edges: None }
    }
}

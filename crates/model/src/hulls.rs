//! Convex hulls of a model's meshes, computed once and shared by all copies of the model.

use std::sync::Arc;

use stepper_geometry::{Hull, HullError};

use crate::asset::Mesh;

/// Convex hulls, one entry per mesh. A mesh has a hull if the hull is the collision shape of a geom that can touch other geoms.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Hulls(pub(super) Vec<Option<Arc<Hull>>>);

impl Hulls {
    /// Stores the convex hull of the mesh with the index `index`, unless it is stored already. `reusable` has hulls of the same meshes.
    /// Those that it lacks are computed.
    ///
    /// # Errors
    /// [`HullError`] if the mesh has no hull.
    pub(super) fn store(&mut self, index: usize, mesh: &Mesh, reusable: &Hulls) -> Result<(), HullError> {
        if self.0.len() <= index {
            self.0.resize(index + 1, None);
        }
        if self.0[index].is_none() {
            let same = reusable.0.get(index).cloned().flatten();
            self.0[index] = Some(same.map_or_else(|| mesh.hull().map(Arc::new), Ok)?);
        }
        Ok(())
    }
}

//! Convex hulls of a model's meshes, computed once and shared by all copies of the model.

use std::sync::Arc;

use stepper_geometry::{Hull, HullError};

use crate::asset::Mesh;

/// Convex hulls, one entry per mesh. A mesh has a hull if the hull is the collision shape of a geom that can touch other geoms.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Hulls(pub(super) Vec<Option<Arc<Hull>>>);

/// Triangles of the convex hull of each mesh, as indices of the mesh's vertices, or `None` for meshes without a hull. A model file stores
/// them.
pub(super) type Surfaces = Vec<Option<Vec<[u32; 3]>>>;

/// Source of the convex hulls in the check of a description.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source<'a> {
    /// The vertices of the meshes: all hulls are computed.
    Vertices,
    /// A model with the same meshes, whose hulls are reused. Missing hulls are computed from the vertices.
    Same(&'a Hulls),
    /// A model file, whose hulls are checked. Missing hulls are computed from the vertices.
    Kept(&'a [Option<Vec<[u32; 3]>>]),
}

impl Source<'_> {
    fn hull(self, index: usize, mesh: &Mesh) -> Result<Arc<Hull>, HullError> {
        match self {
            Self::Same(Hulls(known)) if let Some(Some(hull)) = known.get(index) => Ok(hull.clone()),
            Self::Kept(kept) if let Some(Some(surface)) = kept.get(index) => Hull::from_surface(&mesh.vertices, surface).map(Arc::new),
            _ => mesh.hull().map(Arc::new),
        }
    }
}

impl Hulls {
    /// Stores the convex hull of the mesh with the index `index`, unless it is stored already. The hull comes from `source`.
    ///
    /// # Errors
    /// [`HullError`] if the mesh has no hull, or if the hull in a model file is not the hull of the mesh.
    pub(super) fn store(&mut self, index: usize, mesh: &Mesh, source: Source<'_>) -> Result<(), HullError> {
        if self.0.len() <= index {
            self.0.resize(index + 1, None);
        }
        if self.0[index].is_none() {
            self.0[index] = Some(source.hull(index, mesh)?);
        }
        Ok(())
    }

    /// Triangles of the convex hull of each mesh, as stored in a model file; `None` for meshes without a hull.
    pub(super) fn surfaces(&self) -> Surfaces {
        self.0.iter().map(|hull| hull.as_ref().map(|hull| hull.surface())).collect()
    }
}

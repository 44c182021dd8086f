//! Convex hulls of a model's meshes, computed once and shared by all copies of the model.

use std::sync::Arc;

use stepper_geometry::{Hull, HullError};

use crate::asset::Mesh;
use crate::description::Description;
use crate::shape::Shape;

/// Convex hulls by mesh, for meshes that something can touch as their hull.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Hulls(pub(super) Vec<Option<Arc<Hull>>>);

/// Surfaces of hulls by mesh, as triangles of its vertices. A file stores these of [`Hulls`].
pub(super) type Surfaces = Vec<Option<Vec<[u32; 3]>>>;

/// Source of hulls in the check of a description.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source<'a> {
    /// Computation from the vertices.
    Vertices,
    /// Model with the same meshes. Hulls that it lacks are computed from the vertices.
    Same(&'a Hulls),
    /// File, whose hulls are checked. Hulls that it lacks are computed from the vertices.
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
    /// Finds or computes the hull of a mesh.
    ///
    /// # Errors
    /// [`HullError`] if the mesh has no hull, or that of a file is wrong.
    pub(super) fn get_or_make(&mut self, index: usize, mesh: &Mesh, source: Source<'_>) -> Result<(), HullError> {
        if self.0.len() <= index {
            self.0.resize(index + 1, None);
        }
        if self.0[index].is_none() {
            self.0[index] = Some(source.hull(index, mesh)?);
        }
        Ok(())
    }

    /// Triangles of all convex hulls by mesh, which a model file stores. `None` for meshes without a hull.
    pub(super) fn surfaces(&self) -> Surfaces {
        self.0.iter().map(|hull| hull.as_ref().map(|hull| hull.surface())).collect()
    }
}

impl Description {
    /// Index of the mesh of a geom's shape.
    pub(super) fn mesh_index(&self, shape: &Shape) -> Option<usize> {
        match shape {
            Shape::Mesh { asset, .. } => self.meshes.iter().position(|m| m.name == *asset),
            _ => None,
        }
    }
}

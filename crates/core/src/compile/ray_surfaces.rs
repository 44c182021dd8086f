//! Cache of the meshes and height fields that rays hit, so that each is created once.

use std::collections::BTreeMap;
use std::sync::Arc;

use stepper_geometry::{Grid, RaySurface};

use crate::model::{HeightField, Model, Shape};

/// Cache of ray surfaces, by the name of their mesh or height field.
#[derive(Clone, Debug, Default)]
pub struct RaySurfaces {
    meshes: BTreeMap<String, Arc<RaySurface>>,
    fields: BTreeMap<String, Arc<RaySurface>>,
}

impl RaySurfaces {
    /// Returns the ray surface of a shape, from the cache or new. `None` for a simple shape, and for a mesh or height field that the model
    /// does not contain.
    ///
    /// Rays hit the triangles of a mesh, even if contacts use its hull. If a mesh has no triangles, rays hit its hull.
    pub(crate) fn get_or_make(&mut self, model: &Model, shape: &Shape) -> Option<Arc<RaySurface>> {
        let (known, name) = match shape {
            Shape::Mesh { asset, .. } => (&mut self.meshes, asset),
            Shape::HeightField { asset } => (&mut self.fields, asset),
            _ => return None,
        };
        if !known.contains_key(name) {
            known.insert(name.clone(), Arc::new(surface(model, shape)?));
        }
        known.get(name).cloned()
    }
}

fn surface(model: &Model, shape: &Shape) -> Option<RaySurface> {
    if let Some(field) = model.height_field_of(shape) {
        let HeightField { shape, half, elevation, base, .. } = field.clone();
        return Some(RaySurface::field(Grid::new(shape, half, elevation, base)));
    }
    let mesh = model.mesh_of(shape)?;
    if !mesh.faces.is_empty() {
        return Some(RaySurface::mesh(&mesh.vertices, &mesh.faces));
    }
    match model.hull_of(shape) {
        Some(hull) => Some(RaySurface::hull(hull)),
        None => mesh.hull().ok().map(|hull| RaySurface::hull(&hull)),
    }
}

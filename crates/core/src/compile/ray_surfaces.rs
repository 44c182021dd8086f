//! Surfaces of meshes and height fields that rays hit, each created once.

use std::collections::BTreeMap;
use std::sync::Arc;

use stepper_geometry::{Grid, RaySurface};

use crate::model::{HeightField, Model, Shape};

/// Surfaces by the name of their mesh or height field.
#[derive(Clone, Debug, Default)]
pub struct RaySurfaces {
    meshes: BTreeMap<String, Arc<RaySurface>>,
    fields: BTreeMap<String, Arc<RaySurface>>,
}

impl RaySurfaces {
    /// Surface of a shape, cached or new; `None` for a simple shape, or one without a form in the model.
    ///
    /// The surface of a mesh is its triangles, also if contacts use its hull. Without triangles it is the hull.
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

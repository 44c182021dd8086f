//! Checks of meshes and height fields.

use std::collections::BTreeSet;

use crate::finish::element::{Checked, Element};
use crate::hulls::Hulls;
use crate::{Description, Filter, HeightField, Mesh, ModelError, Shape};

/// Checks all meshes and height fields. Returns the convex hulls that are collision shapes of geoms that can touch other geoms.
pub(super) fn check(model: &Description, reusable: &Hulls) -> Result<Hulls, ModelError> {
    model.meshes.iter().enumerate().try_for_each(|(i, m)| mesh(m, i))?;
    model.height_fields.iter().enumerate().try_for_each(|(i, h)| height_field(h, i))?;
    let has_asset = |g: usize| matches!(model.geoms[g].shape, Shape::Mesh { .. } | Shape::HeightField { .. });
    if !(0..model.geoms.len()).any(has_asset) {
        return Ok(Hulls::default());
    }
    // Geoms that touch nothing need no asset: meshes for visualization may be missing.
    let filter = Filter::new(model);
    let used: BTreeSet<usize> = filter.colliding(has_asset).into_iter().flatten().filter(|&g| has_asset(g)).collect();
    let mut hulls = Hulls::default();
    used.into_iter().try_for_each(|g| form(model, g, &mut hulls, reusable))?;
    Ok(hulls)
}

fn mesh(mesh: &Mesh, index: usize) -> Checked {
    let at = Element::new("mesh", &mesh.name, index);
    if let Some(v) = mesh.vertices.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
        return at.fail(format!("vertex {v} is {:?}", mesh.vertices[v]), "give finite numbers");
    }
    let n = mesh.vertices.len();
    match mesh.faces.iter().position(|f| f.iter().any(|&v| v as usize >= n)) {
        Some(f) => at.fail(format!("face {f} is {:?}, with {n} vertices", mesh.faces[f]), "give indices of its vertices, from 0"),
        None => Ok(()),
    }
}

fn height_field(field: &HeightField, index: usize) -> Checked {
    let at = Element::new("height field", &field.name, index);
    let [rows, columns] = field.shape;
    at.fail_if(rows < 2 || columns < 2, format_args!("it has {rows} rows and {columns} columns"), "give at least 2 of each")?;
    at.length("elevation", &field.elevation, rows * columns, "rows times columns")?;
    at.positive("half extent", &field.half, " m")?;
    at.size("base", &[field.base], " m")
}

/// Checks the mesh or height field of the geom with the index `index`, which can touch other geoms. Adds the convex hull of a mesh to
/// `hulls`.
fn form(model: &Description, index: usize, hulls: &mut Hulls, reusable: &Hulls) -> Checked {
    let geom = &model.geoms[index];
    let at = Element::new("geom", &geom.name, index);
    match &geom.shape {
        Shape::HeightField { asset } if model.height_field_of(&geom.shape).is_none() => {
            at.fail(format!("refers to height field {asset:?}, which does not exist"), "add it to the model's height fields")
        }
        Shape::Mesh { asset, concave } => {
            let Some(mesh) = model.mesh_index(&geom.shape) else {
                return at.fail(format!("refers to mesh {asset:?}, which does not exist"), "add it to the model's meshes");
            };
            let of_mesh = |what: String, remedy: &str| at.fail(format!("mesh {asset:?}: {what}"), remedy);
            if *concave {
                let none = model.meshes[mesh].faces.is_empty();
                return if none { of_mesh("it has no faces".into(), "give its triangles, or set geom_concave to 0") } else { Ok(()) };
            }
            match hulls.store(mesh, &model.meshes[mesh], reusable) {
                Err(e) => of_mesh(format!("{e}, so it has no convex hull"), "give it at least four points that span a volume"),
                Ok(()) => Ok(()),
            }
        }
        _ => Ok(()),
    }
}

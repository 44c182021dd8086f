//! Assets of geoms: meshes and height fields.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use stepper_geometry::{Hull, HullError};

use crate::MassProperties;

/// Triangle mesh in the frame of the geoms that use it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Name by which geoms refer to the mesh.
    pub name: String,
    /// Vertices, m.
    pub vertices: Vec<[f64; 3]>,
    /// Vertex indices of the triangles, counter-clockwise seen from outside. The list may be empty if only the convex hull is used.
    pub faces: Vec<[u32; 3]>,
}

/// Height field: a surface of triangles over a grid in the xy plane of the geom.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeightField {
    /// Name by which geoms refer to the height field.
    pub name: String,
    /// Number of rows and of columns of the grid: number of grid points along y, and along x.
    pub shape: [usize; 2],
    /// Half sizes along x and y, m.
    pub half: [f64; 2],
    /// Heights of the grid points above the geom's origin, m: row by row from the lowest y to the highest. Each row runs from the lowest x
    /// to the highest.
    pub elevation: Vec<f64>,
    /// Thickness of the solid below the geom's origin, m.
    pub base: f64,
}

impl Mesh {
    /// Computes the convex hull of the vertices. A finished model stores the hulls that its geoms collide with, see
    /// [`Model::hull_of`](crate::Model::hull_of).
    ///
    /// # Errors
    /// [`HullError`] if the vertices span no volume.
    pub fn hull(&self) -> Result<Hull, HullError> {
        Hull::new(&self.vertices)
    }

    /// Radius of the ball about the mesh's origin that contains the mesh, m.
    pub fn radius(&self) -> f64 {
        self.vertices.iter().map(|v| Vector3::from(*v).norm()).fold(0.0, f64::max)
    }

    /// Mass properties of the convex hull with the uniform density `density`, kg/m^3; `None` if the hull has no volume.
    pub fn mass_properties(&self, density: f64) -> Option<MassProperties> {
        Some(solid(&self.hull().ok()?, density))
    }
}

/// Mass properties of a solid polyhedron, as a sum of tetrahedra from an inner point to the triangles of its surface. The second moment of
/// a tetrahedron with corners 0, a, b, c about 0 is volume/20 (s s^T + a a^T + b b^T + c c^T) with s = a + b + c.
fn solid(hull: &Hull, density: f64) -> MassProperties {
    let com = Vector3::from(hull.centre());
    let (mut volume, mut second) = (0.0, Matrix3::zeros());
    for t in hull.triangles() {
        let [a, b, c] = t.map(|i| Vector3::from(hull.points()[i as usize]) - com);
        let part = a.dot(&b.cross(&c)) / 6.0;
        let s = a + b + c;
        volume += part;
        second += (s * s.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (part / 20.0);
    }
    let inertia = Matrix3::identity() * second.trace() - second;
    MassProperties { mass: volume * density, com, inertia: inertia * density }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    #[test]
    fn a_mesh_of_a_box_weighs_what_the_box_does() {
        let half = [0.5, 0.2, 0.1];
        let corner = |k: usize| std::array::from_fn(|i| 0.3 * i as f64 + if k >> i & 1 == 1 { half[i] } else { -half[i] });
        let mesh = Mesh { name: "box".into(), vertices: (0..8).map(corner).collect(), faces: vec![] };
        let found = mesh.mass_properties(1000.0).unwrap();
        let exact = MassProperties::solid(&Shape::Box { half }, 80.0).unwrap();
        assert!((found.mass - 80.0).abs() < 1e-11, "{}", found.mass);
        assert!((found.com - Vector3::new(0.0, 0.3, 0.6)).norm() < 1e-13);
        assert!((found.inertia - exact.inertia).norm() < 1e-11);
    }
}

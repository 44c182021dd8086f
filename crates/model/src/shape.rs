//! Shapes of geoms.

use serde::{Deserialize, Serialize};

named! {
    /// Shape of a geom, in the axes of the geom's frame.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub enum Shape {
        /// Half space z <= 0.
        #[default]
        Plane = "plane",
        /// Ball about the origin.
        Sphere {
            /// Radius, m.
            radius: f64,
        } = "sphere",
        /// Capsule: all points within the radius of a segment along z.
        Capsule {
            /// Radius, m.
            radius: f64,
            /// Half the length of the segment, m.
            half_length: f64,
        } = "capsule",
        /// Solid cylinder along z.
        Cylinder {
            /// Radius of the circular section, m.
            radius: f64,
            /// Half the length, m.
            half_length: f64,
        } = "cylinder",
        /// Ellipsoid with its axes along x, y, z.
        Ellipsoid {
            /// Semi-axes, m.
            radii: [f64; 3],
        } = "ellipsoid",
        /// Box with its edges along x, y, z.
        Box {
            /// Half sizes along x, y, z, m.
            half: [f64; 3],
        } = "box",
        /// Mesh, by default the convex hull of its vertices, as in MJCF.
        Mesh {
            /// Name of the [`Mesh`](crate::Mesh) in [`Description::meshes`](crate::Description::meshes).
            asset: String,
            /// Whether the shape is the surface of the mesh's triangles, including hollows, instead of the convex hull. Planes collide with
            /// the hull in both cases.
            concave: bool,
        } = "mesh",
        /// Height field: a surface of triangles over a grid in the xy plane.
        HeightField {
            /// Name of the [`HeightField`](crate::HeightField) in [`Description::height_fields`](crate::Description::height_fields).
            asset: String,
        } = "height field",
    }
}

impl Shape {
    /// Whether the shape collides as a surface of triangles: concave mesh or height field.
    pub const fn is_surface(&self) -> bool {
        matches!(self, Self::HeightField { .. } | Self::Mesh { concave: true, .. })
    }
}

//! Shapes of geoms.

use serde::{Deserialize, Serialize};

/// Shape of a geom, in the axes of the geom's frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// Half space z <= 0.
    #[default]
    Plane,
    /// Ball about the origin.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// Capsule: all points within the radius of a segment along z.
    Capsule {
        /// Radius, m.
        radius: f64,
        /// Half the length of the segment, m.
        half_length: f64,
    },
    /// Solid cylinder along z.
    Cylinder {
        /// Radius of the circular section, m.
        radius: f64,
        /// Half the length, m.
        half_length: f64,
    },
    /// Ellipsoid with its axes along x, y, z.
    Ellipsoid {
        /// Semi-axes, m.
        radii: [f64; 3],
    },
    /// Box with its edges along x, y, z.
    Box {
        /// Half sizes along x, y, z, m.
        half: [f64; 3],
    },
    /// Mesh, by default the convex hull of its vertices, as in MJCF.
    Mesh {
        /// Name of the [`Mesh`](crate::Mesh) in [`Description::meshes`](crate::Description::meshes).
        asset: String,
        /// Whether the shape is the surface of the mesh's triangles, including hollows, instead of the convex hull. Planes collide with the
        /// hull in both cases.
        concave: bool,
    },
    /// Height field: a surface of triangles over a grid in the xy plane.
    HeightField {
        /// Name of the [`HeightField`](crate::HeightField) in [`Description::height_fields`](crate::Description::height_fields).
        asset: String,
    },
}

impl Shape {
    /// Whether the shape collides as a surface of triangles: concave mesh or height field.
    pub const fn is_surface(&self) -> bool {
        matches!(self, Self::HeightField { .. } | Self::Mesh { concave: true, .. })
    }

    /// Name of the shape in MJCF.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Sphere { .. } => "sphere",
            Self::Capsule { .. } => "capsule",
            Self::Cylinder { .. } => "cylinder",
            Self::Ellipsoid { .. } => "ellipsoid",
            Self::Box { .. } => "box",
            Self::Mesh { .. } => "mesh",
            Self::HeightField { .. } => "height field",
        }
    }
}

//! The shapes of geoms.

use serde::{Deserialize, Serialize};

/// The shape of a geom; its axes are those of the geom's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// The half space z <= 0.
    Plane,
    /// A ball.
    Sphere {
        /// m
        radius: f64,
    },
    /// A segment along z, thickened.
    Capsule {
        /// m
        radius: f64,
        /// Half the length of the segment, m.
        half_length: f64,
    },
    /// A solid cylinder along z.
    Cylinder {
        /// m
        radius: f64,
        /// m
        half_length: f64,
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Semi-axes, m.
        radii: [f64; 3],
    },
    /// A box.
    Box {
        /// Half sizes, m.
        half: [f64; 3],
    },
    /// A mesh: the convex hull of its vertices, as MJCF means it.
    Mesh {
        /// Name of its [`Mesh`](crate::Mesh) in [`Description::meshes`](crate::Description::meshes).
        asset: String,
        /// Whether it is the surface of its triangles instead, hollows included. Planes see the hull of either.
        concave: bool,
    },
    /// A height field.
    HeightField {
        /// Name of its [`HeightField`](crate::HeightField) in
        /// [`Description::height_fields`](crate::Description::height_fields).
        asset: String,
    },
}

impl Shape {
    /// Whether it collides as triangles.
    pub const fn is_surface(&self) -> bool {
        matches!(self, Self::HeightField { .. } | Self::Mesh { concave: true, .. })
    }

    /// The field's word for it.
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

//! Solids that can collide: half spaces, convex shapes and surfaces of triangles.

use std::sync::Arc;

use crate::shape::ConvexShape;
use crate::surface::Surface;
use crate::vectors::V;

/// Solid that can collide.
#[derive(Clone, Debug)]
pub enum Solid {
    /// Half space below the xy plane of its frame.
    HalfSpace,
    /// Convex shape.
    Convex(ConvexShape),
    /// Mesh or height field. It may be large, and is shared.
    Surface(Arc<Surface>),
}

impl Solid {
    /// Whether the solid is the convex hull of points.
    #[inline]
    pub fn is_hull(&self) -> bool {
        matches!(self, Self::Convex(shape) if shape.is_hull())
    }

    /// Whether the solid is a height field.
    #[inline]
    pub fn is_field(&self) -> bool {
        matches!(self, Self::Surface(surface) if matches!(**surface, Surface::Grid(_)))
    }

    /// Size of a pair of convex hulls, m: the sum of their bounding radii. `None` if either solid is not a hull.
    #[inline]
    pub fn size_of_hulls(solids: [&Self; 2]) -> Option<f64> {
        match solids {
            [Self::Convex(a @ ConvexShape::Hull(_)), Self::Convex(b @ ConvexShape::Hull(_))] => Some(a.bound() + b.bound()),
            _ => None,
        }
    }

    /// Solid of the same type with another size in MuJoCo's order, m: radius and half length, semi-axes, or half sizes. `None` for solids
    /// without a size, such as hulls.
    pub fn sized(&self, size: V) -> Option<Self> {
        let [radius, half_length, _] = size;
        Some(Self::Convex(match self {
            Self::Convex(ConvexShape::Sphere { .. }) => ConvexShape::Sphere { radius },
            Self::Convex(ConvexShape::Capsule { .. }) => ConvexShape::Capsule { radius, half_length },
            Self::Convex(ConvexShape::Cylinder { .. }) => ConvexShape::Cylinder { radius, half_length },
            Self::Convex(ConvexShape::Ellipsoid { .. }) => ConvexShape::Ellipsoid { radii: size },
            Self::Convex(ConvexShape::Box { .. }) => ConvexShape::Box { half: size },
            Self::Convex(ConvexShape::Hull(_) | ConvexShape::Triangle(_)) | Self::HalfSpace | Self::Surface(_) => return None,
        }))
    }
}

//! Solids that can collide: half spaces, convex shapes and surfaces of triangles.

use std::sync::Arc;

use stepper_real::Real;

use crate::linear_algebra::*;
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

    /// Whether the solid is a box.
    #[inline]
    pub fn is_box(&self) -> bool {
        matches!(self, Self::Convex(ConvexShape::Box { .. }))
    }

    /// Whether the solid is a height field.
    #[inline]
    pub fn is_field(&self) -> bool {
        matches!(self, Self::Surface(surface) if matches!(**surface, Surface::Grid(_)))
    }

    /// Numbers that [`SeparatingPlanes::separated_lanes`](crate::SeparatingPlanes::separated_lanes) needs of two solids: the half sizes of
    /// the first if it is a box, m, zeros if it is a hull; and the sum of the bounding radii, m. `None` for pairs without a separating
    /// plane: the second solid must be a hull, and the first a hull or box.
    ///
    /// `size` is the size of the first solid, m, which may differ between lanes.
    #[inline(always)]
    pub fn sizes_for_plane<R: Real>(solids: [&Self; 2], size: V3<R>) -> Option<(V3<R>, R)> {
        let [Self::Convex(a), Self::Convex(b @ ConvexShape::Hull(_))] = solids else { return None };
        match a {
            ConvexShape::Hull(_) => Some(([R::zero(); 3], R::of(a.bound() + b.bound()))),
            ConvexShape::Box { .. } => Some((size, norm(size) + R::of(b.bound()))),
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

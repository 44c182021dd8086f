//! Collision functions (kernels) for pairs of shapes. Two shapes without a collision function pass through each other.

use crate::Shape;

/// Collision function of the narrow phase for a pair of shapes. Each variant names the shapes and their contact points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Half space and ball: one contact point.
    PlaneSphere,
    /// Half space and capsule: contact points at the two ends of the capsule.
    PlaneCapsule,
    /// Half space and box: contact points at the eight corners of the box.
    PlaneBox,
    /// Half space and cylinder: four contact points on each of the two rims, at quarter turns from the lowest point.
    PlaneCylinder,
    /// Half space and ellipsoid: one contact point.
    PlaneEllipsoid,
    /// Ball and box: one contact point.
    SphereBox,
    /// Ball and cylinder: one contact point.
    SphereCylinder,
    /// Ball and ellipsoid: one contact point.
    SphereEllipsoid,
    /// Capsule and box: up to 2 contact points.
    CapsuleBox,
    /// Two balls or capsules: up to 2 contact points. A ball is a capsule of length 0.
    Segments,
    /// Convex shape and surface of triangles (concave mesh, height field): up to 16 contact points. The function runs for one environment
    /// at a time.
    Surface,
    /// Other pairs of convex shapes, or half space and mesh: up to 8 contact points. The function runs for one environment at a time.
    Convex,
}

impl Kernel {
    /// Largest number of contact points of two shapes.
    #[inline]
    pub const fn points(self) -> usize {
        match self {
            Self::PlaneSphere | Self::PlaneEllipsoid | Self::SphereBox | Self::SphereCylinder | Self::SphereEllipsoid => 1,
            Self::PlaneCapsule | Self::CapsuleBox | Self::Segments => 2,
            Self::PlaneBox | Self::PlaneCylinder => 8,
            Self::Surface => stepper_geometry::MAX_SURFACE_POINTS,
            Self::Convex => stepper_geometry::MAX_POINTS,
        }
    }

    /// Collision function of two shapes; `None` if stepper has no function for them. The shapes are in the order of
    /// [`Description::collision_pairs`](crate::Description::collision_pairs).
    pub fn of(a: &Shape, b: &Shape) -> Option<Self> {
        match (a, b) {
            (Shape::Plane, Shape::Sphere { .. }) => Some(Self::PlaneSphere),
            (Shape::Plane, Shape::Capsule { .. }) => Some(Self::PlaneCapsule),
            (Shape::Plane, Shape::Box { .. }) => Some(Self::PlaneBox),
            (Shape::Plane, Shape::Cylinder { .. }) => Some(Self::PlaneCylinder),
            (Shape::Plane, Shape::Ellipsoid { .. }) => Some(Self::PlaneEllipsoid),
            (Shape::Sphere { .. }, Shape::Box { .. }) => Some(Self::SphereBox),
            (Shape::Sphere { .. }, Shape::Cylinder { .. }) => Some(Self::SphereCylinder),
            (Shape::Sphere { .. }, Shape::Ellipsoid { .. }) => Some(Self::SphereEllipsoid),
            (Shape::Capsule { .. }, Shape::Box { .. }) => Some(Self::CapsuleBox),
            (Shape::Sphere { .. } | Shape::Capsule { .. }, Shape::Sphere { .. } | Shape::Capsule { .. }) => Some(Self::Segments),
            (_, Shape::Plane | Shape::HeightField { .. }) => None,
            (Shape::Plane, _) => Some(Self::Convex),
            _ => match (a.is_surface(), b.is_surface()) {
                (true, true) => None,
                (false, false) => Some(Self::Convex),
                _ => Some(Self::Surface),
            },
        }
    }
}

//! Narrow-phase functions by pair of shapes. Pairs without one cannot touch.

use crate::Shape;

/// Narrow-phase function of a pair of shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Half space and ball: 1 point.
    PlaneSphere,
    /// Half space and capsule: its two ends.
    PlaneCapsule,
    /// Half space and box: its eight corners.
    PlaneBox,
    /// Half space and cylinder: the lowest points of its rims, and those at quarter turns from them.
    PlaneCylinder,
    /// Half space and ellipsoid: 1 point.
    PlaneEllipsoid,
    /// Ball and box: 1 point.
    SphereBox,
    /// Ball and cylinder: 1 point.
    SphereCylinder,
    /// Ball and ellipsoid: 1 point.
    SphereEllipsoid,
    /// Capsule and box: up to 2 points.
    CapsuleBox,
    /// Two balls or capsules, as segments of any length: up to 2 points.
    Segments,
    /// Convex shape and surface of triangles (concave mesh, height field), lane by lane: up to 16 points.
    Surface,
    /// Other convex shapes, lane by lane: up to 5 points.
    Convex,
}

impl Kernel {
    /// Largest number of contacts of a pair.
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

    /// Narrow-phase function of two shapes in the order of [`Description::collision_pairs`](crate::Description::collision_pairs); `None` if
    /// there is none yet.
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

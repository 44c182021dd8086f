//! Which narrow-phase function serves which pair of shapes: the one list of what can touch.

use crate::Shape;

/// The narrow-phase function of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// A half space and a ball: 1 point.
    PlaneSphere,
    /// A half space and a capsule: its two ends.
    PlaneCapsule,
    /// A half space and a box: its eight corners.
    PlaneBox,
    /// A half space and a cylinder: the lowest points of its rims and those at quarter turns from them.
    PlaneCylinder,
    /// A half space and an ellipsoid: 1 point.
    PlaneEllipsoid,
    /// A ball and a box: 1 point.
    SphereBox,
    /// A ball and a cylinder: 1 point.
    SphereCylinder,
    /// A ball and an ellipsoid: 1 point.
    SphereEllipsoid,
    /// A capsule and a box: up to 2 points.
    CapsuleBox,
    /// Two balls, or capsules taken as segments of any length: up to 2 points.
    Segments,
    /// A convex shape and a surface of triangles (concave mesh, height field), lane by lane: up to 16 points.
    Surface,
    /// Convex shapes without a kernel of their own, lane by lane: up to 5 points.
    Convex,
}

impl Kernel {
    /// Contacts that a pair can have.
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

    /// The kernel of two shapes in the order of [`Description::collision_pairs`](crate::Description::collision_pairs); `None` when
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

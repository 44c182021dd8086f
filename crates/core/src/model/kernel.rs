//! Which narrow-phase function serves which pair of shapes: the one list of what can touch.

use super::Shape;

/// The narrow-phase function of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// A half space and a ball: 1 point.
    PlaneSphere,
    /// A half space and a capsule: its two ends.
    PlaneCapsule,
    /// A half space and a box: its eight corners.
    PlaneBox,
    /// Two balls, or capsules taken as segments of any length: up to 2 points.
    Segments,
}

impl Kernel {
    /// Contacts that a pair can have.
    pub const fn points(self) -> usize {
        match self {
            Self::PlaneSphere => 1,
            Self::PlaneCapsule | Self::Segments => 2,
            Self::PlaneBox => 8,
        }
    }

    /// The kernel of two shapes in the order of [`Model::collision_pairs`](super::Model::collision_pairs); `None` when there is none yet.
    pub fn of(a: &Shape, b: &Shape) -> Option<Self> {
        match (a, b) {
            (Shape::Plane, Shape::Sphere { .. }) => Some(Self::PlaneSphere),
            (Shape::Plane, Shape::Capsule { .. }) => Some(Self::PlaneCapsule),
            (Shape::Plane, Shape::Box { .. }) => Some(Self::PlaneBox),
            (Shape::Sphere { .. } | Shape::Capsule { .. }, Shape::Sphere { .. } | Shape::Capsule { .. }) => Some(Self::Segments),
            _ => None,
        }
    }
}

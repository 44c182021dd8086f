//! Bounding boxes of solids, over lanes. Two solids are apart if a face of a bounding box separates the boxes.

use stepper_real::Real;

use crate::approach::COORDINATE_ROUNDING;
use crate::linear_algebra::*;
use crate::shape::ConvexShape;
use crate::solid::Solid;
use crate::surface::Surface;

/// Bounding box of a solid along the axes of the solid's frame, one in each lane.
#[derive(Clone, Copy, Debug)]
pub struct BoundingBox<R> {
    /// Centre of the box in the solid's frame, m.
    centre: V3<R>,
    /// Half sizes of the box along the axes of the solid's frame, m.
    half: V3<R>,
}

impl<R: Real> BoundingBox<R> {
    /// Bounding box of a solid, which may have another size in every lane.
    ///
    /// `size` is the size in MuJoCo's order, m: radius and half length, semi-axes, or half sizes. `size` has no effect on meshes and hulls.
    /// `None` for half spaces, height fields and triangles.
    #[inline(always)]
    pub fn new(solid: &Solid, size: V3<R>) -> Option<Self> {
        let [radius, half_length, _] = size;
        let shape = match solid {
            Solid::Convex(shape) => shape,
            Solid::Surface(surface) => match &**surface {
                Surface::Mesh(mesh) => {
                    return Some(Self::between(mesh.extent));
                }
                // A height field is solid down to its base, so that a box around its triangles would not contain it.
                Surface::Grid(_) => return None,
            },
            Solid::HalfSpace => return None,
        };
        let (centre, half) = match shape {
            ConvexShape::Sphere { .. } => (zero(), [radius; 3]),
            ConvexShape::Capsule { .. } => (zero(), [radius, radius, radius + half_length]),
            ConvexShape::Cylinder { .. } => (zero(), [radius, radius, half_length]),
            ConvexShape::Ellipsoid { .. } | ConvexShape::Box { .. } => (zero(), size),
            ConvexShape::Hull(hull) => return Some(Self::between(hull.extent)),
            ConvexShape::Triangle(_) => return None,
        };
        Some(Self { centre, half })
    }

    /// Box between two opposite corners, the same in every lane.
    #[inline(always)]
    fn between([least, most]: [[f64; 3]; 2]) -> Self {
        let [x, y, z] = scale(add(most, least), 0.5);
        let [width, depth, height] = scale(sub(most, least), 0.5);
        Self { centre: [R::of(x), R::of(y), R::of(z)], half: [R::of(width), R::of(depth), R::of(height)] }
    }

    /// Bounding box of a convex solid along the axes of the world: centre relative to the origin of the solid's frame, and half sizes, m.
    /// `None` for other solids.
    ///
    /// `mat` is the orientation of the solid. Only its last axis is used for capsules, and none for balls. `size` is the size of the solid
    /// in MuJoCo's order, m, as in [`Self::new`].
    #[inline(always)]
    pub fn along_world(solid: &Solid, size: V3<R>, mat: &M3<R>) -> Option<[V3<R>; 2]> {
        let Solid::Convex(shape) = solid else { return None };
        let [radius, half_length, _] = size;
        match shape {
            ConvexShape::Sphere { .. } => Some([zero(), [radius; 3]]),
            ConvexShape::Capsule { .. } => {
                let axis = column(mat, 2);
                Some([zero(), array!(|k| axis[k].abs() * half_length + radius)])
            }
            _ => {
                let Self { centre, half } = Self::new(solid, size)?;
                let reach = array!(|k| mat[3 * k].abs() * half[0] + mat[3 * k + 1].abs() * half[1] + mat[3 * k + 2].abs() * half[2]);
                Some([rotate(mat, centre), reach])
            }
        }
    }

    /// Lanes in which a face of one of two boxes separates them by more than `reach`, m.
    ///
    /// `apart` is the vector from the origin of this box's frame to the origin of the other box's frame, in the world, m. `mats` are the
    /// orientations of both frames. The test uses the separating axes of Gottschalk, Lin & Manocha (1996) without the nine that are
    /// perpendicular to two edges.
    #[inline(always)]
    pub fn is_beyond(&self, other: &Self, apart: V3<R>, mats: [&M3<R>; 2], reach: R) -> R::Mask {
        let d = sub(rotate_back(mats[0], add(apart, rotate(mats[1], other.centre))), self.centre);
        let (mut gap, mut length) = (-reach, R::zero());
        let mut across = self.half;
        let mut axes = [[R::zero(); 3]; 3];
        for j in 0..3 {
            axes[j] = rotate_back(mats[0], column(mats[1], j));
            let width = axes[j][0].abs() * self.half[0] + axes[j][1].abs() * self.half[1] + axes[j][2].abs() * self.half[2];
            gap = gap.max(dot(d, axes[j]).abs() - (width + other.half[j]));
            for i in 0..3 {
                across[i] += axes[j][i].abs() * other.half[j];
            }
        }
        for i in 0..3 {
            gap = gap.max(d[i].abs() - across[i]);
            length += d[i].abs() + across[i];
        }
        gap.gt(reach + R::of(COORDINATE_ROUNDING) * length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Hull;
    use crate::narrow::Narrow;
    use crate::vectors::Pose;
    use proptest::prelude::*;

    fn solid() -> impl Strategy<Value = Solid> {
        let size = || prop::array::uniform3(0.02..0.3f64);
        prop_oneof![
            size().prop_map(|[radius, half_length, _]| ConvexShape::Capsule { radius, half_length }),
            size().prop_map(|[radius, half_length, _]| ConvexShape::Cylinder { radius, half_length }),
            size().prop_map(|radii| ConvexShape::Ellipsoid { radii }),
            size().prop_map(|half| ConvexShape::Box { half }),
            prop::collection::vec(prop::array::uniform3(-0.3..0.3f64), 6..12)
                .prop_filter_map("flat", |points| Hull::new(&points).ok().map(|hull| ConvexShape::Hull(hull.into()))),
        ]
        .prop_map(Solid::Convex)
    }

    fn size_of(solid: &Solid) -> [f64; 3] {
        match solid {
            Solid::Convex(ConvexShape::Capsule { radius, half_length } | ConvexShape::Cylinder { radius, half_length }) => {
                [*radius, *half_length, 0.0]
            }
            Solid::Convex(ConvexShape::Ellipsoid { radii: size } | ConvexShape::Box { half: size }) => *size,
            _ => [0.0; 3],
        }
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (prop::array::uniform3(-0.6..0.6f64), prop::array::uniform4(-1.0..1.0f64)).prop_filter_map("no rotation", |(pos, quat)| {
            let length = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
            (length > 0.1).then(|| Pose { pos, mat: quat_to_mat(quat.map(|x| x / length)) })
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn what_is_beyond_has_no_contact((a, b) in (solid(), solid()), (at, bt) in (pose(), pose()), reach in 0.0..0.1f64) {
            let boxes = [&a, &b].map(|solid| BoundingBox::<f64>::new(solid, size_of(solid)).unwrap());
            let beyond = boxes[0].is_beyond(&boxes[1], sub(bt.pos, at.pos), [&at.mat, &bt.mat], reach);
            let mut narrow = Narrow::default();
            prop_assert!(!beyond || narrow.collide([&a, &b], [at, bt], reach).points.is_empty());
        }
    }
}

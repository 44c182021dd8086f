//! Contact points of two solids.

use crate::boxes;
use crate::facing::Facing;
use crate::linear_algebra::*;
use crate::manifold::Manifold;
use crate::narrow::Narrow;
use crate::pair::Pair;
use crate::search_limits::{CachedNormal, SearchLimits};
use crate::separating_plane::SeparatingPlane;
use crate::separation;
use crate::shape::{ConvexShape, POINT};
use crate::solid::Solid;
use crate::vectors::{Pose, unit_or};

impl Narrow {
    /// Finds the contact points of two solids, in the world frame. Points at a distance of more than `limits.max_distance` are left out.
    /// With `limits.approach`, contacts that cannot push within the step may be absent. Normals point from the first solid to the second.
    ///
    /// Two convex shapes have at most [`MAX_POINTS`](crate::MAX_POINTS), a surface and another solid at most
    /// [`MAX_SURFACE_POINTS`](crate::MAX_SURFACE_POINTS).
    ///
    /// A half space must be the first solid. `limits.approach` is the motion of the second solid in the frame of the first. If one solid is
    /// a surface, it is the motion of the convex shape in the frame of the surface.
    pub fn collide(&mut self, solids: [&Solid; 2], poses: [Pose; 2], limits: impl Into<SearchLimits>) -> &Manifold {
        let limits = limits.into();
        self.found.clear();
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => self.collide_convex(a, &poses[0], b, &poses[1], limits),
            [Solid::HalfSpace, Solid::Convex(b)] => self.collide_half_space(&poses[0], b, &poses[1], &limits),
            [Solid::Surface(a), Solid::Convex(b)] => self.collide_surface(a, &poses[0], b, &poses[1], &limits),
            [Solid::Convex(a), Solid::Surface(b)] => {
                self.collide_surface(b, &poses[1], a, &poses[0], &limits);
                self.found.flip_normals();
            }
            [Solid::HalfSpace, Solid::Surface(b)] => self.collide_half_space_and_surface(&poses[0], b, &poses[1], &limits),
            [_, Solid::Surface(_)] => unreachable!("a surface meets convex shapes"),
            [_, Solid::HalfSpace] => unreachable!("a half space comes first, and two never meet"),
        }
        &self.found
    }

    /// Finds the contact points of two convex shapes.
    fn collide_convex(&mut self, a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose, mut limits: SearchLimits) {
        let Self { clipper, polytope, found: out, .. } = self;
        let max_distance = limits.max_distance;
        let pair = Pair::new(a, pose_a, b, pose_b).rounded(limits.epsilon, pose_a, pose_b);
        if !pair.is_near(max_distance) {
            return;
        }
        if let (ConvexShape::Box { half: ha }, ConvexShape::Box { half: hb }) = (a, b) {
            let Some(by_axes) = boxes::separation(&pair, *ha, *hb, max_distance) else { return };
            if let Some(found) = by_axes {
                clipper.manifold(&pair, &Facing::new(&pair, found), &limits, out);
                // The face's normal gives the exact distance if a feature of the other box is above the face.
                if found.separation <= 0.0 || (!out.is_single_unnamed() && out.deepest() <= found.separation + 1e-9 * pair.size) {
                    out.move_to_world(pose_a);
                    return;
                }
                out.clear();
            }
        }
        limits.cached = limits.cached.map(|cached| CachedNormal { normal: unit_or(cached.normal, [0.0, 0.0, 1.0]), ..cached });
        let facing = separation::nearest(&pair, &limits, polytope);
        if !limits.excludes_contact(&pair, &facing.found) {
            clipper.manifold(&pair, &facing, &limits, out);
            out.move_to_world(pose_a);
        }
        if pair.polyhedra().is_some() {
            let spare = limits.approach.map_or(0.0, |a| a.spare_gap(facing.found.normal, facing.found.separation, pair.size));
            out.separating_plane = Some(SeparatingPlane::new(&pair, &facing, spare));
        }
    }

    /// Finds the contact points of a half space and a convex shape. The half space is below the xy plane of the pose `plane`. Normals
    /// point out of the half space.
    fn collide_half_space(&mut self, plane: &Pose, shape: &ConvexShape, pose: &Pose, limits: &SearchLimits) {
        let pair = Pair::new(&POINT, plane, shape, pose);
        self.clipper.half_space(&pair, limits, &mut self.found);
        self.found.move_to_world(plane);
    }
}

/// Signed distance of two convex shapes, m, and the unit normal from the first to the second in the world frame. The distance of
/// overlapping shapes is minus the penetration depth. Tests compare it with contacts.
pub fn distance(a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose) -> (f64, V3<f64>) {
    separation::signed_distance(&Pair::new(a, pose_a, b, pose_b), pose_a, &mut Default::default())
}

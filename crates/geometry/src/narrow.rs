//! Contact points of two solids.

use crate::boxes;
use crate::cached_normal::CachedNormal;
use crate::facing::Facing;
use crate::manifold::{Manifold, Point, Reach};
use crate::pair::Pair;
use crate::search_limits::SearchLimits;
use crate::separating_plane::SeparatingPlane;
use crate::separation;
use crate::shape::ConvexShape;
use crate::solid::Solid;
use crate::surface::{self, collide_surface};
use crate::vectors::{Pose, unit_or};
use crate::workspace::Workspace;

/// Narrow phase of collision detection: finds the contact points of pairs of solids. It contains its workspace and the result of the last
/// call.
#[derive(Clone, Debug, Default)]
pub struct Narrow {
    /// Buffers that are reused for every pair of solids.
    pub(super) workspace: Workspace,
    /// Contact points of the last pair of solids.
    pub(super) found: Manifold,
}

impl Narrow {
    /// Narrow phase with enough memory for pairs of these solids. Later calls allocate only if a shape touches very many triangles of a
    /// surface.
    pub fn for_solids<'a>(solids: impl Iterator<Item = &'a Solid>) -> Self {
        let corners = solids.map(|s| if let Solid::Convex(shape) = s { shape.corners() } else { 0 }).max().unwrap_or(0);
        let mut narrow = Self::default();
        if corners > 0 {
            narrow.workspace.clipper.reserve(corners);
            narrow.workspace.polytope.reserve();
            narrow.workspace.triangles.reserve(256);
            narrow.workspace.all.reserve(256);
            narrow.workspace.owners.reserve(256);
            narrow.workspace.is_own.reserve(256);
            narrow.found.points.reserve(256);
        }
        narrow
    }

    /// Finds the contact points of two solids. Points at a distance of more than `limits.max_distance` are left out. If the second solid
    /// is a hull, and the first a hull or box near it, the second value is their separating plane, see [`Manifold::separating_plane`].
    ///
    /// A half space must be the first solid. `limits.approach` is the motion of the second solid in the frame of the first. If one solid is
    /// a surface, it is the motion of the convex shape in the frame of the surface.
    pub fn collide(&mut self, solids: [&Solid; 2], poses: [Pose; 2], limits: SearchLimits) -> (&[Point], Option<SeparatingPlane>) {
        let Self { workspace, found } = self;
        let reach = limits.reach();
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => collide(a, &poses[0], b, &poses[1], limits, found, workspace),
            [Solid::HalfSpace, Solid::Convex(b)] => collide_plane(&poses[0], b, &poses[1], reach, found, workspace),
            [Solid::Surface(a), Solid::Convex(b)] => collide_surface(a, &poses[0], b, &poses[1], limits, found, workspace),
            [Solid::Convex(a), Solid::Surface(b)] => {
                collide_surface(b, &poses[1], a, &poses[0], limits, found, workspace);
                found.flip_normals();
            }
            [Solid::HalfSpace, Solid::Surface(b)] => surface::collide_plane_surface(&poses[0], b, &poses[1], reach, found, workspace),
            [_, Solid::Surface(_)] => unreachable!("a surface meets convex shapes"),
            [_, Solid::HalfSpace] => unreachable!("a half space comes first, and two never meet"),
        }
        (&found.points, found.separating_plane)
    }
}

/// Finds the contact points of two convex shapes and writes them to `out`, in the world frame. There are none if the shapes are farther
/// apart than `limits.max_distance`. With `limits.approach`, contacts that cannot push within the step may be absent.
///
/// There are at most [`MAX_POINTS`](crate::MAX_POINTS), in ascending order of [`Point::feature`]. Normals point from the first shape to the
/// second.
pub fn collide(
    a: &ConvexShape,
    pose_a: &Pose,
    b: &ConvexShape,
    pose_b: &Pose,
    limits: impl Into<SearchLimits>,
    out: &mut Manifold,
    workspace: &mut Workspace,
) {
    let mut limits = limits.into();
    let (max_distance, reach) = (limits.max_distance, limits.reach());
    out.clear();
    let pair = Pair::new(a, pose_a, b, pose_b).rounded(limits.epsilon, pose_a, pose_b);
    if !pair.is_near(max_distance) {
        return;
    }
    if let (ConvexShape::Box { half: ha }, ConvexShape::Box { half: hb }) = (a, b) {
        let Some(by_axes) = boxes::separation(&pair, *ha, *hb, max_distance) else { return };
        if let Some(found) = by_axes {
            workspace.clipper.manifold(&pair, &Facing::new(&pair, found), reach, out);
            // The face's normal gives the exact distance if a feature of the other box is above the face.
            if found.separation <= 0.0 || (!out.is_single_unnamed() && out.deepest() <= found.separation + 1e-9 * pair.size) {
                out.move_to_world(pose_a);
                return;
            }
            out.clear();
        }
    }
    limits.cached = limits.cached.map(|cached| CachedNormal { normal: unit_or(cached.normal, [0.0, 0.0, 1.0]), ..cached });
    let facing = separation::nearest(&pair, &limits, &mut workspace.polytope);
    if !limits.excludes_contact(&pair, &facing.found) {
        workspace.clipper.manifold(&pair, &facing, reach, out);
        out.move_to_world(pose_a);
    }
    out.separating_plane = pair.polyhedra().is_some().then(|| limits.separating_plane(&pair, &facing));
}

/// Finds the contact points of a half space and a convex shape and writes them to `out`, in the world frame.
///
/// The half space is below the xy plane of the pose `plane`. Only points within `reach` are added. Normals point out of the half space.
fn collide_plane(plane: &Pose, shape: &ConvexShape, pose: &Pose, reach: Reach, out: &mut Manifold, workspace: &mut Workspace) {
    out.clear();
    let pair = Pair::new(&ConvexShape::Sphere { radius: 0.0 }, plane, shape, pose);
    workspace.clipper.half_space(&pair, reach, out);
    out.move_to_world(plane);
}

//! Contact points of two solids.

use crate::boxes;
use crate::facing::Facing;
use crate::known::Known;
use crate::manifold::{Manifold, Point};
use crate::pair::Pair;
use crate::reach::Reach;
use crate::room::Room;
use crate::separating_plane::SeparatingPlane;
use crate::separation;
use crate::shape::ConvexShape;
use crate::solid::Solid;
use crate::surface::{self, collide_surface};
use crate::vectors::{Pose, unit_or};

/// Narrow phase: finds the contact points of pairs of solids. It contains its workspace and the result of the last call.
#[derive(Clone, Debug, Default)]
pub struct Narrow {
    pub(super) room: Room,
    pub(super) found: Manifold,
}

impl Narrow {
    /// Narrow phase with enough memory for these solids.
    ///
    /// Later calls allocate only if a shape touches very many triangles of a surface.
    pub fn for_solids<'a>(solids: impl Iterator<Item = &'a Solid>) -> Self {
        let corners = solids.map(|s| if let Solid::Convex(shape) = s { shape.corners() } else { 0 }).max().unwrap_or(0);
        let mut narrow = Self::default();
        if corners > 0 {
            narrow.room.clipper.reserve(corners);
            narrow.room.polytope.reserve();
            narrow.room.triangles.reserve(256);
            narrow.room.all.reserve(256);
            narrow.room.owners.reserve(256);
            narrow.room.is_own.reserve(256);
            narrow.found.points.reserve(256);
        }
        narrow
    }

    /// Contact points of two solids within reach of each other, and [`Manifold::separating_plane`]; a half space comes first. With a
    /// surface, `reach.approach` is the motion of the convex shape in the frame of the surface.
    pub fn collide(&mut self, solids: [&Solid; 2], poses: [Pose; 2], reach: Reach) -> (&[Point], Option<SeparatingPlane>) {
        let Self { room, found } = self;
        let prediction = reach.prediction;
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => collide(a, &poses[0], b, &poses[1], reach, found, room),
            [Solid::HalfSpace, Solid::Convex(b)] => collide_plane(&poses[0], b, &poses[1], prediction, found, room),
            [Solid::Surface(a), Solid::Convex(b)] => collide_surface(a, &poses[0], b, &poses[1], reach, found, room),
            [Solid::Convex(a), Solid::Surface(b)] => {
                collide_surface(b, &poses[1], a, &poses[0], reach, found, room);
                found.turn();
            }
            [Solid::HalfSpace, Solid::Surface(b)] => surface::collide_plane_surface(&poses[0], b, &poses[1], prediction, found, room),
            [_, Solid::Surface(_)] => unreachable!("a surface meets convex shapes"),
            [_, Solid::HalfSpace] => unreachable!("a half space comes first, and two never meet"),
        }
        (&found.points, found.separating_plane)
    }
}

/// Finds the contact points of two convex shapes whose distance is at most `reach`, m. `out` is empty exactly if the distance is larger.
///
/// There are at most [`MAX_POINTS`](crate::MAX_POINTS), ascending by feature, in the world frame. Normals point from the first shape to the
/// second.
pub fn collide(
    a: &ConvexShape,
    pose_a: &Pose,
    b: &ConvexShape,
    pose_b: &Pose,
    reach: impl Into<Reach>,
    out: &mut Manifold,
    room: &mut Room,
) {
    let mut reach = reach.into();
    let prediction = reach.prediction;
    out.clear();
    let pair = Pair::new(a, pose_a, b, pose_b).rounded(reach.epsilon, pose_a, pose_b);
    if !pair.is_near(prediction) {
        return;
    }
    if let (ConvexShape::Box { half: ha }, ConvexShape::Box { half: hb }) = (a, b) {
        let Some(by_axes) = boxes::separation(&pair, *ha, *hb, prediction) else { return };
        if let Some(found) = by_axes {
            room.clipper.manifold(&pair, &Facing::new(&pair, found), prediction, out);
            // The face's distance is correct if another feature is over it.
            if found.separation <= 0.0 || (!out.is_lone() && out.deepest() <= found.separation + 1e-9 * pair.size) {
                out.place(pose_a);
                return;
            }
            out.clear();
        }
    }
    reach.known = reach.known.map(|known| Known { normal: unit_or(known.normal, [0.0, 0.0, 1.0]), ..known });
    let facing = separation::nearest(&pair, &reach, &mut room.polytope);
    if !reach.is_left_out(&pair, &facing.found) {
        room.clipper.manifold(&pair, &facing, prediction, out);
        out.place(pose_a);
    }
    out.separating_plane = (a.is_hull() && b.is_hull()).then(|| reach.separating_plane(&pair, &facing));
}

/// The half space below the xy plane of `plane` and a convex shape, as [`collide`].
pub fn collide_plane(plane: &Pose, shape: &ConvexShape, pose: &Pose, prediction: f64, out: &mut Manifold, room: &mut Room) {
    out.clear();
    let pair = Pair::new(&ConvexShape::Sphere { radius: 0.0 }, plane, shape, pose);
    room.clipper.half_space(&pair, prediction, out);
    out.place(plane);
}

//! General convex collision, one pair of shapes of one environment at a time, in f64.
//!
//! Every shape is a *core* thickened by a radius (a ball is a thick point, a capsule a thick segment; the others have radius 0). The contact
//! normal is the direction of the largest separation of the cores,
//!
//! ```text
//! s(n) = min over B of n . y - max over A of n . x,        n* = argmax s(n) over unit vectors,
//! ```
//!
//! which is the distance where the cores are apart and minus the least translation that parts them where they overlap (`separation.rs`).
//! Any unit vector gives a bound from below, so overlapping shapes always have a contact. The features that face each other along n* are then
//! laid on one another (`manifold.rs`).
//!
//! All is computed in the frame of the first shape: what a scene's place in the world changes is rounding. Nothing is remembered from call to
//! call: the same poses give the same contacts, whether a normal from before is known (`recall.rs`), or what parts the two (`parting.rs`), or not.

mod approach;
mod blocks;
mod boxes;
mod clip;
mod expand;
mod gjk;
mod hull;
mod manifold;
mod pair;
mod parting;
mod patch;
mod proof;
mod quickhull;
mod recall;
mod separation;
mod shape;
mod surface;

use std::sync::Arc;

use crate::math::spatial::*;

pub use crate::collision::convex::approach::Approach;
pub use crate::collision::convex::hull::{Hull, HullError};
pub use crate::collision::convex::manifold::{MAX_POINTS, Manifold, Point};
pub use crate::collision::convex::parting::{Parting, Partings};
pub use crate::collision::convex::recall::Known;
pub use crate::collision::convex::shape::ConvexShape;
pub use crate::collision::convex::surface::{Grid, MAX_SURFACE_POINTS, MeshSurface, Surface, collide_surface};

use crate::collision::convex::expand::Polytope;
use crate::collision::convex::manifold::Clipper;
use crate::collision::convex::pair::Pair;
use crate::collision::convex::separation::{Facing, Separation};

/// A vector in f64.
type V = V3<f64>;

/// Where a shape is: its origin and its axes (columns) in the world.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// m
    pub pos: V,
    /// Rotation, row by row.
    pub mat: M3<f64>,
}

/// What collides here.
#[derive(Clone, Debug)]
pub enum Solid {
    /// All below the xy plane.
    HalfSpace,
    /// A convex shape.
    Convex(ConvexShape),
    /// A surface of triangles; it may be large, and is shared.
    Surface(Arc<Surface>),
}

impl Solid {
    /// Whether it is the hull of points.
    pub(crate) fn is_hull(&self) -> bool {
        matches!(self, Self::Convex(shape) if shape.is_hull())
    }

    /// The size of two hulls, m; `None` where one is none.
    pub(crate) fn size_of_hulls(solids: [&Self; 2]) -> Option<f64> {
        match solids {
            [Self::Convex(a @ ConvexShape::Hull(_)), Self::Convex(b @ ConvexShape::Hull(_))] => Some(a.bound() + b.bound()),
            _ => None,
        }
    }

    /// The same of another size (radius, half length; half axes or half sizes; m); `None` where the form is an asset's.
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

/// How far to look, and where first.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Distance beyond which nothing is a contact, m.
    pub prediction: f64,
    /// What is known of the pair from the last step: what is found is the same without it, later.
    pub known: Option<Known>,
    /// How hulls move: contacts that do not count within the step may be left out.
    pub approach: Option<Approach>,
}

impl Reach {
    /// Whether cores separated so are further apart than any contact.
    fn is_beyond(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        self.is_parted(found.normal, found.separation - pair.thickness(), pair.size)
    }

    /// Whether shapes of this size (m) that a plane parts by `gap` (m) have no contact.
    fn is_parted(&self, normal: V, gap: f64, size: f64) -> bool {
        gap > self.prediction || self.approach.is_some_and(|a| a.keeps(normal, gap, size))
    }

    /// Whether no contact with the normal that was found counts.
    fn is_left_out(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        let gap = found.separation - pair.thickness();
        self.is_beyond(pair, found) || self.approach.is_some_and(|a| a.keeps_along(found.normal, gap, pair.size))
    }

    /// What two hulls know of one another afterwards.
    fn parting(&self, pair: &Pair<'_>, facing: &Facing) -> Parting {
        let Separation { normal, separation, .. } = facing.found;
        Parting::new(pair, facing, self.approach.map_or(0.0, |a| a.spare(normal, separation, pair.size)))
    }
}

impl From<f64> for Reach {
    fn from(prediction: f64) -> Self {
        Self { prediction, known: None, approach: None }
    }
}

/// Room to work: made once, reused for every pair.
#[derive(Clone, Debug, Default)]
pub struct Room {
    clipper: Clipper,
    polytope: Polytope,
    triangles: Vec<u32>,
    all: Vec<Point>,
}

/// Room to work, and what was found.
#[derive(Clone, Debug, Default)]
pub struct Narrow {
    room: Room,
    found: Manifold,
}

impl Narrow {
    /// Room for these solids, so that nothing grows later. Only surfaces of triangles still may, when a shape first lies on very many.
    pub fn for_solids<'a>(solids: impl Iterator<Item = &'a Solid>) -> Self {
        let corners = solids.map(|s| if let Solid::Convex(shape) = s { shape.corners() } else { 0 }).max().unwrap_or(0);
        let mut narrow = Self::default();
        if corners > 0 {
            narrow.room.clipper.reserve(corners);
            narrow.room.polytope.reserve();
            narrow.room.triangles.reserve(256);
            narrow.room.all.reserve(256);
            narrow.found.points.reserve(256);
        }
        narrow
    }

    /// The contact points of two solids within reach of each other, and [`Manifold::parting`]; a half space comes first.
    pub fn collide(&mut self, solids: [&Solid; 2], poses: [Pose; 2], reach: Reach) -> (&[Point], Option<Parting>) {
        let Self { room, found } = self;
        let prediction = reach.prediction;
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => collide(a, &poses[0], b, &poses[1], reach, found, room),
            [Solid::HalfSpace, Solid::Convex(b)] => collide_plane(&poses[0], b, &poses[1], prediction, found, room),
            [Solid::Surface(a), Solid::Convex(b)] => collide_surface(a, &poses[0], b, &poses[1], prediction, found, room),
            [Solid::Convex(a), Solid::Surface(b)] => {
                collide_surface(b, &poses[1], a, &poses[0], prediction, found, room);
                found.turn();
            }
            [Solid::HalfSpace, Solid::Surface(b)] => surface::collide_plane_surface(&poses[0], b, &poses[1], prediction, found, room),
            [_, Solid::Surface(_)] => unreachable!("a surface meets convex shapes"),
            [_, Solid::HalfSpace] => unreachable!("a half space comes first, and two never meet"),
        }
        (&found.points, found.parting)
    }
}

/// Finds the contact points of two convex shapes that are within reach (m) of each other: at most [`MAX_POINTS`], in the world, normals
/// from the first to the second, ascending by feature.
///
/// `out` is empty exactly if the shapes are further apart than that.
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
    let pair = Pair::new(a, pose_a, b, pose_b);
    if !pair.is_near(prediction) {
        return;
    }
    if let (ConvexShape::Box { half: ha }, ConvexShape::Box { half: hb }) = (a, b) {
        let Some(by_axes) = boxes::separation(&pair, *ha, *hb, prediction) else { return };
        if let Some(found) = by_axes {
            room.clipper.manifold(&pair, &Facing::new(&pair, found), prediction, out);
            // A face gives the distance where something is above it.
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
    out.parting = (a.is_hull() && b.is_hull()).then(|| reach.parting(&pair, &facing));
}

/// Signed distance of two convex shapes (m; minus the depth where they overlap) and the unit normal from the first to the second, in the world.
pub fn distance(a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose) -> (f64, V) {
    let pair = Pair::new(a, pose_a, b, pose_b);
    let found = separation::nearest(&pair, &f64::INFINITY.into(), &mut Polytope::default()).found;
    (found.separation - pair.thickness(), rotate(&pose_a.mat, found.normal))
}

/// The half space below the xy plane of `plane` and a convex shape, as [`collide`].
pub fn collide_plane(plane: &Pose, shape: &ConvexShape, pose: &Pose, prediction: f64, out: &mut Manifold, room: &mut Room) {
    out.clear();
    let pair = Pair::new(&ConvexShape::Sphere { radius: 0.0 }, plane, shape, pose);
    room.clipper.half_space(&pair, prediction, out);
    out.place(plane);
}

/// x / |x|, or the fallback where x is 0.
fn unit_or(x: V, fallback: V) -> V {
    let length = norm(x);
    if length > 0.0 { scale(x, 1.0 / length) } else { fallback }
}

/// -x
fn neg(x: V) -> V {
    [-x[0], -x[1], -x[2]]
}

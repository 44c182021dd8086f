//! Separating plane of two hulls that remains valid for many steps. It consists of a half space that contains the first hull, and a ball
//! that contains the second hull and bulges little towards the first one. The first hull may be a box. Its half space is computed from its
//! present size, which may change from step to step.
//!
//! The half space is fixed to the first hull and the ball to the second. They contain the hulls at every pose, and therefore remain valid
//! when poses or states change. Let `pos` and `mat` be the pose of the second hull in the frame of the first. Let the first hull be within
//! n . x <= a, and the second within the ball of radius q |m| + e about p - q m in its frame. The separation of the hulls along n is then
//! at least
//!
//! ```text
//! n . (pos + mat (p - q m)) - (q |m| + e) |n| - a >= n . (pos + mat p) - q |n + mat m|^2 / 2 - (a + e |n|)
//! ```
//!
//! The right side remains accurate if q is a thousand times the size of the hull. Planes are made with m = -mat^T n and with the second
//! hull's farthest corner p in that direction. The separation then decreases only quadratically with the rotation angle. The ball is the
//! smallest one that bulges by e beyond p. A corner w with depth t along m and distance l from p is within it if
//!
//! ```text
//! (l^2 - e^2) / (2 (t + e)) <= q.
//! ```

use serde::{Deserialize, Serialize};
use stepper_real::{Real, Scalar};

use crate::approach::Approach;
use crate::facing::Facing;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::polyhedron::Polyhedron;
use crate::search_limits::CachedNormal;
use crate::shape::ConvexShape;
use crate::vectors::neg;

/// Distance by which the ball around the second hull projects beyond the hull towards the first one. It is relative to the part of the
/// gap that the motion of the step cannot close. A larger distance allows a smaller ball, but the plane becomes invalid after a smaller
/// motion of the hulls.
const BULGE: f64 = 0.05;
/// Smallest gap between two hulls for which a separating plane is computed, relative to the size of the hulls. Only the part of the gap
/// that the motion of the step cannot close counts. With a smaller gap, the plane would be valid for a step or two only.
const LEAST: f64 = 5e-5;

/// Normal along which two hulls are separated, the features where it was found, and the plane and ball that contain the hulls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeparatingPlane {
    /// Unit normal n from the first to the second hull, in the frame of the first.
    normal: [f32; 3],
    /// Vertices where the normal was found. The vertex of the first hull is farthest along the normal, that of the second hull farthest in
    /// the opposite direction.
    corners: [u32; 2],
    /// For each vertex in `corners`, the vertex at the other end of the edge that is perpendicular to the normal. Equal to `corners` unless
    /// the normal is perpendicular to an edge of each hull.
    ends: [u32; 2],
    /// Vertex p of the second hull, in the second hull's frame, m. The ball that contains the second hull bulges a little beyond it.
    tip: [f32; 3],
    /// Unit vector m from the centre of the ball that contains the second hull to the hull's vertex `tip`, in the second hull's frame.
    axis: [f32; 3],
    /// Distance of the centre of the ball that contains the second hull from the hull's vertex `tip`, m.
    curve: f32,
    /// Offset along the normal n of the plane that bounds the first hull, plus the bulge of the ball around the second hull, m. Infinite
    /// without a separating plane. For a box as the first shape, the bulge alone: the size of a box may change.
    offset: f32,
}

impl SeparatingPlane {
    /// Value for two hulls that have neither a cached normal nor a separating plane.
    pub const NONE: Self =
        Self { normal: [0.0; 3], corners: [0; 2], ends: [0; 2], tip: [0.0; 3], axis: [0.0; 3], curve: 0.0, offset: f32::INFINITY };

    /// Separating plane along the normal of `facing`. `spare` is the part of the gap that the motion of the step cannot close, m. If it is
    /// too small, the result has the normal and the features only.
    pub(super) fn new(pair: &Pair<'_>, facing: &Facing, spare: f64) -> Self {
        let Facing { found, corners, ends } = *facing;
        let (n, e) = (found.normal, BULGE * spare);
        let narrow = n.map(|x| x as f32);
        let unknown = Self { normal: narrow, corners, ends, ..Self::NONE };
        let (Some(a), ConvexShape::Hull(b), true) = (pair.a.polyhedron(), pair.b, spare > LEAST * pair.size) else {
            return unknown;
        };
        // The plane is computed from the rounded numbers that are stored. Rounding then does not make it invalid.
        let wide = |x: [f32; 3]| x.map(f64::from);
        let [i, j] = corners;
        let tip = b.points()[j as usize].map(|x| x as f32);
        let axis = neg(rotate_back(&pair.mat, n)).map(|x| x as f32);
        let (n, p, m) = (wide(narrow), wide(tip), wide(axis));
        let curve = (b.curve(p, m, e) * (1.0 + 1e-6)) as f32;
        // m is not quite a unit vector: the square of the radius is (q |m|)^2 + 2 q e + e^2.
        let (q, flat) = (f64::from(curve), f64::from(curve) * norm(m));
        let bulge = (2.0 * q * e + e * e) / (flat + (flat * flat + 2.0 * q * e + e * e).sqrt());
        let reach = if let Polyhedron::Hull(a) = a { dot(n, a.points()[i as usize]) } else { 0.0 };
        let offset = reach + bulge * norm(n);
        Self { tip, axis, curve, offset: offset as f32, ..unknown }
    }

    /// Normal and edges from which the search in the next step starts.
    #[inline]
    pub fn cached_normal(&self) -> CachedNormal {
        let [i, j] = self.corners;
        CachedNormal { normal: self.normal.map(f64::from), edges: Some([[i, self.ends[0]], [j, self.ends[1]]]) }
    }
}

/// Separating planes of two hulls, one in each lane, see [`SeparatingPlane`].
#[derive(Clone, Copy, Debug)]
pub struct SeparatingPlanes<R: Real> {
    /// Unit normal n from the first to the second hull, in the frame of the first.
    normal: V3<R>,
    /// Vertex p of the second hull, in the second hull's frame, m. The ball that contains the second hull bulges a little beyond it.
    tip: V3<R>,
    /// Unit vector m from the centre of the ball that contains the second hull to the hull's vertex `tip`, in the second hull's frame.
    axis: V3<R>,
    /// Distance of the centre of the ball that contains the second hull from the hull's vertex `tip`, m.
    curve: R,
    /// Offset along the normal n of the plane that bounds the first hull, plus the bulge of the ball around the second hull, m. Infinite
    /// without a separating plane. For a box as the first shape, the bulge alone.
    offset: R,
}

impl<R: Real> SeparatingPlanes<R> {
    /// Value without a separating plane in any lane.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = R::zero();
        Self { normal: [zero; 3], tip: [zero; 3], axis: [zero; 3], curve: zero, offset: R::splat(R::Scalar::INFINITY) }
    }

    /// Sets the separating plane of the lane `lane`.
    #[inline(always)]
    pub fn set_lane(&mut self, lane: usize, separating_plane: &SeparatingPlane) {
        let of = |x: f32| R::Scalar::from_f64(f64::from(x));
        for k in 0..3 {
            self.normal[k].set_lane(lane, of(separating_plane.normal[k]));
            self.tip[k].set_lane(lane, of(separating_plane.tip[k]));
            self.axis[k].set_lane(lane, of(separating_plane.axis[k]));
        }
        self.curve.set_lane(lane, of(separating_plane.curve));
        self.offset.set_lane(lane, of(separating_plane.offset));
    }

    /// Lanes in which the plane shows that no contact of the hulls can push within the step.
    ///
    /// `half` are the half sizes of the first shape if it is a box, m, and zeros if it is a hull. `apart` is the vector from the first
    /// shape's origin to the second's in the world, m. `mats` are the orientations of the shapes. `approach` is their motion within the
    /// step, and `size` the sum of their bounding radii, m.
    #[inline(always)]
    pub fn separated_lanes(&self, half: V3<R>, apart: V3<R>, mats: [&M3<R>; 2], approach: &Approach<R>, size: R) -> R::Mask {
        let n = rotate(mats[0], self.normal);
        let turned = add(n, rotate(mats[1], self.axis));
        let curved = R::of(0.5) * self.curve * dot(turned, turned);
        let [x, y, z] = self.normal;
        let reach = self.offset + dot([x.abs(), y.abs(), z.abs()], half);
        let gap = dot(n, add(apart, rotate(mats[1], self.tip))) - curved - reach;
        approach.is_separated(self.normal, gap, size)
    }
}

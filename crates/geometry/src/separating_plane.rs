//! Separating plane of two hulls that stays valid for many steps. It consists of a half space that contains the first hull, and a ball
//! that contains the second hull and bulges little towards the first one.
//!
//! Both are fixed to their hulls and depend on their vertices alone, so that a change of poses or states does not invalidate them. Let the
//! first hull be within n . x <= a, and the second within the ball of radius q |m| + e about p - q m in its frame. The separation of the
//! hulls along n is then at least
//!
//! ```text
//! n . (pos + mat (p - q m)) - (q |m| + e) |n| - a >= n . (pos + mat p) - q |n + mat m|^2 / 2 - (a + e |n|)
//! ```
//!
//! The right side stays accurate if q is a thousand times the size of the hull. Planes are made with m = -mat^T n and with the second
//! hull's farthest corner p in that direction. The loss by rotations is then of second order in the angle. The ball is the smallest one
//! that bulges by e beyond p. A corner w with depth t along m and distance l from p is within it if
//!
//! ```text
//! (l^2 - e^2) / (2 (t + e)) <= q.
//! ```

use serde::{Deserialize, Serialize};
use stepper_real::{Real, Scalar};

use crate::approach::Approach;
use crate::facing::Facing;
use crate::known::Known;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::shape::ConvexShape;
use crate::vectors::neg;

/// The part of what two hulls have to spare that the ball may bulge by: more makes it smaller, and leaves less for the hulls to move.
const BULGE: f64 = 0.05;
/// With less to spare than this share of their size it would last for a step or two, and is not worth making.
const LEAST: f64 = 5e-5;

/// Normal along which two hulls are separated, the corners where it was found, and the surface that separates them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeparatingPlane {
    /// n: from the first to the second, unit, in the first's frame.
    normal: [f32; 3],
    /// Corners that are furthest that way and against it, and the other ends of the edges that it is across; the corners again, if it is
    /// not.
    corners: [u32; 2],
    ends: [u32; 2],
    /// p, in the second's frame, m.
    tip: [f32; 3],
    /// m, in the second's frame.
    axis: [f32; 3],
    /// q, m.
    curve: f32,
    /// a + e |n|, m; infinite where nothing is known to part them.
    offset: f32,
}

impl SeparatingPlane {
    /// Separating plane of a pair of which nothing is known.
    pub const NONE: Self =
        Self { normal: [0.0; 3], corners: [0; 2], ends: [0; 2], tip: [0.0; 3], axis: [0.0; 3], curve: 0.0, offset: f32::INFINITY };

    /// What parts hulls that have `spare` (m) to spare along the normal that was found.
    pub(super) fn new(pair: &Pair<'_>, facing: &Facing, spare: f64) -> Self {
        let Facing { found, corners, ends } = *facing;
        let (n, e) = (found.normal, BULGE * spare);
        let narrow = n.map(|x| x as f32);
        let unknown = Self { normal: narrow, corners, ends, ..Self::NONE };
        let (ConvexShape::Hull(a), ConvexShape::Hull(b), true) = (pair.a, pair.b, spare > LEAST * pair.size) else {
            return unknown;
        };
        // Of the numbers as they are kept, so that what is rounded is true.
        let wide = |x: [f32; 3]| x.map(f64::from);
        let [i, j] = facing.corners.map(|c| c as usize);
        let tip = b.points()[j].map(|x| x as f32);
        let axis = neg(rotate_back(&pair.mat, n)).map(|x| x as f32);
        let (n, p, m) = (wide(narrow), wide(tip), wide(axis));
        let curve = (b.curve(p, m, e) * (1.0 + 1e-6)) as f32;
        // m is not quite a unit vector: the square of the radius is (q |m|)^2 + 2 q e + e^2.
        let (q, flat) = (f64::from(curve), f64::from(curve) * norm(m));
        let bulge = (2.0 * q * e + e * e) / (flat + (flat * flat + 2.0 * q * e + e * e).sqrt());
        let offset = dot(n, a.points()[i]) + bulge * norm(n);
        Self { tip, axis, curve, offset: offset as f32, ..unknown }
    }

    /// Where the next search begins.
    #[inline]
    pub fn known(&self) -> Known {
        let [i, j] = self.corners;
        Known { normal: self.normal.map(f64::from), edges: Some([[i, self.ends[0]], [j, self.ends[1]]]) }
    }
}

/// What parts two hulls in each lane.
#[derive(Clone, Copy, Debug)]
pub struct SeparatingPlanes<R: Real> {
    normal: V3<R>,
    tip: V3<R>,
    axis: V3<R>,
    curve: R,
    offset: R,
}

impl<R: Real> SeparatingPlanes<R> {
    /// Whether no surface is known that separates the hulls, in every lane.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = R::zero();
        Self { normal: [zero; 3], tip: [zero; 3], axis: [zero; 3], curve: zero, offset: R::splat(R::Scalar::INFINITY) }
    }

    /// Sets a lane.
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

    /// Lanes in which no contact of hulls that approach one another so can count within the step: `apart` leads from the first's origin to
    /// the second's, `mats` are their axes, `size` is that of both, m.
    #[inline(always)]
    pub fn keep(&self, apart: V3<R>, mats: [&M3<R>; 2], approach: &Approach<R>, size: f64) -> R::Mask {
        let n = rotate(mats[0], self.normal);
        let turned = add(n, rotate(mats[1], self.axis));
        let curved = R::of(0.5) * self.curve * dot(turned, turned);
        let gap = dot(n, add(apart, rotate(mats[1], self.tip))) - curved - self.offset;
        approach.keeps(self.normal, gap, size)
    }
}

//! Tests of surfaces (height fields and meshes) against convex shapes, over lanes. The height of a surface below a shape rejects most
//! pairs.
//!
//! A contact joins a point x of the surface and a point y of the shape with y - x = d n. Suppose the shape is at least a gap g above every
//! point of the surface below it. Then d cos(a) >= g for a normal n at an angle a from upright. Stage 3 creates the contact only if
//! d < 2 h c + slack, where c is the speed at which y approaches x along n. With the upward speed u and the speed w of y relative to the
//! surface, 2 c cos(a) <= w - u for every a, and so
//!
//! ```text
//! g < h (w - u) + slack,        where the surface is level: g < -2 h u + slack.
//! ```
//!
//! Rotation about a point on the line of n moves nothing along n. For a ball, w is therefore the speed of its centre; for a capsule, that
//! of its segment.

use stepper_geometry::{Approach, ConvexShape, Narrow, Solid, Surface};
use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::Scene;
use crate::compile::{CompiledPair, Kernel};
use crate::math::lanes::each_of;
use crate::math::spatial::*;

impl<R: Real> Scene<'_, R> {
    /// Surface of a pair of a surface and a convex shape, and the two geoms: surface first. `None` for other pairs, such as plane and
    /// surface.
    #[inline(always)]
    pub(crate) fn surface_and_shape(&self, pair: &CompiledPair<R::Scalar>) -> Option<(&Surface, [usize; 2])> {
        if pair.kernel != Kernel::Surface {
            return None;
        }
        let [a, b] = pair.geoms;
        [[a, b], [b, a]].into_iter().find_map(|geoms| match &self.compiled.geoms[geoms[0]].solid {
            Some(Solid::Surface(surface)) => Some((&**surface, geoms)),
            _ => None,
        })
    }

    /// Lanes of `near` in which stage 3 may add a contact of a shape with a surface, by the height of the surface below the shape (see the
    /// head of the file).
    ///
    /// `geoms` are the indices of the surface and of the shape; `margin` is the margin of the pair, m.
    #[inline(always)]
    pub(crate) fn may_meet_surface(&self, surface: &Surface, geoms: [usize; 2], margin: R, near: R::Mask) -> R::Mask {
        let [ground, shape] = geoms;
        let (mat, centre) = (&self.poses.mat[ground], self.poses.pos[shape]);
        let up_axis = surface.up_axis();
        let up = column(mat, up_axis);
        let at = rotate_back(mat, sub(centre, self.poses.pos[ground]));
        let (depth, core) = self.reach_below(shape, up);

        let [w, v] = self.relative_motion(&self.poses.search_velocity, geoms, centre);
        let rise = dot(up, v) - norm(cross(up, w)) * core;
        let speed = norm(v) + norm(w) * core;
        let least = margin.max(R::zero()) + self.slack;
        let around = self.compiled.params.geom(shape).bounding_radius
            + self.poses.search_displacement[ground]
            + self.poses.search_displacement[shape]
            + least;
        // Allowance for rounding errors, sufficient in single precision.
        let rounding = R::of(1e-6) * (around + at[0].abs() + at[1].abs() + at[2].abs());
        let least = least + rounding;
        let any_slope = self.h * (speed - rise) + least;
        let level = (-(self.h + self.h) * rise).max(R::zero()) + least;

        let low = at[up_axis] - depth;
        let mut near = near.and((low - R::of(surface.highest())).lt(any_slope));
        for lane in each_of(near.bits()) {
            let of = |x: R| x.lane(lane).to_f64();
            let under = surface.heights_below_disc(at.map(of), of(around + rounding));
            let limit = if under.level { level } else { any_slope };
            if of(low) - under.highest >= of(limit) {
                near = near.and_not(R::Mask::from_bits(1 << lane));
            }
        }
        near
    }

    /// Relative motion of a shape in a surface's frame during a step: displacement and rotation. `margin` is the margin of the pair, m, and
    /// `reach` the largest gap of its contacts, m.
    #[inline(always)]
    pub(crate) fn approach_to_surface(&self, [surface, shape]: [usize; 2], margin: R, reach: R) -> Approach<R> {
        // The contact normal of a ball passes through its centre, that of a capsule through its segment. Other contacts are halfway between
        // the two geoms.
        let radius = match &self.compiled.geoms[shape].solid {
            Some(Solid::Convex(ConvexShape::Sphere { .. })) => R::zero(),
            Some(Solid::Convex(ConvexShape::Capsule { .. })) => self.compiled.params.geom(shape).size[1],
            _ => self.compiled.params.geom(shape).bounding_radius + R::of(0.5) * reach,
        };
        self.approach_at([surface, shape], self.poses.pos[shape], radius, margin)
    }

    /// Lanes of `lanes` in which the two geoms of a pair with a surface hit each other within a step at the free velocity, at one of their
    /// contacts. None for other pairs.
    ///
    /// In these lanes, contacts that stage 3 finds in the middle of the step are unreliable. The body may still be in front of the surface,
    /// and the contacts would brake it too early.
    #[inline(always)]
    pub(crate) fn hits_surface(&self, index: usize, pair: &CompiledPair<R::Scalar>, lanes: R::Mask, contacts: &Contacts<R>) -> R::Mask {
        let mut hits = R::Mask::splat(false);
        if pair.kernel == Kernel::Surface && lanes.any() {
            for k in 0..contacts.slots() {
                let mut pairs = contacts.pairs(k, lanes.bits() & contacts.lanes_of(k));
                let own = pairs.find(|&(other, _)| other == index).map_or(0, |(_, own)| own);
                let point = &contacts.data[k].point;
                let closes = point.distance.lt(self.closing_speed(pair.geoms, point) * self.h);
                hits = hits.or(closes.and(R::Mask::from_bits(own)));
            }
        }
        hits
    }

    /// Distance of a surface and a convex shape in the lanes `lanes`, m; at most `most`. Zero for pairs of other kinds.
    #[inline(never)]
    pub(crate) fn gap_to_surface(&self, pair: &CompiledPair<R::Scalar>, lanes: R::Mask, most: R, narrow: &mut Narrow) -> R {
        let mut gap = R::zero();
        if let Some((surface, [ground, shape])) = self.surface_and_shape(pair) {
            for lane in each_of(lanes.bits()) {
                let poses = [self.pose(ground, lane), self.pose(shape, lane)];
                if let Solid::Convex(convex) = &*self.solid_in(shape, lane) {
                    gap.set_lane(lane, R::Scalar::from_f64(narrow.clearance(surface, convex, poses, most.lane(lane).to_f64())));
                }
            }
        }
        gap
    }

    /// Distance from the origin of a geom to its lowest point along the unit vector `up`, m, and radius of its core, m. For a hull the
    /// distance is an upper bound.
    ///
    /// The core is the centre of a ball, the segment of a capsule, and otherwise the bounding ball.
    #[inline(always)]
    fn reach_below(&self, geom: usize, up: V3<R>) -> (R, R) {
        let (size, bound) = (self.compiled.params.geom(geom).size, self.compiled.params.geom(geom).bounding_radius);
        let m = rotate_back(&self.poses.mat[geom], up);
        let Some(Solid::Convex(shape)) = &self.compiled.geoms[geom].solid else { return (bound, bound) };
        match shape {
            ConvexShape::Sphere { .. } => (size[0], R::zero()),
            ConvexShape::Capsule { .. } => (size[0] + size[1] * m[2].abs(), size[1]),
            ConvexShape::Cylinder { .. } => (size[0] * (m[0] * m[0] + m[1] * m[1]).sqrt() + size[1] * m[2].abs(), bound),
            ConvexShape::Ellipsoid { .. } => (norm(times(size, m)), bound),
            ConvexShape::Box { .. } => (size[0] * m[0].abs() + size[1] * m[1].abs() + size[2] * m[2].abs(), bound),
            ConvexShape::Hull(_) | ConvexShape::Triangle(_) => (bound, bound),
        }
    }
}

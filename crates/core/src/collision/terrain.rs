//! Which shapes a height field may be in the way of, from how high it is under them: most of its pairs are done with here, over lanes.
//!
//! A contact joins a point x of the field and a point y of the shape with y - x = d n. Where the shape is a gap g above all that the field
//! has under it, d cos(a) >= g for a normal at an angle a from upright, and stage 3 takes the contact up only if d < 2 h c + slack, c being
//! the speed at which y closes in along n. With u its speed upwards and w its speed, 2 c cos(a) <= w - u for every a, and so
//!
//! ```text
//! g < h (w - u) + slack,        where the field is level: g < -2 h u + slack.
//! ```
//!
//! Nothing moves along n by turning about a point on the line of n: of a ball only the centre's speed counts, of a capsule that of its
//! segment.

use stepper_geometry::{ConvexShape, Grid, Solid};
use stepper_real::{Mask, Real, Scalar};

use crate::collision::detection::Scene;
use crate::compile::CompiledPair;
use crate::math::lanes::each_of;
use crate::math::spatial::*;

impl<R: Real> Scene<'_, R> {
    /// Those of the lanes `near` in which a contact of a height field, the first geom of the pair, may be taken up.
    #[inline(always)]
    pub(crate) fn may_meet_terrain(&self, grid: &Grid, pair: &CompiledPair<R::Scalar>, near: R::Mask) -> R::Mask {
        let [field, shape] = pair.geoms;
        let (mat, centre) = (&self.poses.mat[field], self.poses.pos[shape]);
        let up = column(mat, 2);
        let at = rotate_back(mat, sub(centre, self.poses.pos[field]));
        let (depth, core) = self.reach_below(shape, up);

        let links = &self.poses.velocity;
        let ([w, v], [w_field, v_field]) = (self.motion_at(links, shape, centre), self.motion_at(links, field, centre));
        let (v, w) = (sub(v, v_field), sub(w, w_field));
        let rise = dot(up, v) - norm(cross(up, w)) * core;
        let speed = norm(v) + norm(w) * core;
        let least = R::splat(pair.margin).max(R::zero()) + self.slack;
        let around = self.compiled.params.bounding_radius(shape) + self.poses.travel[field] + self.poses.travel[shape] + least;
        // A hair more than the exact test will ask for, also in single precision.
        let hair = R::of(1e-6) * (around + at[0].abs() + at[1].abs() + at[2].abs());
        let least = least + hair;
        let anyhow = self.h * (speed - rise) + least;
        let level = (-(self.h + self.h) * rise).max(R::zero()) + least;

        let low = at[2] - depth;
        let mut near = near.and((low - R::of(grid.highest())).lt(anyhow));
        for lane in each_of(near.bits()) {
            let of = |x: R| x.lane(lane).to_f64();
            let under = grid.under_disc([of(at[0]), of(at[1])], of(around + hair));
            let limit = if under.level { level } else { anyhow };
            if of(low) - under.highest >= of(limit) {
                near = near.and_not(R::Mask::from_bits(1 << lane));
            }
        }
        near
    }

    /// How far a geom reaches from its origin against the unit vector `up`, and the radius of a ball that holds all but what a ball or
    /// capsule is thickened by, m.
    #[inline(always)]
    fn reach_below(&self, geom: usize, up: V3<R>) -> (R, R) {
        let (size, bound) = (self.compiled.params.geom_size(geom), self.compiled.params.bounding_radius(geom));
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

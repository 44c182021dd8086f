//! Culling of pairs with a surface, over lanes, by the height of the surface below the shape. It settles most pairs with terrain.
//!
//! A contact joins a point x of the surface and a point y of the shape with y - x = d n. Let the shape be a gap g above all of the surface
//! below it. Then d cos(a) >= g for a normal at an angle a from upright. Stage 3 takes the contact up only if d < 2 h c + slack, where c is
//! the speed at which y closes in along n. With u its speed upwards and w its speed, 2 c cos(a) <= w - u for every a, and so
//!
//! ```text
//! g < h (w - u) + slack,        where the surface is level: g < -2 h u + slack.
//! ```
//!
//! Nothing moves along n by turning about a point on the line of n: of a ball only the centre's speed counts, of a capsule that of its
//! segment.

use stepper_geometry::{Approach, ConvexShape, Solid, Surface};
use stepper_real::{Mask, Real, Scalar};

use crate::collision::detection::Scene;
use crate::compile::{CompiledPair, Kernel};
use crate::math::lanes::each_of;
use crate::math::spatial::*;

impl<R: Real> Scene<'_, R> {
    /// Surface of a pair of a surface and a convex shape, and the geoms of both. `None` for other pairs, also of a plane and a surface.
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

    /// Lanes of `near` in which a contact of a surface and a shape can count.
    #[inline(always)]
    pub(crate) fn may_meet_surface(&self, surface: &Surface, [field, shape]: [usize; 2], margin: R, near: R::Mask) -> R::Mask {
        let (mat, centre) = (&self.poses.mat[field], self.poses.pos[shape]);
        let up = column(mat, 2);
        let at = rotate_back(mat, sub(centre, self.poses.pos[field]));
        let (depth, core) = self.reach_below(shape, up);

        let links = &self.poses.velocity;
        let ([w, v], [w_field, v_field]) = (self.motion_at(links, shape, centre), self.motion_at(links, field, centre));
        let (v, w) = (sub(v, v_field), sub(w, w_field));
        let rise = dot(up, v) - norm(cross(up, w)) * core;
        let speed = norm(v) + norm(w) * core;
        let least = margin.max(R::zero()) + self.slack;
        let around = self.compiled.params.bounding_radius(shape) + self.poses.travel[field] + self.poses.travel[shape] + least;
        // A hair more than the exact test will ask for, also in single precision.
        let hair = R::of(1e-6) * (around + at[0].abs() + at[1].abs() + at[2].abs());
        let least = least + hair;
        let anyhow = self.h * (speed - rise) + least;
        let level = (-(self.h + self.h) * rise).max(R::zero()) + least;

        let low = at[2] - depth;
        let mut near = near.and((low - R::of(surface.highest())).lt(anyhow));
        for lane in each_of(near.bits()) {
            let of = |x: R| x.lane(lane).to_f64();
            let under = surface.under_disc([of(at[0]), of(at[1])], of(around + hair));
            let limit = if under.level { level } else { anyhow };
            if of(low) - under.highest >= of(limit) {
                near = near.and_not(R::Mask::from_bits(1 << lane));
            }
        }
        near
    }

    /// Height of a geom above the highest point of a surface within `around` of it, in the lanes `lanes`, m. Infinite where there is none.
    #[inline(always)]
    pub(crate) fn height_above(&self, surface: &Surface, [ground, shape]: [usize; 2], lanes: R::Mask, around: R) -> R {
        let (mat, centre) = (&self.poses.mat[ground], self.poses.pos[shape]);
        let at = rotate_back(mat, sub(centre, self.poses.pos[ground]));
        let radius = self.compiled.params.bounding_radius(shape) + around;
        let low = at[2] - self.reach_below(shape, column(mat, 2)).0;
        let mut height = R::of(f64::INFINITY);
        for lane in each_of(lanes.bits()) {
            let of = |x: R| x.lane(lane).to_f64();
            let under = surface.under_disc([of(at[0]), of(at[1])], of(radius));
            height.set_lane(lane, R::of(of(low) - under.highest).lane(lane));
        }
        height
    }

    /// Approach of a shape to a surface. Contacts are at most `reach` long, m.
    #[inline(always)]
    pub(crate) fn approach_to_surface(&self, [surface, shape]: [usize; 2], margin: R, reach: R) -> Approach<R> {
        let (mat, centre) = (&self.poses.mat[surface], self.poses.pos[shape]);
        let links = &self.poses.velocity;
        let ([w, v], [w_surface, v_surface]) = (self.motion_at(links, shape, centre), self.motion_at(links, surface, centre));
        let (way, turn) = (scale(rotate_back(mat, sub(v, v_surface)), self.h), scale(rotate_back(mat, sub(w, w_surface)), self.h));
        // The line of a contact's normal passes through the core of a ball or capsule. Other contacts are halfway between the geoms.
        let radius = match &self.compiled.geoms[shape].solid {
            Some(Solid::Convex(ConvexShape::Sphere { .. })) => R::zero(),
            Some(Solid::Convex(ConvexShape::Capsule { .. })) => self.compiled.params.geom_size(shape)[1],
            _ => self.compiled.params.bounding_radius(shape) + R::of(0.5) * reach,
        };
        Approach { way, turn, radius, slack: margin.max(R::zero()) + self.slack }
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

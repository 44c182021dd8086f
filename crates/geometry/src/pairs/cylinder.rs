//! Points of cylinders that can touch a half space, and contacts of cylinders with a ball.

use stepper_real::Real;

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// Cylinder around its z axis.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder<R> {
    /// Centre of the cylinder, m.
    pub centre: V3<R>,
    /// Orientation of the cylinder. The columns are its axes.
    pub mat: M3<R>,
    /// Radius of the cylinder, m.
    pub radius: R,
    /// Half the length of the cylinder, m.
    pub half_length: R,
}

/// Points of a cylinder's rims that can touch a half space, m. On each end face they are the lowest point, the opposite point, and the two
/// points halfway between them.
///
/// Point k is `k % 4` quarter turns from the lowest one, on the end face at +z for k < 4. `normal` is the outward normal of the half space.
///
/// A lying cylinder touches with the lowest point of both end faces, a standing one with all four points of one end face. MuJoCo's
/// `mjc_PlaneCylinder` has the lowest two points and a triangle.
///
/// `tip` is the change of the normal in the frame of the cylinder within the step, n x omega h. If it exceeds the cylinder's tilt, the
/// lowest point is the one toward which the cylinder tips. The cylinder therefore tips over its rim, and not over a line between two
/// points.
#[inline(always)]
pub fn cylinder_rims<R: Real>(normal: V3<R>, tip: V3<R>, cylinder: &Cylinder<R>) -> [V3<R>; 8] {
    let axis = column(&cylinder.mat, 2);
    let (leans, tips) = (sub(scale(axis, dot(normal, axis)), normal), sub(scale(axis, dot(tip, axis)), tip));
    let down = select(dot(leans, leans).lt(dot(tips, tips)), add(leans, tips), leans);
    let length = norm(down);
    // With a tilt below a millionth, all directions are equally low. One that is fixed to the body keeps the points in place.
    let some = length.gt(R::of(1e-6));
    let lowest = select(some, scale(down, R::one() / R::select(some, length, R::one())), column(&cylinder.mat, 0));
    let (lowest, side) = (scale(lowest, cylinder.radius), scale(cross(axis, lowest), cylinder.radius));
    array!(|k| {
        let cap = add_scaled(cylinder.centre, axis, if k < 4 { cylinder.half_length } else { -cylinder.half_length });
        match k % 4 {
            0 => add(cap, lowest),
            1 => add(cap, side),
            2 => sub(cap, lowest),
            _ => sub(cap, side),
        }
    })
}

/// Contact of a ball and a cylinder. `centre` and `radius` are those of the ball, m.
///
/// In the half plane through the axis and the ball's centre, the cylinder is a rectangle. For a centre outside, the closest point is the
/// centre clamped to the rectangle. For a centre inside, it is on the side or the end face, whichever is closer.
#[inline(always)]
pub fn sphere_cylinder<R: Real>(centre: V3<R>, radius: R, cylinder: &Cylinder<R>) -> ContactPoint<R> {
    let x = rotate_back(&cylinder.mat, sub(centre, cylinder.centre));
    let rho = (x[0] * x[0] + x[1] * x[1]).sqrt();
    let off_axis = rho.gt(R::zero());
    let inv = R::one() / R::select(off_axis, rho, R::one());
    let radial = [R::select(off_axis, x[0] * inv, R::one()), R::select(off_axis, x[1] * inv, R::zero())];
    let (side, cap) = (rho - cylinder.radius, x[2].abs() - cylinder.half_length);
    let up = R::one().copysign(x[2]);

    let (out_side, out_cap) = (side.max(R::zero()), cap.max(R::zero()));
    let length = (out_side * out_side + out_cap * out_cap).sqrt();
    let outside = length.gt(R::zero());
    let by_side = side.ge(cap);
    let inv = R::one() / R::select(outside, length, R::one());
    let a = R::select(outside, out_side * inv, R::select(by_side, R::one(), R::zero()));
    let b = R::select(outside, out_cap * inv, R::select(by_side, R::zero(), R::one())) * up;
    let gap = R::select(outside, length, side.max(cap));

    let u = rotate(&cylinder.mat, [radial[0] * a, radial[1] * a, b]);
    let distance = gap - radius;
    let pos = add_scaled(centre, u, -(radius + distance * R::of(0.5)));
    ContactPoint { distance, pos, normal: scale(u, -R::one()) }
}

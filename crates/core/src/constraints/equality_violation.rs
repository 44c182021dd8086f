//! Position errors of equalities at a configuration: the certificate of closed loops.

use stepper_real::Real;

use crate::compile::{Combination, CompiledEquality, EqualityRows, LaneModel};
use crate::dynamics::frame_path::follow_path;
use crate::dynamics::mocap::MocapTrajectory;
use crate::math::spatial::*;

/// Largest position error of the equalities at the configuration `q`, m or rad; 0 without equalities.
///
/// The error of a connect is the distance of its two points. That of a weld is the larger of this distance and of the angle between the two
/// orientations, unless `torquescale` is 0, which lets them turn. That of a coupling is in the unit of its first joint or tendon. With hard
/// contact, equalities with a finite stiffness are springs: their stretch is no violation. MuJoCo's law takes no notice of these springs.
///
/// `mocap` has the poses of mocap bodies, `elapsed` seconds after the beginning of the call.
pub fn max_equality_violation<R: Real>(compiled: &LaneModel<R>, q: &[R], mocap: &[MocapTrajectory<R>], elapsed: f64) -> R {
    if compiled.equalities.is_empty() {
        return R::zero();
    }
    R::vectorize(
        #[inline(always)]
        || {
            let mut largest = R::zero();
            for block in &compiled.equalities {
                for equality in &block.equalities {
                    if equality.spring.is_none() || compiled.softness.is_some() {
                        largest = largest.max(violation(compiled, equality, q, mocap, R::of(elapsed)));
                    }
                }
            }
            largest
        },
    )
}

#[inline(always)]
fn violation<R: Real>(
    compiled: &LaneModel<R>,
    equality: &CompiledEquality<R::Scalar>,
    q: &[R],
    mocap: &[MocapTrajectory<R>],
    elapsed: R,
) -> R {
    match &equality.rows {
        EqualityRows::Points { anchors, turn, paths, .. } => {
            // Relative to the nearest common frame, so that rounding does not grow with the distance from the origin of the world.
            let first = follow_path(compiled, &paths[0], q, mocap, elapsed);
            let second = follow_path(compiled, &paths[1], q, mocap, elapsed);
            let points = [add(first.0, rotate(&first.1, splat(anchors[0]))), add(second.0, rotate(&second.1, splat(anchors[1])))];
            let gap = norm(sub(points[0], points[1]));
            match turn {
                Some((mats, weight)) if *weight != <R::Scalar as Default>::default() => {
                    let turned = mat_mul_transposed(&mat_mul(&first.1, &splat(mats[0])), &mat_mul(&second.1, &splat(mats[1])));
                    gap.max(norm(quat_log(mat_to_quat(&turned))))
                }
                _ => gap,
            }
        }
        EqualityRows::Coupling { first, second, polynomial } => coupling_error(first, second.as_ref(), splat(*polynomial), q).abs(),
    }
}

/// Position error of a coupling: x - ref - polynomial(y - ref).
#[inline(always)]
fn coupling_error<R: Real>(first: &Combination<R::Scalar>, second: Option<&Combination<R::Scalar>>, c: [R; 5], q: &[R]) -> R {
    let error = first.value(q) - R::splat(first.reference) - c[0];
    let Some(second) = second else { return error };
    let x = second.value(q) - R::splat(second.reference);
    error - x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))
}

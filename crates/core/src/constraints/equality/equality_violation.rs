//! Position errors of equality constraints, which show how well closed loops stay closed.

use stepper_real::{Real, kernel};

use crate::compile::{CompiledEquality, EqualityRows, LaneModel, PathLengths, coupling_error};
use crate::constraints::equality::active_equalities::ActiveEqualities;
use crate::dynamics::frame_path::follow_path;
use crate::dynamics::mocap::MocapTrajectory;
use crate::math::spatial::*;

/// Largest position error of the equality constraints at the configuration `q`, m or rad. 0 without equalities.
///
/// - connect: distance of its two points.
/// - weld: the larger of this distance and the angle between the two orientations. With `torquescale` 0 the distance alone.
/// - joint or tendon coupling: error in the unit of the first joint or tendon.
///
/// With hard contact an equality of finite stiffness is a spring, and its stretch is no violation. With MuJoCo's contact law every equality
/// counts. An inactive equality has no violation.
///
/// `mocap` has the trajectories of mocap bodies, `elapsed` is the time since the beginning of the call of `step`, s.
pub(crate) fn max_equality_violation<R: Real>(
    compiled: &LaneModel<R>,
    active: &ActiveEqualities<R>,
    (q, paths): (&[R], &PathLengths<R>),
    mocap: &[MocapTrajectory<R>],
    elapsed: R,
) -> R {
    if compiled.equalities.is_empty() {
        return R::zero();
    }
    kernel!(R, || {
        let mut largest = R::zero();
        for (k, block) in compiled.equalities.iter().enumerate() {
            if !active.has_rows(k) {
                continue;
            }
            for equality in &block.equalities {
                if equality.spring.is_none() || compiled.softness.is_some() {
                    let error = violation(compiled, equality, (q, paths), mocap, elapsed);
                    largest = R::select(active.lanes(equality), largest.max(error), largest);
                }
            }
        }
        largest
    })
}

/// Position error of one equality at the configuration `q`, m or rad.
#[inline(always)]
fn violation<R: Real>(
    compiled: &LaneModel<R>,
    equality: &CompiledEquality<R::Scalar>,
    (q, paths): (&[R], &PathLengths<R>),
    mocap: &[MocapTrajectory<R>],
    elapsed: R,
) -> R {
    let numbers = compiled.params.equality(equality.index);
    match &equality.rows {
        EqualityRows::Points { turn, paths, .. } => {
            // Both poses are relative to the nearest common frame, so that the rounding error does not grow with the distance from the
            // world origin.
            let first = follow_path(compiled, &paths[0], q, mocap, elapsed);
            let second = follow_path(compiled, &paths[1], q, mocap, elapsed);
            let points = [add(first.0, rotate(&first.1, numbers.first)), add(second.0, rotate(&second.1, numbers.second))];
            let gap = norm(sub(points[0], points[1]));
            match turn {
                Some(turn) => {
                    let turned = mat_mul_transposed(&mat_mul(&first.1, &numbers.orientation), &mat_mul(&second.1, &splat(*turn)));
                    R::select(numbers.weight.gt(R::zero()), gap.max(norm(quat_log(mat_to_quat(&turned)))), gap)
                }
                None => gap,
            }
        }
        EqualityRows::Coupling { first, second } => coupling_error(first, second.as_ref(), numbers.polynomial, (q, paths)).abs(),
    }
}

//! Stage 9: computes sensor readings of the new state.
//!
//! True readings are a function of the state after the step and of the step's results: its impulses, and its acceleration (v+ - v) / h,
//! which includes impulses. Positions and velocities are those after the step, so that all readings belong to one time.

use stepper_real::{Real, kernel};

use crate::compile::sensing::{Bounds, CompiledSensor, Read, SensorFrame};
use crate::compile::{Combination, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::sensing::*;

/// Computes the true readings of all sensors into `workspace.truth`. If a sensor needs poses, the function updates `kinematics` to the
/// configuration of `input`. The poses of mocap frames must be set before.
pub fn sense<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &mut Kinematics<R>,
    workspace: &mut SensorWorkspace<R>,
    input: &SensorInput<'_, R>,
) {
    if compiled.sensing.needs.poses {
        kinematics.update(compiled, input.q);
    }
    let (view, truth, order) = workspace.prepare(compiled, kinematics, input);
    // This loop is no kernel. Each reading calls kernels, so that no single kernel contains the code of all sensors.
    for sensor in &compiled.sensing.sensors {
        read(view, sensor, truth, order);
    }
}

/// Writes the true reading of one sensor to `truth`. `order` is a buffer for contacts.
fn read<R: Real>(view: SensorView<'_, R>, sensor: &CompiledSensor<R::Scalar>, truth: &mut [R], order: &mut Vec<(f64, usize)>) {
    let SensorView { compiled, input, .. } = view;
    let (at, dim) = (sensor.at, sensor.dim);
    let place = at..at + dim;
    let tree = |index: &usize| &compiled.sensing.subtrees[*index];
    let scalar = |x: R| [x, R::zero(), R::zero()];
    let paths = &view.kinematics.paths;
    let value = |length: &Combination<R::Scalar>| kernel!(R, || length.value(input.q, paths));
    let rate = |length: &Combination<R::Scalar>| kernel!(R, || length.rate(input.v, paths));
    let reading = match &sensor.read {
        Read::Position(q) => return truth[place].copy_from_slice(&input.q[*q..q + dim]),
        Read::Velocity(v) => return truth[place].copy_from_slice(&input.v[*v..v + dim]),
        Read::Length(length) => scalar(value(length)),
        Read::Rate(length) => scalar(rate(length)),
        Read::ActuatorForce(actuators) => scalar(total(actuators, &input.actuator_forces.force)),
        Read::JointForce(dof) => scalar(input.actuator_forces.without_springs[*dof]),
        Read::ActuatorLength(a) => scalar(input.actuator_forces.length(compiled, *a, input.q)),
        Read::ActuatorRate(a) => scalar(input.actuator_forces.rate(compiled, *a, input.v)),
        Read::LimitPos(length, range) => scalar(overlap(value(length), R::one(), bounds(compiled, range))[0]),
        Read::LimitVel(length, range) => scalar(overlap(value(length), rate(length), bounds(compiled, range))[1]),
        Read::LimitForce(limit) => scalar(input.scalar_impulse[*limit] / input.h),
        Read::Nothing => scalar(R::zero()),
        Read::Clock => scalar(input.time),
        Read::Potential(all) => scalar(view.potential(tree(all))),
        Read::Kinetic(all) => scalar(view.kinetic(tree(all))),
        Read::Inside(object, zone) => scalar(view.inside(object, zone)),
        Read::Touch(body, zone) => scalar(view.touch(*body, zone)),
        Read::Magnetometer(site) => magnetic_field(compiled, view.kinematics, site),
        Read::Velocimeter(site) => view.site_motion(site, false)[1],
        Read::Gyro(site) => view.site_motion(site, false)[0],
        Read::Accelerometer(site) => view.site_motion(site, true)[1],
        Read::Force(site) => view.site_forces[*site][0],
        Read::Torque(site) => view.site_forces[*site][1],
        Read::Com(subtree) => view.com(tree(subtree), zero()),
        Read::ComVelocity(subtree) => view.com_velocity(tree(subtree)),
        Read::AngularMomentum(subtree) => view.angular_momentum(tree(subtree)),
        Read::Combination(terms) => return combine(terms, at, dim, truth),
        Read::Contact(sides, fields, reduction) => return view.contacts(sides, fields, *reduction, order, &mut truth[place]),
        Read::Frame(what, object, reference) => {
            let mut out = [R::zero(); 4];
            view.frame(*what, object, reference.as_ref(), &mut out[..dim]);
            return truth[place].copy_from_slice(&out[..dim]);
        }
        Read::Range(site, rays, fields, solids) => {
            return view.range(site, rays, fields, solids, &mut truth[place]);
        }
        Read::Proximity(what, pairs, cutoff) => {
            return view.proximity(*what, pairs, R::splat(*cutoff), &mut truth[place]);
        }
    };
    truth[place].copy_from_slice(&reading[..dim]);
}

/// Magnetic flux density in a site's axes, T.
fn magnetic_field<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, site: &SensorFrame<R::Scalar>) -> V3<R> {
    kernel!(R, || rotate_back(&mat_mul(&kinematics.mat[site.frame], &splat(site.mat)), splat(compiled.sensing.magnetic)))
}

/// Sum of those entries of `x` whose indices are in `which`.
fn total<R: Real>(which: &[usize], x: &[R]) -> R {
    kernel!(R, || {
        which.iter().fold(
            R::zero(),
            #[inline(always)]
            |sum, &i| sum + x[i],
        )
    })
}

/// Writes the reading of a combination sensor, `dim` numbers, to `truth` from the address `at`. Each number is the sum of coefficients
/// times the corresponding numbers of other sensors' readings. `terms` are pairs of a reading's address and its coefficient.
fn combine<R: Real>(terms: &[(usize, R::Scalar)], at: usize, dim: usize, truth: &mut [R]) {
    kernel!(R, || {
        for k in 0..dim {
            let mut sum = R::zero();
            for &(from, c) in terms {
                sum += R::splat(c) * truth[from + k];
            }
            truth[at + k] = sum;
        }
    })
}

fn bounds<R: Real>(compiled: &LaneModel<R>, bounds: &Bounds<R::Scalar>) -> [R; 2] {
    match *bounds {
        Bounds::Limit(limit) => compiled.params.limit(limit),
        Bounds::Range(range) => range.map(R::splat),
    }
}

/// Minus the distance of `q` beyond the nearer end of its range, and the time derivative of this number at the velocity `v`. Both are zero
/// within the range.
fn overlap<R: Real>(q: R, v: R, [low, high]: [R; 2]) -> [R; 2] {
    kernel!(R, || {
        let z = R::zero();
        let (below, above) = (q - low, high - q);
        let (under, over) = (below.lt(z), above.lt(z));
        [R::select(under, below, R::select(over, above, z)), R::select(under, v, R::select(over, -v, z))]
    })
}

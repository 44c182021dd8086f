//! Gyroscopic motion of single bodies, free or on a ball joint, by a discrete midpoint rule that keeps their angular momentum.
//!
//! Let h be the time step, I the inertia, and R the orientation in the middle of the step. With the angular velocities w before and w+
//! after the step, the body moves from R exp(-h/2 w) to R exp(h/2 w+). Its angular momentum before and after, in the axes of R, is p-(w) =
//! exp(-h/2 w) I w and p+(w+) = exp(h/2 w+) I w+. If the evaluation point is not the middle, `time_before` and `time_after` replace the two
//! halves. The step
//!
//! ```text
//! p+(w+) = p-(w) + h t
//! ```
//!
//! with the torque t is the same with time reversed, so that it is of second order and its energy does not drift (Hairer, Lubich & Wanner
//! 2006, sections II.3 and XI.3). The momentum in world axes changes by exactly the impulse. Centres of mass away from the joint are
//! included: linear momentum and spin of a free body, angular momentum about the anchor of a ball joint.
//!
//! With the mass matrix M in the middle of the step, the equation is w+ = w + M^-1 (h t - N), a fixed-point equation for w+. Here N
//! = p+(w+) - p-(w) - M (w+ - w). Newton's method solves it.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::{CompiledSingleBody, Inertial, LaneModel};
use crate::dynamics::inertia::MassMatrix;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::model::JointKind;

/// Largest number of Newton steps for the gyroscopic motion of a single body.
///
/// Evidence: 2 to 4 suffice up to a radian per step. A wheel that turns by 20 rad per step about its axis, and wobbles, needs up to 8.
const NEWTON_STEPS: usize = 16;

/// Largest error of the rotation in a step, rad, or relative to rotations above a radian. If Newton's method leaves a larger one, the step
/// is unresolved.
const MAX_ERROR: f64 = 1e-4;

/// Corrects the free velocities `v_free` (velocities without constraint impulses) of single bodies so that they follow the discrete
/// midpoint rule, in the lanes `lanes`. `v` is the velocity before the step. `v_free` contains the gyroscopic force at the velocity
/// `v_eval`.
///
/// `times` returns two durations for a degree of freedom, s: from the beginning of the step to its evaluation point (the time at which
/// forces are evaluated), and from there to the end. Lanes in which Newton's method finds no solution are added to `unresolved`, which has
/// an entry for each mechanism.
pub fn correct<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    mass: &MassMatrix<R>,
    times: impl Fn(usize) -> [R; 2],
    [v, v_eval]: [&[R]; 2],
    v_free: &mut [R],
    (lanes, unresolved): (R::Mask, &mut [R::Mask]),
) {
    let rounding = R::of(100.0 * <R::Scalar as Scalar>::EPSILON.to_f64());
    kernel!(R, || {
        for single in &compiled.single_bodies {
            let Some((body, tumbles)) = Body::of_single(compiled, kinematics, single) else { continue };
            let (at, tumbles) = (single.dof, tumbles.and(lanes));
            if tumbles.none() {
                continue;
            }
            let [time_before, time_after] = times(at);
            let h = time_before + time_after;
            let [old, start] = [v, &*v_free].map(|v| take(v, at, single.kind));
            let before = body.momentum(&old, &turn(&old, -time_before));
            let explicit = scale(body.gyroscopic(&take(v_eval, at, single.kind)), h);
            let turns = largest(spin_of(&old)) * h;
            let mut new = select(turns.gt(R::one()), old, start);
            let added = added_inertia(compiled, mass, single, &body);
            let (mut searching, mut is_far) = (tumbles, tumbles);
            for _ in 0..=NEWTON_STEPS {
                let turn = turn(&new, time_after);
                let mut change = sub(explicit, body.transport([&old, &new], before, &turn));
                solve(compiled, mass, single, &mut change);
                let image = add(start, change);
                let error = sub(spin_of(&image), spin_of(&new));
                // Slow rotations may have rounding errors of fast translations.
                let (size, scale) = (largest(error) * h, (largest(spin_of(&new)) * h).max(R::one()));
                is_far = is_far.and_not(searching.and(size.le(scale * R::of(MAX_ERROR))));
                let unfinished = searching.and_not(size.le(scale * rounding));
                let step = body.newton_step(&added, spin_of(&new), error, time_after, &turn);
                let w = add(spin_of(&new), step);
                new = select(searching, [image[0], image[1], image[2], w[0], w[1], w[2]], new);
                searching = unfinished;
                if searching.none() {
                    break;
                }
            }
            let unresolved = &mut unresolved[compiled.mechanism_of(at)];
            *unresolved = unresolved.or(is_far);
            let dofs = single.kind.nv();
            v_free[at..at + dofs].copy_from_slice(&select(tumbles, new, start)[6 - dofs..]);
        }
    })
}

/// Corrects the free velocities `v_free` (velocities without constraint impulses) of single bodies so that contact impulses change their
/// momentum exactly.
///
/// `v_free` contains the gyroscopic force at the velocity `v` before the step, applied for the time `times[0]`, s. It also contains this
/// force at the velocity `after` the step, applied for `times[1]`. `evaluation_times` are two durations, s: from the beginning of the step
/// to its evaluation point, and from there to the end. `times_of` returns the evaluation times and `times` for a degree of freedom.
pub fn correct_spin<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    mass: &MassMatrix<R>,
    times_of: impl Fn(usize) -> [[R; 2]; 2],
    [v, after]: [&[R]; 2],
    v_free: &mut [R],
) {
    kernel!(R, || {
        for single in &compiled.single_bodies {
            let Some((body, tumbles)) = Body::of_single(compiled, kinematics, single) else { continue };
            let at = single.dof;
            let [[time_before, time_after], times] = times_of(at);
            let [old, new] = [v, after].map(|v| take(v, at, single.kind));
            let explicit = add_scaled(scale(body.gyroscopic(&old), times[0]), body.gyroscopic(&new), times[1]);
            let before = body.momentum(&old, &turn(&old, -time_before));
            let mut change = sub(explicit, body.transport([&old, &new], before, &turn(&new, time_after)));
            solve(compiled, mass, single, &mut change);
            let dofs = single.kind.nv();
            for (v, change) in v_free[at..at + dofs].iter_mut().zip(&change[6 - dofs..]) {
                *v = R::select(tumbles, *v + *change, *v);
            }
        }
    })
}

/// Velocity of the free or ball joint whose first degree of freedom is `at`. The linear part, in world axes, comes first and is zero for a
/// ball joint. The angular part is in the body's axes.
#[inline(always)]
fn take<R: Real>(v: &[R], at: usize, kind: JointKind) -> V6<R> {
    let mut out = zero();
    let dofs = kind.nv();
    out[6 - dofs..].copy_from_slice(&v[at..at + dofs]);
    out
}

/// Angular part of the velocity of a single body.
#[inline(always)]
fn spin_of<R: Real>(v: &V6<R>) -> V3<R> {
    [v[3], v[4], v[5]]
}

/// Rotation of a single body with the velocity `v` in `time` seconds.
#[inline(always)]
fn turn<R: Real>(v: &V6<R>, time: R) -> M3<R> {
    quat_to_mat(quat_exp(scale(spin_of(v), time)))
}

/// Largest magnitude of the components of `x`, or NaN if any is NaN.
#[inline(always)]
fn largest<R: Real>(x: V3<R>) -> R {
    x[0].abs().max_or_nan(x[1].abs()).max_or_nan(x[2].abs())
}

/// Columns of the inertia that the matrix A has in addition to the mass matrix of a single body, for its rotation: armature and implicit
/// damping. `mass` has the factors of A.
#[inline(always)]
fn added_inertia<R: Real>(
    compiled: &LaneModel<R>,
    mass: &MassMatrix<R>,
    single: &CompiledSingleBody<R::Scalar>,
    body: &Body<R>,
) -> [V3<R>; 3] {
    let first = single.dof + single.kind.nv() - 3;
    let mut added = [zero(); 3];
    for (j, column) in added.iter_mut().enumerate() {
        *column = scale(body.spin_about_joint(unit(j)), -R::one());
    }
    // A = L^T D L. The rotation comes last, so that its part of A has only these rows of L.
    for k in 0..3 {
        let mut row: V3<R> = unit(k);
        for i in 0..k {
            row[i] = mass.entries[compiled.dofs[first + k].chain + k - i];
        }
        let pivot = R::one() / mass.inv_d[first + k];
        for j in 0..=k {
            added[j] = add_scaled(added[j], row, row[j] * pivot);
        }
    }
    added
}

/// Unit vector along the axis `k`.
#[inline(always)]
fn unit<R: Real>(k: usize) -> V3<R> {
    let mut unit = zero();
    unit[k] = R::one();
    unit
}

/// Solves x <- A^-1 x for the degrees of freedom of one single body. `mass` has the factors of A.
#[inline(always)]
fn solve<R: Real>(compiled: &LaneModel<R>, mass: &MassMatrix<R>, single: &CompiledSingleBody<R::Scalar>, x: &mut V6<R>) {
    let (n, at) = (single.kind.nv(), single.dof);
    let skip = 6 - n;
    if skip > 0 {
        x[..skip].fill(R::zero());
    }
    // The row of a dof has entries for the dof and its ancestors towards the root, which are the previous dofs.
    for i in (0..n).rev() {
        let row = &mass.entries[compiled.dofs[at + i].chain..];
        for k in 1..=i {
            x[skip + i - k] -= row[k] * x[skip + i];
        }
    }
    for i in 0..n {
        x[skip + i] *= mass.inv_d[at + i];
    }
    for i in 0..n {
        let row = &mass.entries[compiled.dofs[at + i].chain..];
        for k in (1..=i).rev() {
            x[skip + i] -= row[k] * x[skip + i - k];
        }
    }
}

/// Single body on a free or ball joint, at its pose in the middle of the step.
struct Body<R: Real> {
    mat: M3<R>,
    mass: R,
    /// Inertia about the centre of mass in body axes: xx, yy, zz, xy, xz, yz, kg m^2.
    inertia: [R; 6],
    /// Centre of mass relative to the joint in body axes, m.
    arm: V3<R>,
    /// Whether the body is on a free joint; otherwise on a ball joint.
    free: bool,
}

impl<R: Real> Body<R> {
    /// Creates the single body of `single`, a link alone on a free or ball joint. Also returns the lanes in which the body has a
    /// gyroscopic force. `None` if it has none in any lane, as for a ball.
    #[inline(always)]
    fn of_single(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, single: &CompiledSingleBody<R::Scalar>) -> Option<(Self, R::Mask)> {
        let Inertial { mass, com, inertia } = compiled.params.inertial(single.link);
        let body = Self {
            mat: kinematics.mat[single.link + 1],
            mass,
            inertia,
            arm: sub(com, splat(single.anchor)),
            free: single.kind == JointKind::Free,
        };
        let tumbles = body.is_round().not();
        tumbles.any().then_some((body, tumbles))
    }

    /// Lanes in which the body has no gyroscopic force: all principal inertias are equal, and the centre of mass is at the joint.
    #[inline(always)]
    fn is_round(&self) -> R::Mask {
        let [xx, yy, zz, rest @ ..] = self.inertia;
        let mut is_round = xx.eq(yy).and(yy.eq(zz));
        for x in [rest, self.arm].as_flattened() {
            is_round = is_round.and(x.eq(R::zero()));
        }
        is_round
    }

    /// Angular momentum I w in body axes, kg m^2/s.
    #[inline(always)]
    fn spin(&self, w: V3<R>) -> V3<R> {
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        [xx * w[0] + xy * w[1] + xz * w[2], xy * w[0] + yy * w[1] + yz * w[2], xz * w[0] + yz * w[1] + zz * w[2]]
    }

    /// Angular momentum of a rotation with the angular velocity `w`, kg m^2/s: about the centre of mass of a free body, and about the
    /// anchor of a ball joint.
    #[inline(always)]
    fn turning(&self, w: V3<R>) -> V3<R> {
        if self.free { self.spin(w) } else { self.spin_about_joint(w) }
    }

    /// Angular momentum about the joint of a rotation with the angular velocity `w` about the joint, kg m^2/s.
    #[inline(always)]
    fn spin_about_joint(&self, w: V3<R>) -> V3<R> {
        add(self.spin(w), scale(cross(self.arm, cross(w, self.arm)), self.mass))
    }

    /// Newton step for the angular velocity `w` after the step: the change that removes `error`, the error of the fixed-point equation.
    ///
    /// The step d solves (E + P) d = (E + I) error. E is `added`, by columns, and I the inertia. P is the derivative of exp(t w) I w with
    /// respect to w, where t is the time `time`, and exp(t w) is `turn`. P d = exp(t w) (I d + (t J(t w) d) x I w), with the right Jacobian
    /// J of the exponential map.
    #[inline(always)]
    fn newton_step(&self, added: &[V3<R>; 3], w: V3<R>, error: V3<R>, time: R, turn: &M3<R>) -> V3<R> {
        let (rotation, momentum) = (scale(w, time), self.turning(w));
        let square = dot(rotation, rotation);
        let small = square.lt(R::of(1e-4));
        let angle = R::select(small, R::one(), square).sqrt();
        let (sin, cos) = angle.sin_cos();
        // (1 - cos x) / x^2 and (x - sin x) / x^3, by their series below 0.01 rad.
        let b = R::select(small, R::of(0.5) - square * R::of(1.0 / 24.0), (R::one() - cos) / (angle * angle));
        let c = R::select(small, R::of(1.0 / 6.0) - square * R::of(1.0 / 120.0), (angle - sin) / (angle * angle * angle));
        let (mut columns, mut target) = (*added, self.turning(error));
        for (k, column) in columns.iter_mut().enumerate() {
            target = add_scaled(target, *column, error[k]);
            let unit = unit(k);
            let once = cross(rotation, unit);
            let turned = add_scaled(add_scaled(unit, once, -b), cross(rotation, once), c);
            *column = add(*column, rotate(turn, add(self.turning(unit), scale(cross(turned, momentum), time))));
        }
        let [k0, k1, k2] = columns;
        let minors = [cross(k1, k2), cross(k2, k0), cross(k0, k1)];
        scale([dot(minors[0], target), dot(minors[1], target), dot(minors[2], target)], dot(k0, minors[0]).recip())
    }

    /// Momentum of the body at the velocity `v`, after the rotation `turn` from the middle of the step. The linear part is in world axes.
    /// The angular part is about the joint, in the body axes at the middle of the step.
    #[inline(always)]
    fn momentum(&self, v: &V6<R>, turn: &M3<R>) -> V6<R> {
        let (u, w) = ([v[0], v[1], v[2]], spin_of(v));
        let own = rotate(turn, self.spin(w));
        // All quantities are in the body axes at the middle of the step.
        let u = rotate_back(&self.mat, u);
        let arm = rotate(turn, self.arm);
        let speed = add(u, rotate(turn, cross(w, self.arm)));
        let p = scale(speed, self.mass);
        // Only torques about the centre of mass change the spin of a free body, independent of that centre's displacement.
        let place = if self.free { self.arm } else { arm };
        let l = add(own, cross(place, p));
        let p = rotate(&self.mat, p);
        [p[0], p[1], p[2], l[0], l[1], l[2]]
    }

    /// Product M v of the body's mass matrix in the middle of the step and the velocity `v`.
    #[inline(always)]
    fn inertial(&self, v: &V6<R>) -> V6<R> {
        let (u, w) = (rotate_back(&self.mat, [v[0], v[1], v[2]]), spin_of(v));
        let p = scale(add(u, cross(w, self.arm)), self.mass);
        let l = add(self.spin(w), cross(self.arm, p));
        let p = rotate(&self.mat, p);
        [p[0], p[1], p[2], l[0], l[1], l[2]]
    }

    /// Term N of the fixed-point equation: momentum at the velocity `new` after the step, minus the momentum `before` the step, minus M
    /// (new - old). `old` is the velocity before the step, and M the mass matrix. `turn` is the rotation from the middle of the step to its
    /// end.
    #[inline(always)]
    fn transport(&self, [old, new]: [&V6<R>; 2], before: V6<R>, turn: &M3<R>) -> V6<R> {
        sub(sub(self.momentum(new, turn), before), self.inertial(&sub(*new, *old)))
    }

    /// Velocity-dependent part of the bias force at the velocity `v`.
    #[inline(always)]
    fn gyroscopic(&self, v: &V6<R>) -> V6<R> {
        let w = spin_of(v);
        let p = scale(cross(w, cross(w, self.arm)), self.mass);
        let l = add(cross(w, self.spin(w)), cross(self.arm, p));
        let p = if self.free { rotate(&self.mat, p) } else { zero() };
        [p[0], p[1], p[2], l[0], l[1], l[2]]
    }
}

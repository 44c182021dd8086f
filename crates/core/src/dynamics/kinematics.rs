//! Kinematics: poses of all frames, joint axes, and link velocities.

use stepper_real::{Real, Scalar, kernel};

use crate::compile::{CompiledJoint, Inertial, LaneModel, Link, ModelStructure, PathLengths};
use crate::math::spatial::*;
use crate::model::JointKind;

/// Poses of all frames, and the joint axes, at one configuration, in world axes.
#[derive(Clone, Debug)]
pub struct Kinematics<R: Real> {
    /// Origin of every frame, m.
    pub pos: Vec<V3<R>>,
    /// Rotation matrix of every frame, row-major.
    pub mat: Vec<M3<R>>,
    /// Reference point of every kinematic tree, m: the origin of its root link.
    pub origin: Vec<V3<R>>,
    /// Spatial velocity per unit velocity of every dof, at the reference point of its kinematic tree.
    pub axes: Vec<V6<R>>,
    /// Velocity of every mocap body: angular, rad/s, and linear at its origin, m/s.
    pub mocap_velocities: Vec<V6<R>>,
    /// Inertia of every link about the reference point of its kinematic tree.
    pub inertia: Vec<Inertia<R>>,
    /// Lengths and moment arms of the paths of spatial tendons.
    pub paths: PathLengths<R>,
    /// Three lists over all hinges in the order of the joints: rotation angle from the reference, rad; its sine; its cosine.
    turns: [Vec<R>; 3],
}

impl<R: Real> Kinematics<R> {
    /// Allocates the kinematics of a compiled model. Only the poses of the world and of the mocap bodies, as at reset, are valid before the
    /// first [`Kinematics::update`].
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let identity = std::array::from_fn(|k| if k % 4 == 0 { R::one() } else { R::zero() });
        let mut kinematics = Self {
            pos: vec![zero(); compiled.nframe()],
            mat: vec![identity; compiled.nframe()],
            origin: vec![zero(); compiled.ntree],
            axes: vec![zero(); compiled.nv],
            mocap_velocities: vec![zero(); compiled.mocap.len()],
            inertia: vec![zero(); compiled.links.len()],
            paths: PathLengths::new(&compiled.paths),
            turns: std::array::from_fn(|_| vec![R::zero(); hinges(compiled).count()]),
        };
        for m in &compiled.mocap {
            kinematics.pos[m.frame] = splat(m.pos);
            kinematics.mat[m.frame] = quat_to_mat(splat(m.quat));
        }
        kinematics
    }

    /// Updates all poses, axes, inertias of links, and paths of tendons to the configuration `q`. Mocap frames do not change.
    pub fn update(&mut self, compiled: &LaneModel<R>, q: &[R]) {
        kernel!(R, || {
            self.turn_all(compiled, q);
            let mut hinge = 0;
            for (l, link) in compiled.links.iter().enumerate() {
                let (pos, mat) = self.place(compiled, link, q, &mut hinge);
                self.pos[l + 1] = pos;
                self.mat[l + 1] = mat;
                if link.is_root {
                    self.origin[link.tree] = pos;
                }
                let origin = self.origin[link.tree];
                self.refer_axes_to(compiled, link, origin);
                let Inertial { mass, com, inertia } = compiled.params.inertial(l);
                let com = sub(add(pos, rotate(&mat, com)), origin);
                self.inertia[l] = inertia_at(mass, inertia, &mat, com);
            }
            if !compiled.paths.is_empty() {
                self.measure_paths(compiled);
            }
        })
    }

    /// Computes the sines and cosines of all hinge angles. In groups of one lane, the compiler can vectorise the separate loop over the
    /// hinges.
    #[inline(always)]
    fn turn_all(&mut self, compiled: &LaneModel<R>, q: &[R]) {
        let [angles, sines, cosines] = &mut self.turns;
        for (angle, joint) in angles.iter_mut().zip(hinges(compiled)) {
            *angle = q[joint.q] - R::splat(joint.reference);
        }
        for ((&angle, sin), cos) in angles.iter().zip(sines).zip(cosines) {
            (*sin, *cos) = angle.sin_cos();
        }
    }

    /// Computes the pose of a link, and writes its joint axes to `axes`: (axis, anchor) of rotations, and (0, axis) of translations.
    ///
    /// `hinge` is the index of the link's first hinge among all hinges. The function advances it past the hinges of the link.
    #[inline(always)]
    fn place(&mut self, compiled: &LaneModel<R>, link: &Link<R::Scalar>, q: &[R], hinge: &mut usize) -> (V3<R>, M3<R>) {
        let (base, frame) = (self.pos[link.parent], self.mat[link.parent]);
        let mut pos = add(base, rotate(&frame, splat(link.pos)));
        let mut mat = match link.mat {
            Some(m) => mat_mul(&frame, &splat(m)),
            None => frame,
        };
        for joint in &compiled.joints[link.joints.clone()] {
            let v = joint.v;
            match joint.kind {
                JointKind::Free => {
                    pos = [q[joint.q], q[joint.q + 1], q[joint.q + 2]];
                    mat = quat_to_mat(quat_at(q, joint.q + 3));
                    for k in 0..3 {
                        let mut unit = [R::zero(); 3];
                        unit[k] = R::one();
                        self.axes[v + k] = spatial(zero(), unit);
                        self.axes[v + 3 + k] = spatial(column(&mat, k), pos);
                    }
                }
                JointKind::Ball => {
                    let anchor = add(pos, rotate(&mat, splat(joint.anchor)));
                    mat = mat_mul(&mat, &quat_to_mat(quat_at(q, joint.q)));
                    pos = sub(anchor, rotate(&mat, splat(joint.anchor)));
                    for k in 0..3 {
                        self.axes[v + k] = spatial(column(&mat, k), anchor);
                    }
                }
                JointKind::Slide => {
                    let axis = rotate(&mat, splat(joint.axis));
                    pos = add_scaled(pos, axis, q[joint.q] - R::splat(joint.reference));
                    self.axes[v] = spatial(zero(), axis);
                }
                JointKind::Hinge => {
                    let [_, sines, cosines] = &self.turns;
                    let (axis, turned) = turn(&mat, joint, sines[*hinge], cosines[*hinge]);
                    *hinge += 1;
                    let mut anchor = pos;
                    if !joint.centred {
                        let arm = splat(joint.anchor);
                        anchor = add(pos, rotate(&mat, arm));
                        pos = sub(anchor, rotate(&turned, arm));
                    }
                    mat = turned;
                    self.axes[v] = spatial(axis, anchor);
                }
            }
        }
        (pos, mat)
    }

    /// Converts `axes` of the rotations of a link from (axis, anchor) to spatial velocities at the reference point `origin`.
    #[inline(always)]
    fn refer_axes_to(&mut self, compiled: &LaneModel<R>, link: &Link<R::Scalar>, origin: V3<R>) {
        for joint in &compiled.joints[link.joints.clone()] {
            let rotations = match joint.kind {
                JointKind::Free => joint.v + 3..joint.v + 6,
                JointKind::Ball => joint.v..joint.v + 3,
                JointKind::Hinge => joint.v..joint.v + 1,
                JointKind::Slide => continue,
            };
            for d in rotations {
                let (axis, anchor) = (angular(&self.axes[d]), linear(&self.axes[d]));
                self.axes[d] = spatial(axis, cross(axis, sub(origin, anchor)));
            }
        }
    }

    /// Computes the spatial velocity of every link at the reference point of its kinematic tree.
    #[inline(always)]
    pub fn velocities(&self, compiled: &LaneModel<R>, v: &[R], out: &mut [V6<R>]) {
        for (l, link) in compiled.links.iter().enumerate() {
            let mut motion = if link.is_root { zero() } else { out[link.parent - 1] };
            for d in link.dofs.clone() {
                motion = add_scaled(motion, self.axes[d], v[d]);
            }
            out[l] = motion;
        }
    }

    /// Sets the poses of mocap bodies to those in `from`.
    pub(crate) fn copy_mocap_poses(&mut self, compiled: &ModelStructure<R::Scalar>, from: &Self) {
        for mocap in &compiled.mocap {
            self.pos[mocap.frame] = from.pos[mocap.frame];
            self.mat[mocap.frame] = from.mat[mocap.frame];
        }
    }

    /// World position of the point `local`, given in the axes of a frame, m.
    #[inline(always)]
    pub fn point(&self, frame: usize, local: V3<R>) -> V3<R> {
        add(self.pos[frame], rotate(&self.mat[frame], local))
    }
}

/// Hinge joints of the compiled model, in the order of the joints.
#[inline(always)]
fn hinges<S: Scalar>(compiled: &ModelStructure<S>) -> impl Iterator<Item = &CompiledJoint<S>> {
    compiled.joints.iter().filter(|joint| joint.kind == JointKind::Hinge)
}

/// Axis of a hinge in the world, and rotation matrix of the frame after the rotation about the axis. `mat` is the matrix before the
/// rotation, and `sin` and `cos` are the sine and cosine of the hinge angle.
#[inline(always)]
pub(super) fn turn<R: Real>(mat: &M3<R>, joint: &CompiledJoint<R::Scalar>, sin: R, cos: R) -> (V3<R>, M3<R>) {
    let Some((k, backwards)) = joint.principal else {
        let axis = splat(joint.axis);
        return (rotate(mat, axis), mat_mul(mat, &axis_rotation(axis, sin, cos)));
    };
    let sin = if backwards { -sin } else { sin };
    let (axis, out) = match k {
        0 => turn_about::<R, 0>(mat, sin, cos),
        1 => turn_about::<R, 1>(mat, sin, cos),
        _ => turn_about::<R, 2>(mat, sin, cos),
    };
    (if backwards { scale(axis, -R::one()) } else { axis }, out)
}

/// Axis `K` of a frame in the world, and rotation matrix of the frame after the rotation about this axis. Only the other two columns
/// change.
///
/// `K` is constant, because a variable index would force the matrix into memory.
#[inline(always)]
fn turn_about<R: Real, const K: usize>(mat: &M3<R>, sin: R, cos: R) -> (V3<R>, M3<R>) {
    let (i, j) = ((K + 1) % 3, (K + 2) % 3);
    let mut out = *mat;
    for r in 0..3 {
        let (a, b) = (mat[3 * r + i], mat[3 * r + j]);
        out[3 * r + i] = a * cos + b * sin;
        out[3 * r + j] = b * cos - a * sin;
    }
    (column(mat, K), out)
}

/// Quaternion (w, x, y, z) in the configuration `q`, from address `at` on.
#[inline(always)]
pub fn quat_at<R: Real>(q: &[R], at: usize) -> [R; 4] {
    [q[at], q[at + 1], q[at + 2], q[at + 3]]
}

/// Computes the separation of the configuration `to` from the configuration `from`, in the coordinates of velocities, nv, m or rad.
/// Returns its size: the largest change of a coordinate, or angle of a ball or free joint.
#[inline(always)]
pub(crate) fn separate<R: Real>(compiled: &LaneModel<R>, [from, to]: [&[R]; 2], separation: &mut [R]) -> R {
    let mut farthest = R::zero();
    for joint in &compiled.joints {
        let (straight, turns) = match joint.kind {
            JointKind::Free => (3, true),
            JointKind::Ball => (0, true),
            JointKind::Slide | JointKind::Hinge => (1, false),
        };
        for k in 0..straight {
            separation[joint.v + k] = to[joint.q + k] - from[joint.q + k];
            farthest = farthest.max(separation[joint.v + k].abs());
        }
        if turns {
            let turn = quat_log(quat_between(quat_at(from, joint.q + straight), quat_at(to, joint.q + straight)));
            separation[joint.v + straight..joint.v + straight + 3].copy_from_slice(&turn);
            farthest = farthest.max(norm(turn));
        }
    }
    farthest
}

/// Computes q (+) factor d into `out`: the configuration after the displacement factor d. `d` has the coordinates of velocities (nv).
pub fn displace<R: Real>(compiled: &LaneModel<R>, q: &[R], d: &[R], factor: R, out: &mut [R]) {
    displace_joints(
        compiled,
        q,
        d,
        #[inline(always)]
        |_| factor,
        out,
    );
}

/// Displaces a configuration as [`displace`], with the factor `factor(dof)` for the joint whose first degree of freedom is `dof`.
#[inline(always)]
pub fn displace_joints<R: Real>(compiled: &LaneModel<R>, q: &[R], d: &[R], factor: impl Fn(usize) -> R, out: &mut [R]) {
    kernel!(R, || {
        for joint in &compiled.joints {
            let (qa, va) = (joint.q, joint.v);
            let factor = factor(va);
            match joint.kind {
                JointKind::Free => {
                    for k in 0..3 {
                        out[qa + k] = q[qa + k] + d[va + k] * factor;
                    }
                    turn_quat(q, qa + 3, [d[va + 3], d[va + 4], d[va + 5]], factor, out);
                }
                JointKind::Ball => turn_quat(q, qa, [d[va], d[va + 1], d[va + 2]], factor, out),
                JointKind::Slide | JointKind::Hinge => out[qa] = q[qa] + d[va] * factor,
            }
        }
    })
}

#[inline(always)]
fn turn_quat<R: Real>(q: &[R], at: usize, w: V3<R>, factor: R, out: &mut [R]) {
    let turned = quat_normalize(quat_mul(quat_at(q, at), quat_exp(scale(w, factor))));
    out[at..at + 4].copy_from_slice(&turned);
}

/// Sum of the kinetic energies of the links, J. `velocities` are their spatial velocities.
pub fn kinetic_energy<R: Real>(kinematics: &Kinematics<R>, velocities: &[V6<R>]) -> R {
    kernel!(R, || {
        let mut sum = R::zero();
        for (inertia, v) in kinematics.inertia.iter().zip(velocities) {
            sum += dot6(apply_inertia(inertia, v), *v);
        }
        sum * R::of(0.5)
    })
}

/// Lanes in which every entry of `x` is finite.
#[inline(always)]
pub fn all_finite<R: Real>(x: &[R]) -> R::Mask {
    // 0 * x is 0 for a finite x and NaN otherwise. The sum over all entries is thus finite only if every entry is.
    let zero = R::zero();
    let mut sum = zero;
    for &x in x {
        sum += x * zero;
    }
    sum.is_finite()
}

/// Computes out = x + rate * time, entry by entry.
pub fn advance<R: Real>(x: &[R], rate: &[R], time: R, out: &mut [R]) {
    kernel!(R, || {
        for ((out, &x), &rate) in out.iter_mut().zip(x).zip(rate) {
            *out = x + rate * time;
        }
    })
}

/// Computes out = x - y, entry by entry.
pub fn difference<R: Real>(x: &[R], y: &[R], out: &mut [R]) {
    kernel!(R, || {
        for ((out, &x), &y) in out.iter_mut().zip(x).zip(y) {
            *out = x - y;
        }
    })
}

/// Copies the lanes `lanes` of a list.
pub(crate) fn select_into<R: Real>(to: &mut [R], from: &[R], lanes: R::Mask) {
    kernel!(R, || {
        for (to, &from) in to.iter_mut().zip(from) {
            *to = R::select(lanes, from, *to);
        }
    });
}

/// Computes out = x + share * (end - x), entry by entry.
pub fn blend<R: Real>(x: &[R], end: &[R], share: R, out: &mut [R]) {
    kernel!(R, || {
        for ((out, &x), &end) in out.iter_mut().zip(x).zip(end) {
            *out = x + (end - x) * share;
        }
    })
}

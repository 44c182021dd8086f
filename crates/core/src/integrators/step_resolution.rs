//! Motion that a step is too long for.
//!
//! Velocity-dependent inertial forces are quadratic in the velocity and taken explicitly, with one corrector pass. Where that pass does not
//! converge - some joint turns by a good part of a radian in a step, and the pass changes the velocity by as much as it is - the forces of
//! a wrong velocity make a larger one, and a few steps later the numbers overflow. There the step goes without these forces, and what it
//! must not violate is kept by force: kinetic energy does not exceed that before the step and the work of all other forces, contacts not
//! counted where they would add to it, and no joint but a slide leaves the step with more than a radian a step. Status UNRESOLVED says so.
//!
//! Speed and energy are bounded in the same way, but no force is left out, where impulses turn a joint by half a turn and more within the
//! step, as levers in a jam do: the rows are linearised at one pose, and say nothing of what the joint meets that far on.

use stepper_real::{Mask, Real};

use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::kinematics::{Kinematics, kinetic_energy};
use crate::math::spatial::*;
use crate::model::JointKind;

/// Turn of a joint in a step from which on it is looked at, rad.
const FAST_TURN: f64 = 0.5;

/// Fastest turn that a joint leaves such a step with, rad a step.
const MAX_TURN: f64 = 1.0;

/// Change of the velocity by the corrector, relative to its size, that is not convergence.
const MAX_RELATIVE_CHANGE: f64 = 0.25;

/// Lanes in which the corrector's `change` of the free velocity `v_free` says that the step is too long for its motion.
pub fn unresolved<R: Real>(compiled: &LaneModel<R>, v: &[R], v_free: &[R], change: &[R], h: R) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let fast = (fastest_turn(compiled, v).max(fastest_turn(compiled, v_free)) * h).gt(R::of(FAST_TURN));
            if fast.none() {
                return fast;
            }
            let (mut size, mut most) = (R::zero(), R::zero());
            for i in 0..compiled.nv {
                size = size.max(v[i].abs()).max(v_free[i].abs());
                // Not max, which loses a NaN.
                most = R::select(change[i].abs().le(most), most, change[i].abs());
            }
            fast.and_not(most.le(size * R::of(MAX_RELATIVE_CHANGE)))
        },
    )
}

/// Turn of a joint in a step by impulses that is no longer resolved, rad.
const MAX_IMPULSE_TURN: f64 = std::f64::consts::PI;

/// Lanes in which constraints made a hinge or a ball joint turn by half a turn in the step, faster than anything did in `v`, before it, and
/// in `v_free`, without them.
pub fn thrown<R: Real>(compiled: &LaneModel<R>, [v, v_free]: [&[R]; 2], v_next: &[R], h: R) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let mut turn = R::zero();
            for joint in compiled.joints.iter().filter(|j| matches!(j.kind, JointKind::Hinge | JointKind::Ball)) {
                for &v in &v_next[joint.v..joint.v + joint.kind.nv()] {
                    turn = turn.max(v.abs());
                }
            }
            let far = (turn * h).gt(R::of(MAX_IMPULSE_TURN));
            if far.none() {
                return far;
            }
            far.and(turn.gt(fastest_turn(compiled, v).max(fastest_turn(compiled, v_free))))
        },
    )
}

/// Largest angular velocity of a joint, rad/s.
#[inline(always)]
fn fastest_turn<R: Real>(compiled: &LaneModel<R>, v: &[R]) -> R {
    let mut turn = R::zero();
    for joint in compiled.joints.iter().filter(|j| j.kind != JointKind::Slide) {
        let first = if joint.kind == JointKind::Free { 3 } else { 0 };
        for d in joint.v + first..joint.v + joint.kind.nv() {
            turn = turn.max(v[d].abs());
        }
    }
    turn
}

/// Slows `v` down in `lanes` until its fastest joint turns by a radian a step.
pub fn slow_down<R: Real>(compiled: &LaneModel<R>, lanes: R::Mask, h: R, v: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            let turn = fastest_turn(compiled, v) * h;
            let fast = lanes.and(turn.gt(R::of(MAX_TURN)));
            let factor = R::select(fast, R::of(MAX_TURN) / R::select(fast, turn, R::one()), R::one());
            for v in v {
                *v *= factor;
            }
        },
    )
}

/// Kinetic energy with rotors at a placed configuration, J.
fn energy<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], velocity: &mut [V6<R>]) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            kinematics.velocities(compiled, v, velocity);
            let mut sum = kinetic_energy(kinematics, velocity);
            for (d, &v) in v.iter().enumerate() {
                sum += compiled.params.dof(d).armature * v.square() * R::of(0.5);
            }
            sum
        },
    )
}

/// Room for [`StepResolution::keep_energy`].
#[derive(Clone, Debug)]
pub struct StepResolution<R: Real> {
    /// No velocity at all.
    pub rest: Vec<R>,
    kinematics: Kinematics<R>,
    velocity: Vec<V6<R>>,
}

impl<R: Real> StepResolution<R> {
    /// Room for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        Self { rest: vec![R::zero(); compiled.nv], kinematics: Kinematics::new(compiled), velocity: vec![zero(); compiled.links.len()] }
    }

    /// The velocity `v` after the step, slowed down in `lanes` until its energy is that of `before` and of the work that the step did with
    /// the inertia of `middle`; constraints, which made `v` of `v_free`, take energy out if anything. States are (q, v).
    #[expect(clippy::too_many_arguments, reason = "the states that the step joins, named at the call")]
    pub fn keep_energy(
        &mut self,
        compiled: &LaneModel<R>,
        middle: &Kinematics<R>,
        lanes: R::Mask,
        before: [&[R]; 2],
        [q, v]: [&[R]; 2],
        v_free: &[R],
        out: &mut [R],
    ) {
        for mocap in &compiled.mocap {
            self.kinematics.pos[mocap.frame] = middle.pos[mocap.frame];
            self.kinematics.mat[mocap.frame] = middle.mat[mocap.frame];
        }
        R::vectorize(
            #[inline(always)]
            || {
                let mut energy_with = |v: &[R]| energy(compiled, middle, v, &mut self.velocity);
                let work = energy_with(v).min(energy_with(v_free)) - energy_with(before[1]);
                self.kinematics.update(compiled, before[0]);
                let start = energy(compiled, &self.kinematics, before[1], &mut self.velocity);
                self.kinematics.update(compiled, q);
                let end = energy(compiled, &self.kinematics, v, &mut self.velocity);
                let allowed = (start + work).max(R::zero());
                let slower = lanes.and(end.gt(allowed));
                let factor = R::select(slower, (allowed / R::select(slower, end, R::one())).sqrt(), R::one());
                for (out, &v) in out.iter_mut().zip(v) {
                    *out = v * factor;
                }
            },
        )
    }
}

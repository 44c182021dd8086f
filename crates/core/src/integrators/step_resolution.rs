//! Motion that a step is too long for.
//!
//! Velocity-dependent inertial forces are quadratic in the velocity and taken explicitly, with one corrector pass. Where that pass does not
//! converge - some joint turns by a good part of a radian in a step, and the pass changes the velocity by as much as it is - the forces of
//! a wrong velocity make a larger one, and a few steps later the numbers overflow. There the step goes without these forces, and what it
//! must not violate is kept by force: kinetic energy does not exceed that before the step and the work of all other forces, contacts not
//! counted where they would add to it, and no joint but a slide leaves the step with more than a radian a step. Status UNRESOLVED says so.
//!
//! A step that passes this test may still make energy, since its inertial forces are those of an estimated velocity: in the whip of a
//! chain so much that it grows by a tenth within 0.1 s. Where the corrector changes the velocity by a twentieth, the step computes its
//! energy balance ([`StepResolution::gains_energy`]), and status UNRESOLVED tells of a gain. The motion is left as it is.
//!
//! Speed and energy are bounded in the same way, but no force is left out, where impulses turn a joint by half a turn and more within the
//! step, as levers in a jam do: the rows are linearised at one pose, and say nothing of what the joint meets that far on.

use stepper_real::{Mask, Real};

use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::inertia::{NewtonEuler, link_forces};
use crate::dynamics::kinematics::{Kinematics, kinetic_energy};
use crate::math::spatial::*;
use crate::model::JointKind;

/// Turn of a joint in a step from which on it is looked at, rad.
const FAST_ROTATION: f64 = 0.5;

/// Fastest turn that a joint leaves such a step with, rad a step.
const MAX_ROTATION: f64 = 1.0;

/// Change of the velocity by the corrector, relative to its size, that is not convergence.
const MAX_RELATIVE_CHANGE: f64 = 0.25;

/// Turn of a joint in a step from which on the energy balance may be computed, rad. Chains that gain energy turn by 0.07 and more.
const BALANCE_ROTATION: f64 = 0.05;

/// Change of the velocity by the corrector, relative to its size, from which on the energy balance is computed. Robots under random control
/// at their own time steps reach it in less than 1 % of their steps; chains of 5 to 40 links that gain a tenth of their energy reach it in
/// the steps that gain most.
const BALANCE_RELATIVE_CHANGE: f64 = 0.05;

/// Growth of the kinetic energy by the error of the step, relative to it, that makes a step unresolved: 1/s, and at the most in one step.
/// Eleven chains that gain more than a tenth within 0.1 s have steps of 10 to 300 / s. Twelve robots under random control at 2, 5 and 10 ms
/// have 8 / s at the most where nothing pushes.
const MAX_GROWTH_RATE: f64 = 10.0;
const MAX_GROWTH: f64 = 0.1;

/// Change of the velocity by constraints, relative to its size, from which on a step may grow by twice as much: impulses are taken at one
/// configuration of the step, so that a blow changes the energy by what turns within the step, with either sign (15 / s at 10 ms).
const IMPACT_RELATIVE_CHANGE: f64 = 0.1;

/// Lanes in which the corrector's `change` of the free velocity `v_free` says that the step is too long for its motion, and those in which
/// the step may make energy by its error.
pub fn assess_corrector<R: Real>(compiled: &LaneModel<R>, v: &[R], v_free: &[R], change: &[R], h: R) -> [R::Mask; 2] {
    R::vectorize(
        #[inline(always)]
        || {
            let turn = max_joint_rate(compiled, v).max(max_joint_rate(compiled, v_free)) * h;
            let active = turn.gt(R::of(BALANCE_ROTATION));
            if active.none() {
                return [active; 2];
            }
            let (mut size, mut most) = (R::zero(), R::zero());
            for i in 0..compiled.nv {
                size = size.max(v[i].abs()).max(v_free[i].abs());
                // Not max, which loses a NaN.
                most = R::select(change[i].abs().le(most), most, change[i].abs());
            }
            let fast = turn.gt(R::of(FAST_ROTATION));
            [fast.and_not(most.le(size * R::of(MAX_RELATIVE_CHANGE))), active.and_not(most.le(size * R::of(BALANCE_RELATIVE_CHANGE)))]
        },
    )
}

/// Turn of a joint in a step by impulses that is no longer resolved, rad.
const MAX_IMPULSE_ROTATION: f64 = std::f64::consts::PI;

/// Lanes in which constraints made a hinge or a ball joint turn by half a turn in the step, faster than anything did in `v`, before it, and
/// in `v_free`, without them.
pub fn diverging<R: Real>(compiled: &LaneModel<R>, [v, v_free]: [&[R]; 2], v_next: &[R], h: R) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let mut turn = R::zero();
            for joint in compiled.joints.iter().filter(|j| matches!(j.kind, JointKind::Hinge | JointKind::Ball)) {
                for &v in &v_next[joint.v..joint.v + joint.kind.nv()] {
                    turn = turn.max(v.abs());
                }
            }
            let far = (turn * h).gt(R::of(MAX_IMPULSE_ROTATION));
            if far.none() {
                return far;
            }
            far.and(turn.gt(max_joint_rate(compiled, v).max(max_joint_rate(compiled, v_free))))
        },
    )
}

/// Largest angular velocity of a joint, rad/s.
#[inline(always)]
fn max_joint_rate<R: Real>(compiled: &LaneModel<R>, v: &[R]) -> R {
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
pub fn limit_joint_rates<R: Real>(compiled: &LaneModel<R>, lanes: R::Mask, h: R, v: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            let turn = max_joint_rate(compiled, v) * h;
            let fast = lanes.and(turn.gt(R::of(MAX_ROTATION)));
            let factor = R::select(fast, R::of(MAX_ROTATION) / R::select(fast, turn, R::one()), R::one());
            for v in v {
                *v *= factor;
            }
        },
    )
}

/// Kinetic energy with rotors at a placed configuration, J.
fn kinetic_energy_with_rotors<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], velocity: &mut [V6<R>]) -> R {
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

/// Room for [`StepResolution::limit_energy`].
#[derive(Clone, Debug)]
pub struct StepResolution<R: Real> {
    /// No velocity at all.
    pub zero_velocity: Vec<R>,
    kinematics: Kinematics<R>,
    velocity: Vec<V6<R>>,
    change: Vec<V6<R>>,
    /// Mean velocity of the step and its change, nv.
    mean: [Vec<R>; 2],
    newton_euler: NewtonEuler<R>,
    /// Links alone in their trees: their inertia does not depend on the configuration.
    single_link: Vec<bool>,
}

impl<R: Real> StepResolution<R> {
    /// Room for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let mut single_link = vec![false; compiled.links.len()];
        compiled.spinners.iter().for_each(|spinner| single_link[spinner.link] = true);
        Self {
            zero_velocity: vec![R::zero(); compiled.nv],
            kinematics: Kinematics::new(compiled),
            velocity: vec![zero(); compiled.links.len()],
            change: vec![zero(); compiled.links.len()],
            mean: std::array::from_fn(|_| vec![R::zero(); compiled.nv]),
            newton_euler: NewtonEuler::new(compiled),
            single_link,
        }
    }

    /// Lanes in which a step of `h` seconds makes energy by its own error, so much that it is unresolved.
    ///
    /// Work of forces and impulses f is f (v + v+) / 2, and by the equation of motion f = M (v+ - v) + h c, with mass matrix M and inertial
    /// forces c as the rule took them in the `middle`, c at the velocity `v_mean`. So what is left of the change of the kinetic energy,
    ///
    /// ```text
    /// K(q+, v+) - K(q, v) - (v + v+) / 2 (M (v+ - v) + h c),
    /// ```
    ///
    /// nobody put in, whatever acts: actuators, damping, friction, contacts. The work of gravity and springs at the middle differs from the
    /// change of their potential by less: chains that gain 98 J by the first have 0.01 J of the second. Bodies that are alone do not count:
    /// the midpoint rule keeps their energy.
    pub fn gains_energy(
        &mut self,
        compiled: &LaneModel<R>,
        middle: &Kinematics<R>,
        [before, after]: [[&[R]; 2]; 2],
        [v_free, v_mean]: [&[R]; 2],
        h: R,
    ) -> R::Mask {
        self.place_mocap(compiled, middle);
        R::vectorize(
            #[inline(always)]
            || {
                let [mean, change] = &mut self.mean;
                let mut work = R::zero();
                for d in 0..compiled.nv {
                    mean[d] = (before[1][d] + after[1][d]) * R::of(0.5);
                    change[d] = after[1][d] - before[1][d];
                    work += compiled.params.dof(d).armature * mean[d] * change[d];
                }
                middle.velocities(compiled, mean, &mut self.velocity);
                middle.velocities(compiled, change, &mut self.change);
                link_forces(compiled, middle, v_mean, &mut self.newton_euler);
                let ground = spatial(zero(), scale(compiled.params.gravity(), -R::one()));
                for l in 0..compiled.links.len() {
                    if !self.single_link[l] {
                        let momentum = apply_inertia(&middle.inertia[l], &self.change[l]);
                        let weight = apply_inertia(&middle.inertia[l], &ground);
                        work += dot6(self.velocity[l], momentum) + dot6(self.velocity[l], self.newton_euler.force[l]) * h;
                        work -= dot6(self.velocity[l], weight) * h;
                    }
                }
                let [start, end] = [self.kinetic_energy_of_chains(compiled, before), self.kinetic_energy_of_chains(compiled, after)];
                let (mut pushed, mut fastest) = (R::zero(), R::zero());
                for d in 0..compiled.nv {
                    pushed = pushed.max((after[1][d] - v_free[d]).abs());
                    fastest = fastest.max(after[1][d].abs()).max(before[1][d].abs());
                }
                let most = (h * R::of(MAX_GROWTH_RATE)).min(R::of(MAX_GROWTH)) * start.max(end);
                let is_impact = pushed.gt(fastest * R::of(IMPACT_RELATIVE_CHANGE));
                ((end - start) - work).gt(R::select(is_impact, most + most, most))
            },
        )
    }

    /// Places the mocap bodies where they are in the middle of the step.
    fn place_mocap(&mut self, compiled: &LaneModel<R>, middle: &Kinematics<R>) {
        for mocap in &compiled.mocap {
            self.kinematics.pos[mocap.frame] = middle.pos[mocap.frame];
            self.kinematics.mat[mocap.frame] = middle.mat[mocap.frame];
        }
    }

    /// Kinetic energy with rotors of the bodies that are not alone, J.
    #[inline(always)]
    fn kinetic_energy_of_chains(&mut self, compiled: &LaneModel<R>, [q, v]: [&[R]; 2]) -> R {
        self.kinematics.update(compiled, q);
        self.kinematics.velocities(compiled, v, &mut self.velocity);
        let mut twice = R::zero();
        for l in 0..compiled.links.len() {
            if !self.single_link[l] {
                twice += dot6(apply_inertia(&self.kinematics.inertia[l], &self.velocity[l]), self.velocity[l]);
            }
        }
        for (d, &v) in v.iter().enumerate() {
            twice += compiled.params.dof(d).armature * v.square();
        }
        twice * R::of(0.5)
    }

    /// The velocity `v` after the step, slowed down in `lanes` until its energy is that of `before` and of the work that the step did with
    /// the inertia of `middle`; constraints, which made `v` of `v_free`, take energy out if anything. States are (q, v).
    #[expect(clippy::too_many_arguments, reason = "the states that the step joins, named at the call")]
    pub fn limit_energy(
        &mut self,
        compiled: &LaneModel<R>,
        middle: &Kinematics<R>,
        lanes: R::Mask,
        before: [&[R]; 2],
        [q, v]: [&[R]; 2],
        v_free: &[R],
        out: &mut [R],
    ) {
        self.place_mocap(compiled, middle);
        R::vectorize(
            #[inline(always)]
            || {
                let mut energy_with = |v: &[R]| kinetic_energy_with_rotors(compiled, middle, v, &mut self.velocity);
                let work = energy_with(v).min(energy_with(v_free)) - energy_with(before[1]);
                self.kinematics.update(compiled, before[0]);
                let start = kinetic_energy_with_rotors(compiled, &self.kinematics, before[1], &mut self.velocity);
                self.kinematics.update(compiled, q);
                let end = kinetic_energy_with_rotors(compiled, &self.kinematics, v, &mut self.velocity);
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

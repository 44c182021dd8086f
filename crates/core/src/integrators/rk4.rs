//! Runge-Kutta-Munthe-Kaas method of order 4 for smooth motion (integrator `rk4` with hard contact).

use stepper_real::{Mask, Real, kernel};

use crate::actuation::forces::{ActuatorForces, ForceState, Implicit};
use crate::compile::{LaneModel, ModelStructure, MomentKind};
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::{Kinematics, displace};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::inputs::Inputs;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::stages::s01_actuate::{activation_rate, actuate, clamp_activation};
use crate::stages::s02_smooth::Smooth;

/// Workspace of the four Runge-Kutta stages.
///
/// The unknowns are a displacement theta from the configuration before the step, the velocity and the activations. A displacement of a
/// rotation follows `theta' = dexpinv(omega)` with angular velocities in the body's frame (Munthe-Kaas 1998).
#[derive(Clone, Debug)]
pub(crate) struct Rk4<R: Real> {
    kinematics: Kinematics<R>,
    smooth: Smooth<R>,
    actuator_forces: ActuatorForces<R>,
    /// Generalized forces of the inputs `qfrc` and `xfrc`, nv.
    applied: Vec<R>,
    /// Current state: configuration, nq, velocity, nv, and activations, na.
    q: Vec<R>,
    v: Vec<R>,
    act: Vec<R>,
    /// Displacement theta from the configuration before the step to that of the current state, in the coordinates of velocities, nv.
    rotation: Vec<R>,
    /// Rates of displacement, velocity and activations at the current state.
    rate: [Vec<R>; 3],
    /// Weighted sums of the rates of the stages.
    sum: [Vec<R>; 3],
    /// Lanes in which each kinematic tree has smooth motion: no constraint acts on it, and its motion is not too fast for the time step.
    smooth_trees: Vec<R::Mask>,
    /// Kinematic tree of each configuration coordinate.
    tree_of_q: Vec<usize>,
}

impl<R: Real> Rk4<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let sizes = [compiled.nv, compiled.nv, compiled.na];
        Self {
            kinematics: Kinematics::new(compiled),
            smooth: Smooth::new(compiled),
            actuator_forces: ActuatorForces::new(compiled),
            applied: zeros(compiled.nv),
            q: zeros(compiled.nq),
            v: zeros(compiled.nv),
            act: zeros(compiled.na),
            rotation: zeros(compiled.nv),
            rate: sizes.map(zeros),
            sum: sizes.map(zeros),
            smooth_trees: vec![R::Mask::splat(false); compiled.ntree],
            tree_of_q: compiled.tree_of_q(),
        }
    }

    /// Sets the current state to `state` + `time` times the current rates. If `time` is zero, the result is exactly `state`.
    fn set_state(&mut self, compiled: &LaneModel<R>, state: [&[R]; 3], time: R) {
        kernel!(R, || {
            let moving = time.gt(R::zero());
            for i in 0..compiled.nv {
                self.rotation[i] = R::select(moving, self.rate[0][i] * time, R::zero());
                self.v[i] = state[1][i] + R::select(moving, self.rate[1][i] * time, R::zero());
            }
            for i in 0..compiled.na {
                self.act[i] = state[2][i] + R::select(moving, self.rate[2][i] * time, R::zero());
            }
            clamp_activation(compiled, &mut self.act);
            displace(compiled, state[0], &self.rotation, R::one(), &mut self.q);
        })
    }

    /// Computes the rates of displacement, velocity and activations at the current state, in a step of `h` seconds.
    fn rates(&mut self, compiled: &LaneModel<R>, inputs: &Inputs<R>, h: R) {
        self.angular_rates(compiled);
        self.kinematics.update(compiled, &self.q);
        self.smooth.factor_mass(compiled, &self.kinematics, Implicit::none());
        self.smooth.apply(compiled, &self.kinematics, [&inputs.qfrc, &inputs.xfrc], &mut self.applied);
        self.actuator_forces.transmit(compiled, (&self.kinematics, &self.q), (&self.v, R::zero()));
        actuate(
            compiled,
            &ForceState::state([&self.q, &self.v, &self.act], h, &inputs.ctrl, &inputs.actuator_dynamics),
            None,
            &mut self.actuator_forces,
        );
        self.smooth.acceleration(compiled, &self.kinematics, [&self.actuator_forces.tau, &self.applied], &self.v, &self.v);
        self.rate[1].copy_from_slice(&self.smooth.acc);
        activation_rate(compiled, &self.act, &inputs.ctrl, &mut self.rate[2]);
    }

    /// Computes the displacement rate theta' at (theta, v).
    fn angular_rates(&mut self, compiled: &LaneModel<R>) {
        kernel!(R, || {
            self.rate[0].copy_from_slice(&self.v);
            for joint in &compiled.joints {
                let at = match joint.kind {
                    JointKind::Free => joint.v + 3,
                    JointKind::Ball => joint.v,
                    JointKind::Slide | JointKind::Hinge => continue,
                };
                let rotation = [self.rotation[at], self.rotation[at + 1], self.rotation[at + 2]];
                let omega = [self.v[at], self.v[at + 1], self.v[at + 2]];
                // dexpinv up to the order that the method needs: omega + theta x omega / 2 + theta x (theta x omega) / 12.
                let once = cross(rotation, omega);
                let rate = add(add_scaled(omega, once, R::of(0.5)), scale(cross(rotation, once), R::of(1.0 / 12.0)));
                self.rate[0][at..at + 3].copy_from_slice(&rate);
            }
        })
    }

    /// Finds the kinematic trees with smooth motion: without constraints, and without an actuator that pulls on contacts. `free` also has
    /// the lanes in which a mechanism is too fast for the time step.
    pub(crate) fn find_smooth_trees(&mut self, context: StepContext<'_, R>, problem: &ConstraintProblem<R>, free: &FreeMotion<R>) {
        let StepContext { input: StepInput { compiled, alive, .. }, evaluation } = context;
        let flights = alive.and_not(evaluation.substep.is_impact);
        self.smooth_trees.fill(R::Mask::splat(false));
        problem.add_constrained_trees(compiled, alive, &mut self.smooth_trees);
        for (smooth, &mechanism) in self.smooth_trees.iter_mut().zip(&compiled.mechanisms.of_tree) {
            *smooth = flights.and_not(smooth.or(free.unresolved[mechanism]));
        }
        for moment in compiled.actuators.iter().filter_map(|actuator| actuator.variable_moment.as_ref()) {
            if matches!(moment.kind, MomentKind::Contacts { .. }) {
                for (&(dof, _), &arm) in moment.dofs.iter().zip(&free.actuator_forces.arms[moment.arms..]) {
                    let smooth = &mut self.smooth_trees[compiled.dofs[dof].tree];
                    *smooth = smooth.and(kernel!(R, || arm.eq(R::zero())));
                }
            }
        }
    }

    /// Lanes in which all trees of a mechanism have smooth motion ([`Rk4::find_smooth_trees`]).
    pub(crate) fn is_smooth(&self, compiled: &LaneModel<R>, mechanism: usize) -> R::Mask {
        let trees = compiled.mechanisms.of_tree.iter().zip(&self.smooth_trees).filter(|(of_tree, _)| **of_tree == mechanism);
        trees.fold(R::Mask::splat(true), |lanes, (_, smooth)| lanes.and(*smooth))
    }

    /// Replaces the midpoint step by a Runge-Kutta step in trees with smooth motion ([`Rk4::find_smooth_trees`]). Without constraints, the
    /// free velocity is the velocity after the step.
    #[inline(always)]
    pub(crate) fn replace_smooth_trees(
        &mut self,
        context: StepContext<'_, R>,
        free: &mut FreeMotion<R>,
        velocity: &mut VelocitySolution<R>,
        position: &mut PositionSolution<R>,
    ) {
        let StepContext { input, evaluation: Evaluation { scheme, kinematics, .. } } = context;
        let StepInput { compiled, state, inputs, .. } = input;
        self.kinematics.copy_mocap_poses(compiled, kinematics);
        let state = [&state.q[..], &state.v[..], &state.act[..]];
        self.sum.iter_mut().for_each(|s| s.fill(R::zero()));
        for (fraction, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            self.set_state(compiled, state, scheme.h * R::of(fraction));
            self.rates(compiled, inputs, scheme.h);
            kernel!(R, || {
                for (sum, rate) in self.sum.iter_mut().zip(&self.rate) {
                    for (sum, &rate) in sum.iter_mut().zip(rate) {
                        *sum += R::of(weight) * rate;
                    }
                }
            });
        }
        std::mem::swap(&mut self.sum, &mut self.rate);
        self.set_state(compiled, state, scheme.h * R::of(1.0 / 6.0));
        kernel!(R, || {
            for ((out, &new), &tree) in position.q.iter_mut().zip(&self.q).zip(&self.tree_of_q) {
                *out = R::select(self.smooth_trees[tree], new, *out);
            }
            for v in [&mut velocity.v, &mut free.v] {
                for ((out, &new), dof) in v.iter_mut().zip(&self.v).zip(&compiled.dofs) {
                    *out = R::select(self.smooth_trees[dof.tree], new, *out);
                }
            }
            for ((out, &new), &tree) in position.act.iter_mut().zip(&self.act).zip(&compiled.tree_of_act) {
                *out = R::select(tree.map_or(input.alive, |tree| self.smooth_trees[tree]), new, *out);
            }
        })
    }
}

//! Stage 2: smooth dynamics, which determine the motion without constraints.

use stepper_real::{Real, kernel};

use crate::actuation::forces::Implicit;
use crate::compile::{CompensationParams, LaneModel, ModelStructure};
use crate::dynamics::fluid::Fluid;
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::dynamics::inertia::{MassMatrix, NewtonEuler, link_forces, project_forces};
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::path_lengths::add_path_bias;
use crate::math::spatial::*;

/// Smooth dynamics at one configuration: mass matrix, bias force and acceleration without constraints.
#[derive(Clone, Debug)]
pub struct Smooth<R: Real> {
    /// Factored mass matrix, with the implicit terms of damping and stiffness.
    pub mass: MassMatrix<R>,
    /// Bias force c(q, v), minus the forces of the surrounding fluid and of gravity compensation, nv.
    pub bias: Vec<R>,
    /// Acceleration without constraints, nv.
    pub acc: Vec<R>,
    /// Velocities and accelerations of the links from the last call of [`Smooth::acceleration`].
    pub newton_euler: NewtonEuler<R>,
    /// Diagonal of the mass matrix without implicit terms, nv; empty in models without servos.
    pub inertia: Vec<R>,
    /// Additional damping of joint springs that have a damper: the coefficient 3/2 s h k of [`crate::actuation::forces`], nv. Empty in
    /// models without joint springs.
    spring_damping: Vec<R>,
    composite: Vec<Inertia<R>>,
    fluid: Fluid<R>,
}

impl<R: Real> Smooth<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        Self {
            mass: MassMatrix::new(compiled),
            bias: vec![R::zero(); compiled.nv],
            acc: vec![R::zero(); compiled.nv],
            inertia: vec![R::zero(); if compiled.servos.is_empty() { 0 } else { compiled.nv }],
            spring_damping: vec![R::zero(); if compiled.joints.iter().any(|j| j.sprung) { compiled.nv } else { 0 }],
            composite: vec![zero(); compiled.links.len()],
            newton_euler: NewtonEuler::new(compiled),
            fluid: Fluid::new(compiled),
        }
    }

    /// Assembles the mass matrix, with the implicit terms of joint damping and stiffness.
    pub fn assemble_mass(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, weights: ImplicitWeights<R>) {
        kernel!(R, || {
            self.mass.assemble(compiled, kinematics, &mut self.composite);
            // The diagonal is copied before implicit terms are added to it. Stage 1 reads the copy.
            for (inertia, dof) in self.inertia.iter_mut().zip(&compiled.dofs) {
                *inertia = self.mass.entries[dof.chain];
            }
            self.mass.add_joints(compiled, weights, &mut self.spring_damping);
        })
    }

    /// Completes the mass matrix of [`Smooth::assemble_mass`] with the implicit terms of servos and fluid drag, and factors it.
    pub fn complete_mass(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, implicit: Implicit<'_, R>) {
        kernel!(R, || {
            self.mass.add_servos(compiled, implicit.servos, implicit.arms, true);
            if !compiled.fluid.is_empty() {
                match implicit.drag_at {
                    Some(v) => self.fluid.linearise(compiled, kinematics, v, implicit.weights.damping, &mut self.mass.entries),
                    None => self.fluid.make_drag_explicit(),
                }
            }
            self.mass.factor(compiled);
        })
    }

    /// Assembles, completes and factors the mass matrix.
    pub fn factor_mass(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, implicit: Implicit<'_, R>) {
        self.assemble_mass(compiled, kinematics, implicit.weights);
        self.complete_mass(compiled, kinematics, implicit);
    }

    /// Computes the acceleration without constraints, A^-1 (tau + applied - c(q, v_inertial) - D v), into `self.acc`. A is the matrix of
    /// [`Smooth::factor_mass`], c the bias force, and D the damping of joints with the additional damping of their springs. The third
    /// argument has the two generalized forces tau and applied.
    ///
    /// `v` is the velocity before the step. A step with this acceleration is implicit in the damping D and in the springs that A contains
    /// (see [`crate::actuation::forces`]).
    pub fn acceleration(
        &mut self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        [tau, applied]: [&[R]; 2],
        v: &[R],
        v_inertial: &[R],
    ) {
        kernel!(R, || {
            link_forces(compiled, kinematics, v_inertial, &mut self.newton_euler);
            if !compiled.fluid.is_empty() {
                self.fluid.subtract(compiled, kinematics, &self.newton_euler.velocity, &mut self.newton_euler.force);
            }
            for (i, compensated) in compiled.compensation.iter().enumerate() {
                let CompensationParams { pos, force } = compiled.params.compensation(i);
                let arm = sub(kinematics.point(compensated.link + 1, pos), kinematics.origin[compiled.links[compensated.link].tree]);
                self.newton_euler.force[compensated.link] =
                    sub(self.newton_euler.force[compensated.link], spatial(cross(arm, force), force));
            }
            project_forces(compiled, kinematics, &mut self.newton_euler.force, &mut self.bias);
            add_path_bias(compiled, kinematics, &self.newton_euler, &mut self.bias);
            let forces = tau.iter().zip(applied).zip(&self.bias);
            let damping = compiled.params.dofs();
            for (((acc, ((&tau, &applied), &bias)), &[damping, ..]), &v) in self.acc.iter_mut().zip(forces).zip(damping).zip(v) {
                *acc = (tau + applied) - bias - damping * v;
            }
            for ((acc, &damping), &v) in self.acc.iter_mut().zip(&self.spring_damping).zip(v) {
                *acc -= damping * v;
            }
            self.mass.solve(compiled, &mut self.acc);
        })
    }

    /// Adds the terms of implicit servos and fluid drag to the mass matrix. A servo adds its added inertia (`added_inertias`) times the
    /// products of its moment arms; `arms` has those of actuators on sites. The fluid adds `h` times its drag, linearised at the velocity
    /// `v`. The function leaves out entries that couple two degrees of freedom on different branches.
    ///
    /// The drag in later calls of [`Smooth::acceleration`] remains explicit.
    pub fn add_implicit_terms(
        &mut self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        [added_inertias, arms]: [&[R]; 2],
        v: &[R],
        h: R,
    ) {
        kernel!(R, || {
            self.mass.add_servos(compiled, added_inertias, arms, false);
            if !compiled.fluid.is_empty() {
                self.fluid.linearise(compiled, kinematics, v, h, &mut self.mass.entries);
                self.fluid.make_drag_explicit();
            }
        })
    }

    /// Computes the generalized forces of the user's applied forces into `out`.
    ///
    /// `qfrc` acts on the joints. `xfrc` has force and torque on each body (six numbers, at its centre of mass, world axes). Either may be
    /// empty.
    pub fn apply(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, [qfrc, xfrc]: [&[R]; 2], out: &mut [R]) {
        if qfrc.is_empty() {
            out.fill(R::zero());
        } else {
            out.copy_from_slice(qfrc);
        }
        if xfrc.is_empty() {
            return;
        }
        kernel!(R, || {
            // `newton_euler.force` and `bias` are only buffers here. The next call of `acceleration` overwrites them.
            self.newton_euler.force.fill(zero());
            for (b, body) in compiled.bodies.iter().enumerate() {
                if body.frame == 0 || body.frame > compiled.links.len() {
                    continue;
                }
                let l = body.frame - 1;
                let w = &xfrc[6 * b..6 * b + 6];
                let (force, torque) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
                let arm = sub(kinematics.point(body.frame, compiled.params.body_com(b)), kinematics.origin[compiled.links[l].tree]);
                self.newton_euler.force[l] = add(self.newton_euler.force[l], spatial(add(torque, cross(arm, force)), force));
            }
            project_forces(compiled, kinematics, &mut self.newton_euler.force, &mut self.bias);
            for i in 0..compiled.nv {
                out[i] += self.bias[i];
            }
        })
    }
}

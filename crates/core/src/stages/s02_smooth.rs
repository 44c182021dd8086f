//! Stage 2: smooth dynamics. What would happen without constraints.

use stepper_real::Real;

use crate::inertia::{MassMatrix, NewtonEuler, bias_force, project_forces};
use crate::kinematics::Kinematics;
use crate::plan::Plan;
use crate::spatial::*;

/// Smooth dynamics at one configuration.
#[derive(Clone, Debug)]
pub struct Smooth<R: Real> {
    /// Factors of M + theta h D.
    pub mass: MassMatrix<R>,
    /// Bias force c(q, v).
    pub bias: Vec<R>,
    /// Acceleration if nothing were in the way.
    pub acc: Vec<R>,
    composite: Vec<Inertia<R>>,
    work: NewtonEuler<R>,
}

impl<R: Real> Smooth<R> {
    /// Room for a plan.
    pub fn new(plan: &Plan<R::Scalar>) -> Self {
        Self {
            mass: MassMatrix::new(plan),
            bias: vec![R::zero(); plan.nv],
            acc: vec![R::zero(); plan.nv],
            composite: vec![zero(); plan.links.len()],
            work: NewtonEuler::new(plan),
        }
    }

    /// The mass matrix M + `damping_time` D and its factors.
    pub fn factor_mass(&mut self, plan: &Plan<R::Scalar>, kinematics: &Kinematics<R>, damping_time: R) {
        R::vectorize(
            #[inline(always)]
            || {
                self.mass.assemble(plan, kinematics, &mut self.composite, damping_time);
                self.mass.factor(plan);
            },
        )
    }

    /// `acc = (M + theta h D)^-1 (tau + applied - c(q, v_bias) - D v)`: a step of it is implicit in the joint damping D, because the mass
    /// matrix holds theta h D; theta is 1 for Euler's rule, 1/2 for the midpoint's, 0 for the acceleration itself.
    pub fn acceleration(&mut self, plan: &Plan<R::Scalar>, kinematics: &Kinematics<R>, forces: [&[R]; 2], v: &[R], v_bias: &[R]) {
        R::vectorize(
            #[inline(always)]
            || {
                bias_force(plan, kinematics, v_bias, &mut self.work, &mut self.bias);
                let [tau, applied] = forces;
                for i in 0..plan.nv {
                    let damping = R::splat(plan.dofs[i].damping) * v[i];
                    self.acc[i] = (tau[i] + applied[i]) - self.bias[i] - damping;
                }
                self.mass.solve(plan, &mut self.acc);
            },
        )
    }

    /// Generalized forces of the wrenches `xfrc` (force, torque; six per body, at its centre of mass, world axes), added to `out`.
    pub fn add_wrenches(&mut self, plan: &Plan<R::Scalar>, kinematics: &Kinematics<R>, xfrc: &[R], out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                self.work.force.fill(zero());
                for (b, body) in plan.bodies.iter().enumerate() {
                    if body.frame == 0 || body.frame > plan.links.len() {
                        continue;
                    }
                    let l = body.frame - 1;
                    let w = &xfrc[6 * b..6 * b + 6];
                    let (force, torque) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
                    let arm = sub(kinematics.point(body.frame, splat(body.com)), kinematics.origin[plan.links[l].tree]);
                    self.work.force[l] = add(self.work.force[l], spatial(add(torque, cross(arm, force)), force));
                }
                project_forces(plan, kinematics, &mut self.work.force, &mut self.bias);
                for i in 0..plan.nv {
                    out[i] += self.bias[i];
                }
            },
        )
    }
}

//! Quantities of one environment outside a step, computed in f64.

use std::borrow::Cow;

use stepper_real::Real;

use crate::analysis::smooth_dynamics::SmoothDynamics;
use crate::compile::{Inertial, LaneModel};
use crate::dynamics::kinematics::{Kinematics, kinetic_energy};
use crate::integrators::inputs::Inputs;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::sensing::orientations;

/// Snapshot of one environment's state and inputs, from which quantities outside a step are computed.
#[derive(Clone, Debug)]
pub struct Snapshot<'a> {
    /// Compiled model with the parameters of the environment.
    pub(crate) compiled: Cow<'a, LaneModel<f64>>,
    /// Configuration, (nq,).
    pub(crate) q: Vec<f64>,
    /// Velocity, (nv,).
    pub(crate) v: Vec<f64>,
    /// Activations, (na,).
    pub(crate) act: Vec<f64>,
    /// Inputs of the user: controls and applied forces.
    pub(crate) inputs: Inputs<f64>,
    /// Time step, s, by which early activations are advanced.
    pub(crate) timestep: f64,
    /// Poses of the mocap bodies: position, m, and quaternion.
    pub(crate) mocap: Vec<([f64; 3], [f64; 4])>,
}

/// Kinematics of the configuration `q`. `mocap` has the poses of the mocap bodies: position, m, and quaternion.
pub(crate) fn kinematics_at(compiled: &LaneModel<f64>, q: &[f64], mocap: impl Iterator<Item = ([f64; 3], [f64; 4])>) -> Kinematics<f64> {
    let mut kinematics = Kinematics::new(compiled);
    for (m, (pos, quat)) in compiled.mocap.iter().zip(mocap) {
        kinematics.pos[m.frame] = pos;
        kinematics.mat[m.frame] = quat_to_mat(quat_normalize(quat));
    }
    kinematics.update(compiled, q);
    kinematics
}

/// Position (m) and orientation of every body at the configuration `q`. `mocap` has the poses of the mocap bodies.
pub(crate) fn body_poses(compiled: &LaneModel<f64>, q: &[f64], mocap: &[([f64; 3], [f64; 4])]) -> Vec<([f64; 3], [f64; 4])> {
    let kinematics = kinematics_at(compiled, q, mocap.iter().copied());
    let mut orientation = vec![[1.0, 0.0, 0.0, 0.0]; compiled.nframe()];
    for (m, &(_, quat)) in compiled.mocap.iter().zip(mocap) {
        orientation[m.frame] = quat_normalize(quat);
    }
    orientations(compiled, q, &mut orientation);
    compiled.bodies.iter().map(|b| (kinematics.point(b.frame, b.pos), quat_mul(orientation[b.frame], b.quat))).collect()
}

impl Snapshot<'_> {
    fn kinematics(&self) -> Kinematics<f64> {
        kinematics_at(&self.compiled, &self.q, self.mocap.iter().copied())
    }

    /// Mass matrix with armature, (nv, nv), row-major: kg, kg m and kg m^2.
    pub fn mass_matrix(&self) -> Vec<f64> {
        SmoothDynamics::default().mass_matrix(&self.compiled, &self.kinematics()).to_vec()
    }

    /// Coriolis, centrifugal and gravitational forces, (nv,), N or N m.
    pub fn bias_force(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.compiled.nv];
        SmoothDynamics::default().bias_force(&self.compiled, &self.kinematics(), &self.v, &mut out);
        out
    }

    /// Acceleration without constraints, (nv,), m/s^2 or rad/s^2.
    pub fn smooth_acceleration(&self) -> Vec<f64> {
        let state = [&self.q[..], &self.v, &self.act];
        SmoothDynamics::default().acceleration(&self.compiled, &self.kinematics(), state, (&self.inputs, None, self.timestep)).to_vec()
    }

    /// Potential energy (of gravity, and of springs of joints and tendons) and kinetic energy (with armature), J.
    pub fn energy(&self) -> (f64, f64) {
        let compiled = &*self.compiled;
        let kinematics = self.kinematics();
        let mut potential = 0.0;
        for l in 0..compiled.links.len() {
            let Inertial { mass, com, .. } = compiled.params.inertial(l);
            potential -= mass * dot(compiled.params.gravity(), kinematics.point(l + 1, com));
        }
        for (j, joint) in compiled.joints.iter().enumerate() {
            potential += 0.5 * compiled.params.spring(j) * self.stretch_squared(joint);
        }
        let mut rotors: f64 = self.v.iter().enumerate().map(|(d, v)| compiled.params.dof(d).armature * v * v).sum();
        for tendon in &compiled.tendons {
            let Some((spring, stretch)) = tendon.stretch(&self.q[..], &kinematics.paths) else { continue };
            potential += 0.5 * spring.stiffness * stretch.square();
            rotors += spring.inertia * tendon.length.rate(&self.v, &kinematics.paths).square();
        }
        let mut velocities = vec![zero(); compiled.links.len()];
        kinematics.velocities(compiled, &self.v, &mut velocities);
        (potential, kinetic_energy(&kinematics, &velocities) + 0.5 * rotors)
    }

    /// Square of a joint's distance from the rest position of its spring, m^2 or rad^2.
    fn stretch_squared(&self, joint: &crate::compile::CompiledJoint<f64>) -> f64 {
        let (mut at, mut i, mut sum) = (joint.q, 0, 0.0);
        if joint.kind != JointKind::Ball {
            let scalars = if joint.kind == JointKind::Free { 3 } else { 1 };
            sum += (0..scalars).map(|s| (self.q[at + s] - joint.rest[s]).square()).sum::<f64>();
            (at, i) = (at + scalars, scalars);
        }
        if matches!(joint.kind, JointKind::Ball | JointKind::Free) {
            let r = &joint.rest[i..i + 4];
            let q = [self.q[at], self.q[at + 1], self.q[at + 2], self.q[at + 3]];
            let twist = quat_log(quat_mul([r[0], -r[1], -r[2], -r[3]], q));
            sum += dot(twist, twist);
        }
        sum
    }

    /// Linear momentum (kg m/s) and angular momentum about the common centre of mass (kg m^2/s) of all moving bodies, without armature.
    pub fn momentum(&self) -> ([f64; 3], [f64; 3]) {
        let compiled = &*self.compiled;
        let kinematics = self.kinematics();
        let mut velocities = vec![zero(); compiled.links.len()];
        kinematics.velocities(compiled, &self.v, &mut velocities);
        let inertials = (0..compiled.links.len()).map(|l| compiled.params.inertial(l));
        let mass: f64 = inertials.clone().map(|link| link.mass).sum();
        if mass == 0.0 {
            return ([0.0; 3], [0.0; 3]);
        }
        let coms = inertials.enumerate().map(|(l, link)| scale(kinematics.point(l + 1, link.com), link.mass));
        let centre = scale(coms.fold([0.0; 3], add), 1.0 / mass);
        let (mut linear_sum, mut angular_sum) = ([0.0; 3], [0.0; 3]);
        for (l, link) in compiled.links.iter().enumerate() {
            let h = apply_inertia(&kinematics.inertia[l], &velocities[l]);
            let p = linear(&h);
            linear_sum = add(linear_sum, p);
            let arm = sub(kinematics.origin[link.tree], centre);
            angular_sum = add(angular_sum, add(angular(&h), cross(arm, p)));
        }
        (linear_sum, angular_sum)
    }
}

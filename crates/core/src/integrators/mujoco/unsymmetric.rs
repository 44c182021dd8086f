//! Unsymmetric matrix of the integrator `implicit`, which contains the derivative of the Coriolis forces.

use stepper_real::{Real, kernel};

use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::inertia::{NewtonEuler, bias_force};
use crate::dynamics::kinematics::Kinematics;

/// Dense unsymmetric matrix A + h dc/dv of the integrator `implicit`, row-major, and buffers of its computation. A is the mass matrix
/// with implicit damping, and c the Coriolis forces.
#[derive(Clone, Debug)]
pub(crate) struct Unsymmetric<R: Real> {
    entries: Vec<R>,
    newton_euler: NewtonEuler<R>,
    /// Velocity at which the bias force is evaluated. `bias` is the bias force there.
    velocity: Vec<R>,
    bias: Vec<R>,
    /// Bias force at zero velocity minus the bias force at the velocity before the step.
    difference: Vec<R>,
}

impl<R: Real> Unsymmetric<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let n = compiled.nv;
        Self { entries: zeros(n * n), newton_euler: NewtonEuler::new(compiled), velocity: zeros(n), bias: zeros(n), difference: zeros(n) }
    }

    /// Solves x <- (A + h dc/dv)^-1 x, where `a` has the entries of the symmetric matrix A, and c are the Coriolis forces at the velocity
    /// `v`.
    ///
    /// c is quadratic in v, so that dc/dv e = c(v + e) - c(v) - c(e) exactly. Gravity and other forces that do not depend on v cancel in
    /// b(v + e) - b(v) - b(e) + b(0), where b is the bias force.
    pub(super) fn solve(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, a: &[R], v: &[R], h: R, x: &mut [R]) {
        let n = compiled.nv;
        kernel!(R, || {
            self.entries.fill(R::zero());
            for i in 0..n {
                let row = &compiled.dofs[i];
                for (&entry, &c) in a[row.chain..row.chain + row.depth].iter().zip(compiled.chain_of(i)) {
                    self.entries[i * n + c as usize] = entry;
                    self.entries[c as usize * n + i] = entry;
                }
            }
            self.velocity.copy_from_slice(v);
            self.find_bias(compiled, kinematics);
            self.difference.copy_from_slice(&self.bias);
            self.velocity.fill(R::zero());
            self.find_bias(compiled, kinematics);
            for (difference, &bias) in self.difference.iter_mut().zip(&self.bias) {
                *difference = bias - *difference;
            }
            for column in 0..n {
                self.velocity.fill(R::zero());
                self.velocity[column] = R::one();
                self.find_bias(compiled, kinematics);
                for (i, &bias) in self.bias.iter().enumerate() {
                    self.entries[i * n + column] += -h * bias;
                }
                self.velocity.copy_from_slice(v);
                self.velocity[column] += R::one();
                self.find_bias(compiled, kinematics);
                for (i, (&bias, &difference)) in self.bias.iter().zip(&self.difference).enumerate() {
                    let entry = &mut self.entries[i * n + column];
                    *entry += h * bias;
                    *entry += h * difference;
                }
            }
            solve_dense(&mut self.entries, x);
        });
    }

    /// Computes the bias force (Coriolis, centrifugal and gravity) at the velocity `self.velocity`, into `self.bias`.
    fn find_bias(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        let Self { newton_euler, velocity, bias, .. } = self;
        kernel!(R, || bias_force(compiled, kinematics, velocity, newton_euler, bias));
    }
}

/// Solves a dense system by Gaussian elimination without pivots. `matrix` is row-major and is overwritten; `x` is the right side, and
/// receives the solution.
///
/// The symmetric part of the matrices here is nearly a mass matrix, which is positive definite. The other terms are of order h.
#[inline(always)]
pub(super) fn solve_dense<R: Real>(matrix: &mut [R], x: &mut [R]) {
    let n = x.len();
    for k in 0..n {
        let (above, below) = matrix.split_at_mut((k + 1) * n);
        let pivot = &above[k * n..];
        let inverse = R::one() / pivot[k];
        for (i, row) in below.chunks_exact_mut(n).enumerate() {
            let factor = row[k] * inverse;
            for (entry, &pivot) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                *entry -= factor * pivot;
            }
            let above = x[k];
            x[k + 1 + i] -= factor * above;
        }
    }
    for k in (0..n).rev() {
        let row = &matrix[k * n..][..n];
        let mut sum = x[k];
        for (&entry, &x) in row[k + 1..].iter().zip(&x[k + 1..]) {
            sum -= entry * x;
        }
        x[k] = sum / row[k];
    }
}

//! Effective mass matrix of a discrete step, M + h D + h^2 K, and its effect on constraint rows. M is the mass matrix, D the damping, K the
//! stiffness, and h the time step.

use std::ops::Range;

use stepper_real::Real;

use crate::compile::{EndLaw, LaneModel, MIN_MOBILITY, ModelStructure, SoftLaw};
use crate::constraints::rows::unbounded;
use crate::constraints::soft::system::SoftSystem;

/// Effective mass matrix of a discrete step, M + h D + h^2 K.
///
/// Terms with the sparsity of the kinematic trees are added to the entries that the solver receives. This struct stores M, and the
/// couplings of several degrees of freedom, which become rows (w / 2) (arms . a)^2 of the objective.
#[derive(Clone, Debug)]
pub struct EffectiveMass<R: Real> {
    /// Length of the step, s.
    pub(crate) h: R,
    /// Entries of the mass matrix M.
    pub(crate) mass: Vec<R>,
    /// Diagonal of M, and diagonal of the effective mass matrix.
    pub(crate) diagonals: [Vec<R>; 2],
    /// Couplings of several degrees of freedom: range of the terms in `dofs` and `arms`, and weight w of the coupling.
    couplings: Vec<(Range<usize>, R)>,
    /// Degrees of freedom of all couplings, ascending within each coupling. `arms` has their moment arms.
    dofs: Vec<u32>,
    arms: Vec<R>,
}

impl<R: Real> EffectiveMass<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let couplings = compiled.tendons.len() + compiled.servos.len();
        let terms = couplings * compiled.nv;
        Self {
            h: R::zero(),
            mass: zeros(compiled.chain.len()),
            diagonals: [zeros(compiled.nv), zeros(compiled.nv)],
            couplings: Vec::with_capacity(couplings),
            dofs: Vec::with_capacity(terms),
            arms: Vec::with_capacity(terms),
        }
    }

    /// Stores `entries`, the entries of M, and the time step `h`. Clears all couplings.
    pub(crate) fn begin(&mut self, compiled: &LaneModel<R>, entries: &[R], h: R) {
        self.h = h;
        self.mass.copy_from_slice(entries);
        for (dof, own) in compiled.dofs.iter().zip(&mut self.diagonals[0]) {
            *own = entries[dof.chain];
        }
        self.couplings.clear();
        self.dofs.clear();
        self.arms.clear();
    }

    /// Adds the matrix w (arms)(arms)^T. `parts` are pairs of degree of freedom and arm. With a single degree of freedom, the matrix is
    /// added to `entries`, the entries of the mass matrix. With several, it becomes a coupling.
    #[inline(always)]
    pub(crate) fn add(&mut self, compiled: &LaneModel<R>, parts: impl Iterator<Item = (usize, R)>, w: R, entries: &mut [R]) {
        let start = self.dofs.len();
        for (dof, arm) in parts {
            match self.dofs[start..].binary_search(&(dof as u32)) {
                Ok(k) => self.arms[start + k] += arm,
                Err(k) => {
                    self.dofs.insert(start + k, dof as u32);
                    self.arms.insert(start + k, arm);
                }
            }
        }
        if let [dof] = self.dofs[start..] {
            entries[compiled.dofs[dof as usize].chain] += w * self.arms[start] * self.arms[start];
            self.dofs.truncate(start);
            self.arms.truncate(start);
        } else {
            self.couplings.push((start..self.dofs.len(), w));
        }
    }

    /// Computes the diagonal of the effective mass matrix, after `entries` have all terms.
    pub(crate) fn finish(&mut self, compiled: &LaneModel<R>, entries: &[R]) {
        for (dof, own) in compiled.dofs.iter().zip(&mut self.diagonals[1]) {
            *own = entries[dof.chain];
        }
        for (terms, w) in &self.couplings {
            for (&dof, &arm) in self.dofs[terms.clone()].iter().zip(&self.arms[terms.clone()]) {
                self.diagonals[1][dof as usize] += *w * arm * arm;
            }
        }
    }

    /// Appends the couplings to the rows of a problem, in the lanes `lanes`. Returns whether there are any.
    #[inline(always)]
    pub(super) fn couple(&self, system: &mut SoftSystem<R>, lanes: R::Mask) -> bool {
        for (terms, w) in &self.couplings {
            let (dofs, arms) = (&self.dofs[terms.clone()], &self.arms[terms.clone()]);
            let of = |d: usize| dofs.iter().position(|&dof| dof as usize == d).map_or(R::zero(), |k| arms[k]);
            system.problem.push_row(dofs, of, R::zero(), R::select(lanes, *w, R::zero()), unbounded());
        }
        !self.couplings.is_empty()
    }

    /// Inverse inertia of a row with the effective mass matrix, divided by its inverse inertia with M. The diagonals of both matrices give
    /// an approximation. `dofs` lists the row's degrees of freedom, and `of` returns the Jacobian entry of a degree of freedom.
    #[inline(always)]
    pub(super) fn mobility(&self, dofs: &[u32], of: impl Fn(usize) -> R) -> R {
        let (mut own, mut bare) = (R::zero(), R::zero());
        for &d in dofs {
            let d = d as usize;
            let j = of(d);
            bare += j * j / self.diagonals[0][d];
            own += j * j / self.diagonals[1][d];
        }
        let moves = bare.gt(R::of(MIN_MOBILITY));
        R::select(moves, own / R::select(moves, bare, R::one()), R::one())
    }
}

/// Weight D of a row for the effective mass matrix. `weight` is the weight D of the row's law. `mobility` is the row's inverse inertia with
/// the effective mass matrix, divided by its inverse inertia with M.
#[inline(always)]
pub(super) fn in_metric<R: Real>(weight: R, mobility: R) -> R {
    (weight / mobility).min(R::of(1.0 / MIN_MOBILITY))
}

/// Reference acceleration and weight D of a row with the position error r.
///
/// `v` is the time derivative of r, and `shift` the acceleration of the row if no joint accelerates. With `effective`, the row is evaluated
/// at the end of a discrete step. Otherwise it follows MuJoCo's continuous integrators.
#[inline(always)]
pub(super) fn law_at<R: Real>(
    law: &SoftLaw<R::Scalar>,
    effective: Option<&EffectiveMass<R>>,
    impedance: R,
    [r, v, shift]: [R; 3],
    active: R::Mask,
) -> [R; 2] {
    let Some(effective) = effective else {
        let [reference, weight] = law.row_at(impedance, r, v, active);
        return [reference - shift, weight];
    };
    let end = EndLaw::new(law, impedance, effective.h);
    let reference = -(end.spring[0] * r + end.spring[1] * v + shift) / end.factor;
    let weight = end.regularisation(impedance, R::splat(law.weight)).recip();
    [reference, R::select(active, weight, R::zero())]
}

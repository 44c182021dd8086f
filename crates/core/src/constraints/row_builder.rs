//! Workspace of stage 4 for the construction of one row after the other: Jacobian, half solve, and elimination of equalities.

use std::ops::Range;

use stepper_real::Real;

use crate::compile::ModelStructure;
use crate::math::spatial::*;

/// Builder of constraint rows. It contains the row under construction; [`crate::constraints::assembler::Assembler`] adds the row to the
/// problem.
#[derive(Clone, Debug)]
pub(crate) struct RowBuilder<R: Real> {
    /// Degrees of freedom at which the row may have entries, ascending.
    pub(crate) dofs: Vec<u32>,
    /// Entries of up to three rows, by degree of freedom. They are J^T at first, and L^-T J^T after the half solve, where L^T D L is the
    /// mass matrix.
    pub(crate) column: Vec<V3<R>>,
    /// Entries of the sliding rows while the rotation rows of the same contact are built.
    pub(crate) linear: Vec<V3<R>>,
    /// Workspace of the half solve: entries of a column along a chain of degrees of freedom.
    pub(crate) path: Vec<R>,
    /// For each degree of freedom, lanes (bits) in which it moves the second geom of a contact, and lanes in which it moves the first.
    pub(crate) signs: Vec<[u32; 2]>,
    /// Set of degrees of freedom, as bits of 64-bit words.
    pub(crate) words: Vec<u64>,
    /// Lanes (bits) in which both surfaces of the contact may move. In models with moving surfaces (conveyors, mocap bodies), these are all
    /// lanes of the contact.
    pub(crate) both_move: u32,
    /// Lanes (bits) in which the first surface of the contact is a plane.
    pub(crate) flat: u32,
    /// Ranges of eliminated equality rows that share a degree of freedom with the row.
    pub(crate) coupled: Vec<Range<usize>>,
    /// Entries of the eliminated equality rows, times D^-1/2 and times D^1/2, where L^T D L is the mass matrix.
    pub(crate) eliminated_entries: [Vec<R>; 2],
    /// Coefficient of each eliminated row in the last elimination. Functions that estimate rounding errors overwrite the coefficient with
    /// its magnitude.
    pub(crate) projections: Vec<V3<R>>,
    /// Squared scales of the entries of `column`. An entry is a sum of terms, and its scale is their size. Entries far below their
    /// scale are rounding errors.
    pub(crate) scales: Vec<V3<R>>,
    /// Squared scales of the terms that the elimination of equalities subtracts from each entry of a column.
    pub(crate) removed_scales: Vec<V3<R>>,
    /// Squared scales of the target velocities of hard equality rows, (m/s)^2, in the order of these rows.
    pub(crate) velocity_scales: Vec<R>,
    /// Sum of squared terms of each row in the block of equalities under construction.
    pub(crate) sizes: Vec<R>,
    /// Whether each block of equalities needs the scales of its entries to detect dependent rows.
    pub(crate) needs_scales: Vec<bool>,
    /// Squared scales of the entries of the rows of a block of equalities.
    pub(crate) entry_scales: Vec<R>,
    /// Squared scales of the coefficients by which the eliminated rows are subtracted from the rows of a block of equalities.
    pub(crate) coefficient_scales: Vec<R>,
    /// Velocity terms of each row of a block of equalities, m/s: h/2 J' v, J v before the step, and the bias that corrects the position
    /// error.
    pub(crate) velocity_terms: Vec<[R; 3]>,
}

impl<R: Real> RowBuilder<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let block = compiled.equalities.iter().map(|b| b.rows).max().unwrap_or(0);
        let rows = compiled.equalities.iter().map(|b| b.rows).sum();
        let entries = || compiled.equalities.iter().map(|b| b.rows * b.dofs.len());
        Self {
            dofs: Vec::with_capacity(compiled.nv),
            column: vec![zero(); compiled.nv],
            linear: vec![zero(); if compiled.has_rolling_friction { compiled.nv } else { 0 }],
            path: vec![R::zero(); compiled.nv],
            signs: vec![[0; 2]; compiled.nv],
            words: vec![0; compiled.nv.div_ceil(64)],
            both_move: 0,
            flat: 0,
            coupled: Vec::with_capacity(compiled.equalities.len()),
            eliminated_entries: std::array::from_fn(|_| Vec::with_capacity(entries().sum())),
            projections: vec![zero(); rows],
            scales: vec![zero(); compiled.nv],
            removed_scales: vec![zero(); compiled.nv],
            velocity_scales: Vec::with_capacity(rows),
            sizes: Vec::with_capacity(block),
            needs_scales: vec![false; compiled.equalities.len()],
            entry_scales: Vec::with_capacity(entries().max().unwrap_or(0)),
            coefficient_scales: vec![R::zero(); block],
            velocity_terms: Vec::with_capacity(block),
        }
    }
}

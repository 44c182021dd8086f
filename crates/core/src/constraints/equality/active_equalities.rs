//! Active equalities of the model, in each lane.

use stepper_real::{Mask, Real, kernel};

use crate::compile::{CompiledEquality, ModelStructure};

/// Active equalities: for each equality, the lanes in which it is active (MuJoCo's `eq_active`).
#[derive(Clone, Debug)]
pub(crate) struct ActiveEqualities<R: Real> {
    /// Lanes in which each equality of the model is active.
    lanes: Vec<R::Mask>,
    /// Whether each block of the compiled model has an equality that is active in any lane.
    blocks: Vec<bool>,
}

impl<R: Real> ActiveEqualities<R> {
    /// Creates the default of the model (`eq_active0`) in every lane.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let equalities = compiled.equalities.iter().map(|block| block.equalities.len()).sum();
        let none = R::Mask::splat(false);
        let mut active = Self { lanes: vec![none; equalities], blocks: vec![false; compiled.equalities.len()] };
        active.load(compiled, &[], 0, 0);
        active
    }

    /// Loads the user's `eq_active` for the environments `first..first + used`. `rows` is (num_envs, neq), and 0 disables an equality. An
    /// empty array selects the defaults of the model.
    pub(crate) fn load(&mut self, compiled: &ModelStructure<R::Scalar>, rows: &[f64], first: usize, used: usize) {
        kernel!(R, || {
            let count = self.lanes.len();
            for (block, any) in compiled.equalities.iter().zip(&mut self.blocks) {
                *any = false;
                for CompiledEquality { index, active, .. } in &block.equalities {
                    let bits = if rows.is_empty() {
                        if *active { u32::MAX } else { 0 }
                    } else {
                        (0..used).fold(0, |bits, lane| bits | u32::from(rows[(first + lane) * count + index] != 0.0) << lane)
                    };
                    self.lanes[*index] = R::Mask::from_bits(bits);
                    *any |= bits != 0;
                }
            }
        });
    }

    /// Lanes in which the equality is active.
    #[inline(always)]
    pub(crate) fn lanes(&self, equality: &CompiledEquality<R::Scalar>) -> R::Mask {
        self.lanes[equality.index]
    }

    /// Whether the block with index `block` has rows: one of its equalities is active in some lane.
    #[inline(always)]
    pub(crate) fn has_rows(&self, block: usize) -> bool {
        self.blocks[block]
    }
}

//! Cache of the arrays of derived quantities: repeated reads return the same array until the state changes.

use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

/// Cached arrays of the current state, and the quantities that were read at the previous state.
///
/// A program that reads several quantities after each step gets them in one pass over the environments.
#[derive(Default)]
pub(crate) struct DerivedArrays {
    /// Revision of the arrays, by [`stepper_core::Simulation::revision`].
    revision: u64,
    arrays: Vec<(DerivedQuantity, Py<PyAny>)>,
    /// Quantities that were read at this revision, and at the last revision with reads.
    asked: Vec<DerivedQuantity>,
    before: Vec<DerivedQuantity>,
}

impl DerivedArrays {
    /// Cached array of a quantity at a revision. Arrays of other revisions are dropped.
    pub(crate) fn get(&mut self, revision: u64, quantity: DerivedQuantity) -> Option<&Py<PyAny>> {
        if self.revision != revision {
            self.arrays.clear();
            self.revision = revision;
            if !self.asked.is_empty() {
                std::mem::swap(&mut self.asked, &mut self.before);
                self.asked.clear();
            }
        }
        if !self.asked.contains(&quantity) {
            self.asked.push(quantity);
        }
        self.arrays.iter().find(|(of, _)| *of == quantity).map(|(_, array)| array)
    }

    /// Quantities to compute for a read that the cache does not serve.
    ///
    /// They are the requested one and those that were read together with it before. Results of the last step are computed alone, as they
    /// may need another step.
    pub(crate) fn together(&self, quantity: DerivedQuantity) -> Vec<DerivedQuantity> {
        let mut all = vec![quantity];
        if self.before.contains(&quantity) && !quantity.is_of_last_step() {
            let known = |of: &DerivedQuantity| self.arrays.iter().any(|(kept, _)| kept == of);
            all.extend(self.before.iter().filter(|of| **of != quantity && !of.is_of_last_step() && !known(of)));
        }
        all
    }

    /// Adds an array to the cache, for the revision of the last call of [`DerivedArrays::get`].
    pub(crate) fn keep(&mut self, quantity: DerivedQuantity, array: Py<PyAny>) {
        self.arrays.push((quantity, array));
    }
}

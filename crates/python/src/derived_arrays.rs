//! Cache of the arrays of derived quantities: repeated reads return the same array until the state changes.

use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

/// Cache of NumPy arrays of derived quantities at the current state, with a list of the quantities that were read at the previous state.
///
/// A program that reads several quantities after each step gets them in one pass over the environments.
#[derive(Default)]
pub(crate) struct DerivedArrays {
    /// [`stepper_core::Simulation::revision`] at which the arrays were computed.
    revision: u64,
    arrays: Vec<(DerivedQuantity, Py<PyAny>)>,
    /// Quantities that were read since the revision last changed, which happens when the state or an input changes.
    asked: Vec<DerivedQuantity>,
    /// Quantities that were read at the previous revision of the state. Revisions at which nothing was read are skipped.
    before: Vec<DerivedQuantity>,
}

impl DerivedArrays {
    /// Cached array of a quantity at this revision of the simulation's state; `None` if it is not cached. If the revision has changed, the
    /// cache is cleared first.
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

    /// Quantities to compute when `quantity` is read and not in the cache.
    ///
    /// The list starts with `quantity`. It continues with uncached quantities that were read together with it at the previous revision.
    /// Quantities of the last step are not in the list, unless `quantity` is one: they can require the evaluation of a step.
    pub(crate) fn together(&self, quantity: DerivedQuantity) -> Vec<DerivedQuantity> {
        let mut all = vec![quantity];
        if self.before.contains(&quantity) && !quantity.is_of_last_step() {
            let known = |of: &DerivedQuantity| self.arrays.iter().any(|(kept, _)| kept == of);
            all.extend(self.before.iter().filter(|of| **of != quantity && !of.is_of_last_step() && !known(of)));
        }
        all
    }

    /// Adds an array to the cache. It must belong to the revision that was passed to the last call of [`DerivedArrays::get`].
    pub(crate) fn keep(&mut self, quantity: DerivedQuantity, array: Py<PyAny>) {
        self.arrays.push((quantity, array));
    }
}

//! Arrays of derived quantities that were handed out: they are handed out again until something changes.

use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

/// Arrays of one moment of a simulation, and what was asked for at the last one: who reads several quantities after every step gets them in
/// one pass over the environments.
#[derive(Default)]
pub(crate) struct DerivedArrays {
    /// [`stepper_core::Simulation::revision`] that they are of.
    revision: u64,
    arrays: Vec<(DerivedQuantity, Py<PyAny>)>,
    /// What was asked for at this revision, and at the last one at which anything was.
    asked: Vec<DerivedQuantity>,
    before: Vec<DerivedQuantity>,
}

impl DerivedArrays {
    /// The array of a quantity at a revision, if it was kept; arrays of another revision are given up.
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

    /// What to derive when a quantity that is not kept is asked for: itself, and what is likely to be asked for next, where it was asked
    /// for together with this one before. What the last step did is derived alone: it may take another step.
    pub(crate) fn together(&self, quantity: DerivedQuantity) -> Vec<DerivedQuantity> {
        let mut all = vec![quantity];
        if self.before.contains(&quantity) && !quantity.is_of_last_step() {
            let known = |of: &DerivedQuantity| self.arrays.iter().any(|(kept, _)| kept == of);
            all.extend(self.before.iter().filter(|of| **of != quantity && !of.is_of_last_step() && !known(of)));
        }
        all
    }

    /// Keeps an array of the revision that [`DerivedArrays::get`] was asked for last.
    pub(crate) fn keep(&mut self, quantity: DerivedQuantity, array: Py<PyAny>) {
        self.arrays.push((quantity, array));
    }
}

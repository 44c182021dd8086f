//! Arrays of derived quantities that were handed out: they are handed out again until something changes.

use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

/// Arrays of one moment of a simulation.
#[derive(Default)]
pub(crate) struct DerivedArrays {
    /// [`stepper_core::Simulation::revision`] that they are of.
    revision: u64,
    arrays: Vec<(DerivedQuantity, Py<PyAny>)>,
}

impl DerivedArrays {
    /// The array of a quantity at a revision, if it was kept; arrays of another revision are given up.
    pub(crate) fn get(&mut self, revision: u64, quantity: DerivedQuantity) -> Option<&Py<PyAny>> {
        if self.revision != revision {
            self.arrays.clear();
            self.revision = revision;
        }
        self.arrays.iter().find(|(of, _)| *of == quantity).map(|(_, array)| array)
    }

    /// Keeps an array of the revision that [`DerivedArrays::get`] was asked for last.
    pub(crate) fn keep(&mut self, quantity: DerivedQuantity, array: Py<PyAny>) {
        self.arrays.push((quantity, array));
    }
}

//! Shared parts of the property tests: the number of random cases, and the fraction of them that must have a property.

#![allow(dead_code, reason = "not every test file passes draws over")]

use std::cell::Cell;

use proptest::test_runner::Config;
use stepper_solve::Capacity;

/// Capacity for `dimension` coordinates, `scalars` scalar rows and `contacts` contacts with three rows. Each row may have entries at every
/// coordinate.
pub(crate) fn capacity(dimension: usize, scalars: usize, contacts: usize) -> Capacity {
    let scalar_entries = scalars * dimension;
    Capacity { dimension, scalars, scalar_entries, contacts, columns_per_contact: dimension, ..Capacity::default() }
}

/// Configuration of a property test with `usual` random cases, or with the number in the environment variable PROPTEST_CASES. The number of
/// rejected cases has no limit; [`Share`] counts them.
pub(crate) fn cases(usual: u32) -> Config {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok());
    Config { max_global_rejects: u32::MAX, ..Config::with_cases(asked.unwrap_or(usual)) }
}

/// Counter of all random cases, and of those for which a property holds. The property is usually that the solver solves the problem, and
/// the test examines only such cases further.
#[derive(Debug, Default)]
pub(crate) struct Share {
    held: Cell<u32>,
    drawn: Cell<u32>,
}

impl Share {
    /// Counts one random case, and whether the property `holds` for it. Returns `holds`.
    pub(crate) fn count(&self, holds: bool) -> bool {
        self.drawn.set(self.drawn.get() + 1);
        self.held.set(self.held.get() + u32::from(holds));
        holds
    }

    /// Fails if the number of cases with the property is below the fraction `share` of all cases by more than five standard deviations.
    /// Chance causes a failure in one test in three million. `what` names the property in the output.
    pub(crate) fn at_least(&self, share: f64, what: &str) {
        let (held, drawn) = (f64::from(self.held.get()), f64::from(self.drawn.get()));
        println!("{what}: {:.5} of {drawn}", held / drawn);
        // One more draw than five deviations, so that a share slightly below 1 tolerates at least one failure.
        let chance = 5.0 * (share * (1.0 - share) * drawn).sqrt() + 1.0;
        assert!(held >= share * drawn - chance, "{what}: {held} of {drawn} draws, must be {share}");
    }
}

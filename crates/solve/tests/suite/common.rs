//! Common parts of the property tests: how many problems they draw, and how many of them they may pass over.

#![allow(dead_code, reason = "not every test file passes draws over")]

use std::cell::Cell;

use proptest::test_runner::Config;

/// Cases of a property test: PROPTEST_CASES, or `usual`. Draws that are passed over have no separate bound: [`Share`] counts them.
pub(crate) fn cases(usual: u32) -> Config {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok());
    Config { max_global_rejects: u32::MAX, ..Config::with_cases(asked.unwrap_or(usual)) }
}

/// Draws for which a property holds, most often that they are solved, so that the rest of the test examines them.
#[derive(Debug, Default)]
pub(crate) struct Share {
    held: Cell<u32>,
    drawn: Cell<u32>,
}

impl Share {
    /// Counts a draw; returns `holds`.
    pub(crate) fn count(&self, holds: bool) -> bool {
        self.drawn.set(self.drawn.get() + 1);
        self.held.set(self.held.get() + u32::from(holds));
        holds
    }

    /// Fails when it held for less than `share` of the draws by more than chance explains: five standard deviations, one test in three
    /// million.
    pub(crate) fn at_least(&self, share: f64, what: &str) {
        let (held, drawn) = (f64::from(self.held.get()), f64::from(self.drawn.get()));
        println!("{what}: {:.5} of {drawn}", held / drawn);
        // One more draw than the deviation, so that a share slightly below 1 tolerates few draws.
        let chance = 5.0 * (share * (1.0 - share) * drawn).sqrt() + 1.0;
        assert!(held >= share * drawn - chance, "{what}: {held} of {drawn} draws, must be {share}");
    }
}

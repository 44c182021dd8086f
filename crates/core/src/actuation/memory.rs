//! Memory of actuator pipelines that persists between steps, lane-interleaved.

use serde::{Deserialize, Serialize};
use stepper_real::Scalar;

use crate::math::lane_arrays::{clear_column, lane_arrays};

/// Memory of the actuator pipelines of a group of environments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory<S> {
    /// Lanes (bits) whose pipelines have not received a control yet. Their first control fills the delay lines and lags.
    pub waiting: u32,
    /// Stored values of all actuators: delay lines, lagged efforts, integrals, phases and held efforts.
    pub numbers: Vec<S>,
    /// Position of the newest sample in every delay line, the same in all lanes, because all environments step together.
    pub cursors: Vec<u32>,
    /// Controls after the actuator pipelines in the last step, nu per lane.
    pub applied: Vec<S>,
}

lane_arrays!(Memory { arrays: [numbers applied], sets: [waiting], shared: [cursors], parts: [] });

impl<S: Scalar> Memory<S> {
    /// Creates the memory with allocated buffers: `numbers` values per lane, `lines` delay lines, and `controls` controls per lane.
    ///
    /// `alive` has the bits of the lanes that are used.
    pub fn with_capacity(lanes: usize, alive: u32, numbers: usize, lines: usize, controls: usize) -> Self {
        let zeros = |n: usize| vec![S::default(); n * lanes];
        Self { waiting: alive, numbers: zeros(numbers), cursors: vec![0; lines], applied: zeros(controls) }
    }

    /// Clears the memory of a lane, so that its next control counts as the first. The group has `lanes` lanes. The applied controls stay.
    pub fn forget(&mut self, lane: usize, lanes: usize) {
        if !self.applied.is_empty() {
            clear_column(&mut self.numbers, lanes, lane);
            self.waiting |= 1 << lane;
        }
    }

    /// Begins a new episode of a lane: clears the memory and the applied controls. The group has `lanes` lanes.
    pub fn begin(&mut self, lane: usize, lanes: usize) {
        self.forget(lane, lanes);
        clear_column(&mut self.applied, lanes, lane);
    }

    /// Clears the entries of an unused lane, so that equal states have equal bytes. The group has `lanes` lanes.
    pub fn clear(&mut self, lane: usize, lanes: usize) {
        self.begin(lane, lanes);
        self.waiting &= !(1 << lane);
    }
}

//! Memory of the sensors that persists between steps, lane-interleaved.

use serde::{Deserialize, Serialize};
use stepper_real::Scalar;

use crate::compile::ModelStructure;
use crate::math::lane_arrays::{clear_column, lane_arrays};

/// Memory of the sensors of a group of environments: random number state, results of the last step, and values of the transfer functions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory<S> {
    /// Lanes (bits) whose state was set by the user after the last step. Results of the last step do not apply to them.
    pub fresh: u32,
    /// Lanes (bits) in which the transfer functions have not made the first observation of the episode yet.
    pub waiting: u32,
    /// Seed of the random numbers, per lane.
    pub seed: Vec<u64>,
    /// Index of the random stream, per lane.
    pub stream: Vec<u32>,
    /// Number of earlier episodes under the current seed, per lane.
    pub episode: Vec<u32>,
    /// Number of steps since the beginning of the episode, per lane.
    pub step: Vec<u32>,
    /// Acceleration (v+ - v) / h of the last step, nv per lane.
    pub acceleration: Vec<S>,
    /// Controls of the last step, nu per lane. Empty if no sensor needs them.
    pub ctrl: Vec<S>,
    /// Forces and torques on bodies that the user applied in the last step, 6 nbody per lane. Empty if no sensor needs them.
    pub xfrc: Vec<S>,
    /// Stored values of the transfer functions, such as biases and delay lines.
    pub numbers: Vec<S>,
    /// Position of the newest sample in every delay line, the same in all lanes, because all environments step together.
    pub cursors: Vec<u32>,
    /// Readings after the transfer functions; empty when all sensors are ideal.
    pub observation: Vec<S>,
    /// Number of clipped readings and number of lost samples in the last call, per lane, for every sensor with errors.
    pub faults: Vec<u32>,
}

lane_arrays!(Memory {
    arrays: [seed stream episode step acceleration ctrl xfrc numbers observation faults],
    sets: [fresh waiting],
    shared: [cursors],
    parts: []
});

impl<S: Scalar> Memory<S> {
    /// Creates the memory for ideal sensors (without errors). `first` is the index of the first environment of the group.
    pub fn new(compiled: &ModelStructure<S>, lanes: usize, first: usize) -> Self {
        let needs = compiled.sensing.needs;
        let zeros = |there: bool, n: usize| vec![S::default(); if there { n * lanes } else { 0 }];
        Self {
            seed: vec![0; lanes],
            stream: (0..lanes).map(|l| (first + l) as u32).collect(),
            episode: vec![0; lanes],
            step: vec![0; lanes],
            acceleration: zeros(true, compiled.nv),
            ctrl: zeros(needs.step || needs.actuators, compiled.actuators.len()),
            xfrc: zeros(needs.wrenches, 6 * compiled.bodies.len()),
            ..Self::default()
        }
    }

    /// Allocates the buffers of transfer functions: `numbers` stored values per lane, `lines` delay lines, and `readings` readings per
    /// lane.
    pub fn with_errors(&mut self, numbers: usize, lines: usize, readings: usize) {
        let lanes = self.seed.len();
        self.numbers = vec![S::default(); numbers * lanes];
        self.cursors = vec![0; lines];
        self.faults = vec![0; 2 * lines * lanes];
        self.observation = vec![S::default(); readings * lanes];
    }

    /// Marks the state of a lane as set by the user, so that sensors do not read the results of the last step. Nothing is cleared.
    pub fn refresh(&mut self, lane: usize) {
        self.fresh |= 1 << lane;
    }

    /// Clears the results of the last step in a lane. The sensors' transfer functions begin again with the next observation of the lane.
    pub fn forget(&mut self, lane: usize) {
        let lanes = self.seed.len();
        [&mut self.acceleration, &mut self.xfrc].into_iter().for_each(|numbers| clear_column(numbers, lanes, lane));
        clear_column(&mut self.faults, lanes, lane);
        self.refresh(lane);
        self.waiting |= 1 << lane;
    }

    /// Begins a new episode of a lane: the next one under the current seed, or the first one under the seed `seed`.
    pub fn begin(&mut self, lane: usize, seed: Option<u64>) {
        // Ideal sensors draw no random numbers. Their episode number does not increase, so that equal episodes have equal states.
        let counts = seed.is_none() && !self.observation.is_empty();
        self.episode[lane] = if counts { self.episode[lane].wrapping_add(1) } else { 0 };
        self.seed[lane] = seed.unwrap_or(self.seed[lane]);
        self.step[lane] = 0;
        clear_column(&mut self.ctrl, self.seed.len(), lane);
        self.forget(lane);
    }

    /// Clears the entries of an unused lane, so that equal states have equal bytes.
    pub fn clear(&mut self, lane: usize) {
        let lanes = self.seed.len();
        self.begin(lane, Some(0));
        self.stream[lane] = 0;
        [&mut self.numbers, &mut self.observation].into_iter().for_each(|numbers| clear_column(numbers, lanes, lane));
        self.fresh &= !(1 << lane);
        self.waiting &= !(1 << lane);
    }
}

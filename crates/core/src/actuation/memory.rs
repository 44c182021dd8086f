//! Memory of actuator pipelines that persists between steps, lane-interleaved.

use serde::{Deserialize, Serialize};
use stepper_real::Scalar;

use crate::math::lanes::{DestinationLanes, columns, lane_bits, set_columns, set_lane_bits};

/// Memory of the actuator pipelines of a group of environments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory<S> {
    /// Lanes (bits) whose pipelines have not received a control yet. Their first control fills the delay lines and lags.
    pub waiting: u32,
    /// Stored values of all actuators: delay lines, lagged efforts, integrals, phases and held efforts.
    pub numbers: Vec<S>,
    /// Position of the newest sample in every delay line, the same in all lanes.
    pub cursors: Vec<u32>,
    /// Controls after the actuator pipelines in the last step, nu per lane.
    pub applied: Vec<S>,
}

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
            self.numbers.iter_mut().skip(lane).step_by(lanes).for_each(|x| *x = S::default());
            self.waiting |= 1 << lane;
        }
    }

    /// Begins a new episode of a lane: clears the memory and the applied controls. The group has `lanes` lanes.
    pub fn begin(&mut self, lane: usize, lanes: usize) {
        self.forget(lane, lanes);
        self.applied.iter_mut().skip(lane).step_by(lanes).for_each(|x| *x = S::default());
    }

    /// Clears the entries of an unused lane, so that equal states have equal bytes. The group has `lanes` lanes.
    pub fn clear(&mut self, lane: usize, lanes: usize) {
        self.begin(lane, lanes);
        self.waiting &= !(1 << lane);
    }

    /// Copy of the memory of the `n` lanes that begin with lane `first`. The group has `lanes` lanes.
    pub fn part(&self, lanes: usize, first: usize, n: usize) -> Self {
        Self {
            waiting: lane_bits(self.waiting, first, n),
            numbers: columns(&self.numbers, lanes, first, n),
            cursors: self.cursors.clone(),
            applied: columns(&self.applied, lanes, first, n),
        }
    }

    /// Copies `part`, the memory of `n` lanes, to the lanes `to`. The group has `lanes` lanes.
    pub(crate) fn set_part(&mut self, lanes: usize, to: DestinationLanes, n: usize, part: &Self) {
        set_lane_bits(&mut self.waiting, to, n, part.waiting);
        set_columns(&mut self.numbers, lanes, to, n, &part.numbers);
        set_columns(&mut self.applied, lanes, to, n, &part.applied);
        // All environments step together, and share the positions of the delay lines.
        self.cursors.copy_from_slice(&part.cursors);
    }

    /// Size of the buffers, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.numbers[..]) + size_of_val(&self.applied[..]) + size_of_val(&self.cursors[..])
    }

    /// Whether another memory has buffers of the same sizes.
    pub fn fits(&self, other: &Self) -> bool {
        let sizes = |m: &Self| (m.numbers.len(), m.cursors.len(), m.applied.len());
        sizes(self) == sizes(other)
    }
}

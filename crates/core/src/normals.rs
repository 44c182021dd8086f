//! Normals of hulls that were near one another in the last step: where the next search begins.
//!
//! They save time and change no result, see [`Reach::known`](crate::geometry::convex::Reach::known). Still they are state, so that a step is a
//! function of its state whatever rounding does.

use serde::{Deserialize, Serialize};
use stepper_real::Scalar;

use crate::geometry::convex::Solid;
use crate::plan::{Kernel, Plan};
use crate::spatial::*;

/// Pairs of one environment whose normals are kept, at most; a pair has one place, and shares it with others.
const PLACES: usize = 16;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Held {
    /// Number of the pair in the plan.
    pair: u32,
    normal: [f32; 3],
}

const NONE: Held = Held { pair: u32::MAX, normal: [0.0; 3] };

/// The normals of all lanes of a group.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Normals {
    /// Places of each lane: a power of two, or none.
    places: usize,
    held: Vec<Held>,
}

impl Normals {
    /// Room for so many lanes; none in a scene without pairs of hulls.
    pub fn new<S: Scalar>(plan: &Plan<S>, lanes: usize) -> Self {
        let is_hull = |g: usize| plan.geoms[g].solid.as_ref().is_some_and(Solid::is_hull);
        let listed = plan.pairs.iter().filter(|p| p.kernel == Kernel::Convex && p.geoms.iter().all(|&g| is_hull(g))).count();
        let crowded = plan.crowd.iter().flat_map(|c| &c.members).filter(|m| is_hull(m.geom)).count();
        let places = match listed + crowded.saturating_sub(1) {
            0 => 0,
            n => n.next_power_of_two().min(PLACES),
        };
        Self { places, held: vec![NONE; places * lanes] }
    }

    fn at(&self, lane: usize, pair: usize) -> Option<usize> {
        (self.places > 0).then(|| lane * self.places + pair % self.places)
    }

    /// The normal of a pair in the last step, in the first's frame, if it is known.
    pub(crate) fn of(&self, lane: usize, pair: usize) -> Option<V3<f64>> {
        let held = &self.held[self.at(lane, pair)?];
        (held.pair == pair as u32).then(|| held.normal.map(f64::from))
    }

    /// Keeps the normal of a pair.
    pub(crate) fn keep(&mut self, lane: usize, pair: usize, normal: V3<f64>) {
        if let Some(at) = self.at(lane, pair) {
            self.held[at] = Held { pair: pair as u32, normal: normal.map(|x| x as f32) };
        }
    }

    /// Takes over those of the same plan and number of lanes.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.held.copy_from_slice(&other.held);
    }

    /// Forgets those of a lane.
    pub(crate) fn forget(&mut self, lane: usize) {
        self.held[lane * self.places..(lane + 1) * self.places].fill(NONE);
    }

    /// Those of `n` lanes from `first` on.
    pub(crate) fn part(&self, first: usize, n: usize) -> Self {
        Self { places: self.places, held: self.held[first * self.places..(first + n) * self.places].to_vec() }
    }

    /// Takes over those of `n` lanes from `first` on.
    pub(crate) fn set_part(&mut self, first: usize, n: usize, part: &Self) {
        self.held[first * self.places..(first + n) * self.places].copy_from_slice(&part.held);
    }

    /// Whether there is room for as many.
    pub(crate) fn fits(&self, other: &Self) -> bool {
        (self.places, self.held.len()) == (other.places, other.held.len())
    }

    /// Memory that it holds, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.held[..])
    }
}

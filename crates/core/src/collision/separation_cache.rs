//! Cache of separating planes: results for pairs of hulls, and of a box and a hull, that one step stores for the next. An entry is the
//! normal at which the next search starts, and a separating plane that remains valid for some motion.
//!
//! The cache saves time and changes no contact by more than rounding errors, see
//! [`SearchLimits::cached`](stepper_geometry::SearchLimits::cached) and [`SeparatingPlane`]. It is nevertheless part of the saved state: a
//! search from another normal may round differently, and a step must depend on the state alone.

use serde::{Deserialize, Serialize};
use stepper_geometry::{SeparatingPlane, Solid};
use stepper_real::Scalar;

use crate::compile::{Kernel, ModelStructure};
use crate::math::lanes::{DestinationLanes, each_of};

/// Largest number of pairs of one environment in the cache. If a step stores more pairs, only the first ones are kept.
///
/// Evidence: a Panda with a gripper of hulls and boxes takes 7.6 us per step with 16, and 4.9 us with 64.
const MAX_ENTRIES: usize = 64;

/// Entry of the cache: separating plane of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Held {
    /// Index of the pair in the compiled model.
    pair: u32,
    separating_plane: SeparatingPlane,
}

/// Unused entry.
const NONE: Held = Held { pair: u32::MAX, separating_plane: SeparatingPlane::NONE };

/// Cache of separating planes, for all lanes of a group.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeparationCache {
    /// Number of entries that each lane can have.
    places: usize,
    /// Number of used entries of each lane.
    count: Vec<u32>,
    /// Entries: those of lane l begin at `l * places`.
    held: Vec<Held>,
}

impl SeparationCache {
    /// Empty cache for `lanes` lanes. It has no space for entries if the scene has no pair of hulls or of a box and a hull.
    pub fn new<S: Scalar>(compiled: &ModelStructure<S>, lanes: usize) -> Self {
        let is = |g: usize, kind: fn(&Solid) -> bool| compiled.geoms[g].solid.as_ref().is_some_and(kind);
        let has_plane = |[a, b]: [usize; 2]| is(b, Solid::is_hull) && (is(a, Solid::is_hull) || is(a, Solid::is_box));
        let listed = compiled.pairs.iter().filter(|p| p.kernel == Kernel::Convex && has_plane(p.geoms)).count();
        let members = || compiled.dynamic_pairs.iter().flat_map(|c| &c.members);
        let [hulls, boxes] = [Solid::is_hull, Solid::is_box].map(|kind| members().filter(|m| is(m.geom, kind)).count());
        let places = (listed + hulls * hulls.saturating_sub(1) / 2 + hulls * boxes).min(MAX_ENTRIES);
        let lanes = if places == 0 { 0 } else { lanes };
        Self { places, count: vec![0; lanes], held: vec![NONE; places * lanes] }
    }

    /// Whether the cache has no space for entries, because the scene has no pair of hulls or of a box and a hull.
    #[inline(always)]
    pub(crate) fn is_unused(&self) -> bool {
        self.places == 0
    }

    /// Range of the used entries of lane `lane` in `held`.
    #[inline(always)]
    fn used(&self, lane: usize) -> std::ops::Range<usize> {
        let used = self.count.get(lane).map_or(0, |&n| n as usize);
        lane * self.places..lane * self.places + used
    }

    /// Separating plane of the pair with index `pair` in lane `lane`; `None` if the cache does not have it.
    ///
    /// The search begins at the entry `last`, continues at the first entry after the end, and sets `last` to the entry of the pair. The
    /// narrow phase tests pairs in the order of the entries, so that this entry or the next one is usually the right one.
    #[inline(always)]
    pub(crate) fn of(&self, lane: usize, pair: usize, last: &mut usize) -> Option<&SeparatingPlane> {
        let entries = &self.held[self.used(lane)];
        let (before, after) = entries.split_at((*last).min(entries.len()));
        let is_pair = |h: &Held| h.pair == pair as u32;
        let place = after.iter().position(is_pair).map(|k| before.len() + k).or_else(|| before.iter().position(is_pair))?;
        *last = place;
        Some(&entries[place].separating_plane)
    }

    /// Adds the separating plane of a pair that is not in the cache yet, unless the cache is full.
    #[inline(always)]
    pub(crate) fn keep(&mut self, lane: usize, pair: usize, separating_plane: &SeparatingPlane) {
        let next = self.used(lane);
        if next.len() < self.places {
            self.held[next.end] = Held { pair: pair as u32, separating_plane: *separating_plane };
            self.count[lane] += 1;
        }
    }

    /// Copies all entries of `from`, a cache of the same size.
    pub(crate) fn copy_from(&mut self, from: &Self) {
        self.count.copy_from_slice(&from.count);
        self.held.copy_from_slice(&from.held);
    }

    /// Removes the entries of all lanes.
    pub(crate) fn clear(&mut self) {
        self.count.fill(0);
    }

    /// Removes the entries of lane `lane`.
    pub(crate) fn forget(&mut self, lane: usize) {
        if let Some(count) = self.count.get_mut(lane) {
            *count = 0;
        }
    }

    /// Cache with the entries of the `n` lanes that begin with lane `first`. `lane_arrays!` passes the number of all lanes to all parts;
    /// here it is not needed.
    pub(crate) fn copy_lanes(&self, _lanes: usize, first: usize, n: usize) -> Self {
        let count = self.count.get(first..first + n).unwrap_or_default().to_vec();
        Self { places: self.places, count, held: self.held[first * self.places..(first + n) * self.places].to_vec() }
    }

    /// Copies the entries of `part`, a cache of `n` lanes, to the lanes `to` of this cache.
    pub(crate) fn set_lanes(&mut self, _lanes: usize, to: DestinationLanes, n: usize, part: &Self) {
        if self.places == 0 {
            return;
        }
        match to {
            DestinationLanes::StartingAt(first) => {
                self.count[first..first + n].copy_from_slice(&part.count);
                self.held[first * self.places..(first + n) * self.places].copy_from_slice(&part.held);
            }
            DestinationLanes::Each(set) => each_of(set).for_each(|lane| {
                self.count[lane] = part.count[0];
                self.held[lane * self.places..(lane + 1) * self.places].copy_from_slice(&part.held);
            }),
        }
    }

    /// Clears unused entries, so that equal caches have equal bytes.
    pub(crate) fn tidy(&mut self) {
        for lane in 0..self.count.len() {
            let end = self.used(lane).end;
            self.held[end..(lane + 1) * self.places].fill(NONE);
        }
    }

    /// Whether `other` has as many lanes and entries as this cache, and valid counts of used entries.
    pub(crate) fn fits(&self, other: &Self) -> bool {
        let shape = |n: &Self| (n.places, n.count.len(), n.held.len());
        shape(self) == shape(other) && self.count.iter().chain(&other.count).all(|&n| n as usize <= self.places)
    }

    /// Allocated memory, bytes.
    pub(crate) fn bytes_of_arrays(&self) -> usize {
        size_of_val(&self.count[..]) + size_of_val(&self.held[..])
    }
}

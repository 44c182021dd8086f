//! Balls and capsules that are near boxes in few lanes: such pairs of all lanes share a register.
//!
//! Over stairs or stones every environment is near other boxes. A kernel over lanes would then compute a pair in all lanes for one that
//! needs it. Here an item is a pair in one lane, and a register holds as many items as it has lanes. A number does not depend on its
//! neighbours in a register, so that the contacts have the same bits.

use stepper_geometry::pairs::ContactPoint;
use stepper_real::{Real, Scalar};

use crate::compile::{CompiledPair, Kernel};
use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::array_of;

/// Pair in one lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item<S> {
    /// Number of the pair in the compiled model.
    pub(crate) index: usize,
    /// The ball or capsule, and the box.
    pub(crate) geoms: [usize; 2],
    pub(crate) margin: S,
    pub(crate) lane: usize,
}

/// Point of an item that can touch within the step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found<S> {
    pub(super) index: usize,
    pub(super) feature: u32,
    pub(super) lane: usize,
    pub(super) point: ContactPoint<S>,
    /// Distance of a ball's centre from the border of the face that it is over, m. Not positive if it is over none.
    pub(super) clearance: S,
}

/// Items of one kernel, and their points, both in the order of the pairs.
#[derive(Clone, Debug)]
pub(super) struct Queue<S> {
    pub(super) items: Vec<Item<S>>,
    pub(super) found: Vec<Found<S>>,
    /// Number of points that are taken.
    pub(super) taken: usize,
}

/// Pairs that are near in few lanes.
#[derive(Clone, Debug)]
pub(crate) struct PackedPairs<S> {
    pub(super) balls: Queue<S>,
    pub(super) capsules: Queue<S>,
}

impl<S> Default for PackedPairs<S> {
    fn default() -> Self {
        let queue = || Queue { items: vec![], found: vec![], taken: 0 };
        Self { balls: queue(), capsules: queue() }
    }
}

impl<S: Scalar> PackedPairs<S> {
    /// Forgets all pairs.
    pub(crate) fn clear(&mut self) {
        for queue in [&mut self.balls, &mut self.capsules] {
            queue.items.clear();
            queue.found.clear();
            queue.taken = 0;
        }
    }

    /// Queue of a pair that is near in these lanes (bits); `None` for one that all lanes compute together.
    pub(super) fn queue<R: Real<Scalar = S>>(&mut self, kernel: Kernel, lanes: u32) -> Option<&mut Queue<S>> {
        if 2 * lanes.count_ones() as usize > R::LANES {
            return None;
        }
        match kernel {
            Kernel::SphereBox => Some(&mut self.balls),
            Kernel::CapsuleBox => Some(&mut self.capsules),
            _ => None,
        }
    }

    /// Adds a pair that is near in the lanes `lanes` (bits). Pairs come in ascending order.
    pub(crate) fn add<R: Real<Scalar = S>>(&mut self, index: usize, pair: &CompiledPair<S>, lanes: u32) {
        if let Some(queue) = self.queue::<R>(pair.kernel, lanes) {
            let item = |lane| Item { index, geoms: pair.geoms, margin: pair.margin, lane };
            queue.items.extend(each_of(lanes).map(item));
        }
    }
}

/// Numbers of items, each of its lane, side by side.
#[inline(always)]
pub(super) fn gather<R: Real, const N: usize>(items: &[Item<R::Scalar>], of: impl Fn(&Item<R::Scalar>) -> [R; N]) -> [R; N] {
    let mut rows = [[R::Scalar::ZERO; MAX_LANES]; N];
    for (place, item) in items.iter().enumerate() {
        let numbers = of(item);
        for k in 0..N {
            rows[k][place] = numbers[k].lane(item.lane);
        }
    }
    array_of(
        #[inline(always)]
        |k| R::load(&rows[k]),
    )
}

/// A number of each item, one item per lane.
#[inline(always)]
pub(crate) fn gather_scalars<R: Real, I>(items: &[I], of: impl Fn(&I) -> R::Scalar) -> R {
    let mut row = [R::Scalar::ZERO; MAX_LANES];
    row.iter_mut().zip(items).for_each(|(x, item)| *x = of(item));
    R::load(&row)
}

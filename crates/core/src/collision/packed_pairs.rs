//! Packed pairs of balls or capsules with boxes: pairs of several lanes share one SIMD register.
//!
//! On stairs or stones, the robots of different environments are near different boxes. A kernel over lanes would then compute a pair in
//! all lanes although its geoms are near each other in only one lane. In this module an item is a pair in one lane, and a register holds
//! as many items as it has lanes. Lanes of a register do not affect each other, so that packing does not change the bits of the contacts.

use stepper_geometry::pairs::{ContactPoint, Cuboid};
use stepper_real::{Real, Scalar};

use crate::compile::{CompiledPair, Kernel, LaneModel};
use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::array;
use crate::math::spatial::{M3, V3};

/// Item: a packed pair in one of its lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item<S> {
    /// Index of the pair in the compiled model.
    pub(crate) index: usize,
    /// Indices of the two geoms in the compiled model: the ball or capsule, then the box.
    pub(crate) geoms: [usize; 2],
    /// Margin of the pair, m.
    pub(crate) margin: S,
    /// Lane in which the pair is tested.
    pub(crate) lane: usize,
}

/// Contact point of an item (a packed pair in one lane) whose gap is small enough to close within two steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found<S> {
    /// Index of the pair in the compiled model.
    pub(super) index: usize,
    /// Number of the contact point among those of the pair: 0, or 1 for the second point of a capsule.
    pub(super) feature: u32,
    pub(super) lane: usize,
    pub(super) point: ContactPoint<S>,
    /// Distance of the ball's centre from the border of the box face that the ball is over, m. Zero or negative if the centre is over no
    /// face. Zero for a capsule.
    pub(super) clearance: S,
}

/// Items (pairs in one lane) of one kernel, and their contact points. Both are in the order of the pairs.
#[derive(Clone, Debug, Default)]
pub(super) struct Queue<S> {
    pub(super) items: Vec<Item<S>>,
    pub(super) found_points: Vec<Found<S>>,
    /// Number of points of `found_points` that [`Scene::take_packed`](crate::collision::detection::Scene::take_packed) has already added to
    /// the contacts.
    pub(super) taken: usize,
}

/// Packed pairs: pairs of balls or capsules with boxes that are near each other in at most half of the lanes.
#[derive(Clone, Debug, Default)]
pub(crate) struct PackedPairs<S> {
    pub(super) balls: Queue<S>,
    pub(super) capsules: Queue<S>,
}

impl<S: Scalar> PackedPairs<S> {
    /// Removes all items and their points.
    pub(crate) fn clear(&mut self) {
        for queue in [&mut self.balls, &mut self.capsules] {
            queue.items.clear();
            queue.found_points.clear();
            queue.taken = 0;
        }
    }

    /// Queue for a pair that is near in the lanes `lanes` (bits). `None` for a pair that is not packed, because of its kernel or because it
    /// is near in too many lanes.
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

    /// Adds an item for each lane of `lanes` (bits) of a pair, if the pair can be packed. The caller adds pairs in ascending order.
    pub(crate) fn add<R: Real<Scalar = S>>(&mut self, index: usize, pair: &CompiledPair<S>, lanes: u32) {
        if let Some(queue) = self.queue::<R>(pair.kernel, lanes) {
            let item = |lane| Item { index, geoms: pair.geoms, margin: pair.margin, lane };
            queue.items.extend(each_of(lanes).map(item));
        }
    }
}

/// Gathers values of items in registers, such as `gather!(items, |item| pos[item.geoms[0]])`. For each item, the closure returns the values
/// in all lanes of the step, and the macro takes the item's lane. See [`gather_lanes`].
macro_rules! gather {
    ($items:expr, |$item:pat_param| $numbers:expr) => {
        $crate::collision::packed_pairs::gather_lanes(
            $items,
            #[inline(always)]
            |$item| $numbers,
        )
    };
}

pub(super) use gather;

/// Boxes of the items, which are their second geoms. `pos` and `mat` are the poses of all geoms.
#[inline(always)]
pub(super) fn gather_boxes<R: Real>(compiled: &LaneModel<R>, pos: &[V3<R>], mat: &[M3<R>], items: &[Item<R::Scalar>]) -> Cuboid<R> {
    Cuboid {
        centre: gather!(items, |item| pos[item.geoms[1]]),
        mat: gather!(items, |item| mat[item.geoms[1]]),
        half: gather!(items, |item| compiled.params.geom_size(item.geoms[1])),
    }
}

/// Gathers N values per item in registers. For each item, `of` returns the values in all lanes of the step, from which the function takes
/// the item's lane. Item k is in lane k of the result.
#[inline(always)]
pub(super) fn gather_lanes<R: Real, const N: usize>(items: &[Item<R::Scalar>], of: impl Fn(&Item<R::Scalar>) -> [R; N]) -> [R; N] {
    let mut rows = [[R::Scalar::ZERO; MAX_LANES]; N];
    for (place, item) in items.iter().enumerate() {
        let numbers = of(item);
        for k in 0..N {
            rows[k][place] = numbers[k].lane(item.lane);
        }
    }
    array!(|k| R::load(&rows[k]))
}

/// Gathers one scalar of each item in a register. Item k is in lane k of the result.
#[inline(always)]
pub(crate) fn gather_scalars<R: Real, I>(items: &[I], of: impl Fn(&I) -> R::Scalar) -> R {
    let mut row = [R::Scalar::ZERO; MAX_LANES];
    row.iter_mut().zip(items).for_each(|(x, item)| *x = of(item));
    R::load(&row)
}

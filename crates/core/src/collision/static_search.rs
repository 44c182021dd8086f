//! Broad phase of moving geoms and geoms that are fixed to the world. It uses boxes along the axes of the world, and a tree over the
//! static ones.
//!
//! The bounds of the tree hold a static geom in all lanes, because its pose may differ between environments. Each lane walks down
//! the tree with the box about all geoms of a kinematic tree. At a leaf the boxes of these geoms are tested, as many at a time as a
//! register has lanes.

use stepper_geometry::BoundingBox;
use stepper_real::{Mask, Real, Scalar};

use crate::compile::{LaneModel, Params, StaticPairs};
use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::*;

/// Rounding error of bounds, relative to coordinates and sizes, also in single precision.
const ROUNDING: f64 = 4e-6;

/// Box along the axes of the world: lowest coordinates, then highest, m.
type Bounds<T> = [T; 6];

/// Bounding boxes, and the pairs whose boxes overlap.
#[derive(Clone, Debug)]
pub(crate) struct StaticSearch<R: Real> {
    /// Bounds of the nodes of the tree.
    nodes: Vec<Bounds<R::Scalar>>,
    /// Bounds of each group of moving geoms.
    groups: Vec<Bounds<R>>,
    /// Bounds of the moving geoms: a row of all geoms for every lane and coordinate.
    boxes: Vec<R::Scalar>,
    found: Vec<u64>,
    /// Largest bounding radius and smallest inscribed radius of the static geoms, m.
    largest: R::Scalar,
    thinnest: R::Scalar,
    /// Index of each pair in the compiled model, and the lanes (bits) in which it can touch; ascending.
    pub(crate) pairs: Vec<(u32, u32)>,
}

/// Static geoms near each moving geom for which memory is reserved at the beginning.
const EXPECTED: usize = 8;

/// Bits of a lane in an entry of `found`.
const LANE_BITS: u32 = MAX_LANES.ilog2();

impl<R: Real> StaticSearch<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        let StaticPairs { moving, groups, nodes, .. } = &compiled.static_pairs;
        let zero = R::Scalar::ZERO;
        let capacity = R::LANES * moving.len() * compiled.static_pairs.fixed.len().min(EXPECTED);
        Self {
            nodes: vec![[zero; 6]; nodes.len()],
            groups: vec![[R::zero(); 6]; groups.len()],
            boxes: vec![zero; R::LANES * 6 * Self::row(&compiled.static_pairs)],
            found: Vec::with_capacity(capacity),
            largest: zero,
            thinnest: zero,
            pairs: Vec::with_capacity(capacity),
        }
    }

    /// Length of a row of `boxes`: padded for a whole register at its end.
    fn row(pairs: &StaticPairs) -> usize {
        pairs.moving.len() + R::LANES
    }

    /// Updates the bounds of the tree from the poses and sizes of the static geoms.
    pub(crate) fn update_tree(&mut self, compiled: &LaneModel<R>, pos: &[V3<R>], mat: &[M3<R>]) {
        let StaticPairs { fixed, nodes, .. } = &compiled.static_pairs;
        let params = &compiled.params;
        let lanes =
            |of: fn(&Params<R>, usize) -> R| fixed.iter().flat_map(move |f| (0..R::LANES).map(move |lane| of(params, f.geom).lane(lane)));
        self.largest = lanes(Params::bounding_radius).fold(R::Scalar::ZERO, |x, y| if y > x { y } else { x });
        self.thinnest = lanes(Params::inscribed_radius).fold(self.largest, |x, y| if y < x { y } else { x });
        for (at, node) in nodes.iter().enumerate().rev() {
            self.nodes[at] = match node.leaf() {
                Some(leaf) => {
                    let (g, margin) = (fixed[leaf].geom, R::of(fixed[leaf].margin));
                    over_lanes(bounds(compiled, g, pos[g], &mat[g], margin))
                }
                None => {
                    let (first, second) = (at + 1, nodes[at + 1].end as usize);
                    union(&self.nodes[first], &self.nodes[second])
                }
            };
        }
    }

    /// Lanes in which a geom that moves by `displacement`, m, may have passed through the thinnest static geom.
    #[inline(always)]
    pub(crate) fn may_tunnel(&self, compiled: &LaneModel<R>, geom: usize, displacement: R) -> R::Mask {
        displacement.gt(R::of(0.5) * (compiled.params.inscribed_radius(geom) + R::splat(self.thinnest)))
    }

    /// Finds the pairs of the lanes in `alive` whose boxes overlap. `travel` bounds the displacement of every geom, m, and selects
    /// whether to find all pairs whose bounding balls overlap.
    pub(crate) fn find(&mut self, compiled: &LaneModel<R>, alive: u32, poses: (&[V3<R>], &[M3<R>]), travel: impl Fn(usize) -> (R, bool)) {
        self.found.clear();
        R::vectorize(
            #[inline(always)]
            || {
                self.update_boxes(compiled, poses, travel);
                for lane in each_of(alive) {
                    for group in 0..self.groups.len() {
                        self.visit_tree(&compiled.static_pairs, group, lane);
                    }
                }
            },
        );
        self.found.sort_unstable();
        self.merge_lanes();
    }

    /// Updates the boxes of the moving geoms and of each group of them.
    #[inline(always)]
    fn update_boxes(&mut self, compiled: &LaneModel<R>, (pos, mat): (&[V3<R>], &[M3<R>]), travel: impl Fn(usize) -> (R, bool)) {
        let StaticPairs { moving, groups, .. } = &compiled.static_pairs;
        let row = Self::row(&compiled.static_pairs);
        let mut lanes = [R::Scalar::ZERO; MAX_LANES];
        for (range, whole) in groups.iter().zip(&mut self.groups) {
            for m in range.clone() {
                let g = moving[m].geom;
                let (mut reach, balls) = travel(g);
                if balls {
                    reach += compiled.params.bounding_radius(g) + R::splat(self.largest);
                }
                let own = bounds(compiled, g, pos[g], &mat[g], reach);
                for k in 0..6 {
                    own[k].store(&mut lanes);
                    for (lane, &x) in lanes[..R::LANES].iter().enumerate() {
                        self.boxes[(lane * 6 + k) * row + m] = x;
                    }
                }
                *whole = if m == range.start { own } else { union_of_lanes(whole, &own) };
            }
        }
    }

    /// Adds the pairs of a group in a lane.
    #[inline(always)]
    fn visit_tree(&mut self, pairs: &StaticPairs, group: usize, lane: usize) {
        let whole: Bounds<R::Scalar> = lane_of(&self.groups[group], lane);
        let mut at = 0;
        while let Some(node) = pairs.nodes.get(at) {
            let own = &self.nodes[at];
            if (0..3).all(|k| whole[k] <= own[k + 3] && own[k] <= whole[k + 3]) {
                if let Some(leaf) = node.leaf() {
                    self.visit_leaf(pairs, group, leaf, at, lane);
                }
                at += 1;
            } else {
                at = node.end as usize;
            }
        }
    }

    /// Adds the pairs of the geoms of a group and a static geom in a lane.
    #[inline(always)]
    fn visit_leaf(&mut self, pairs: &StaticPairs, group: usize, leaf: usize, node: usize, lane: usize) {
        let (row, geoms, own) = (Self::row(pairs), &pairs.groups[group], &self.nodes[node]);
        let own: Bounds<R> = splat(*own);
        for first in geoms.clone().step_by(R::LANES) {
            let mut overlaps = R::Mask::splat(true);
            for k in 0..3 {
                let low = R::load(&self.boxes[(lane * 6 + k) * row + first..]);
                let high = R::load(&self.boxes[(lane * 6 + k + 3) * row + first..]);
                overlaps = overlaps.and(low.le(own[k + 3])).and(own[k].le(high));
            }
            for i in each_of(overlaps.bits()).take_while(|i| first + i < geoms.end) {
                if let Some(number) = pairs.number(&pairs.fixed[leaf], first + i) {
                    self.found.push(u64::from(number) << LANE_BITS | lane as u64);
                }
            }
        }
    }

    /// Joins the lanes of each pair.
    fn merge_lanes(&mut self) {
        self.pairs.clear();
        for &x in &self.found {
            let (number, lane) = ((x >> LANE_BITS) as u32, x & ((1 << LANE_BITS) - 1));
            match self.pairs.last_mut() {
                Some(last) if last.0 == number => last.1 |= 1 << lane,
                _ => self.pairs.push((number, 1 << lane)),
            }
        }
    }

    /// Found pairs among the first `listed` pairs of the model.
    pub(crate) fn listed_pairs(&self, listed: usize) -> &[(u32, u32)] {
        &self.pairs[..self.count_listed(listed)]
    }

    /// Found pairs after the first `listed` pairs of the model, which are dynamic pairs.
    pub(crate) fn dynamic_pairs(&self, listed: usize) -> &[(u32, u32)] {
        &self.pairs[self.count_listed(listed)..]
    }

    fn count_listed(&self, listed: usize) -> usize {
        self.pairs.partition_point(|pair| (pair.0 as usize) < listed)
    }
}

/// Bounding box of a geom that moves by at most `travel`, m.
#[inline(always)]
fn bounds<R: Real>(compiled: &LaneModel<R>, geom: usize, pos: V3<R>, mat: &M3<R>, travel: R) -> Bounds<R> {
    let solid = compiled.geoms[geom].solid.as_ref().expect("made for every geom of static pairs");
    let [centre, half] = BoundingBox::along_world(solid, compiled.params.geom_size(geom), mat).expect("convex");
    let centre = add(pos, centre);
    let sum = |v: V3<R>| v[0].abs() + v[1].abs() + v[2].abs();
    let reach = travel + R::of(ROUNDING) * (sum(centre) + sum(half) + travel);
    array_of(
        #[inline(always)]
        |k| if k < 3 { centre[k] - (half[k] + reach) } else { centre[k - 3] + (half[k - 3] + reach) },
    )
}

/// Box of one lane.
#[inline(always)]
fn lane_of<R: Real>(own: &Bounds<R>, lane: usize) -> Bounds<R::Scalar> {
    let mut out = [R::Scalar::ZERO; 6];
    for (x, lanes) in out.iter_mut().zip(own) {
        *x = lanes.lane(lane);
    }
    out
}

/// Box that contains the boxes of all lanes. All coordinates must be finite.
fn over_lanes<R: Real>(own: Bounds<R>) -> Bounds<R::Scalar> {
    let mut whole = own.map(|x| x.lane(0));
    for lane in 1..R::LANES {
        whole = union(&whole, &own.map(|x| x.lane(lane)));
    }
    whole
}

fn union<S: Scalar>(a: &Bounds<S>, b: &Bounds<S>) -> Bounds<S> {
    let pick = |k: usize| if (k < 3) == (b[k] < a[k]) { b[k] } else { a[k] };
    std::array::from_fn(pick)
}

#[inline(always)]
fn union_of_lanes<R: Real>(a: &Bounds<R>, b: &Bounds<R>) -> Bounds<R> {
    array_of(
        #[inline(always)]
        |k| if k < 3 { a[k].min(b[k]) } else { a[k].max(b[k]) },
    )
}

/// Merges pairs into a list of pairs, both ascending. The first `count` entries of the list are used; it has capacity for all.
pub(crate) fn merge(more: &[(u32, u32)], list: &mut [(u32, u32)], count: usize) {
    let (mut i, mut j) = (count, more.len());
    while j > 0 {
        let from_list = i > 0 && list[i - 1].0 > more[j - 1].0;
        list[i + j - 1] = if from_list { list[i - 1] } else { more[j - 1] };
        if from_list {
            i -= 1;
        } else {
            j -= 1;
        }
    }
}

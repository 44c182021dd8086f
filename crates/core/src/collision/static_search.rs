//! Broad phase of the static pairs, which consist of a moving geom and a geom that is fixed to the world, both bounded and convex. The
//! search uses axis-aligned bounding boxes, and a tree over the static geoms.
//!
//! A node of the tree bounds its static geoms in all lanes, because their poses may differ between environments. A mover is a kinematic
//! tree of bodies or a mocap body. For each lane and mover, the search descends the tree of boxes with the box around all geoms of the
//! mover. At a leaf, it tests the boxes of these geoms, as many at a time as a register has lanes.

use stepper_geometry::BoundingBox;
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::{LaneModel, Params, StaticPairs};
use crate::math::lanes::{MAX_LANES, each_of, merge_lanes, with_lane};
use crate::math::spatial::*;

/// Enlargement of bounding boxes for rounding errors, as a fraction of coordinates and sizes. It is sufficient in single precision.
const ROUNDING: f64 = 4e-6;

/// Axis-aligned box in world axes: lowest coordinates, then highest coordinates, m.
type Bounds<T> = [T; 6];

/// Broad phase of the static pairs: bounding boxes, and the pairs whose boxes overlap.
#[derive(Clone, Debug)]
pub(crate) struct StaticSearch<R: Real> {
    /// Bounding boxes of the nodes of the tree over the static geoms.
    nodes: Vec<Bounds<R::Scalar>>,
    /// Bounding box of each mover (kinematic tree or mocap body), around all its geoms of static pairs.
    movers: Vec<Bounds<R>>,
    /// Bounding boxes of the moving geoms: for every lane and each of the six coordinates, a row with one number per geom.
    boxes: Vec<R::Scalar>,
    /// Found pairs of the present search, each with a lane, as [`with_lane`] combines them.
    found_pairs: Vec<u64>,
    /// Largest bounding radius of the static geoms, m.
    largest: R::Scalar,
    /// Smallest inscribed radius of the static geoms, m.
    thinnest: R::Scalar,
    /// Static pairs that can touch, ascending: index of the pair in the compiled model, and lanes (bits) in which it can touch.
    pub(crate) pairs: Vec<(u32, u32)>,
}

/// Number of nearby static geoms per moving geom for which the constructor reserves memory.
const EXPECTED: usize = 8;

impl<R: Real> StaticSearch<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        let StaticPairs { moving, movers, nodes, .. } = &compiled.static_pairs;
        let zero = R::Scalar::ZERO;
        let capacity = R::LANES * moving.len() * compiled.static_pairs.fixed.len().min(EXPECTED);
        Self {
            nodes: vec![[zero; 6]; nodes.len()],
            movers: vec![[R::zero(); 6]; movers.len()],
            boxes: vec![zero; R::LANES * 6 * Self::row(&compiled.static_pairs)],
            found_pairs: Vec::with_capacity(capacity),
            largest: zero,
            thinnest: zero,
            pairs: Vec::with_capacity(capacity),
        }
    }

    /// Length of a row of `boxes`: one number per moving geom, plus the number of lanes, because a SIMD load may read beyond the last geom.
    fn row(pairs: &StaticPairs) -> usize {
        pairs.moving.len() + R::LANES
    }

    /// Updates the bounding boxes of the tree, and the largest and smallest radii of the static geoms, from the parameters of the model.
    /// `pos` and `mat` are the poses of the geoms.
    pub(crate) fn update_tree(&mut self, compiled: &LaneModel<R>, pos: &[V3<R>], mat: &[M3<R>]) {
        let StaticPairs { fixed, nodes, .. } = &compiled.static_pairs;
        let params = &compiled.params;
        let lanes =
            |of: fn(&Params<R>, usize) -> R| fixed.iter().flat_map(move |f| (0..R::LANES).map(move |lane| of(params, f.geom).lane(lane)));
        self.largest = lanes(|params, g| params.geom(g).bounding_radius).fold(R::Scalar::ZERO, |x, y| if y > x { y } else { x });
        self.thinnest = lanes(|params, g| params.geom(g).inscribed_radius).fold(self.largest, |x, y| if y < x { y } else { x });
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
        displacement.gt(R::of(0.5) * (compiled.params.geom(geom).inscribed_radius + R::splat(self.thinnest)))
    }

    /// Finds the static pairs whose boxes overlap in the lanes `alive` (bits), and stores them in `pairs`.
    ///
    /// For each moving geom, `motion` returns the distance by which its box is enlarged, m. Its second result is whether the search must
    /// find all static geoms whose bounding ball overlaps that of the moving geom. It must if the moving geom may have passed through a
    /// static geom.
    pub(crate) fn find(&mut self, compiled: &LaneModel<R>, alive: u32, poses: (&[V3<R>], &[M3<R>]), motion: impl Fn(usize) -> (R, bool)) {
        self.found_pairs.clear();
        kernel!(R, || {
            self.update_boxes(compiled, poses, motion);
            for lane in each_of(alive) {
                for mover in 0..self.movers.len() {
                    self.visit_tree(&compiled.static_pairs, mover, lane);
                }
            }
        });
        self.found_pairs.sort_unstable();
        merge_lanes(&self.found_pairs, |index| index as u32, &mut self.pairs);
    }

    /// Updates the boxes of the moving geoms and of the movers (kinematic trees and mocap bodies).
    ///
    /// For each moving geom, `motion` returns the distance by which its box is enlarged, m, and whether to enlarge the box further. The
    /// larger box overlaps every static geom whose bounding ball overlaps the bounding ball of the moving geom.
    #[inline(always)]
    fn update_boxes(&mut self, compiled: &LaneModel<R>, (pos, mat): (&[V3<R>], &[M3<R>]), motion: impl Fn(usize) -> (R, bool)) {
        let StaticPairs { moving, movers, .. } = &compiled.static_pairs;
        let row = Self::row(&compiled.static_pairs);
        let mut lanes = [R::Scalar::ZERO; MAX_LANES];
        for (range, whole) in movers.iter().zip(&mut self.movers) {
            for m in range.clone() {
                let g = moving[m].geom;
                let (mut reach, covers_balls) = motion(g);
                if covers_balls {
                    reach += compiled.params.geom(g).bounding_radius + R::splat(self.largest);
                }
                let own = bounds(compiled, g, pos[g], &mat[g], reach);
                for k in 0..6 {
                    own[k].store(&mut lanes);
                    for (lane, &x) in lanes[..R::LANES].iter().enumerate() {
                        self.boxes[(lane * 6 + k) * row + m] = x;
                    }
                }
                *whole = array!(|k| match k {
                    _ if m == range.start => own[k],
                    0..3 => whole[k].min(own[k]),
                    _ => whole[k].max(own[k]),
                });
            }
        }
    }

    /// Searches the tree with the box of the mover `mover` in the lane `lane`, and adds the overlapping pairs to `found_pairs`.
    #[inline(always)]
    fn visit_tree(&mut self, pairs: &StaticPairs, mover: usize, lane: usize) {
        let sides = &self.movers[mover];
        let whole: Bounds<R::Scalar> = array!(|k| sides[k].lane(lane));
        let mut at = 0;
        while let Some(node) = pairs.nodes.get(at) {
            let own = &self.nodes[at];
            if (0..3).all(|k| whole[k] <= own[k + 3] && own[k] <= whole[k + 3]) {
                if let Some(leaf) = node.leaf() {
                    self.visit_leaf(pairs, mover, leaf, at, lane);
                }
                at += 1;
            } else {
                at = node.end as usize;
            }
        }
    }

    /// Adds the pairs of the static geom `leaf` with those geoms of the mover `mover` whose boxes overlap the box of the tree node
    /// `node`, in the lane `lane`.
    #[inline(always)]
    fn visit_leaf(&mut self, pairs: &StaticPairs, mover: usize, leaf: usize, node: usize, lane: usize) {
        let (row, geoms, own) = (Self::row(pairs), &pairs.movers[mover], &self.nodes[node]);
        let own: Bounds<R> = splat(*own);
        for first in geoms.clone().step_by(R::LANES) {
            let mut overlaps = R::Mask::splat(true);
            for k in 0..3 {
                let low = R::load(&self.boxes[(lane * 6 + k) * row + first..]);
                let high = R::load(&self.boxes[(lane * 6 + k + 3) * row + first..]);
                overlaps = overlaps.and(low.le(own[k + 3])).and(own[k].le(high));
            }
            for i in each_of(overlaps.bits()).take_while(|i| first + i < geoms.end) {
                if let Some(index) = pairs.pair_index(&pairs.fixed[leaf], first + i) {
                    self.found_pairs.push(with_lane(u64::from(index), lane as u64));
                }
            }
        }
    }

    /// Listed pairs and dynamic pairs that the search found. `listed` is the number of listed pairs of the model; dynamic pairs have larger
    /// indices.
    pub(crate) fn listed_and_dynamic(&self, listed: usize) -> [&[(u32, u32)]; 2] {
        let (listed, dynamic) = self.pairs.split_at(self.pairs.partition_point(|pair| (pair.0 as usize) < listed));
        [listed, dynamic]
    }
}

/// Axis-aligned bounding box of a convex geom, enlarged by `enlargement`, m, and by rounding errors.
#[inline(always)]
fn bounds<R: Real>(compiled: &LaneModel<R>, geom: usize, pos: V3<R>, mat: &M3<R>, enlargement: R) -> Bounds<R> {
    let solid = compiled.geoms[geom].solid.as_ref().expect("made for every geom of static pairs");
    let [centre, half] = BoundingBox::along_world(solid, compiled.params.geom(geom).size, mat).expect("convex");
    let centre = add(pos, centre);
    let sum = |v: V3<R>| v[0].abs() + v[1].abs() + v[2].abs();
    let reach = enlargement + R::of(ROUNDING) * (sum(centre) + sum(half) + enlargement);
    array!(|k| if k < 3 { centre[k] - (half[k] + reach) } else { centre[k - 3] + (half[k - 3] + reach) })
}

/// Smallest box that contains the boxes of all lanes. All coordinates must be finite.
fn over_lanes<R: Real>(own: Bounds<R>) -> Bounds<R::Scalar> {
    let mut whole = own.map(|x| x.lane(0));
    for lane in 1..R::LANES {
        whole = union(&whole, &own.map(|x| x.lane(lane)));
    }
    whole
}

/// Smallest box that contains two boxes.
fn union<S: Scalar>(a: &Bounds<S>, b: &Bounds<S>) -> Bounds<S> {
    let pick = |k: usize| if (k < 3) == (b[k] < a[k]) { b[k] } else { a[k] };
    std::array::from_fn(pick)
}

/// Merges the pairs `more` into `list`, whose first `count` entries are used. Both lists ascend, and `list` has space for all entries.
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

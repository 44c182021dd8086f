//! Static pairs: pairs of a moving geom and a geom that is fixed to the world, both bounded and convex. The broad phase finds them with a
//! tree of bounding boxes.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use stepper_geometry::Solid;
use stepper_real::Scalar;

use crate::compile::collision::{CompiledGeom, CompiledPair, DynamicPairs, PairTable};

/// Smallest number of static geoms for which the tree is searched. With a single one, such as the base of an arm, its pairs are not static
/// pairs but tested like those of moving geoms. Dynamic pairs are not in the list of pairs, so that they always need the tree.
///
/// Evidence: a Panda takes 0.96 of the time, a Shadow hand 0.98.
const MIN_STATIC_GEOMS: usize = 2;

/// Mark for a missing index: of a row of the table of pairs, of a pair in it, of a member of the dynamic pairs, or of a leaf's geom.
const NONE: u32 = u32::MAX;

/// Geom of static pairs that is fixed to the world.
#[derive(Clone, Copy, Debug)]
pub struct StaticGeom {
    /// Index of the static geom in the compiled model.
    pub geom: usize,
    /// Upper bound of the margins of the static pairs with this geom, m.
    pub margin: f64,
    /// Index of the row of this static geom in the table [`StaticPairs::indices`]; [`NONE`] if none of its pairs is in the compiled model's
    /// list of pairs.
    row: u32,
    /// Index of the static geom in [`DynamicPairs::members`]; [`NONE`] if the geom has no dynamic pairs.
    member: u32,
}

/// Moving geom of static pairs.
#[derive(Clone, Copy, Debug)]
pub struct MovingGeom {
    /// Index of the moving geom in the compiled model.
    pub geom: usize,
    /// Index of the moving geom in [`DynamicPairs::members`]; [`NONE`] if the geom has no dynamic pairs.
    member: u32,
}

/// Node of the tree of bounding boxes over the static geoms. The nodes are in depth-first order.
#[derive(Clone, Copy, Debug)]
pub struct TreeNode {
    /// Index of the first node after the subtree of this node.
    pub end: u32,
    /// Index in [`StaticPairs::fixed`] of the static geom of a leaf; [`NONE`] for an inner node.
    leaf: u32,
}

impl TreeNode {
    /// Index in [`StaticPairs::fixed`] of the static geom of a leaf; `None` for an inner node.
    #[inline(always)]
    pub fn leaf(&self) -> Option<usize> {
        (self.leaf != NONE).then_some(self.leaf as usize)
    }
}

/// Static pairs: pairs of a moving geom and a geom that is fixed to the world, both bounded and convex (no planes, height fields or
/// concave meshes), if there are enough static geoms. Each is also in the compiled model's list of pairs, or one of its dynamic pairs.
#[derive(Clone, Debug, Default)]
pub struct StaticPairs {
    /// Geoms of static pairs that are fixed to the world.
    pub fixed: Vec<StaticGeom>,
    /// Moving geoms of static pairs, sorted by their kinematic tree or mocap body.
    pub moving: Vec<MovingGeom>,
    /// Ranges of `moving`, one for the geoms of each kinematic tree and of each mocap body.
    pub movers: Vec<Range<usize>>,
    /// Nodes of the tree of bounding boxes over the static geoms.
    pub nodes: Vec<TreeNode>,
    /// For every pair in the compiled model's list of pairs, whether it is a static pair.
    pub listed: Vec<bool>,
    /// Table of those static pairs that are in the compiled model's list of pairs. Rows are static geoms and columns moving geoms. A value
    /// is the index of the pair, or [`NONE`]. Static geoms without such a pair have no row.
    indices: Vec<u32>,
    /// Indices of the dynamic pairs in the compiled model.
    dynamic: PairTable,
}

impl StaticPairs {
    /// Finds the static pairs among the listed and dynamic pairs of geoms. The function `place` returns the position of a static geom, m.
    /// The function `mover` maps the index of a moving frame to the number of its mover: its kinematic tree or mocap body.
    pub(super) fn new<S: Scalar>(
        geoms: &[CompiledGeom<S>],
        (pairs, dynamic_pairs): (&[CompiledPair<S>], Option<&DynamicPairs<S>>),
        place: impl Fn(usize) -> [f64; 3],
        mover: impl Fn(usize) -> usize,
    ) -> Self {
        let is_convex = |g: usize| matches!(geoms[g].solid, Some(Solid::Convex(_)));
        // Order of a pair: the geom that is fixed to the world first, if there is one.
        let sorted = |[a, b]: [usize; 2]| if geoms[a].frame == 0 { [a, b] } else { [b, a] };
        let is_one =
            |[fixed, moving]: [usize; 2]| geoms[fixed].frame == 0 && geoms[moving].frame != 0 && is_convex(fixed) && is_convex(moving);
        let listed: Vec<bool> = pairs.iter().map(|pair| is_one(sorted(pair.geoms))).collect();
        let ones = || (0..).zip(pairs).zip(&listed).filter(|(_, listed)| **listed).map(|(pair, _)| pair);
        let members = dynamic_pairs.map_or(&[][..], |dynamic| &dynamic.members);
        let places: BTreeMap<usize, u32> = members.iter().map(|m| m.geom).zip(0..).collect();
        let member = |g: usize| places.get(&g).copied().unwrap_or(NONE);
        let mut margins = BTreeMap::new();
        let mut moving = BTreeSet::new();
        let mut add = |fixed: usize, margin: f64| {
            let most = margins.entry(fixed).or_insert(0.0_f64);
            *most = most.max(margin);
        };
        for (_, pair) in ones() {
            let [a, b] = sorted(pair.geoms);
            add(a, pair.margin.to_f64());
            moving.insert(b);
        }
        let most = members.iter().filter(|m| geoms[m.geom].frame != 0).map(|m| m.margin).fold(0.0, f64::max);
        for m in members {
            if geoms[m.geom].frame == 0 {
                add(m.geom, m.margin + most);
            } else {
                moving.insert(m.geom);
            }
        }
        let is_few = dynamic_pairs.is_none() && margins.len() < MIN_STATIC_GEOMS;
        if is_few || margins.is_empty() || moving.is_empty() {
            return Self { listed: vec![false; pairs.len()], ..Self::default() };
        }

        let mover = |g: usize| (mover(geoms[g].frame), g);
        let mut moving: Vec<usize> = moving.into_iter().collect();
        moving.sort_by_key(|&g| mover(g));
        let mut end = 0;
        let movers = moving.chunk_by(|&a, &b| mover(a).0 == mover(b).0).map(|geoms| {
            end += geoms.len();
            end - geoms.len()..end
        });
        let movers = movers.collect();

        let mut fixed: Vec<StaticGeom> =
            margins.into_iter().map(|(geom, margin)| StaticGeom { geom, margin, row: NONE, member: member(geom) }).collect();
        let columns: BTreeMap<usize, usize> = moving.iter().copied().zip(0..).collect();
        let (mut indices, mut rows) = (vec![], 0);
        for (index, pair) in ones() {
            let [a, b] = sorted(pair.geoms);
            let at = fixed.binary_search_by_key(&a, |f| f.geom).expect("made of these pairs");
            if fixed[at].row == NONE {
                fixed[at].row = rows;
                rows += 1;
                indices.resize(rows as usize * moving.len(), NONE);
            }
            indices[fixed[at].row as usize * moving.len() + columns[&b]] = index;
        }
        let centres: Vec<[f64; 3]> = fixed.iter().map(|f| place(f.geom)).collect();
        let mut nodes = vec![];
        add_nodes(&mut (0..fixed.len()).collect::<Vec<_>>(), &centres, &mut nodes);
        let dynamic = dynamic_pairs.map_or_else(PairTable::default, |dynamic| dynamic.table.clone());
        let moving = moving.into_iter().map(|geom| MovingGeom { geom, member: member(geom) }).collect();
        Self { fixed, moving, movers, nodes, listed, indices, dynamic }
    }

    /// Whether the model has no static pairs.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.fixed.is_empty()
    }

    /// Index in the compiled model of the pair of `fixed` and the moving geom `self.moving[moving]`. `None` if they are neither a listed
    /// pair nor two members of the dynamic pairs. Two members may be unable to collide, see [`DynamicPairs::pair`].
    #[inline(always)]
    pub fn pair_index(&self, fixed: &StaticGeom, moving: usize) -> Option<u32> {
        if fixed.row != NONE {
            let index = self.indices[fixed.row as usize * self.moving.len() + moving];
            if index != NONE {
                return Some(index);
            }
        }
        let (i, j) = (fixed.member, self.moving[moving].member);
        (i != NONE && j != NONE).then(|| self.dynamic.index(i as usize, j as usize) as u32)
    }
}

/// Appends the nodes of the tree over the static geoms `fixed`. The function splits the geoms in halves by their centres, along the axis
/// with the largest spread.
fn add_nodes(fixed: &mut [usize], centres: &[[f64; 3]], nodes: &mut Vec<TreeNode>) {
    let at = nodes.len();
    nodes.push(TreeNode { end: 0, leaf: if fixed.len() == 1 { fixed[0] as u32 } else { NONE } });
    if fixed.len() > 1 {
        let spread = |k: usize| {
            let along = || fixed.iter().map(|&i| centres[i][k]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        };
        let axis = (0..3).max_by(|&j, &k| spread(j).total_cmp(&spread(k))).expect("three axes");
        fixed.sort_by(|&i, &j| centres[i][axis].total_cmp(&centres[j][axis]));
        let (low, high) = fixed.split_at_mut(fixed.len() / 2);
        add_nodes(low, centres, nodes);
        add_nodes(high, centres, nodes);
    }
    nodes[at].end = nodes.len() as u32;
}

//! Islands of a lane, and an order of an island's coordinates for which the skyline of the matrix is low.
//!
//! Two coordinates are neighbours if a row has entries at both, and connected coordinates are an island. The order is that of a
//! breadth-first search, reversed (as in Cuthill & McKee 1969, George 1971), which places neighbours close to each other. The search begins
//! at an end of a large island, and at the first coordinate of a small one. The graph is implicit: the search goes from a coordinate to its
//! rows, and from these rows to their coordinates.

use crate::newton::lane::Lane;

/// Placeholder for a coordinate or an island that has no number yet.
const NONE: u32 = u32::MAX;

/// Largest number of coordinates of an island whose search begins at the first coordinate of its first constraint. In a robot, that
/// coordinate is near the root of the tree, and the reversed order eliminates it last.
const SMALL: usize = 64;

/// Islands of one lane: sets of constraints that are coupled directly or by others. Coordinates without rows belong to no island.
#[derive(Clone, Debug, Default)]
pub(super) struct Islands {
    /// Parent of each coordinate in the union-find forest, whose trees are the islands.
    parent: Vec<u32>,
    /// Number of the island of each root of the union-find forest.
    name: Vec<u32>,
    /// Number of the island of each block (the rows of one constraint).
    pub(super) of_block: Vec<u32>,
    /// Number of islands of the lane.
    pub(super) count: usize,
}

impl Islands {
    /// Finds the islands of a lane. They are numbered in the order of their first constraints.
    pub(super) fn find(&mut self, lane: &Lane) {
        self.parent.clear();
        self.parent.extend(0..lane.w.len() as u32);
        for block in &lane.blocks {
            let columns = lane.columns(block);
            let mut root = self.root(columns[0]);
            for &c in &columns[1..] {
                let other = self.root(c);
                // The smaller index is the root, independent of the order of the rows.
                self.parent[root.max(other) as usize] = root.min(other);
                root = root.min(other);
            }
        }
        self.name.clear();
        self.name.resize(lane.w.len(), NONE);
        self.of_block.clear();
        self.count = 0;
        for block in &lane.blocks {
            let root = self.root(lane.columns(block)[0]) as usize;
            if self.name[root] == NONE {
                self.name[root] = self.count as u32;
                self.count += 1;
            }
            self.of_block.push(self.name[root]);
        }
    }

    /// Root of a coordinate in the union-find forest.
    fn root(&mut self, mut c: u32) -> u32 {
        while self.parent[c as usize] != c {
            let above = self.parent[self.parent[c as usize] as usize];
            self.parent[c as usize] = above;
            c = above;
        }
        c
    }
}

/// Order of the coordinates of an island, with the workspace that finds it.
#[derive(Clone, Debug, Default)]
pub(super) struct Ordering {
    /// Coordinates of the island in their new order.
    pub(super) coordinates: Vec<u32>,
    /// Index of each coordinate in the new order. It has no meaning for coordinates of other islands.
    pub(super) number: Vec<u32>,
    /// Indices of the blocks (rows of one constraint) with entries at each coordinate, one list after the other.
    blocks: Vec<u32>,
    /// Start of each coordinate's list in `blocks`.
    begin: Vec<u32>,
    /// Whether the breadth-first search has visited each block (the rows of one constraint).
    seen: Vec<bool>,
}

impl Ordering {
    /// Lists the constraints that have entries at each coordinate, for all islands at once.
    pub(super) fn list_blocks(&mut self, lane: &Lane) {
        let n = lane.w.len();
        self.begin.clear();
        self.begin.resize(n + 2, 0);
        for &c in &lane.columns {
            self.begin[c as usize + 2] += 1;
        }
        for c in 2..n + 2 {
            self.begin[c] += self.begin[c - 1];
        }
        self.blocks.clear();
        self.blocks.resize(lane.columns.len(), 0);
        for (i, block) in lane.blocks.iter().enumerate() {
            for &c in lane.columns(block) {
                let at = &mut self.begin[c as usize + 1];
                self.blocks[*at as usize] = i as u32;
                *at += 1;
            }
        }
        self.coordinates.clear();
        self.number.clear();
        self.number.resize(n, NONE);
    }

    /// Range of a coordinate's constraints in the list of the constraints of all coordinates.
    fn blocks_of(&self, c: u32) -> std::ops::Range<usize> {
        self.begin[c as usize] as usize..self.begin[c as usize + 1] as usize
    }

    /// Computes the order of the coordinates of the island that contains the constraint `any`.
    pub(super) fn order_island(&mut self, lane: &Lane, any: usize) {
        self.search(lane, lane.columns(&lane.blocks[any])[0]);
        // In a large island, the search is repeated twice from the coordinate that it reached last, so that the levels are narrow.
        for _ in 0..(if self.coordinates.len() > SMALL { 2 } else { 0 }) {
            let last = *self.coordinates.last().expect("a block has coordinates");
            self.search(lane, last);
        }
        self.coordinates.reverse();
        for (i, &c) in self.coordinates.iter().enumerate() {
            self.number[c as usize] = i as u32;
        }
    }

    /// Orders the coordinates of an island by breadth-first search from the coordinate `start`.
    fn search(&mut self, lane: &Lane, start: u32) {
        self.seen.clear();
        self.seen.resize(lane.blocks.len(), false);
        for &c in &self.coordinates {
            self.number[c as usize] = NONE;
        }
        self.coordinates.clear();
        self.coordinates.push(start);
        self.number[start as usize] = 0;
        let mut next = 0;
        while let Some(&c) = self.coordinates.get(next) {
            next += 1;
            for place in self.blocks_of(c) {
                let b = self.blocks[place] as usize;
                if std::mem::replace(&mut self.seen[b], true) {
                    continue;
                }
                for &c in lane.columns(&lane.blocks[b]) {
                    if self.number[c as usize] == NONE {
                        self.number[c as usize] = 0;
                        self.coordinates.push(c);
                    }
                }
            }
        }
    }
}

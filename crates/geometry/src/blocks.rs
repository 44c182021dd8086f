//! Vertices of a convex hull in blocks of eight, stored by coordinate for SIMD.

use crate::linear_algebra::*;
use crate::vectors::V;

/// Number of points in a [`Block`], and of edges in a [`Ring`]. Most vertices of a hull have fewer edges, and the compiler vectorises loops
/// of this length.
pub(super) const SIDE: usize = 8;

/// Up to eight edges of a hull that start at the same vertex.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ring {
    /// Vectors along the edges from a vertex, m, by coordinate: `edge[i][k]` is coordinate i of edge k. Unused entries are 0.
    edge: [[f64; SIDE]; 3],
    /// Squared lengths of the edges, m^2; 0 in unused entries.
    pub(super) square: [f64; SIDE],
    /// Index of the vertex at the other end of each edge.
    pub(super) to: [u32; SIDE],
}

impl Ring {
    /// Dot product of each edge of the ring and the vector `d`; 0 in unused entries.
    #[inline(always)]
    pub(super) fn along(&self, d: V) -> [f64; SIDE] {
        along(&self.edge, d)
    }
}

/// Dot products of `d` and eight vectors that are stored by coordinate.
#[inline(always)]
fn along([x, y, z]: &[[f64; SIDE]; 3], d: V) -> [f64; SIDE] {
    std::array::from_fn(|k| x[k] * d[0] + y[k] * d[1] + z[k] * d[2])
}

/// Eight vertices of a hull. The last one is repeated if there are fewer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// Positions of the eight vertices, m, by coordinate: `at[i][k]` is coordinate i of vertex k.
    at: [[f64; SIDE]; 3],
    /// Squared distances of the eight vertices from the origin, m^2.
    square: [f64; SIDE],
}

impl Block {
    /// Block of one to eight points, m.
    pub(super) fn new(points: &[V]) -> Self {
        let point = |i: usize| points[i.min(points.len() - 1)];
        Self { at: std::array::from_fn(|k| std::array::from_fn(|i| point(i)[k])), square: std::array::from_fn(|i| dot(point(i), point(i))) }
    }

    /// Maximum of w . w + k . w over the points w, m^2. `k` is in m.
    pub(super) fn highest(&self, k: V) -> f64 {
        let [x, y, z] = &self.at;
        let height: [f64; SIDE] = std::array::from_fn(|i| self.square[i] + (x[i] * k[0] + y[i] * k[1] + z[i] * k[2]));
        height.iter().fold(f64::NEG_INFINITY, |most, &x| if x > most { x } else { most })
    }

    /// The eight vertices of the block, m.
    pub(super) fn points(&self) -> impl Iterator<Item = V> + '_ {
        (0..SIDE).map(|i| std::array::from_fn(|k| self.at[k][i]))
    }
}

/// Maximum of eight numbers.
#[inline(always)]
pub(super) fn highest(x: [f64; SIDE]) -> f64 {
    let higher = |a: f64, b: f64| if a > b { a } else { b };
    let four: [f64; 4] = std::array::from_fn(|k| higher(x[k], x[k + 4]));
    higher(higher(four[0], four[2]), higher(four[1], four[3]))
}

/// Index of the vertex that is farthest along `d`, counted over all blocks. Of several equally far vertices it is the first.
pub(super) fn furthest(blocks: &[Block], d: V) -> usize {
    let mut best = (f64::NEG_INFINITY, 0);
    for (i, block) in blocks.iter().enumerate() {
        let highest = highest(along(&block.at, d));
        if highest > best.0 {
            best = (highest, i);
        }
    }
    let x = along(&blocks[best.1].at, d);
    SIDE * best.1 + (0..SIDE).rev().fold(0, |first, k| if x[k] == best.0 { k } else { first })
}

/// Edges of all vertices of a closed surface, as a list of rings, and the position of each vertex's first ring in this list.
///
/// The rings of vertex v are `rings[first[v]..first[v + 1]]`. `triangles` are counter-clockwise seen from outside.
pub(super) fn rings(points: &[V], triangles: &[[u32; 3]]) -> (Vec<Ring>, Vec<u32>) {
    let mut neighbours: Vec<Vec<u32>> = vec![vec![]; points.len()];
    for t in triangles {
        (0..3).for_each(|k| neighbours[t[k] as usize].push(t[(k + 1) % 3]));
    }
    let (mut rings, mut first) = (vec![], vec![0]);
    for (p, neighbours) in points.iter().zip(&neighbours) {
        for some in neighbours.chunks(SIDE) {
            let mut ring = Ring { edge: [[0.0; SIDE]; 3], square: [0.0; SIDE], to: [0; SIDE] };
            for (k, &v) in some.iter().enumerate() {
                let e = sub(points[v as usize], *p);
                (0..3).for_each(|i| ring.edge[i][k] = e[i]);
                (ring.square[k], ring.to[k]) = (dot(e, e), v);
            }
            rings.push(ring);
        }
        first.push(rings.len() as u32);
    }
    (rings, first)
}

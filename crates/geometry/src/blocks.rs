//! Vertices of a hull in blocks of eight, in arrays by coordinate, for SIMD.

use crate::linear_algebra::*;
use crate::vectors::V;

/// Number of points in a block or ring. It suffices for most rings, and the compiler vectorises loops of this length.
pub(super) const SIDE: usize = 8;

/// Up to eight neighbours of a vertex along edges.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ring {
    /// Vectors from the vertex to its neighbours, m, by coordinate; zeros in empty places.
    edge: [[f64; SIDE]; 3],
    /// Squared lengths of the edges, m^2.
    pub(super) square: [f64; SIDE],
    pub(super) to: [u32; SIDE],
}

impl Ring {
    /// Component of each edge along `d`.
    #[inline(always)]
    pub(super) fn along(&self, d: V) -> [f64; SIDE] {
        along(&self.edge, d)
    }
}

/// Components along `d` of vectors that are stored by coordinate.
#[inline(always)]
fn along([x, y, z]: &[[f64; SIDE]; 3], d: V) -> [f64; SIDE] {
    std::array::from_fn(|k| x[k] * d[0] + y[k] * d[1] + z[k] * d[2])
}

/// Eight points. The last one is repeated if there are fewer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// Positions by coordinate, m.
    at: [[f64; SIDE]; 3],
    /// Squared distances from the origin, m^2.
    square: [f64; SIDE],
}

impl Block {
    pub(super) fn new(points: &[V]) -> Self {
        let point = |i: usize| points[i.min(points.len() - 1)];
        Self { at: std::array::from_fn(|k| std::array::from_fn(|i| point(i)[k])), square: std::array::from_fn(|i| dot(point(i), point(i))) }
    }

    /// Maximum of w . w + k . w over the points w.
    pub(super) fn highest(&self, k: V) -> f64 {
        let [x, y, z] = &self.at;
        let height: [f64; SIDE] = std::array::from_fn(|i| self.square[i] + (x[i] * k[0] + y[i] * k[1] + z[i] * k[2]));
        height.iter().fold(f64::NEG_INFINITY, |most, &x| if x > most { x } else { most })
    }

    /// Points, m.
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

/// Index of the point that is farthest along `d`; the first one of several.
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

/// Rings of all points in one list, and the index of each point's first ring.
pub(super) fn rings(points: &[V], triangles: &[[u32; 3]]) -> (Vec<Ring>, Vec<u32>) {
    let mut beside: Vec<Vec<u32>> = vec![vec![]; points.len()];
    for t in triangles {
        (0..3).for_each(|k| beside[t[k] as usize].push(t[(k + 1) % 3]));
    }
    let (mut rings, mut first) = (vec![], vec![0]);
    for (p, beside) in points.iter().zip(&beside) {
        for some in beside.chunks(SIDE) {
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

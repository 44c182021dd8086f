//! A hull's points by eights and by coordinate.

use crate::linear_algebra::*;
use crate::vectors::V;

/// Points of a block or ring: enough for most rings, and a number that the compiler makes vectors of.
pub(super) const SIDE: usize = 8;

/// Some of the points across an edge from a point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ring {
    /// From the point to each, m, by coordinate; zeros where there are fewer.
    edge: [[f64; SIDE]; 3],
    /// Squares of their lengths, m^2.
    pub(super) square: [f64; SIDE],
    pub(super) to: [u32; SIDE],
}

impl Ring {
    /// How far each is from the point along `d`.
    #[inline(always)]
    pub(super) fn along(&self, d: V) -> [f64; SIDE] {
        along(&self.edge, d)
    }
}

/// Components of vectors, by coordinate, along `d`.
#[inline(always)]
fn along([x, y, z]: &[[f64; SIDE]; 3], d: V) -> [f64; SIDE] {
    std::array::from_fn(|k| x[k] * d[0] + y[k] * d[1] + z[k] * d[2])
}

/// Some of the points, the last repeated where there are fewer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// By coordinate, m.
    at: [[f64; SIDE]; 3],
    /// Squares of their distances from the origin, m^2.
    square: [f64; SIDE],
}

impl Block {
    pub(super) fn new(points: &[V]) -> Self {
        let point = |i: usize| points[i.min(points.len() - 1)];
        Self { at: std::array::from_fn(|k| std::array::from_fn(|i| point(i)[k])), square: std::array::from_fn(|i| dot(point(i), point(i))) }
    }

    /// The greatest w . w + k . w of its points w.
    pub(super) fn highest(&self, k: V) -> f64 {
        let [x, y, z] = &self.at;
        let height: [f64; SIDE] = std::array::from_fn(|i| self.square[i] + (x[i] * k[0] + y[i] * k[1] + z[i] * k[2]));
        height.iter().fold(f64::NEG_INFINITY, |most, &x| if x > most { x } else { most })
    }

    /// Its points, m.
    pub(super) fn points(&self) -> impl Iterator<Item = V> + '_ {
        (0..SIDE).map(|i| std::array::from_fn(|k| self.at[k][i]))
    }
}

/// The greatest of some numbers.
#[inline(always)]
pub(super) fn highest(x: [f64; SIDE]) -> f64 {
    let higher = |a: f64, b: f64| if a > b { a } else { b };
    let four: [f64; 4] = std::array::from_fn(|k| higher(x[k], x[k + 4]));
    higher(higher(four[0], four[2]), higher(four[1], four[3]))
}

/// The first of the points of blocks furthest along `d`.
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

/// The rings of all points, one after the other, and where each point's begin.
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

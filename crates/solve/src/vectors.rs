//! Arithmetic of vectors in scalar f64.
//!
//! Vectors of an island come in tiles of four numbers, padded to whole tiles. The compiler therefore vectorises their loops on every CPU,
//! with the same bits.

/// Number of coordinates in a tile, the unit of vectorised loops.
pub(crate) const TILE: usize = 4;

/// Four consecutive numbers (a tile) of `x`, from index `at` on.
#[inline(always)]
pub(crate) fn tile(x: &[f64], at: usize) -> [f64; TILE] {
    let x = &x[at..at + TILE];
    [x[0], x[1], x[2], x[3]]
}

/// Euclidean length of a vector.
#[inline(always)]
pub(crate) fn norm(x: &[f64]) -> f64 {
    inner(x, x).sqrt()
}

/// Dot product of two vectors, summed in their order.
#[inline(always)]
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b)
}

/// Dot product of two vectors whose length is a multiple of four. Four partial sums are added at the end.
#[inline(always)]
pub(crate) fn inner_of_tiles(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [0.0; TILE];
    for (a, b) in a.as_chunks::<TILE>().0.iter().zip(b.as_chunks::<TILE>().0) {
        for k in 0..TILE {
            sum[k] += a[k] * b[k];
        }
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3])
}

/// Adds s y to `x`. The length of both is a multiple of four.
#[inline(always)]
pub(crate) fn add_scaled(x: &mut [f64], s: f64, y: &[f64]) {
    for (x, y) in x.chunks_exact_mut(TILE).zip(y.chunks_exact(TILE)) {
        for k in 0..TILE {
            x[k] += s * y[k];
        }
    }
}

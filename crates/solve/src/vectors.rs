//! Arithmetic of vectors in scalar f64. Those of an island come in tiles of four numbers, without a rest, so that the compiler makes
//! vectors of their loops on every CPU, with the same bits.

/// Number of coordinates in a tile.
pub(crate) const TILE: usize = 4;

/// Length of a vector.
#[inline(always)]
pub(crate) fn norm(x: &[f64]) -> f64 {
    inner(x, x).sqrt()
}

/// Sum of products, one after the other.
#[inline(always)]
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b)
}

/// Sum of products over whole tiles, with a partial sum for each place in a tile: a fixed order.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [0.0; TILE];
    for (a, b) in a.chunks_exact(TILE).zip(b.chunks_exact(TILE)) {
        for k in 0..TILE {
            sum[k] += a[k] * b[k];
        }
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3])
}

/// x += s y over whole tiles.
#[inline(always)]
pub(crate) fn add_scaled(x: &mut [f64], s: f64, y: &[f64]) {
    for (x, y) in x.chunks_exact_mut(TILE).zip(y.chunks_exact(TILE)) {
        for k in 0..TILE {
            x[k] += s * y[k];
        }
    }
}

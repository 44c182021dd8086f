//! Arithmetic of vectors in scalar f64.
//!
//! Vectors of an island come in tiles of four numbers, padded to whole tiles. The compiler therefore vectorises their loops on every CPU,
//! with the same bits.

/// Number of coordinates in a tile, the unit of vectorised loops.
pub(crate) const TILE: usize = 4;

/// Numbers at four consecutive coordinates.
pub(crate) type Tile = [f64; TILE];

/// Evaluates an expression for a constraint with `$n` rows, in which the number of rows is the constant `$N`, so that loops over the rows
/// are unrolled.
macro_rules! with_row_count {
    ($n:expr, $N:ident => $body:expr) => {
        $crate::vectors::with_row_count!(@ $n, $N => $body; 1 2 3 4 5 6)
    };
    (@ $n:expr, $N:ident => $body:expr; $($rows:literal)*) => {
        match $n {
            $($rows => {
                const $N: usize = $rows;
                $body
            })*
            rows => unreachable!("a constraint has {rows} rows, not 1 to 6"),
        }
    };
}
pub(crate) use with_row_count;

/// The numbers `x` times `s`.
#[inline(always)]
pub(crate) fn scaled<const N: usize>(s: f64, mut x: [f64; N]) -> [f64; N] {
    for x in &mut x {
        *x *= s;
    }
    x
}

/// Adds s y to the numbers `x`.
#[inline(always)]
pub(crate) fn add_multiple<const N: usize>(x: &mut [f64; N], s: f64, y: &[f64; N]) {
    for k in 0..N {
        x[k] += s * y[k];
    }
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
pub(crate) fn add_multiple_of_tiles(x: &mut [f64], s: f64, y: &[f64]) {
    for (x, y) in x.as_chunks_mut::<TILE>().0.iter_mut().zip(y.as_chunks().0) {
        add_multiple(x, s, y);
    }
}

//! Sets of admissible impulses for Newton's method, lane by lane in scalar f64, for any number of rows.
//!
//! A set has its projection, the derivative of the projection, De Saxce's term (of a contact: mu |v_t|, which the solver adds to the normal
//! velocity), and the residual of the natural map. A new type of set needs a variant in this file only.

use crate::vectors::{TILE, add_scaled, norm, tile};

/// Set of the admissible impulses of one constraint.
#[derive(Clone, Copy, Debug)]
pub enum AdmissibleSet {
    /// Interval of the impulse of one row, `lo <= lambda <= hi`. An equality has infinite bounds.
    Interval {
        /// Least impulse of the row, N s or N m s.
        lo: f64,
        /// Largest impulse of the row, N s or N m s.
        hi: f64,
    },
    /// Friction cone of the impulse (n, t...) of a contact, `|lambda_t| <= mu lambda_n`.
    Cone {
        /// Friction coefficient of the contact.
        mu: f64,
    },
}

impl AdmissibleSet {
    /// De Saxce's term mu |v_t| of a contact with the velocities `v`, m/s; 0 for an interval. The solver adds it to the normal velocity.
    #[inline(always)]
    pub(crate) fn slip(&self, v: &[f64]) -> f64 {
        match *self {
            Self::Interval { .. } => 0.0,
            Self::Cone { mu } => mu * norm(&v[1..]),
        }
    }

    /// Projects the impulse `x` on the set, and writes the projection to `z`, N s or N m s.
    #[inline(always)]
    pub(crate) fn project(&self, x: &[f64], z: &mut [f64]) {
        match *self {
            Self::Interval { lo, hi } => z[0] = x[0].max(lo).min(hi),
            Self::Cone { mu } => {
                let tangent = norm(&x[1..]);
                let (height, scale) = ConeRegion::of(x[0], tangent, mu).image(x[0], tangent, mu);
                z[0] = height;
                for (z, x) in z[1..].iter_mut().zip(&x[1..]) {
                    *z = x * scale;
                }
            }
        }
    }

    /// Residual |lambda - P_K(lambda - rho u)| / rho of one constraint, m/s. P_K is the projection on this set, and the velocity u includes
    /// De Saxce's term mu |v_t|.
    ///
    /// `v` are the velocities without this term, m/s, and `rho` is the step of the natural map, kg. The function multiplies the first
    /// component of the residual by `rigid_fraction`, which is below 1 for a normal row with a spring. A NaN propagates.
    pub(crate) fn natural_residual(&self, lambda: &[f64], v: &[f64], rho: f64, rigid_fraction: f64) -> f64 {
        match *self {
            Self::Interval { lo, hi } => {
                let moved = lambda[0] - rho * v[0];
                // This form propagates a NaN.
                let mapped = if moved < lo { lo } else { moved };
                (lambda[0] - if mapped > hi { hi } else { mapped }).abs() * rigid_fraction / rho
            }
            Self::Cone { mu } => {
                let n = lambda[0] - rho * (v[0] + mu * norm(&v[1..]));
                let moved = || lambda[1..].iter().zip(&v[1..]).map(|(l, v)| l - rho * v);
                let tangent = moved().fold(0.0, |sum, x| sum + x * x).sqrt();
                let (height, scale) = ConeRegion::of(n, tangent, mu).image(n, tangent, mu);
                let apart = lambda[1..].iter().zip(moved()).fold(0.0, |sum, (l, x)| sum + (l - x * scale).powi(2));
                (((lambda[0] - height) * rigid_fraction).powi(2) + apart).sqrt() / rho
            }
        }
    }

    /// Computes rho DP_K(x) Y into `out`, row by row. DP_K is the derivative of the projection on this set at the argument `x`, and Y a
    /// matrix such as the constraint's scaled Jacobian. If the product is zero, returns false and leaves `out` unchanged.
    ///
    /// `y` are the rows of Y with `n` entries each, in whole tiles (four numbers). If velocities `v` are given, the product includes De
    /// Saxce's term mu |v_t|. The function then multiplies DP_K by `I + e_n (0, mu v_t / |v_t|)`, the derivative of the velocity with this
    /// term.
    #[inline(always)]
    pub(crate) fn differentiate(&self, rho: f64, x: &[f64], v: Option<&[f64]>, y: &[f64], n: usize, out: &mut Product) -> bool {
        let mu = match *self {
            Self::Interval { lo, hi } => {
                let free = x[0] > lo && x[0] < hi;
                if free {
                    out.rows.clear();
                    out.rows.extend(y.iter().map(|y| rho * y));
                }
                return free;
            }
            Self::Cone { mu } => mu,
        };
        let tangent = norm(&x[1..]);
        let case = ConeRegion::of(x[0], tangent, mu);
        if let ConeRegion::Zero = case {
            return false;
        }
        let speed = v.map_or(0.0, |v| norm(&v[1..]));
        let slip = if speed > 0.0 { mu / speed } else { 0.0 };
        out.slip.clear();
        out.slip.extend(v.iter().flat_map(|v| &v[1..]).map(|v| v * slip));
        out.slip.resize(x.len() - 1, 0.0);
        out.rows.resize(y.len(), 0.0);
        // With a constant number of rows the compiler unrolls the loops over them.
        match x.len() {
            3 => differentiate_cone([rho, mu], x, tangent, case, y, [3, n], out),
            4 => differentiate_cone([rho, mu], x, tangent, case, y, [4, n], out),
            6 => differentiate_cone([rho, mu], x, tangent, case, y, [6, n], out),
            rows => differentiate_cone([rho, mu], x, tangent, case, y, [rows, n], out),
        }
        true
    }
}

/// Computes rho DP (I + e_n s'^T) Y of a friction cone into `out`, tile by tile. The argument `x` of the projection has the tangential
/// length `tangent` and is in the region `case`. `out.slip` has the derivative s' of De Saxce's term mu |v_t|.
///
/// The derivative of the projection is `DP = b b^T / (1 + mu^2) + (mu height / |x_t|) (I - t t^T)`, with t = x_t / |x_t| and b = (1, mu t).
/// In the interior of the cone it is the identity.
#[inline(always)]
fn differentiate_cone([rho, mu]: [f64; 2], x: &[f64], tangent: f64, case: ConeRegion, y: &[f64], [rows, n]: [usize; 2], out: &mut Product) {
    let Product { rows: out, slip } = out;
    let inverse = if tangent > 0.0 { 1.0 / tangent } else { 0.0 };
    let part = 1.0 / (1.0 + mu * mu);
    for at in (0..n).step_by(TILE) {
        let mut normal = tile(y, at);
        for k in 1..rows {
            add_scaled(&mut normal, slip[k - 1], &tile(y, k * n + at));
        }
        let ConeRegion::Surface { height } = case else {
            put_tile(out, at, scaled(rho, normal));
            for k in 1..rows {
                put_tile(out, k * n + at, scaled(rho, tile(y, k * n + at)));
            }
            continue;
        };
        let mut radial = [0.0; TILE];
        for k in 1..rows {
            add_scaled(&mut radial, x[k] * inverse, &tile(y, k * n + at));
        }
        let shrink = mu * height * inverse;
        for (normal, radial) in normal.iter_mut().zip(&mut radial) {
            *normal = rho * ((*normal + mu * *radial) * part);
            *radial = mu * *normal - rho * (shrink * *radial);
        }
        put_tile(out, at, normal);
        for k in 1..rows {
            let mut row = scaled(rho * shrink, tile(y, k * n + at));
            add_scaled(&mut row, x[k] * inverse, &radial);
            put_tile(out, k * n + at, row);
        }
    }
}

/// Product of the number `s` and the four numbers `y`.
#[inline(always)]
fn scaled(s: f64, mut y: [f64; TILE]) -> [f64; TILE] {
    for y in &mut y {
        *y *= s;
    }
    y
}

/// Writes the four numbers of a tile to `x` from index `at` on.
#[inline(always)]
fn put_tile(x: &mut [f64], at: usize, numbers: [f64; TILE]) {
    x[at..at + TILE].copy_from_slice(&numbers);
}

/// Region of a projection's argument in which the projection is differentiable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Piece {
    /// Polar cone of a friction cone: the projected impulse is zero, and the contact is open.
    Open,
    /// Interior of the set of admissible impulses: the row meets its target velocity, or the contact sticks.
    Held,
    /// Outside a friction cone and its polar cone: the impulse is on the cone's surface, and the contact slips.
    Sliding,
    /// Below the interval of a row's impulse: the projection is at the lower bound.
    Lower,
    /// Above the interval of a row's impulse: the projection is at the upper bound.
    Upper,
}

impl AdmissibleSet {
    /// Region of the projection that contains the argument `x`.
    pub(crate) fn piece(&self, x: &[f64]) -> Piece {
        match *self {
            Self::Interval { lo, hi } => match x[0] {
                x if x <= lo => Piece::Lower,
                x if x >= hi => Piece::Upper,
                _ => Piece::Held,
            },
            Self::Cone { mu } => match ConeRegion::of(x[0], norm(&x[1..]), mu) {
                ConeRegion::Zero => Piece::Open,
                ConeRegion::Inside => Piece::Held,
                ConeRegion::Surface { .. } => Piece::Sliding,
            },
        }
    }

    /// Distance of the argument `x` of the projection from the boundary of the region `piece`, N s; negative outside the region.
    ///
    /// The second result is true if the nearest boundary is that between sticking and slipping.
    pub(crate) fn margin(&self, piece: Piece, x: &[f64]) -> (f64, bool) {
        match *self {
            Self::Interval { lo, hi } => match piece {
                Piece::Lower => (lo - x[0], false),
                Piece::Upper => (x[0] - hi, false),
                _ => ((x[0] - lo).min(hi - x[0]), false),
            },
            // Without friction the tangential components have no effect.
            Self::Cone { mu: 0.0 } => (if piece == Piece::Open { -x[0] } else { x[0] }, false),
            Self::Cone { mu } => {
                let tangent = norm(&x[1..]);
                match piece {
                    Piece::Open => (-x[0] - mu * tangent, false),
                    Piece::Sliding if tangent - mu * x[0] < x[0] + mu * tangent => (tangent - mu * x[0], true),
                    Piece::Sliding => (x[0] + mu * tangent, false),
                    _ => (mu * x[0] - tangent, true),
                }
            }
        }
    }
}

/// Product rho DP Y of one constraint, with a workspace: step rho times the derivative DP of the constraint's projection times a matrix Y.
#[derive(Clone, Debug, Default)]
pub(crate) struct Product {
    /// Entries of the product, row by row.
    pub(crate) rows: Vec<f64>,
    /// Derivative of De Saxce's term mu |v_t| with respect to the tangential velocities v_t.
    slip: Vec<f64>,
}

/// Region of a point (n, |t|) relative to a friction cone, for its projection.
#[derive(Clone, Copy, Debug)]
enum ConeRegion {
    /// Polar cone of the friction cone: the projection of the point is 0.
    Zero,
    /// Interior of the friction cone: the projection of the point is the point itself.
    Inside,
    /// Region between the friction cone and its polar cone. The projection has the normal component `height`, and mu times it along the
    /// tangent.
    Surface { height: f64 },
}

impl ConeRegion {
    /// Region of the point with the normal component `n` and the tangential length `tangent`.
    #[inline(always)]
    fn of(n: f64, tangent: f64, mu: f64) -> Self {
        if n >= 0.0 && tangent <= mu * n {
            Self::Inside
        } else if mu * tangent <= -n {
            Self::Zero
        } else {
            Self::Surface { height: (mu * tangent + n) / (1.0 + mu * mu) }
        }
    }

    /// Projection of a point with the normal component `n` and tangential length `tangent`, which is in this region of a friction cone.
    /// Returns the normal component of the projection, and the factor of the tangential components: projected divided by original.
    #[inline(always)]
    fn image(self, n: f64, tangent: f64, mu: f64) -> (f64, f64) {
        match self {
            ConeRegion::Zero => (0.0, 0.0),
            ConeRegion::Inside => (n, 1.0),
            ConeRegion::Surface { height } => (height, if tangent > 0.0 { mu * height / tangent } else { 0.0 }),
        }
    }
}

//! Sets of admissible impulses for Newton's method, lane by lane in scalar f64, for any number of rows.
//!
//! A set has the residual of its natural map, and Alart and Curnier's map (1991) with its derivative. The impulses lambda are a solution if
//! the map of `lambda - rho v` is lambda, where v are the velocities of the rows. Only `newton/response.rs` lists the types of sets too.

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
    /// Impulses by Alart and Curnier's map for the argument `x`, N s or N m s; written to `z`.
    ///
    /// For a cone, the normal impulse is `max(0, x_n)`. The tangential one is `x_t`, shortened to mu times the normal impulse if it is
    /// longer.
    #[inline(always)]
    pub(crate) fn map(&self, x: &[f64], z: &mut [f64]) {
        match *self {
            Self::Interval { lo, hi } => z[0] = x[0].max(lo).min(hi),
            Self::Cone { mu } => {
                let (normal, tangent) = (x[0].max(0.0), norm(&x[1..]));
                let scale = if tangent > mu * normal { mu * normal / tangent } else { 1.0 };
                z[0] = normal;
                for (z, x) in z[1..].iter_mut().zip(&x[1..]) {
                    *z = x * scale;
                }
            }
        }
    }

    /// Residual |lambda - P_K(lambda - rho u)| / rho of one constraint, m/s. P_K is the projection on this set, and the velocity u includes
    /// De Saxce's term mu |v_t|.
    ///
    /// `v` are the velocities without this term and without those due to the compliance, m/s, and `rho` is the step of the natural map, kg.
    /// The function multiplies the first component of the residual by `rigid_fraction`, which is below 1 for a normal row with a spring. A
    /// NaN propagates.
    #[inline(always)]
    pub(crate) fn natural_residual(&self, lambda: &[f64], v: &[f64], compliance: f64, rho: f64, rigid_fraction: f64) -> f64 {
        let u = |k: usize| v[k] + compliance * lambda[k];
        match *self {
            Self::Interval { lo, hi } => {
                let moved = lambda[0] - rho * u(0);
                // This form propagates a NaN.
                let mapped = if moved < lo { lo } else { moved };
                (lambda[0] - if mapped > hi { hi } else { mapped }).abs() * rigid_fraction / rho
            }
            Self::Cone { mu } => {
                let tangents = 1..lambda.len();
                let slip = tangents.clone().fold(0.0, |sum, k| sum + u(k) * u(k)).sqrt();
                let n = lambda[0] - rho * (u(0) + mu * slip);
                let moved = |k: usize| lambda[k] - rho * u(k);
                let tangent = tangents.clone().fold(0.0, |sum, k| sum + moved(k) * moved(k)).sqrt();
                let (height, scale) = project_cone(n, tangent, mu);
                let apart = tangents.fold(0.0, |sum, k| sum + (lambda[k] - moved(k) * scale).powi(2));
                (((lambda[0] - height) * rigid_fraction).powi(2) + apart).sqrt() / rho
            }
        }
    }

    /// Computes rho DP Y into `out`. DP is the derivative of [`AdmissibleSet::map`] at the argument `x`, and Y a matrix such as the
    /// constraint's scaled Jacobian. `mode` is the mode of the constraint at `x`; it must be [`Mode::Held`] or [`Mode::Slipping`].
    ///
    /// `y` are the rows of Y with `n` entries each, in whole tiles (four numbers).
    #[inline(always)]
    pub(crate) fn differentiate(&self, mode: Mode, rho: f64, x: &[f64], y: &[f64], n: usize, out: &mut Product) {
        out.rows.clear();
        out.friction.clear();
        out.coupling.clear();
        match *self {
            Self::Cone { mu } if mode == Mode::Slipping => {
                out.rows.resize(y.len(), 0.0);
                out.friction.resize(n, 0.0);
                // With a constant number of rows the compiler unrolls the loops over them.
                match x.len() {
                    3 => differentiate_slip([rho, mu], x, y, [3, n], out),
                    4 => differentiate_slip([rho, mu], x, y, [4, n], out),
                    6 => differentiate_slip([rho, mu], x, y, [6, n], out),
                    rows => differentiate_slip([rho, mu], x, y, [rows, n], out),
                }
            }
            _ => out.rows.extend(y.iter().map(|y| rho * y)),
        }
    }
}

/// Computes rho DP Y of a slipping contact into `out`, tile by tile.
///
/// With the direction `t = x_t / |x_t|`, DP is 1 for the normal row, and `(mu x_n / |x_t|) (I - t t^T)` for the tangential rows. The bound
/// mu x_n of friction adds mu t times the normal row to the tangential rows: this part is not symmetric.
#[inline(always)]
fn differentiate_slip([rho, mu]: [f64; 2], x: &[f64], y: &[f64], [rows, n]: [usize; 2], out: &mut Product) {
    let tangent = norm(&x[1..]);
    let inverse = if tangent > 0.0 { 1.0 / tangent } else { 0.0 };
    let shrink = mu * x[0] * inverse;
    out.coupling.extend(x[1..].iter().map(|x| rho * mu * (x * inverse)));
    for at in (0..n).step_by(TILE) {
        let mut radial = [0.0; TILE];
        for k in 1..rows {
            add_scaled(&mut radial, x[k] * inverse, &tile(y, k * n + at));
        }
        put_tile(&mut out.rows, at, scaled(rho, tile(y, at)));
        put_tile(&mut out.friction, at, scaled(rho * mu, radial));
        for k in 1..rows {
            let mut row = scaled(rho * shrink, tile(y, k * n + at));
            add_scaled(&mut row, -rho * shrink * (x[k] * inverse), &radial);
            put_tile(&mut out.rows, k * n + at, row);
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

/// Mode of a constraint: a region of the map's argument in which the map is differentiable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// The contact is open and has no impulse.
    Open,
    /// The row meets its target velocity, or the contact sticks.
    Held,
    /// The contact slips: its impulse is on the surface of the friction cone.
    Slipping,
    /// The row's impulse is at its lower bound.
    Lower,
    /// The row's impulse is at its upper bound.
    Upper,
}

impl Mode {
    /// Whether the impulse changes with the loads: it is neither at a bound nor zero.
    #[inline(always)]
    pub(crate) fn is_active(self) -> bool {
        matches!(self, Self::Held | Self::Slipping)
    }
}

impl AdmissibleSet {
    /// Mode of a constraint whose map has the argument `x`.
    #[inline(always)]
    pub(crate) fn mode(&self, x: &[f64]) -> Mode {
        match *self {
            Self::Interval { lo, hi } => match x[0] {
                x if x <= lo => Mode::Lower,
                x if x >= hi => Mode::Upper,
                _ => Mode::Held,
            },
            Self::Cone { .. } if x[0] <= 0.0 => Mode::Open,
            Self::Cone { mu } if norm(&x[1..]) > mu * x[0] => Mode::Slipping,
            Self::Cone { .. } => Mode::Held,
        }
    }

    /// Measure of how far the map's argument `x` is from the boundary of the region of `mode`, N s; negative outside the region. It is
    /// linear in the distance.
    ///
    /// The second result is true if the nearest boundary is that between sticking and slipping.
    pub(crate) fn margin(&self, mode: Mode, x: &[f64]) -> (f64, bool) {
        match *self {
            Self::Interval { lo, hi } => match mode {
                Mode::Lower => (lo - x[0], false),
                Mode::Upper => (x[0] - hi, false),
                _ => ((x[0] - lo).min(hi - x[0]), false),
            },
            Self::Cone { mu } => {
                let excess = norm(&x[1..]) - mu * x[0];
                match mode {
                    Mode::Open => (-x[0], false),
                    // Without friction the tangential components have no effect.
                    _ if mu == 0.0 => (x[0], false),
                    Mode::Slipping if excess < x[0] => (excess, true),
                    Mode::Slipping => (x[0], false),
                    _ => (-excess, true),
                }
            }
        }
    }
}

/// Product rho DP Y of one constraint: step rho times the derivative DP of the constraint's map times a matrix Y.
#[derive(Clone, Debug, Default)]
pub(crate) struct Product {
    /// Product with the symmetric part of DP, row by row.
    pub(crate) rows: Vec<f64>,
    /// Coefficients rho mu t of the rest of the product: the tangential rows are these multiples of the normal row of Y. The list is empty
    /// if the contact does not slip.
    coupling: Vec<f64>,
    /// Sum of the tangential rows of Y with the coefficients `coupling`; empty if the contact does not slip. The rest of `Y^T rho DP Y` is
    /// the outer product of this row and the normal row of Y.
    pub(crate) friction: Vec<f64>,
}

impl Product {
    /// Adds the unsymmetric part to `rows`. `normal` is the normal row of Y.
    #[inline(always)]
    pub(crate) fn complete(&mut self, normal: &[f64]) {
        for (row, c) in self.rows.chunks_exact_mut(normal.len()).skip(1).zip(&self.coupling) {
            add_scaled(row, *c, normal);
        }
    }
}

/// Projection of a point on a friction cone. The point has the normal component `n` and the tangential length `tangent`. Returns the normal
/// component of the projection, and the factor of the tangential components.
#[inline(always)]
fn project_cone(n: f64, tangent: f64, mu: f64) -> (f64, f64) {
    if n >= 0.0 && tangent <= mu * n {
        (n, 1.0)
    } else if mu * tangent <= -n {
        (0.0, 0.0)
    } else {
        let height = (mu * tangent + n) / (1.0 + mu * mu);
        (height, if tangent > 0.0 { mu * height / tangent } else { 0.0 })
    }
}

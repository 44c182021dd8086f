//! Sets of admissible impulses for Newton's method, lane by lane in scalar f64, for any number of rows.
//!
//! A set has the residual of its natural map, and Alart and Curnier's map (1991) with its derivative. The impulses lambda are a solution if
//! the map of `lambda - rho v` is lambda, where v are the velocities of the rows. Only `newton/response.rs` lists the types of sets too.

use crate::vectors::{TILE, Tile, add_multiple, norm, scaled};

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
    /// Impulses by Alart and Curnier's map for the argument `x`, N s or N m s, and the mode of the constraint there.
    ///
    /// For a cone, the normal impulse is `max(0, x_n)`. The tangential one is `x_t`, shortened to mu times the normal impulse if it is
    /// longer. An interval has one row. For a NaN, the result is `x` with the mode [`Mode::Held`].
    #[inline(always)]
    pub(crate) fn map<const N: usize>(&self, x: [f64; N]) -> ([f64; N], Mode) {
        match *self {
            Self::Interval { lo, .. } if x[0] <= lo => ([lo; N], Mode::Lower),
            Self::Interval { hi, .. } if x[0] >= hi => ([hi; N], Mode::Upper),
            Self::Interval { .. } => (x, Mode::Held),
            Self::Cone { .. } if x[0] <= 0.0 => ([0.0; N], Mode::Open),
            Self::Cone { mu } => {
                let (bound, tangent) = (mu * x[0], norm(&x[1..]));
                if tangent > bound {
                    let mut z = scaled(bound / tangent, x);
                    z[0] = x[0];
                    (z, Mode::Slipping)
                } else {
                    (x, Mode::Held)
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

    /// Derivative of the map at the argument `x` of a contact that slips. `None` if the mode `mode` is not [`Mode::Slipping`].
    #[inline(always)]
    pub(crate) fn slip<const N: usize>(&self, mode: Mode, x: [f64; N]) -> Option<SlipDerivative<N>> {
        match *self {
            Self::Cone { mu } if mode == Mode::Slipping => {
                let inverse = 1.0 / norm(&x[1..]);
                Some(SlipDerivative { direction: scaled(inverse, x), mu, shrink: mu * x[0] * inverse })
            }
            _ => None,
        }
    }

    /// Derivative DP of [`AdmissibleSet::map`] at the argument `x`. `mode` is the mode of the constraint at `x`; it must be
    /// [`Mode::Held`] or [`Mode::Slipping`].
    pub(crate) fn derivative<const N: usize>(&self, mode: Mode, x: [f64; N]) -> [[f64; N]; N] {
        let identity = |i, j| f64::from(u8::from(i == j));
        let slip = self.slip(mode, x);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match slip {
                Some(SlipDerivative { direction: t, mu, .. }) if i > 0 && j == 0 => mu * t[i],
                Some(SlipDerivative { direction: t, shrink, .. }) if i > 0 => shrink * (identity(i, j) - t[i] * t[j]),
                _ => identity(i, j),
            })
        })
    }
}

/// Derivative DP of the map of a contact that slips.
///
/// With the direction `t = x_t / |x_t|`, DP is 1 for the normal row, and `(mu x_n / |x_t|) (I - t t^T)` for the tangential rows. The bound
/// mu x_n of friction adds mu t times the normal row to the tangential rows. This part is not symmetric.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlipDerivative<const N: usize> {
    /// Direction t = x_t / |x_t| of the friction impulse, where x is the map's argument. The first component has no meaning.
    direction: [f64; N],
    /// Friction coefficient of the contact.
    mu: f64,
    /// Ratio mu x_n / |x_t|.
    shrink: f64,
}

impl<const N: usize> SlipDerivative<N> {
    /// Factors of the product `rho Y^T DP Y`, where Y has `N` rows, for four columns `y` of Y.
    ///
    /// The product is `a^T n + sum_k q_k^T q_k`, where n is the normal row of Y, and Y_t are the others. The first result is
    /// `a = rho (n + mu t Y_t)`. The second one has the N - 2 rows `q_k = sqrt(rho shrink) h_k Y_t`, followed by rows of zeros. The h_k are
    /// an orthonormal basis of the directions orthogonal to t.
    #[inline(always)]
    pub(crate) fn factors(&self, rho: f64, y: &[Tile; N]) -> (Tile, [Tile; N]) {
        let (t, last) = (&self.direction, N - 1);
        let mut radial = [0.0; TILE];
        for k in 1..N {
            add_multiple(&mut radial, t[k], &y[k]);
        }
        let mut a = y[0];
        add_multiple(&mut a, self.mu, &radial);
        // Householder's reflection `I - u u^T / (1 + |t_last|)` with u = t + sign(t_last) e_last maps t to the last axis up to its sign
        // (Golub & Van Loan 2013, section 5.1). Its other rows are the h_k.
        let mut mirror = radial;
        add_multiple(&mut mirror, 1.0_f64.copysign(t[last]), &y[last]);
        let (factor, inverse) = ((rho * self.shrink).sqrt(), 1.0 / (1.0 + t[last].abs()));
        let mut q = [[0.0; TILE]; N];
        for k in 1..last {
            q[k - 1] = y[k];
            add_multiple(&mut q[k - 1], -inverse * t[k], &mirror);
            q[k - 1] = scaled(factor, q[k - 1]);
        }
        (scaled(rho, a), q)
    }
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

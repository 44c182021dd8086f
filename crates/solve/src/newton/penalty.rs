//! The inner problem: one step of the proximal method, by Newton's method in the space of w.
//!
//! With x_i = c_i lambda_i - rho_i (Y_i w + g_i + s_i) and z_i = P_K(x_i), the function whose gradient is `w - sum_i Y_i^T z_i` is convex
//! and once differentiable; its Hessian is `I + sum_i rho_i Y_i^T DP_K Y_i`. Compliance R of a row makes `c = 1 / (1 + rho R)` and weakens rho
//! by as much.
//!
//! De Saxce's s_i = mu |v_t| is held, or ("implicit") taken at the present w. Then the equation is the exact law's, its matrix is not
//! symmetric and nothing is minimised any more, but near the answer Newton's method converges on it at once.

use super::cone::{Case, inner, norm};
use super::dense::Dense;
use super::island::{Block, Island, add_scaled};
use super::lane::Set;
use super::skyline::Skyline;
use stepper_real::Real;

/// Least pivot of an implicit step: the identity less what friction may take from it (Painleve's paradox takes all).
const LEAST_PIVOT: f64 = 1e-3;

/// Newton's method at one w.
#[derive(Clone, Debug, Default)]
pub(super) struct Penalty {
    /// kappa: rho_i is so many times the step of the natural map.
    pub(super) kappa: f64,
    /// De Saxce's term of every block, m/s, where it is held.
    pub(super) slip: Vec<f64>,
    /// z of every row, N s.
    pub(super) z: Vec<f64>,
    /// Velocities Y w + g.
    v: Vec<f64>,
    x: Vec<f64>,
    /// Y direction.
    dv: Vec<f64>,
    gradient: Vec<f64>,
    direction: Vec<f64>,
    trial: Vec<f64>,
    /// rho DP Y of a block.
    product: Vec<f64>,
    /// What of its tangential rows is along t.
    radial: Vec<f64>,
    /// Length of the longest row, with its fellows in a block.
    longest: f64,
    matrix: Skyline,
    /// The matrix of an implicit step where the skyline has pivots that are too small.
    dense: Dense,
}

impl Penalty {
    /// Makes room for an island.
    pub(super) fn reset(&mut self, rows: &Island) {
        self.matrix.reset(rows.w.len());
        for block in &rows.blocks {
            self.matrix.reserve(&block.span);
        }
        self.matrix.finish();
        self.longest = rows.blocks.iter().fold(0.0, |most: f64, block| most.max(block.rows.len() as f64 / block.rho)).sqrt();
        for room in [&mut self.z, &mut self.x, &mut self.trial] {
            room.clear();
            room.resize(rows.g.len(), 0.0);
        }
    }

    /// Takes everything at w; returns a bound of the velocities that the gradient is in the rows, m/s.
    pub(super) fn evaluate(&mut self, rows: &Island, implicit: bool) -> f64 {
        rows.multiply(&rows.w, &mut self.v);
        for (v, g) in self.v.iter_mut().zip(&rows.g) {
            *v += g;
        }
        self.project(rows, implicit);
        self.differentiate(rows)
    }

    /// x and z at the velocities v.
    #[inline(always)]
    fn project(&mut self, rows: &Island, implicit: bool) {
        for (i, block) in rows.blocks.iter().enumerate() {
            let own = block.rows.clone();
            let (scale, rho) = stiffness(block, self.kappa);
            for k in own.clone() {
                self.x[k] = scale * rows.lambda[k] - rho * self.v[k];
            }
            self.x[own.start] -= rho * if implicit { slip(block, &self.v[own.clone()]) } else { self.slip[i] };
            project(block, &self.x[own.clone()], &mut self.z[own]);
        }
    }

    /// The gradient at w, when z is taken there.
    #[inline(always)]
    fn differentiate(&mut self, rows: &Island) -> f64 {
        self.gradient.clone_from(&rows.w);
        rows.add_transposed(&self.z, -1.0, &mut self.gradient);
        self.longest * norm(&self.gradient)
    }

    /// Moves w by Newton's step, as far along it as the function falls, and takes everything there; returns what [`Penalty::evaluate`] does,
    /// infinity when the matrix has no factors.
    ///
    /// This is nearly all of the time, so it runs with the instructions of the lanes.
    pub(super) fn advance<R: Real>(&mut self, rows: &mut Island, implicit: bool) -> f64 {
        R::vectorize(
            #[inline(always)]
            || self.step(rows, implicit),
        )
    }

    #[inline(always)]
    fn step(&mut self, rows: &mut Island, implicit: bool) -> f64 {
        self.matrix.identity();
        for block in &rows.blocks {
            if self.curvature(rows, block, implicit) {
                let y = &rows.y[block.y.clone()];
                self.matrix.add_product(&block.span, y, &self.product, !implicit);
            }
        }
        let least = if implicit { LEAST_PIVOT } else { 0.0 };
        let factored = self.matrix.factor(least, !implicit);
        self.direction.clear();
        self.direction.extend(self.gradient.iter().map(|g| -g));
        if factored {
            self.matrix.solve(&mut self.direction);
        } else if implicit && rows.w.len() <= LARGEST_DENSE && self.factor_dense(rows) {
            self.dense.solve(&mut self.direction);
        } else {
            return f64::INFINITY;
        }
        rows.multiply(&self.direction, &mut self.dv);
        if !implicit {
            let way = self.search(rows);
            self.go(rows, way);
            self.project(rows, implicit);
            return self.differentiate(rows);
        }
        // Where the whole way makes it worse, half of it, and half again.
        let before = self.longest * norm(&self.gradient);
        let mut way = 1.0;
        self.go(rows, way);
        loop {
            self.project(rows, implicit);
            let error = self.differentiate(rows);
            if error < before || way <= LEAST_WAY {
                return error;
            }
            way *= 0.5;
            self.go(rows, -way);
        }
    }

    /// Factors of an implicit step's matrix with pivoting; false when it has none.
    #[inline(always)]
    fn factor_dense(&mut self, rows: &Island) -> bool {
        self.dense.identity(rows.w.len());
        for block in &rows.blocks {
            if self.curvature(rows, block, true) {
                let y = &rows.y[block.y.clone()];
                self.dense.add_product(block.span.start, block.span.len(), y, &self.product);
            }
        }
        self.dense.factor()
    }

    /// w and v, so far along the direction.
    #[inline(always)]
    fn go(&mut self, rows: &mut Island, way: f64) {
        add_scaled(&mut rows.w, way, &self.direction);
        for (v, d) in self.v.iter_mut().zip(&self.dv) {
            *v += way * d;
        }
    }

    /// Leaves rho DP Y of a block in `product`, row by row; false when it is zero. Implicit, DP is multiplied by the derivative of v + s:
    /// `I + e_n (0, mu v_t / |v_t|)`.
    #[inline(always)]
    fn curvature(&mut self, rows: &Island, block: &Block, implicit: bool) -> bool {
        let (_, rho) = stiffness(block, self.kappa);
        let (x, v) = (&self.x[block.rows.clone()], &self.v[block.rows.clone()]);
        let (n, y) = (block.span.len(), &rows.y[block.y.clone()]);
        let out = &mut self.product;
        out.clear();
        let mu = match block.set {
            Set::Interval { lo, hi } => {
                let free = x[0] > lo && x[0] < hi;
                if free {
                    out.extend(y.iter().map(|y| rho * y));
                }
                return free;
            }
            Set::Cone { mu } => mu,
        };
        let tangent = norm(&x[1..]);
        let case = Case::of(x[0], tangent, mu);
        if let Case::Zero = case {
            return false;
        }
        out.extend(y.iter().map(|y| rho * y));
        let (normal, tangents) = out.split_at_mut(n);
        let speed = norm(&v[1..]);
        if implicit && speed > 0.0 {
            for (row, v) in tangents.chunks_exact(n).zip(&v[1..]) {
                add_scaled(normal, mu * v / speed, row);
            }
        }
        // DP = b b^T / (1 + mu^2) + (mu height / |x_t|) (I - t t^T), with t = x_t / |x_t| and b = (1, mu t).
        if let Case::Surface { height } = case {
            let inverse = if tangent > 0.0 { 1.0 / tangent } else { 0.0 };
            let turn = mu * height * inverse;
            let radial = &mut self.radial;
            radial.clear();
            radial.resize(n, 0.0);
            for (row, x) in tangents.chunks_exact(n).zip(&x[1..]) {
                add_scaled(radial, x * inverse, row);
            }
            for (normal, radial) in normal.iter_mut().zip(radial.iter_mut()) {
                *normal = (*normal + mu * *radial) / (1.0 + mu * mu);
                *radial = mu * *normal - turn * *radial;
            }
            for (row, x) in tangents.chunks_exact_mut(n).zip(&x[1..]) {
                let t = x * inverse;
                for (y, radial) in row.iter_mut().zip(radial.iter()) {
                    *y = turn * *y + t * radial;
                }
            }
        }
        true
    }

    /// How far to go along the step: where the slope is a hundredth of what it was, by regula falsi (Illinois); 1 if that will do.
    #[inline(always)]
    fn search(&mut self, rows: &Island) -> f64 {
        let start = inner(&self.gradient, &self.direction);
        let mut end = self.slope(rows, 1.0);
        if end <= 0.1 * start.abs() || start >= 0.0 {
            return 1.0;
        }
        let ([mut low, mut high], mut begin, mut way) = ([0.0, 1.0], start, 1.0);
        for _ in 0..MOST_SEARCH {
            way = low - begin * (high - low) / (end - begin);
            let slope = self.slope(rows, way);
            if slope.abs() <= 0.01 * start.abs() {
                return way;
            }
            if slope < 0.0 {
                (low, begin, end) = (way, slope, 0.5 * end);
            } else {
                (high, end, begin) = (way, slope, 0.5 * begin);
            }
        }
        // As far as the function is known to fall all the way.
        if low > 0.0 { low } else { way }
    }

    /// Slope of the function `way` along the step.
    #[inline(always)]
    fn slope(&mut self, rows: &Island, way: f64) -> f64 {
        let mut slope = rows.w.iter().zip(&self.direction).fold(0.0, |sum, (w, d)| sum + (w + way * d) * d);
        for block in &rows.blocks {
            let (_, rho) = stiffness(block, self.kappa);
            let own = block.rows.clone();
            for i in own.clone() {
                self.trial[i] = self.x[i] - way * rho * self.dv[i];
            }
            project(block, &self.trial[own.clone()], &mut self.z[own.clone()]);
            slope -= inner(&self.z[own.clone()], &self.dv[own]);
        }
        slope
    }
}

/// Largest island whose matrix is factorised with pivoting where it has to be: 64 coordinates take some 50 microseconds.
const LARGEST_DENSE: usize = 64;
/// Least part of an implicit step.
const LEAST_WAY: f64 = 0.125;
/// Points tried along a step at the most.
const MOST_SEARCH: usize = 30;

/// c and rho of a block.
#[inline(always)]
fn stiffness(block: &Block, kappa: f64) -> (f64, f64) {
    let rho = kappa * block.rho;
    let scale = 1.0 / (1.0 + rho * block.compliance);
    (scale, rho * scale)
}

/// De Saxce's term mu |v_t| of a block with velocities v.
#[inline(always)]
pub(super) fn slip(block: &Block, v: &[f64]) -> f64 {
    match block.set {
        Set::Interval { .. } => 0.0,
        Set::Cone { mu } => mu * norm(&v[1..]),
    }
}

/// z = P_K(x).
#[inline(always)]
fn project(block: &Block, x: &[f64], z: &mut [f64]) {
    match block.set {
        Set::Interval { lo, hi } => z[0] = x[0].max(lo).min(hi),
        Set::Cone { mu } => {
            let tangent = norm(&x[1..]);
            let (height, scale) = Case::of(x[0], tangent, mu).image(x[0], tangent, mu);
            z[0] = height;
            for (z, x) in z[1..].iter_mut().zip(&x[1..]) {
                *z = x * scale;
            }
        }
    }
}

//! Augmented Lagrangian of one island. One step of the proximal method goes to its minimum over w (scaled velocity change), which Newton's
//! method finds.
//!
//! With x_i = c_i lambda_i - rho_i (Y_i w + g_i + s_i) and z_i = P_K(x_i), `w - sum_i Y_i^T z_i` is the gradient of a convex function that
//! is once differentiable. Its Hessian is `I + sum_i rho_i Y_i^T DP_K Y_i`. A compliance R of a row gives `c = 1 / (1 + rho R)` and
//! multiplies rho by the same factor.
//!
//! De Saxce's term s_i = mu |v_t| is constant, or evaluated at the current w (an "implicit" step). The equation of an implicit step is that
//! of the exact friction law. Its matrix is not symmetric, and no function is minimised. Close to the solution Newton's method still
//! converges at once.

use crate::admissible_set::Product;
use crate::newton::dense::Dense;
use crate::newton::island::{Block, Island};
use crate::newton::skyline::Skyline;
use crate::vectors::{add_scaled, inner, norm};
use stepper_real::{Real, kernel};

/// Smallest size of a pivot of Newton's matrix for the exact friction law. Without constraints the matrix is the identity. Friction may
/// reduce a pivot to zero, in Painleve's paradox.
const LEAST_PIVOT: f64 = 1e-3;

/// Augmented Lagrangian of one island at the current scaled velocity change w, and Newton's method for its minimum.
#[derive(Clone, Debug, Default)]
pub(super) struct AugmentedLagrangian {
    /// Ratio kappa of the proximal step length to the step of the natural map, the function that is zero at the solution.
    pub(super) kappa: f64,
    /// De Saxce's term mu |v_t| of each constraint, m/s, if it is constant.
    pub(super) slip: Vec<f64>,
    /// Projection z = P_K(x) of each row's argument on the admissible impulses, N s: the next impulses.
    pub(super) z: Vec<f64>,
    /// Velocities Y w + g of all rows of the island, m/s: Y is the scaled Jacobian, w the scaled velocity change by the impulses, and g the
    /// velocity before any impulse.
    v: Vec<f64>,
    /// Argument x of the projection on the admissible impulses, N s.
    x: Vec<f64>,
    /// Change of the rows' velocities along Newton's direction, m/s.
    dv: Vec<f64>,
    /// Gradient of the augmented Lagrangian with respect to the scaled velocity change w.
    gradient: Vec<f64>,
    /// Newton's direction of the scaled velocity change w.
    direction: Vec<f64>,
    /// Argument of the projection at a point of the line search, N s.
    trial: Vec<f64>,
    /// Product rho DP Y of one constraint: step rho times the derivative DP of its projection times its scaled Jacobian Y.
    product: Product,
    /// Largest norm of one constraint's rows: root of the trace of its block of the Delassus matrix.
    longest: f64,
    /// Matrix of a Newton step, replaced by its factors.
    matrix: Skyline,
    /// Newton's matrix for the exact friction law, if pivots in the skyline are too small.
    dense: Dense,
}

impl AugmentedLagrangian {
    /// Allocates the matrix and the buffers for an island.
    pub(super) fn reset(&mut self, rows: &Island) {
        self.matrix.reset(rows.w.len());
        for block in &rows.blocks {
            self.matrix.reserve(rows.tiles(block));
        }
        self.matrix.complete_pattern();
        self.longest = rows.blocks.iter().fold(0.0, |most: f64, block| most.max(block.trace)).sqrt();
        for buffer in [&mut self.z, &mut self.x, &mut self.trial] {
            buffer.clear();
            buffer.resize(rows.g.len(), 0.0);
        }
    }

    /// Computes the projected impulses and the gradient at the current scaled velocity change w of an island. Returns an upper bound of the
    /// gradient, expressed as the velocity of a row, m/s.
    ///
    /// If `implicit`, De Saxce's terms mu |v_t| are those at the current velocities (the exact friction law); otherwise they are constant.
    pub(super) fn evaluate(&mut self, rows: &Island, implicit: bool) -> f64 {
        rows.multiply(&rows.w, &mut self.v);
        for (v, g) in self.v.iter_mut().zip(&rows.g) {
            *v += g;
        }
        self.project(rows, implicit);
        self.compute_gradient(rows)
    }

    /// Computes the argument x of each constraint's projection from the current velocities, and its projection z on the admissible
    /// impulses. If `implicit`, De Saxce's terms mu |v_t| are those at the current velocities (the exact friction law).
    #[inline(always)]
    fn project(&mut self, rows: &Island, implicit: bool) {
        for (i, block) in rows.blocks.iter().enumerate() {
            let own = block.rows.clone();
            let (scale, rho) = stiffness(block, self.kappa);
            for k in own.clone() {
                self.x[k] = scale * rows.lambda[k] - rho * self.v[k];
            }
            self.x[own.start] -= rho * if implicit { block.set.slip(&self.v[own.clone()]) } else { self.slip[i] };
            block.set.project(&self.x[own.clone()], &mut self.z[own]);
        }
    }

    /// Computes the gradient w - Y^T z from the scaled velocity change w and the projected impulses z. Returns an upper bound of the
    /// gradient, expressed as the velocity of a row, m/s.
    #[inline(always)]
    fn compute_gradient(&mut self, rows: &Island) -> f64 {
        self.gradient.clone_from(&rows.w);
        rows.add_transposed(&self.z, -1.0, &mut self.gradient);
        self.longest * norm(&self.gradient)
    }

    /// Makes one Newton step with a line search, and evaluates the gradient at the new scaled velocity change w. If `implicit`, the step is
    /// for the exact friction law.
    ///
    /// Returns an upper bound of the gradient, expressed as the velocity of a row, m/s, or infinity if the matrix cannot be factorised.
    /// Nearly all of the time is spent here, so that it runs with the instructions of the CPU level of `R`.
    pub(super) fn advance<R: Real>(&mut self, rows: &mut Island, implicit: bool) -> f64 {
        kernel!(R, || self.step(rows, implicit))
    }

    /// Makes a Newton step with a line search, without selecting the CPU level: the body of [`AugmentedLagrangian::advance`].
    #[inline(always)]
    fn step(&mut self, rows: &mut Island, implicit: bool) -> f64 {
        self.matrix.set_identity();
        for block in &rows.blocks {
            if self.compute_curvature(rows, block, implicit) {
                let y = &rows.y[block.y.clone()];
                self.matrix.add_product(rows.tiles(block), y, &self.product.rows, !implicit);
            }
        }
        let least = if implicit { LEAST_PIVOT } else { 0.0 };
        let factored = self.matrix.factor(least, !implicit, implicit);
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
            let length = self.search_line(rows);
            self.move_along(rows, length);
            self.project(rows, implicit);
            return self.compute_gradient(rows);
        }
        // If the full step increases the error, the length is halved repeatedly.
        let before = self.longest * norm(&self.gradient);
        let mut length = 1.0;
        self.move_along(rows, length);
        loop {
            self.project(rows, implicit);
            let error = self.compute_gradient(rows);
            if error < before || length <= LEAST_LENGTH {
                return error;
            }
            length *= 0.5;
            self.move_along(rows, -length);
        }
    }

    /// Factorises Newton's matrix for the exact friction law as a full matrix with pivoting. Returns false if it is singular.
    #[inline(always)]
    fn factor_dense(&mut self, rows: &Island) -> bool {
        self.dense.set_identity(rows.w.len());
        for block in &rows.blocks {
            if self.compute_curvature(rows, block, true) {
                let y = &rows.y[block.y.clone()];
                self.dense.add_product(rows.tiles(block), y, &self.product.rows);
            }
        }
        self.dense.factor()
    }

    /// Moves the scaled velocity change w of an island and the velocities v of its rows by `length` times the search direction.
    #[inline(always)]
    fn move_along(&mut self, rows: &mut Island, length: f64) {
        add_scaled(&mut rows.w, length, &self.direction);
        for (v, d) in self.v.iter_mut().zip(&self.dv) {
            *v += length * d;
        }
    }

    /// Computes rho DP Y of one constraint into `product`: step times the derivative of the constraint's projection times its scaled
    /// Jacobian. If `implicit`, the product includes the derivative of De Saxce's term mu |v_t|. Returns false if the product is zero.
    #[inline(always)]
    fn compute_curvature(&mut self, rows: &Island, block: &Block, implicit: bool) -> bool {
        let (_, rho) = stiffness(block, self.kappa);
        let v = implicit.then(|| &self.v[block.rows.clone()]);
        block.set.differentiate(rho, &self.x[block.rows.clone()], v, &rows.y[block.y.clone()], rows.width(block), &mut self.product)
    }

    /// Step length at which the slope along the search direction is at most a hundredth of the initial one, by regula falsi (Illinois). The
    /// length is 1 if the slope after the full step is at most a tenth of the initial one.
    #[inline(always)]
    fn search_line(&mut self, rows: &Island) -> f64 {
        let start = inner(&self.gradient, &self.direction);
        let mut end = self.slope(rows, 1.0);
        if end <= 0.1 * start.abs() || start >= 0.0 {
            return 1.0;
        }
        let ([mut low, mut high], mut begin, mut length) = ([0.0, 1.0], start, 1.0);
        for _ in 0..MOST_POINTS {
            length = low - begin * (high - low) / (end - begin);
            let slope = self.slope(rows, length);
            if slope.abs() <= 0.01 * start.abs() {
                return length;
            }
            if slope < 0.0 {
                (low, begin, end) = (length, slope, 0.5 * end);
            } else {
                (high, end, begin) = (length, slope, 0.5 * begin);
            }
        }
        // The function decreases at least up to this length.
        if low > 0.0 { low } else { length }
    }

    /// Derivative of the augmented Lagrangian along the search direction, after a step of the length `length`, a multiple of the direction.
    #[inline(always)]
    fn slope(&mut self, rows: &Island, length: f64) -> f64 {
        let mut slope = rows.w.iter().zip(&self.direction).fold(0.0, |sum, (w, d)| sum + (w + length * d) * d);
        for block in &rows.blocks {
            let (_, rho) = stiffness(block, self.kappa);
            let own = block.rows.clone();
            for i in own.clone() {
                self.trial[i] = self.x[i] - length * rho * self.dv[i];
            }
            block.set.project(&self.trial[own.clone()], &mut self.z[own.clone()]);
            slope -= inner(&self.z[own.clone()], &self.dv[own]);
        }
        slope
    }
}

/// Largest number of coordinates of an island whose matrix is factorised with pivoting if the skyline factorisation fails.
///
/// The skyline factorisation accepts pivots of either sign, and fails if a pivot is too small. With pivoting in every step instead, 280
/// problems of robots, grasps and heaps, and 29 of a wall hit by a ball, take the same number of steps.
const LARGEST_DENSE: usize = 256;
/// Smallest length of a step with the exact friction law, as a fraction of the full Newton step. The search halves the length until the
/// error decreases.
const LEAST_LENGTH: f64 = 0.125;
/// Largest number of points at which Newton's line search evaluates the slope.
const MOST_POINTS: usize = 30;

/// Factors in the argument c lambda - rho v of a constraint's projection: factor c of the impulse lambda, and step rho of the velocity v.
/// `kappa` is the ratio of rho without compliance to `block.rho`, the step of the natural map.
#[inline(always)]
fn stiffness(block: &Block, kappa: f64) -> (f64, f64) {
    let rho = kappa * block.rho;
    let scale = 1.0 / (1.0 + rho * block.compliance);
    (scale, rho * scale)
}

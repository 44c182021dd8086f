//! Equation of one proximal step of an island, and Newton's method for it.
//!
//! The unknown is w (scaled velocity change), whose metric is the identity. With `x_i = c_i lambda_i - rho_i (Y_i w + g_i)` and Alart and
//! Curnier's map P (1991), the equation is `w = sum_i Y_i^T P(x_i)`, and its solution gives the next impulses `P(x_i)`. A compliance R of a
//! row gives `c = 1 / (1 + rho R)` and multiplies rho by the same factor. Newton's matrix is `I + sum_i rho_i Y_i^T DP_i Y_i`, which is not
//! symmetric where contacts slip. No function is minimised.

use crate::admissible_set::Mode;
use crate::newton::island::{Block, Island};
use crate::newton::skyline::Skyline;
use crate::vectors::{TILE, Tile, add_multiple_of_tiles, inner_of_tiles, scaled, with_row_count};
use stepper_real::{Real, kernel};

/// Smallest size of a pivot of Newton's matrix. Without constraints the matrix is the identity. Friction may reduce a pivot to zero, as in
/// Painleve's paradox. The proximal step then fails. With a smaller kappa the matrix is closer to the identity.
const LEAST_PIVOT: f64 = 1e-3;

/// Equation of one proximal step at the current scaled velocity change w of an island, and Newton's method for it.
#[derive(Clone, Debug, Default)]
pub(super) struct ProximalStep {
    /// Ratio kappa of the step length rho to the step of the natural map, the function that is zero at the solution.
    pub(super) kappa: f64,
    /// Image z = P(x) of each row's argument: the next impulses, N s.
    pub(super) z: Vec<f64>,
    /// Velocities Y w + g of all rows of the island, m/s: Y is the scaled Jacobian, w the scaled velocity change by the impulses, and g the
    /// velocity before any impulse.
    v: Vec<f64>,
    /// Argument x of each row's map, N s.
    x: Vec<f64>,
    /// Mode of each constraint at its argument.
    modes: Vec<Mode>,
    /// Change of the rows' velocities along Newton's direction, m/s.
    dv: Vec<f64>,
    /// Error w - Y^T z of the equation.
    error: Vec<f64>,
    /// Newton's direction of the scaled velocity change w.
    direction: Vec<f64>,
    /// Rows of one constraint, in each tile: rho Y, or the rows q of a slipping contact
    /// ([`factors`](crate::admissible_set::SlipDerivative::factors)). Here rho is the step, and Y the scaled Jacobian.
    product: Vec<Tile>,
    /// Factors a and n of a slipping contact's unsymmetric product `a^T n`, in each tile: n is the contact's normal row.
    unsymmetric: [Vec<Tile>; 2],
    /// Largest norm of one constraint's rows: root of the trace of its block of the Delassus matrix.
    longest: f64,
    /// Matrix of a Newton step, replaced by its factors. Its kept sum is that over the constraints in `kept`, for kappa = 1.
    matrix: Skyline,
    /// Whether each constraint is part of the matrix's kept sum.
    kept: Vec<bool>,
}

impl ProximalStep {
    /// Allocates the matrix and the buffers for an island.
    pub(super) fn reset(&mut self, rows: &Island) {
        self.matrix.reset(rows.w.len() / TILE);
        for block in &rows.blocks {
            self.matrix.reserve(rows.tiles(block));
        }
        self.matrix.complete_pattern();
        self.kept.clear();
        self.kept.resize(rows.blocks.len(), false);
        self.longest = rows.blocks.iter().fold(0.0, |most: f64, block| most.max(block.trace)).sqrt();
        for buffer in [&mut self.z, &mut self.x] {
            buffer.clear();
            buffer.resize(rows.g.len(), 0.0);
        }
    }

    /// Computes the impulses and the error of the equation at the scaled velocity change w of an island. Returns an upper bound of the
    /// error, expressed as the velocity of a row, m/s.
    ///
    /// The velocities are those of the last residual of the island. A proximal step that fails restores w and leaves them as they are.
    #[inline(always)]
    pub(super) fn evaluate(&mut self, rows: &Island) -> f64 {
        self.v.clone_from(&rows.v);
        self.compute_error(rows)
    }

    /// Computes the impulses from the current velocities, and the error of the equation from w and the impulses. Returns an upper bound of
    /// the error, expressed as the velocity of a row, m/s.
    #[inline(always)]
    fn compute_error(&mut self, rows: &Island) -> f64 {
        self.error.clone_from(&rows.w);
        self.modes.clear();
        for block in &rows.blocks {
            let own = block.rows.clone();
            with_row_count!(own.len(), N => {
                let x: [f64; N] = argument(rows, &self.v, block, self.kappa);
                let (z, mode) = block.set.map(x);
                self.modes.push(mode);
                self.x[own.clone()].copy_from_slice(&x);
                self.z[own].copy_from_slice(&z);
                rows.add_transposed(block, scaled(-1.0, z), &mut self.error);
            });
        }
        self.error_bound()
    }

    /// Whether no constraint of an island has another mode with the ratio `kappa` of step lengths than with 1. The impulses and velocities
    /// are those of the last residual. If so, a proximal step with this kappa mostly converges.
    #[inline(always)]
    pub(super) fn keeps_modes(&self, rows: &Island, kappa: f64) -> bool {
        rows.blocks.iter().all(|block| {
            with_row_count!(block.rows.len(), N => {
                let [now, then] = [1.0, kappa].map(|kappa| block.set.map::<N>(argument(rows, &rows.v, block, kappa)).1);
                now == then
            })
        })
    }

    /// Upper bound of the error of the equation, expressed as the velocity of a row, m/s.
    #[inline(always)]
    fn error_bound(&self) -> f64 {
        self.longest * inner_of_tiles(&self.error, &self.error).sqrt()
    }

    /// Makes one Newton step, and evaluates the equation at the new scaled velocity change w. Returns an upper bound of the error,
    /// expressed as the velocity of a row, m/s, or infinity if the matrix cannot be factorised.
    ///
    /// The function runs with the instructions of the CPU level of `R`.
    pub(super) fn advance<R: Real>(&mut self, rows: &mut Island) -> f64 {
        kernel!(R, || self.step(rows))
    }

    /// Makes a Newton step without selecting the CPU level: the body of [`ProximalStep::advance`].
    #[inline(always)]
    fn step(&mut self, rows: &mut Island) -> f64 {
        self.update_kept_sum(rows);
        self.matrix.set_to_kept(self.kappa);
        for (i, block) in rows.blocks.iter().enumerate() {
            if !self.kept[i] {
                self.add_block(rows, block, self.modes[i]);
            }
        }
        self.matrix.complete();
        if !self.matrix.factor(LEAST_PIVOT) {
            return f64::INFINITY;
        }
        self.direction.clear();
        self.direction.extend(self.error.iter().map(|g| -g));
        self.matrix.solve(&mut self.direction);
        rows.multiply(&self.direction, &mut self.dv);
        // If the full step increases the error, the length is halved repeatedly.
        let before = self.error_bound();
        let mut length = 1.0;
        self.move_along(rows, length);
        loop {
            let error = self.compute_error(rows);
            if error < before || length <= LEAST_LENGTH {
                return error;
            }
            length *= 0.5;
            self.move_along(rows, -length);
        }
    }

    /// Adds to the matrix's kept sum the constraints that have come to be held, and subtracts those that no longer are. The part of a held
    /// constraint without compliance is proportional to kappa, and most constraints are held from one Newton step to the next.
    ///
    /// A part that is taken away leaves a rounding error, which kappa multiplies. Above [`MOST_KAPPA_OF_CHANGES`] the sum is made again.
    #[inline(always)]
    fn update_kept_sum(&mut self, rows: &Island) {
        if self.kappa > MOST_KAPPA_OF_CHANGES {
            self.matrix.clear_kept();
            self.kept.fill(false);
        }
        for ((kept, block), &mode) in self.kept.iter_mut().zip(&rows.blocks).zip(&self.modes) {
            let is_held = block.compliance == 0.0 && mode == Mode::Held;
            if is_held != *kept {
                *kept = is_held;
                let rho = if is_held { block.rho } else { -block.rho };
                with_row_count!(block.rows.len(), N => {
                    let y = rows.entries::<N>(block);
                    self.product.clear();
                    self.product.extend(y.as_flattened().iter().map(|&y| scaled(rho, y)));
                    self.matrix.add_to_kept(rows.tiles(block), self.product.as_chunks().0, y);
                });
            }
        }
    }

    /// Adds the product `rho Y^T DP Y` of one constraint to Newton's matrix: step rho, scaled Jacobian Y, and derivative DP of its map.
    #[inline(always)]
    fn add_block(&mut self, rows: &Island, block: &Block, mode: Mode) {
        if !mode.is_active() {
            return;
        }
        let (x, tiles) = (&self.x[block.rows.clone()], rows.tiles(block));
        let (_, rho) = stiffness(block, self.kappa);
        with_row_count!(x.len(), N => {
            let y = rows.entries::<N>(block);
            self.product.clear();
            match block.set.slip(mode, std::array::from_fn(|k| x[k])) {
                None => {
                    self.product.extend(y.as_flattened().iter().map(|&y| scaled(rho, y)));
                    self.matrix.add_symmetric(tiles, self.product.as_chunks::<N>().0, y);
                }
                Some(slip) => {
                    // A contact with two rows adds one row of zeros, because chunks cannot be empty.
                    const OTHERS: usize = if N > 2 { N - 2 } else { 1 };
                    let [a, normal] = &mut self.unsymmetric;
                    a.clear();
                    normal.clear();
                    for y in y {
                        let (own, others) = slip.factors(rho, y);
                        a.push(own);
                        normal.push(y[0]);
                        self.product.extend_from_slice(&others[..OTHERS]);
                    }
                    self.matrix.add_unsymmetric::<OTHERS>(tiles, [a, normal], self.product.as_chunks().0);
                }
            }
        });
    }

    /// Moves the scaled velocity change w of an island and the velocities v of its rows by `length` times the search direction.
    #[inline(always)]
    fn move_along(&mut self, rows: &mut Island, length: f64) {
        add_multiple_of_tiles(&mut rows.w, length, &self.direction);
        for (v, d) in self.v.iter_mut().zip(&self.dv) {
            *v += length * d;
        }
    }
}

/// Largest kappa at which the sum over held constraints is changed and not made again. Times the rounding error of the sum, it is far below
/// [`LEAST_PIVOT`].
const MOST_KAPPA_OF_CHANGES: f64 = 1e9;
/// Smallest length of a step, as a fraction of the full Newton step. The search halves the length until the error decreases, and takes the
/// smallest length all the same.
const LEAST_LENGTH: f64 = 0.125;

/// Argument c lambda - rho v of a constraint's map at the velocities `v` of all rows of the island, N s.
#[inline(always)]
fn argument<const N: usize>(rows: &Island, v: &[f64], block: &Block, kappa: f64) -> [f64; N] {
    let (scale, rho) = stiffness(block, kappa);
    let (lambda, v) = (&rows.lambda[block.rows.clone()], &v[block.rows.clone()]);
    std::array::from_fn(|k| scale * lambda[k] - rho * v[k])
}

/// Factors in the argument c lambda - rho v of a constraint's map: factor c of the impulse lambda, and step rho of the velocity v.
/// `kappa` is the ratio of rho without compliance to `block.rho`, the step of the natural map.
#[inline(always)]
fn stiffness(block: &Block, kappa: f64) -> (f64, f64) {
    let rho = kappa * block.rho;
    let scale = 1.0 / (1.0 + rho * block.compliance);
    (scale, rho * scale)
}

//! Contacts with torsional friction: rows (n, t1, t2, spin), and with rolling friction too: rows (n, t1, t2, spin, roll1, roll2).
//!
//! MuJoCo's elliptic cone is sqrt(sum (f_i / mu_i)^2) <= f_n. If row i is multiplied by mu_i / mu, the cone becomes the circular cone |x_t|
//! <= mu x_n in three or five tangential dimensions. Then f_i = (mu_i / mu) x_i, and all velocities v' of the scaled rows are in m/s.
//! Coulomb's law (maximal dissipation) is the same for the original and the scaled rows, because f . v = x . v'. A type of friction that
//! the contact lacks is a row of zeros.

use crate::cone::{masked, positive};
use crate::constraints::local_solver::{LocalSolver, NaturalStep, least_tangent, slip_multiplier};
use stepper_real::{Mask, Real, Scalar};

/// Solver of a single contact with torsional or rolling friction. It has `N` rows, of which `T` are tangential.
///
/// With the normal impulse eliminated, the tangential problem is `A x_t + c = -s x_t`, as for
/// [`SlidingSolver`](crate::constraints::sliding::SlidingSolver): c is the tangential velocity without the impulse x_t, and s the friction
/// multiplier. The solver uses the principal axes of A, the columns of Q, and the principal values a, which Jacobi's method finds.
///
/// The tangential block of the Delassus matrix is then replaced by `G_nn (k k^T) + Q diag(a) Q^T`, where k is the column of the normal row
/// divided by G_nn. Only changes of the impulse are computed with this replacement. Errors of the axes therefore do not change the solution
/// to which the iterations converge.
#[derive(Clone, Copy, Debug)]
pub struct RollingSolver<R: Real, const N: usize, const T: usize> {
    /// Inverse 1 / G_nn of the normal row's diagonal entry of the Delassus matrix, kg.
    inv_gnn: R,
    /// Diagonal entry G_nn of the Delassus matrix for the normal row, compliance included, 1/kg.
    nn: R,
    /// Principal axes of the matrix A that relates the tangential impulse to the tangential velocity, one after the other.
    axes: [[R; T]; T],
    /// Principal values of the tangential matrix A, bounded away from zero, 1/kg.
    a: [R; T],
    /// Inverses of the principal values of the tangential matrix A, kg.
    inv_a: [R; T],
    /// Coupling G_tn / G_nn of the tangential rows t and the normal row n of the contact's Delassus block G, in the principal axes of the
    /// tangential matrix.
    coupling: [R; T],
    /// Step of the weaker update [`LocalSolver::relax`] of the contact: impulse per velocity, kg.
    step: R,
}

impl<R: Real, const N: usize, const T: usize> RollingSolver<R, N, T> {
    /// Impulse of all rows of a contact.
    ///
    /// `n` is the normal impulse. `x` has the tangential impulses in the principal axes of the matrix A. Outside `lanes`, the function
    /// replaces them by zero.
    #[inline(always)]
    fn impulse(&self, n: R, x: [R; T], lanes: R::Mask) -> [R; N] {
        let mut out = [R::zero(); N];
        out[0] = n;
        for (axis, &x) in self.axes.iter().zip(&x) {
            for i in 0..T {
                out[i + 1] += axis[i] * masked(lanes, x);
            }
        }
        out
    }

    /// Impulse of a slipping contact in the lanes `todo`, at the multiplier s > 0 for which the friction impulse is mu times the normal
    /// impulse.
    ///
    /// `push` is the normal impulse, N s, and `p` the tangential velocity in the principal axes, m/s, both without any tangential impulse.
    /// The search for the multiplier starts at `guess`. The function returns the tangential impulse in the principal axes, the normal
    /// impulse, and the multiplier.
    #[inline(always)]
    fn slip(&self, mu: R, p: [R; T], push: R, guess: R, todo: R::Mask) -> ([R; T], R, R) {
        let s = slip_multiplier(
            mu,
            guess,
            self.nn,
            todo,
            #[inline(always)]
            |s| {
                let (rate, x, n) = self.sliding(p, push, s);
                let square = dot(x, x);
                [square, n, dot(self.coupling, rate) * square + n * dot(x, rate)]
            },
        );
        // Scaling removes the remaining error of Newton's method, so that the impulse is on its cone.
        let (_, mut x, n) = self.sliding(p, push, s);
        let n = n.max(R::zero());
        let length = dot(x, x).sqrt();
        let scale = mu * n / R::select(length.gt(R::zero()), length, R::one());
        for x in &mut x {
            *x *= scale;
        }
        (x, n, s)
    }

    /// Impulses of a slipping contact at the multiplier s of its friction disc. Returns minus the derivative of the tangential impulse with
    /// respect to s, the tangential impulse, and the normal impulse.
    ///
    /// `push` is the normal impulse, N s, and `p` the tangential velocity in the principal axes, m/s, both without any tangential impulse.
    #[inline(always)]
    fn sliding(&self, p: [R; T], push: R, s: R) -> ([R; T], [R; T], R) {
        let (mut x, mut rate) = ([R::zero(); T], [R::zero(); T]);
        for i in 0..T {
            let inverse = R::one() / (self.a[i] + s);
            x[i] = -p[i] * inverse;
            rate[i] = x[i] * inverse;
        }
        (rate, x, push - dot(self.coupling, x))
    }

    /// Adds the compliance `normal` to the normal row and the compliance `tangential` to each other row, 1/kg. Returns the ratio of the
    /// normal row's previous diagonal entry to the new one.
    ///
    /// The principal axes remain those of the matrix without compliance. An error of the axes does not change the solution to which the
    /// sweeps converge.
    #[inline(always)]
    fn add_compliance(&mut self, [normal, tangential]: [R; 2]) -> R {
        let nn = self.nn;
        self.nn += normal;
        self.inv_gnn = R::one() / self.nn;
        let (ratio, mut largest) = (nn * self.inv_gnn, R::zero());
        for i in 0..T {
            // Part of the tangential block that the normal impulse no longer removes.
            let freed = self.coupling[i] * self.coupling[i] * nn * (R::one() - ratio);
            self.a[i] += tangential + freed;
            self.inv_a[i] = R::one() / self.a[i];
            self.coupling[i] *= ratio;
            largest = largest.max(self.a[i]);
        }
        self.step = R::one() / (largest + self.nn * dot(self.coupling, self.coupling));
        ratio
    }
}

impl<R: Real, const N: usize, const T: usize> LocalSolver<R, N> for RollingSolver<R, N, T> {
    #[inline(always)]
    fn new(gram: &[[R; N]; N], active: R::Mask) -> (Self, R) {
        let nn = R::select(active, gram[0][0], R::one());
        let inv_gnn = R::one() / nn;
        let (mut trace, mut k, mut matrix) = (nn, [R::zero(); T], [[R::zero(); T]; T]);
        for i in 0..T {
            k[i] = masked(active, gram[0][i + 1]) * inv_gnn;
            trace += masked(active, gram[i + 1][i + 1]);
        }
        for i in 0..T {
            for j in i..T {
                matrix[i][j] = masked(active, gram[i + 1][j + 1]) - k[i] * k[j] * nn;
                matrix[j][i] = matrix[i][j];
            }
        }
        let axes = principal_axes(&mut matrix);
        let floor = least_tangent(trace);
        let (mut a, mut inv_a, mut largest) = ([R::zero(); T], [R::zero(); T], R::zero());
        for i in 0..T {
            a[i] = matrix[i][i].max(floor);
            inv_a[i] = R::one() / a[i];
            largest = largest.max(a[i]);
        }
        let coupling = in_axes(&axes, k);
        let step = R::one() / (largest + nn * dot(coupling, coupling));
        (Self { inv_gnn, nn, axes, a, inv_a, coupling, step }, trace)
    }

    #[inline(always)]
    fn solve(&self, mu: R, v: [R; N], lambda: [R; N], guess: R, lanes: R::Mask) -> ([R; N], R) {
        let (vt, xt) = (in_axes(&self.axes, tangential(v)), in_axes(&self.axes, tangential(lambda)));
        let push = lambda[0] + dot(self.coupling, xt) - v[0] * self.inv_gnn;
        let closing = positive(lanes, push);
        let (mut p, mut stick) = ([R::zero(); T], [R::zero(); T]);
        for i in 0..T {
            p[i] = vt[i] - self.a[i] * xt[i] - self.coupling[i] * v[0];
            stick[i] = -p[i] * self.inv_a[i];
        }
        let sticking = push - dot(self.coupling, stick);
        let bound = (mu * sticking).max(R::zero());
        let slides = closing.and_not(dot(stick, stick).le(bound * bound));
        let (mut x, mut n, mut s) = (stick, sticking, R::zero());
        if slides.any() {
            let slip = self.slip(mu, p, push, guess, slides);
            for i in 0..T {
                x[i] = R::select(slides, slip.0[i], x[i]);
            }
            n = R::select(slides, slip.1, n);
            s = masked(slides, slip.2);
        }
        (self.impulse(masked(closing, n), x, closing), s)
    }

    #[inline(always)]
    fn relax(&self, mu: R, v: [R; N], lambda: [R; N], active: R::Mask) -> [R; N] {
        let (vt, xt) = (in_axes(&self.axes, tangential(v)), in_axes(&self.axes, tangential(lambda)));
        let n = (lambda[0] - v[0] * self.inv_gnn).max(R::zero());
        let d = (n - lambda[0]) * self.nn;
        let mut x = xt;
        for i in 0..T {
            x[i] -= (vt[i] + self.coupling[i] * d) * self.step;
        }
        let (length, most) = (dot(x, x).sqrt(), mu * n);
        let scale = R::select(length.gt(most), most / R::select(length.gt(R::zero()), length, R::one()), R::one());
        for x in &mut x {
            *x *= scale;
        }
        self.impulse(n, x, active)
    }

    #[inline(always)]
    fn fixed_directions(&self, g: [R; N], trace: R) -> Option<[[R; N]; 2]> {
        // The principal values are bounded by this floor. The trace of the caller has another rounding error.
        let floor = least_tangent(trace) * R::of(1.0 + 8.0 * <R::Scalar as Scalar>::EPSILON.to_f64());
        let (offsets, mut any) = (in_axes(&self.axes, tangential(g)), R::Mask::splat(false));
        let mut out = [[R::zero(); N]; 2];
        for i in 0..T {
            let fixed = self.a[i].le(floor);
            any = any.or(fixed);
            out[0][i + 1] = masked(fixed, offsets[i] - self.coupling[i] * g[0]);
            out[1][i + 1] = masked(fixed, self.coupling[i]);
        }
        any.any().then_some(out)
    }

    #[inline(always)]
    fn mobility(&self, step: &NaturalStep<R>) -> R {
        step.inv_rho
    }

    #[inline(always)]
    fn damp(&mut self, compliance: R, step: &mut NaturalStep<R>) {
        self.add_compliance([compliance; 2]);
        step.inv_rho += compliance * step.mobility_ratio;
        step.rho = R::one() / step.inv_rho;
    }

    #[inline(always)]
    fn add_normal_compliance(&mut self, compliance: R) -> R {
        self.add_compliance([compliance, R::zero()])
    }
}

/// Largest number of iterations of Jacobi's method over all pairs of axes. The method converges quadratically: five dimensions take four to
/// five iterations to the last digit.
const JACOBI: usize = 5;

/// Dot product of two vectors with an entry for each tangential row.
#[inline(always)]
fn dot<R: Real, const T: usize>(a: [R; T], b: [R; T]) -> R {
    let mut sum = a[0] * b[0];
    for i in 1..T {
        sum += a[i] * b[i];
    }
    sum
}

/// Tangential part, without the normal row, of a vector with an entry for each row of a contact.
#[inline(always)]
fn tangential<R: Real, const N: usize, const T: usize>(x: [R; N]) -> [R; T] {
    let mut out = [R::zero(); T];
    out.copy_from_slice(&x[1..]);
    out
}

/// Components of the tangential vector `x` along the principal axes `axes`.
#[inline(always)]
fn in_axes<R: Real, const T: usize>(axes: &[[R; T]; T], x: [R; T]) -> [R; T] {
    let mut out = [R::zero(); T];
    for i in 0..T {
        out[i] = dot(axes[i], x);
    }
    out
}

/// Principal axes of a symmetric matrix, which is diagonalised by Jacobi's cyclic method (Golub & Van Loan 2013, section 8.5).
///
/// A pair of axes is not rotated if the square of the cosine between them, in the metric of the matrix, is below epsilon^(3/2). Such a
/// rotation would be rounding error. `m` becomes diagonal.
#[inline(always)]
fn principal_axes<R: Real, const T: usize>(m: &mut [[R; T]; T]) -> [[R; T]; T] {
    let mut axes = [[R::zero(); T]; T];
    for i in 0..T {
        axes[i][i] = R::one();
    }
    let epsilon = <R::Scalar as Scalar>::EPSILON.to_f64();
    let aligned = R::of(epsilon * epsilon.sqrt());
    for _ in 0..JACOBI {
        for p in 0..T {
            for q in p + 1..T {
                rotate(m, &mut axes, p, q, aligned);
            }
        }
    }
    axes
}

/// Rotates the axes p and q so that `m[p][q]` becomes zero. Lanes in which the square of the cosine between the axes, in the metric `m`, is
/// at most `aligned` do not rotate.
#[inline(always)]
fn rotate<R: Real, const T: usize>(m: &mut [[R; T]; T], axes: &mut [[R; T]; T], p: usize, q: usize, aligned: R) {
    let off = m[p][q];
    let apart = (off * off).gt(m[p][p] * m[q][q] * aligned);
    if apart.none() {
        return;
    }
    let half = (m[q][q] - m[p][p]) * R::of(0.5);
    let root = (half * half + off * off).sqrt().copysign(half);
    // The smaller of the two possible tangents of the rotation angle. It is zero in lanes that do not rotate.
    let below = half + root;
    let there = apart.and(below.abs().gt(R::zero()));
    let tan = masked(there, off / R::select(there, below, R::one()));
    let cos = R::one() / (R::one() + tan * tan).sqrt();
    let sin = tan * cos;
    for k in 0..T {
        let (a, b) = (m[k][p], m[k][q]);
        m[k][p] = cos * a - sin * b;
        m[k][q] = sin * a + cos * b;
    }
    for k in 0..T {
        let (a, b) = (m[p][k], m[q][k]);
        m[p][k] = cos * a - sin * b;
        m[q][k] = sin * a + cos * b;
        let (a, b) = (axes[p][k], axes[q][k]);
        axes[p][k] = cos * a - sin * b;
        axes[q][k] = sin * a + cos * b;
    }
}

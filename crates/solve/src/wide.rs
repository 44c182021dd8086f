//! One contact with torsional and rolling friction: rows (n, t1, t2, spin, roll1, roll2).
//!
//! MuJoCo's elliptic cone, sqrt(sum (f_i / mu_i)^2) <= f_n, becomes the circular one |x_t| <= mu x_n in five dimensions when row i is
//! multiplied by mu_i / mu: f_i = (mu_i / mu) x_i, and all velocities are in m/s. Coulomb's law (maximal dissipation) is the same in both,
//! because f . v = x . v'. A kind of friction that the contact lacks is a row of zeros.

use std::ops::Range;

use crate::aside::Order;
use crate::cone::{keep, movable, positive};
use crate::contact::{MAX_NEWTON, least_tangent, near};
use stepper_real::{Mask, Real, Scalar};

/// Tangential rows.
const T: usize = 5;

/// A contact with six rows.
///
/// As in [`ContactBlock`](crate::ContactBlock) the normal impulse is eliminated and `A x_t + c = -s x_t` is solved in the principal axes of
/// A, here five, found by Jacobi's method. The model `nn (k k^T) + Q diag(a) Q^T` of the tangential block is used for the update only: at
/// its fixed point the law holds for the velocities themselves, however precise the axes are.
#[derive(Clone, Debug)]
pub struct WideBlock<R: Real> {
    pub(crate) support: Range<usize>,
    pub(crate) y: usize,
    /// Lanes in which the contact exists.
    pub active: R::Mask,
    /// Lanes in which there is a contact along whose normal nothing can move: it has no rows, and its impulse stays.
    pub held: R::Mask,
    /// Coefficient of friction of the scaled rows.
    pub mu: R,
    /// Velocity before any impulse, with the bias of the normal row, m/s.
    pub g: [R; 6],
    /// Compliance R, at least 0: the velocity that every row gives way by per unit of impulse. 0 is hard.
    pub(crate) compliance: R,
    inv_gnn: R,
    nn: R,
    /// Principal axes of A, one after the other.
    axes: [[R; T]; T],
    /// Principal values of A, bounded away from zero, and their inverses.
    a: [R; T],
    inv_a: [R; T],
    /// G_tn / G_nn in the principal axes.
    coupling: [R; T],
    /// Step of the weaker update.
    step: R,
    /// Step of the natural map, 6 / trace(G).
    pub(crate) rho: R,
    /// Its inverse.
    pub(crate) inv_rho: R,
    /// So many times what is left of trace(G) it was before separate rows were taken out.
    pub(crate) whole: R,
}

impl<R: Real> WideBlock<R> {
    /// `gram` is G, of which the upper triangle is read; `least` is the mobility along the normal below which nothing moves, 1/kg.
    #[inline(always)]
    pub(crate) fn new(support: Range<usize>, y: usize, gram: &[[R; 6]; 6], active: R::Mask, mu: R, g: [R; 6], least: R) -> Self {
        let sliding = gram[0][0] + gram[1][1] + gram[2][2];
        let exists = movable(active, gram[0][0], sliding, least);
        let nn = R::select(exists, gram[0][0], R::one());
        let inv_gnn = R::one() / nn;
        let (mut trace, mut k, mut matrix) = (nn, [R::zero(); T], [[R::zero(); T]; T]);
        for i in 0..T {
            k[i] = keep(exists, gram[0][i + 1]) * inv_gnn;
            trace += keep(exists, gram[i + 1][i + 1]);
        }
        for i in 0..T {
            for j in i..T {
                matrix[i][j] = keep(exists, gram[i + 1][j + 1]) - k[i] * k[j] * nn;
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
        let coupling = turn(&axes, k);
        let step = R::one() / (largest + nn * dot(coupling, coupling));
        let (rho, inv_rho) = (R::of(6.0) / trace, trace * R::of(1.0 / 6.0));
        let (held, compliance, whole) = (active.and_not(exists), R::zero(), R::one());
        Self { support, y, active: exists, held, mu, g, compliance, inv_gnn, nn, axes, a, inv_a, coupling, step, rho, inv_rho, whole }
    }

    /// Mean diagonal entry of G, before separate rows were taken out of it.
    #[inline(always)]
    pub(crate) fn mobility(&self) -> R {
        self.inv_rho
    }

    /// Gives all rows the compliance R, where the impulse `lambda` costs nothing. The principal axes stay: they serve the update alone.
    #[inline(always)]
    pub(crate) fn damp(&mut self, compliance: R, lambda: [R; 6]) {
        self.compliance = compliance;
        for k in 0..6 {
            self.g[k] -= compliance * lambda[k];
        }
        let nn = self.nn;
        self.nn += compliance;
        self.inv_gnn = R::one() / self.nn;
        let (share, mut largest) = (nn * self.inv_gnn, R::zero());
        for i in 0..T {
            // Of the tangential block, what the normal impulse no longer takes away.
            let freed = self.coupling[i] * self.coupling[i] * nn * (R::one() - share);
            self.a[i] += compliance + freed;
            self.inv_a[i] = R::one() / self.a[i];
            self.coupling[i] *= share;
            largest = largest.max(self.a[i]);
        }
        self.step = R::one() / (largest + self.nn * dot(self.coupling, self.coupling));
        self.inv_rho += compliance * self.whole;
        self.rho = R::one() / self.inv_rho;
    }

    /// The part of some lanes.
    #[inline(always)]
    pub(crate) fn pick(&self, order: &Order) -> WideBlock<R::Half> {
        let mut axes = [[R::Half::zero(); T]; T];
        for i in 0..T {
            axes[i] = order.pick_each(&self.axes[i]);
        }
        WideBlock {
            support: self.support.clone(),
            y: self.y,
            active: order.pick_mask::<R>(self.active),
            held: order.pick_mask::<R>(self.held),
            mu: order.pick(self.mu),
            g: order.pick_each(&self.g),
            compliance: order.pick(self.compliance),
            inv_gnn: order.pick(self.inv_gnn),
            nn: order.pick(self.nn),
            axes,
            a: order.pick_each(&self.a),
            inv_a: order.pick_each(&self.inv_a),
            coupling: order.pick_each(&self.coupling),
            step: order.pick(self.step),
            rho: order.pick(self.rho),
            inv_rho: order.pick(self.inv_rho),
            whole: order.pick(self.whole),
        }
    }

    /// The impulse that solves this contact alone, when `v` is its velocity under the impulse `lambda`; with the multiplier s of its
    /// friction disc (0 where it sticks or opens). `guess` starts the search.
    #[inline(always)]
    pub(crate) fn solve(&self, v: [R; 6], lambda: [R; 6], guess: R, lanes: R::Mask) -> ([R; 6], R) {
        let (vt, xt) = (turn(&self.axes, tail(v)), turn(&self.axes, tail(lambda)));
        let push = lambda[0] + dot(self.coupling, xt) - v[0] * self.inv_gnn;
        let closing = positive(lanes, push);
        let (mut p, mut stick) = ([R::zero(); T], [R::zero(); T]);
        for i in 0..T {
            p[i] = vt[i] - self.a[i] * xt[i] - self.coupling[i] * v[0];
            stick[i] = -p[i] * self.inv_a[i];
        }
        let held = push - dot(self.coupling, stick);
        let bound = (self.mu * held).max(R::zero());
        let slides = closing.and_not(dot(stick, stick).le(bound * bound));
        let (mut x, mut n, mut s) = (stick, held, R::zero());
        if slides.any() {
            let slip = self.slip(p, push, guess, slides);
            for i in 0..T {
                x[i] = R::select(slides, slip.x[i], x[i]);
            }
            n = R::select(slides, slip.n, n);
            s = keep(slides, slip.s);
        }
        (self.impulse(keep(closing, n), x, closing), s)
    }

    /// A weaker update that cycles less, as that of [`ContactBlock`](crate::ContactBlock).
    #[inline(always)]
    pub(crate) fn relax(&self, v: [R; 6], lambda: [R; 6]) -> [R; 6] {
        let (vt, xt) = (turn(&self.axes, tail(v)), turn(&self.axes, tail(lambda)));
        let n = (lambda[0] - v[0] * self.inv_gnn).max(R::zero());
        let d = (n - lambda[0]) * self.nn;
        let mut x = xt;
        for i in 0..T {
            x[i] -= (vt[i] + self.coupling[i] * d) * self.step;
        }
        let (length, most) = (dot(x, x).sqrt(), self.mu * n);
        let scale = R::select(length.gt(most), most / R::select(length.gt(R::zero()), length, R::one()), R::one());
        for x in &mut x {
            *x *= scale;
        }
        self.impulse(n, x, self.active)
    }

    /// Normal impulse and tangential one in the principal axes, in the contact's rows; nothing outside `lanes`.
    #[inline(always)]
    fn impulse(&self, n: R, x: [R; T], lanes: R::Mask) -> [R; 6] {
        let mut out = [n, R::zero(), R::zero(), R::zero(), R::zero(), R::zero()];
        for (axis, &x) in self.axes.iter().zip(&x) {
            for i in 0..T {
                out[i + 1] += axis[i] * keep(lanes, x);
            }
        }
        out
    }

    /// The impulse at the s > 0 at which |x(s)| = mu n(s), in the lanes `todo`: Newton's method on mu n / |x| = 1 inside a bracket, as exact
    /// as that of [`ContactBlock`](crate::ContactBlock).
    #[inline(always)]
    fn slip(&self, p: [R; T], push: R, guess: R, mut todo: R::Mask) -> Slip<R> {
        let zero = R::zero();
        let near = near::<R>();
        let unbounded = R::of(f64::INFINITY);
        let (mut lo, mut hi, mut s) = (zero, unbounded, guess);
        for _ in 0..MAX_NEWTON {
            let (rate, x, n) = self.sliding(p, push, s);
            let length2 = dot(x, x);
            let length = length2.sqrt();
            let excess = self.mu * n - length;
            let low = excess.lt(zero);
            lo = R::select(low, s, lo);
            hi = R::select(low, hi, s);
            // The derivative of mu n / |x| over s, times |x|^3 / mu.
            let slope = dot(self.coupling, rate) * length2 + n * dot(x, rate);
            let newton = s - excess * length2 / (self.mu * slope);
            let bisect = R::select(hi.lt(unbounded), (lo + hi) * R::of(0.5), s + s + self.nn);
            let inside = newton.ge(lo).and(newton.le(hi)).and(newton.lt(unbounded));
            s = R::select(todo, R::select(inside, newton, bisect), s);
            todo = todo.and_not(excess.abs().le(near * length));
            if todo.none() {
                break;
            }
        }
        // What Newton's method left is removed by scaling, so that the impulse is on its cone.
        let (_, mut x, n) = self.sliding(p, push, s);
        let n = n.max(zero);
        let length = dot(x, x).sqrt();
        let scale = self.mu * n / R::select(length.gt(zero), length, R::one());
        for x in &mut x {
            *x *= scale;
        }
        Slip { x, n, s }
    }

    /// At the multiplier s: what the tangential impulse loses per s, that impulse, the normal one.
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
}

/// A sliding contact: tangential impulse in the principal axes of A, normal impulse, multiplier of the friction disc.
struct Slip<R: Real> {
    x: [R; T],
    n: R,
    s: R,
}

/// Sweeps of Jacobi's method at the most: it converges quadratically, and five dimensions take four to five to the last digit.
const JACOBI: usize = 5;

#[inline(always)]
fn dot<R: Real>(a: [R; T], b: [R; T]) -> R {
    let mut sum = a[0] * b[0];
    for i in 1..T {
        sum += a[i] * b[i];
    }
    sum
}

/// The tangential rows.
#[inline(always)]
fn tail<R: Real>(x: [R; 6]) -> [R; T] {
    [x[1], x[2], x[3], x[4], x[5]]
}

/// Components of `x` along the axes.
#[inline(always)]
fn turn<R: Real>(axes: &[[R; T]; T], x: [R; T]) -> [R; T] {
    let mut out = [R::zero(); T];
    for i in 0..T {
        out[i] = dot(axes[i], x);
    }
    out
}

/// Makes a symmetric matrix diagonal by Jacobi's cyclic method (Golub & Van Loan 2013, section 8.5); returns its principal axes. Axes are left as
/// they are when the square of the cosine between them is below epsilon^(3/2): the next turn would be rounding.
#[inline(always)]
fn principal_axes<R: Real>(m: &mut [[R; T]; T]) -> [[R; T]; T] {
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

/// Turns the axes p and q so that m[p][q] becomes zero, where they are not `aligned`.
#[inline(always)]
fn rotate<R: Real>(m: &mut [[R; T]; T], axes: &mut [[R; T]; T], p: usize, q: usize, aligned: R) {
    let off = m[p][q];
    let apart = (off * off).gt(m[p][p] * m[q][q] * aligned);
    if apart.none() {
        return;
    }
    let half = (m[q][q] - m[p][p]) * R::of(0.5);
    let root = (half * half + off * off).sqrt().copysign(half);
    // The smaller of the two tangents; none where there is nothing to do.
    let below = half + root;
    let there = apart.and(below.abs().gt(R::zero()));
    let tan = keep(there, off / R::select(there, below, R::one()));
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

//! One contact: its 3 x 3 block of G, prepared once, and the exact solution of its own Coulomb problem.

use std::ops::Range;

use crate::aside::Order;
use crate::cone::{keep, movable, norm2};
use stepper_real::{Mask, Real, Scalar};

/// A contact with friction: rows (n, t1, t2).
///
/// With the normal impulse eliminated, the tangential problem is `A lambda_t + c = -s lambda_t`, where
/// `A = G_tt - G_tn G_nt / G_nn`. It is solved in the principal axes of A, where it is two independent scalar equations coupled by s.
#[derive(Clone, Debug)]
pub struct ContactBlock<R: Real> {
    pub(crate) support: Range<usize>,
    pub(crate) y: usize,
    /// Lanes in which the contact exists.
    pub active: R::Mask,
    /// Lanes in which there is a contact along whose normal nothing can move: it has no rows, and its impulse stays.
    pub held: R::Mask,
    /// Coefficient of friction; 0 for a frictionless contact.
    pub mu: R,
    /// Velocity before any impulse, with the bias of the normal row, m/s.
    pub g: [R; 3],
    /// Compliance R, at least 0: the velocity that every row gives way by per unit of impulse. 0 is hard.
    pub(crate) compliance: R,
    /// G_nn, G_na, G_nb, G_aa, G_ab, G_bb, compliance included.
    gram: [R; 6],
    inv_gnn: R,
    /// Principal axis of A: (cos, sin).
    axis: [R; 2],
    /// Principal values of A, bounded away from zero, and their inverses.
    a: [R; 2],
    inv_a: [R; 2],
    /// G_tn / G_nn in the principal axes.
    coupling: [R; 2],
    /// Step of the natural map, 3 / trace(G).
    pub(crate) rho: R,
    /// Its inverse.
    pub(crate) inv_rho: R,
    /// So many times what is left of trace(G) it was before separate rows were taken out.
    pub(crate) whole: R,
}

impl<R: Real> ContactBlock<R> {
    /// `least` is the mobility along the normal below which nothing moves, 1/kg.
    #[inline(always)]
    pub(crate) fn new(support: Range<usize>, y: usize, gram: [R; 6], active: R::Mask, mu: R, g: [R; 3], least: R) -> Self {
        // Lanes without this contact get the identity block, so that nothing below divides by zero.
        let exists = movable(active, gram[0], gram[0] + gram[3] + gram[5], least);
        let identity = [R::one(), R::zero(), R::zero(), R::one(), R::zero(), R::one()];
        let mut block = identity;
        for i in 0..6 {
            block[i] = R::select(exists, gram[i], identity[i]);
        }
        let mut made = Self {
            support,
            y,
            active: exists,
            held: active.and_not(exists),
            mu,
            g,
            compliance: R::zero(),
            gram: block,
            inv_gnn: R::one(),
            axis: [R::one(), R::zero()],
            a: [R::one(); 2],
            inv_a: [R::one(); 2],
            coupling: [R::zero(); 2],
            rho: R::one(),
            inv_rho: R::one(),
            whole: R::one(),
        };
        made.prepare();
        made
    }

    /// Makes what the exact solution needs of the block of G.
    #[inline(always)]
    fn prepare(&mut self) {
        let [nn, na, nb, aa, ab, bb] = self.gram;
        let inv_gnn = R::one() / nn;
        let trace = nn + aa + bb;

        let (a11, a12, a22) = (aa - na * na * inv_gnn, ab - na * nb * inv_gnn, bb - nb * nb * inv_gnn);
        let (mean, half) = ((a11 + a22) * R::of(0.5), (a11 - a22) * R::of(0.5));
        let radius = norm2(half, a12);
        let round = radius.le(R::of(<R::Scalar as Scalar>::EPSILON.to_f64()) * trace);
        let ratio = half / R::select(round, R::one(), radius);
        let cos = R::select(round, R::one(), ((R::one() + ratio).max(R::zero()) * R::of(0.5)).sqrt());
        let sin = keep(round.not(), ((R::one() - ratio).max(R::zero()) * R::of(0.5)).sqrt()).copysign(a12);

        let floor = least_tangent(trace);
        let major = (mean + radius).max(floor);
        let minor = ((a11 * a22 - a12 * a12) / major).max(floor);
        let (ca, cb) = (na * inv_gnn, nb * inv_gnn);
        self.inv_gnn = inv_gnn;
        self.axis = [cos, sin];
        self.a = [major, minor];
        self.inv_a = [R::one() / major, R::one() / minor];
        self.coupling = [cos * ca + sin * cb, cos * cb - sin * ca];
        self.rho = R::of(3.0) / trace;
        self.inv_rho = trace * R::of(1.0 / 3.0);
    }

    /// Mean diagonal entry of G, before separate rows were taken out of it.
    #[inline(always)]
    pub(crate) fn mobility(&self) -> R {
        (self.gram[0] + self.gram[3] + self.gram[5]) * self.whole * R::of(1.0 / 3.0)
    }

    /// Gives all rows the compliance R, where the impulse `lambda` costs nothing.
    #[inline(always)]
    pub(crate) fn damp(&mut self, compliance: R, lambda: [R; 3]) {
        self.compliance = compliance;
        for k in 0..3 {
            self.g[k] -= compliance * lambda[k];
        }
        for k in [0, 3, 5] {
            self.gram[k] += compliance;
        }
        self.prepare();
        (self.rho, self.inv_rho) = (self.rho / self.whole, self.inv_rho * self.whole);
    }

    /// The part of some lanes.
    #[inline(always)]
    pub(crate) fn pick(&self, order: &Order) -> ContactBlock<R::Half> {
        ContactBlock {
            support: self.support.clone(),
            y: self.y,
            active: order.pick_mask::<R>(self.active),
            held: order.pick_mask::<R>(self.held),
            mu: order.pick(self.mu),
            g: order.pick_each(&self.g),
            compliance: order.pick(self.compliance),
            gram: order.pick_each(&self.gram),
            inv_gnn: order.pick(self.inv_gnn),
            axis: order.pick_each(&self.axis),
            a: order.pick_each(&self.a),
            inv_a: order.pick_each(&self.inv_a),
            coupling: order.pick_each(&self.coupling),
            rho: order.pick(self.rho),
            inv_rho: order.pick(self.inv_rho),
            whole: order.pick(self.whole),
        }
    }

    /// The impulse that solves this contact alone, when `v` is its velocity under the impulse `lambda`, compliance included; with the multiplier s of its
    /// friction disc (0 where it sticks or opens).
    ///
    /// Sliding is Newton's method on `mu lambda_n(s) / |lambda_t(s)| = 1`, which is linear in s when A is round and uncoupled, kept
    /// inside a bracket; `guess` starts it.
    #[inline(always)]
    pub(crate) fn solve(&self, v: [R; 3], lambda: [R; 3], guess: R, lanes: R::Mask) -> ([R; 3], R) {
        let zero = R::zero();
        let [nn, na, nb, aa, ab, bb] = self.gram;
        let c = [
            v[0] - (nn * lambda[0] + na * lambda[1] + nb * lambda[2]),
            v[1] - (na * lambda[0] + aa * lambda[1] + ab * lambda[2]),
            v[2] - (nb * lambda[0] + ab * lambda[1] + bb * lambda[2]),
        ];
        let closing = lanes.and(c[0].lt(zero));
        let push = -c[0] * self.inv_gnn;
        let (t1, t2) = (c[1] + na * push, c[2] + nb * push);
        let [cos, sin] = self.axis;
        let p = [cos * t1 + sin * t2, cos * t2 - sin * t1];

        // Sticking is s = 0; it needs no division and no root.
        let stick = [-p[0] * self.inv_a[0], -p[1] * self.inv_a[1]];
        let held = push - (self.coupling[0] * stick[0] + self.coupling[1] * stick[1]);
        let rubs = self.mu.gt(zero);
        let bound = (self.mu * held).max(zero);
        let sticks = (stick[0] * stick[0] + stick[1] * stick[1]).le(bound * bound);
        let slides = closing.and(rubs).and_not(sticks);
        let (mut x, mut n, mut s) = (stick, R::select(rubs, held, push), zero);
        if slides.any() {
            let slip = self.slip([p[0], p[1]], push, guess, slides);
            x = [R::select(slides, slip.x[0], x[0]), R::select(slides, slip.x[1], x[1])];
            n = R::select(slides, slip.n, n);
            s = keep(slides, slip.s);
        }
        let x = [keep(rubs, x[0]), keep(rubs, x[1])];
        ([keep(closing, n), keep(closing, cos * x[0] - sin * x[1]), keep(closing, sin * x[0] + cos * x[1])], s)
    }

    /// A weaker update that cycles less: the normal impulse with the tangential one held, then the tangential one projected on the disc that
    /// the normal one leaves it.
    #[inline(always)]
    pub(crate) fn relax(&self, v: [R; 3], lambda: [R; 3]) -> [R; 3] {
        let zero = R::zero();
        let [_, na, nb, aa, ab, bb] = self.gram;
        let n = (lambda[0] - v[0] * self.inv_gnn).max(zero);
        let d = n - lambda[0];
        let half = (aa - bb) * R::of(0.5);
        let step = R::one() / ((aa + bb) * R::of(0.5) + norm2(half, ab)).max(least_tangent(self.gram[0] + aa + bb));
        let x = [lambda[1] - (v[1] + na * d) * step, lambda[2] - (v[2] + nb * d) * step];
        let (length, most) = (norm2(x[0], x[1]), self.mu * n);
        let scale = R::select(length.gt(most), most / R::select(length.gt(zero), length, R::one()), R::one());
        [n, x[0] * scale, x[1] * scale]
    }

    /// The impulse at the s > 0 at which |lambda_t(s)| = mu lambda_n(s), in the lanes `todo`.
    ///
    /// A step beyond [`near`] is the last, and its error is not looked at.
    #[inline(always)]
    fn slip(&self, p: [R; 2], push: R, guess: R, mut todo: R::Mask) -> Slip<R> {
        let zero = R::zero();
        let near = near::<R>();
        let unbounded = R::of(f64::INFINITY);
        let (mut lo, mut hi, mut s) = (zero, unbounded, guess);
        for _ in 0..MAX_NEWTON {
            let Sliding { x, n, dn, .. } = self.sliding(p, push, s);
            let length2 = x[0] * x[0] + x[1] * x[1];
            let length = length2.sqrt();
            let excess = self.mu * n - length;
            let low = excess.lt(zero);
            lo = R::select(low, s, lo);
            hi = R::select(low, hi, s);
            // The derivative of mu n / |x| over s, times |x|^3 / mu.
            let slope = dn * length2 + n * (x[0] * p[0] + x[1] * p[1]);
            let newton = s - excess * length2 / (self.mu * slope);
            let bisect = R::select(hi.lt(unbounded), (lo + hi) * R::of(0.5), s + s + self.a[0]);
            let inside = newton.ge(lo).and(newton.le(hi)).and(newton.lt(unbounded));
            s = R::select(todo, R::select(inside, newton, bisect), s);
            todo = todo.and_not(excess.abs().le(near * length));
            if todo.none() {
                break;
            }
        }
        // What Newton's method left is removed by scaling, so that the impulse is on its cone.
        let Sliding { x, n, d, .. } = self.sliding(p, push, s);
        let n = (n / d).max(zero);
        let length = norm2(x[0], x[1]);
        let scale = self.mu * n / R::select(length.gt(zero), length, R::one());
        Slip { x: [x[0] * scale, x[1] * scale], n, s }
    }

    /// The impulse at the multiplier s, without a division.
    #[inline(always)]
    fn sliding(&self, p: [R; 2], push: R, s: R) -> Sliding<R> {
        let (d0, d1) = (self.a[0] + s, self.a[1] + s);
        let d = d0 * d1;
        let x = [-p[0] * d1, -p[1] * d0];
        let n = push * d - (self.coupling[0] * x[0] + self.coupling[1] * x[1]);
        let dn = push * (d0 + d1) + (self.coupling[0] * p[0] + self.coupling[1] * p[1]);
        Sliding { x, n, dn, d }
    }
}

/// A sliding contact at some multiplier s: its impulse, times d.
struct Sliding<R: Real> {
    /// Tangential, in the principal axes of A; its derivative over s is -p.
    x: [R; 2],
    /// Normal.
    n: R,
    /// Its derivative over s.
    dn: R,
    /// det(A + s).
    d: R,
}

/// A sliding contact: tangential impulse in the principal axes of A, normal impulse, multiplier of the friction disc.
struct Slip<R: Real> {
    x: [R; 2],
    n: R,
    s: R,
}

/// The least tangential mobility of a contact whose block has the trace `trace`, 1/kg.
///
/// A direction in which the contact cannot move (a planar mechanism) has a zero principal value: a floor below most physical ratios, and far above the
/// rounding of the entries, keeps its impulse at zero instead of 0/0. It bounds a step, not the answer: what can move less takes more sweeps.
/// Where a cylinder is braked in line with both of its axes a floor of 2e-11 made impulses of 1e8 N s of rounding.
#[inline(always)]
pub(crate) fn least_tangent<R: Real>(trace: R) -> R {
    trace * R::of(f64::max(1e-8, <R::Scalar as Scalar>::EPSILON.to_f64() * 1e5))
}

/// Newton steps of a sliding contact; one to three are usual, the rest is for bisection to rescue a poor start.
pub(crate) const MAX_NEWTON: usize = 24;

/// How far from its cone, as a part of its length, a sliding impulse may be before the last Newton step, which squares it: four roots of the
/// rounding.
#[inline(always)]
pub(crate) fn near<R: Real>() -> R {
    R::of(4.0 * <R::Scalar as Scalar>::EPSILON.to_f64().sqrt())
}

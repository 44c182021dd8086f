//! Contacts with sliding friction: the contact's 3 x 3 block of the Delassus matrix G, prepared once, and the exact solution of a single
//! contact.

use crate::cone::{masked, norm2};
use crate::constraints::local_solver::{LocalSolver, NaturalStep, least_tangent, slip_multiplier};
use stepper_real::{Mask, Real, Scalar};

/// Solver of a single contact with sliding friction, in closed form except for one scalar equation.
///
/// With the normal impulse eliminated, the tangential problem is `A lambda_t + c = -s lambda_t`, where `A = G_tt - G_tn G_nt / G_nn`. G is
/// the contact's block of the Delassus matrix, and c the tangential velocity without tangential impulse. The multiplier s is slip velocity
/// divided by friction impulse. In the principal axes of A the problem is two independent scalar equations coupled by s.
#[derive(Clone, Copy, Debug)]
pub struct SlidingSolver<R: Real> {
    /// Entries G_nn, G_na, G_nb, G_aa, G_ab, G_bb of the contact's block of the Delassus matrix, compliance included, 1/kg. The indices are
    /// the normal n and the two tangents a and b.
    gram: [R; 6],
    /// Compliance of the contact's normal row alone, 1/kg. The row's diagonal entry of the Delassus matrix includes it, although it is not
    /// a mobility of the bodies.
    normal_compliance: R,
    /// Inverse 1 / G_nn of the normal row's diagonal entry of the Delassus matrix, kg.
    inv_gnn: R,
    /// First principal axis (cos, sin) of the matrix A that relates the tangential impulse to the tangential velocity.
    axis: [R; 2],
    /// Principal values of the tangential matrix A, bounded away from zero, 1/kg.
    a: [R; 2],
    /// Inverses of the principal values of the tangential matrix A, kg.
    inv_a: [R; 2],
    /// Coupling G_tn / G_nn of the tangential rows t and the normal row n of the contact's Delassus block G, in the principal axes of the
    /// tangential matrix.
    coupling: [R; 2],
}

impl<R: Real> SlidingSolver<R> {
    /// Computes the coefficients of the exact solution from the contact's block of the Delassus matrix. Returns the trace of the block
    /// without the compliance of the normal row, 1/kg.
    #[inline(always)]
    fn prepare(&mut self) -> R {
        let [nn, na, nb, aa, ab, bb] = self.gram;
        let inv_gnn = R::one() / nn;
        let trace = nn + aa + bb - self.normal_compliance;

        let (a11, a12, a22) = (aa - na * na * inv_gnn, ab - na * nb * inv_gnn, bb - nb * nb * inv_gnn);
        let (mean, half) = ((a11 + a22) * R::of(0.5), (a11 - a22) * R::of(0.5));
        let radius = norm2(half, a12);
        let round = radius.le(R::of(<R::Scalar as Scalar>::EPSILON.to_f64()) * trace);
        let ratio = half / R::select(round, R::one(), radius);
        let cos = R::select(round, R::one(), ((R::one() + ratio).max(R::zero()) * R::of(0.5)).sqrt());
        let sin = masked(round.not(), ((R::one() - ratio).max(R::zero()) * R::of(0.5)).sqrt()).copysign(a12);

        let floor = least_tangent(trace);
        let major = (mean + radius).max(floor);
        let minor = ((a11 * a22 - a12 * a12) / major).max(floor);
        let (ca, cb) = (na * inv_gnn, nb * inv_gnn);
        self.inv_gnn = inv_gnn;
        self.axis = [cos, sin];
        self.a = [major, minor];
        self.inv_a = [R::one() / major, R::one() / minor];
        self.coupling = [cos * ca + sin * cb, cos * cb - sin * ca];
        trace
    }

    /// Impulse of a slipping contact in the lanes `todo`, at the multiplier s > 0 for which |lambda_t(s)| = mu lambda_n(s).
    ///
    /// `push` is the normal impulse, N s, and `p` the tangential velocity in the principal axes, m/s, both without any tangential impulse.
    /// The search for the multiplier starts at `guess`. The function returns the tangential impulse in the principal axes, the normal
    /// impulse, and the multiplier.
    #[inline(always)]
    fn slip(&self, mu: R, p: [R; 2], push: R, guess: R, todo: R::Mask) -> ([R; 2], R, R) {
        let s = slip_multiplier(
            mu,
            guess,
            self.a[0],
            todo,
            #[inline(always)]
            |s| {
                let Sliding { x, n, dn, .. } = self.sliding(p, push, s);
                let square = x[0] * x[0] + x[1] * x[1];
                [square, n, dn * square + n * (x[0] * p[0] + x[1] * p[1])]
            },
        );
        // Scaling removes the remaining error of Newton's method, so that the impulse is on its cone.
        let Sliding { x, n, d, .. } = self.sliding(p, push, s);
        let n = (n / d).max(R::zero());
        let length = norm2(x[0], x[1]);
        let scale = mu * n / R::select(length.gt(R::zero()), length, R::one());
        ([x[0] * scale, x[1] * scale], n, s)
    }

    /// Impulse of a slipping contact at the multiplier s of its friction disc, times det(A + s), so that no division is needed.
    ///
    /// `push` is the normal impulse, N s, and `p` the tangential velocity in the principal axes, m/s, both without any tangential impulse.
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

impl<R: Real> LocalSolver<R, 3> for SlidingSolver<R> {
    #[inline(always)]
    fn new(gram: &[[R; 3]; 3], active: R::Mask) -> (Self, R) {
        // Other lanes get the identity as a block, so that nothing below divides by zero.
        let [[nn, na, nb], [_, aa, ab], [_, _, bb]] = *gram;
        let (gram, identity) = ([nn, na, nb, aa, ab, bb], [R::one(), R::zero(), R::zero(), R::one(), R::zero(), R::one()]);
        let mut block = identity;
        for i in 0..6 {
            block[i] = R::select(active, gram[i], identity[i]);
        }
        let mut solver = Self {
            gram: block,
            normal_compliance: R::zero(),
            inv_gnn: R::one(),
            axis: [R::one(), R::zero()],
            a: [R::one(); 2],
            inv_a: [R::one(); 2],
            coupling: [R::zero(); 2],
        };
        let trace = solver.prepare();
        (solver, trace)
    }

    /// Solution for one contact. A slipping contact is solved by Newton's method on `mu lambda_n(s) / |lambda_t(s)| = 1`, inside a bracket
    /// and from `guess`. The equation is linear in s if A is isotropic and uncoupled.
    #[inline(always)]
    fn solve(&self, mu: R, v: [R; 3], lambda: [R; 3], guess: R, lanes: R::Mask) -> ([R; 3], R) {
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

        // A sticking contact has s = 0, which needs no division and no root.
        let stick = [-p[0] * self.inv_a[0], -p[1] * self.inv_a[1]];
        let sticking = push - (self.coupling[0] * stick[0] + self.coupling[1] * stick[1]);
        let has_friction = mu.gt(zero);
        let bound = (mu * sticking).max(zero);
        let sticks = (stick[0] * stick[0] + stick[1] * stick[1]).le(bound * bound);
        let slides = closing.and(has_friction).and_not(sticks);
        let (mut x, mut n, mut s) = (stick, R::select(has_friction, sticking, push), zero);
        if slides.any() {
            let slip = self.slip(mu, p, push, guess, slides);
            x = [R::select(slides, slip.0[0], x[0]), R::select(slides, slip.0[1], x[1])];
            n = R::select(slides, slip.1, n);
            s = masked(slides, slip.2);
        }
        let x = [masked(has_friction, x[0]), masked(has_friction, x[1])];
        ([masked(closing, n), masked(closing, cos * x[0] - sin * x[1]), masked(closing, sin * x[0] + cos * x[1])], s)
    }

    #[inline(always)]
    fn relax(&self, mu: R, v: [R; 3], lambda: [R; 3], _active: R::Mask) -> [R; 3] {
        let zero = R::zero();
        let [_, na, nb, aa, ab, bb] = self.gram;
        let n = (lambda[0] - v[0] * self.inv_gnn).max(zero);
        let d = n - lambda[0];
        let half = (aa - bb) * R::of(0.5);
        let step =
            R::one() / ((aa + bb) * R::of(0.5) + norm2(half, ab)).max(least_tangent(self.gram[0] + aa + bb - self.normal_compliance));
        let x = [lambda[1] - (v[1] + na * d) * step, lambda[2] - (v[2] + nb * d) * step];
        let (length, most) = (norm2(x[0], x[1]), mu * n);
        let scale = R::select(length.gt(most), most / R::select(length.gt(zero), length, R::one()), R::one());
        [n, x[0] * scale, x[1] * scale]
    }

    #[inline(always)]
    fn fixed_directions(&self, g: [R; 3], _trace: R) -> Option<[[R; 3]; 2]> {
        let [nn, na, nb, aa, _, bb] = self.gram;
        let (floor, [cos, sin]) = (least_tangent(nn + aa + bb - self.normal_compliance), self.axis);
        let fixed = [self.a[0].le(floor), self.a[1].le(floor)];
        if fixed[0].or(fixed[1]).none() {
            return None;
        }
        let (t1, t2) = (g[1] - na * self.inv_gnn * g[0], g[2] - nb * self.inv_gnn * g[0]);
        let p = [R::zero(), masked(fixed[0], cos * t1 + sin * t2), masked(fixed[1], cos * t2 - sin * t1)];
        Some([p, [R::zero(), masked(fixed[0], self.coupling[0]), masked(fixed[1], self.coupling[1])]])
    }

    #[inline(always)]
    fn mobility(&self, step: &NaturalStep<R>) -> R {
        (self.gram[0] + self.gram[3] + self.gram[5] - self.normal_compliance) * step.mobility_ratio * R::of(1.0 / 3.0)
    }

    #[inline(always)]
    fn damp(&mut self, compliance: R, step: &mut NaturalStep<R>) {
        for k in [0, 3, 5] {
            self.gram[k] += compliance;
        }
        *step = NaturalStep::of_trace::<3>(self.prepare()).with_mobility_ratio(step.mobility_ratio);
    }

    #[inline(always)]
    fn add_normal_compliance(&mut self, compliance: R) -> R {
        let before = self.gram[0];
        self.gram[0] += compliance;
        self.normal_compliance = compliance;
        self.prepare();
        before * self.inv_gnn
    }
}

/// Impulse of a slipping contact at a multiplier s of the friction disc, times det(A + s), so that no division is needed. A is the matrix
/// that relates the tangential impulse to the tangential velocity.
struct Sliding<R: Real> {
    /// Tangential impulse in the principal axes of the tangential matrix A, times det(A + s). Its derivative with respect to the multiplier
    /// s is -p, where p is the tangential velocity without any tangential impulse.
    x: [R; 2],
    /// Normal impulse of the contact, times the determinant det(A + s) of the tangential matrix A plus the multiplier s.
    n: R,
    /// Derivative of `n` (normal impulse times det(A + s), where A is the tangential matrix) with respect to the multiplier s of the
    /// friction disc.
    dn: R,
    /// Determinant det(A + s) of the tangential matrix A plus the multiplier s (slip velocity divided by friction impulse).
    d: R,
}

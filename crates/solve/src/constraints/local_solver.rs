//! Solution of one contact with friction, while all other impulses stay constant. This file has what does not depend on the number of
//! rows; `sliding.rs` has the solver of three rows, and `rolling.rs` that of four and six.

use std::fmt::Debug;

use stepper_real::{Mask, Real, Scalar};

/// Solver of one contact with friction, while the impulses of all other constraints stay constant. The admissible impulses are the circular
/// cone of Coulomb's law.
pub trait LocalSolver<R: Real, const N: usize>: Copy + Debug + Sized {
    /// Solver of a contact whose block of the Delassus matrix is `gram`, in the lanes `active`. The solver of other lanes is a placeholder.
    /// Only the upper triangle is read.
    ///
    /// Also returns the trace of the block, 1/kg.
    fn new(gram: &[[R; N]; N], active: R::Mask) -> (Self, R);

    /// Impulse that solves this contact, and the multiplier s of its friction disc (slip velocity divided by friction impulse, 1/kg), which
    /// is 0 for a contact that sticks or opens.
    ///
    /// `v` is the contact's velocity under the impulse `lambda`, including the velocity due to its compliance. `mu` is the friction
    /// coefficient. The search for s starts at `guess`. Outside the lanes `lanes`, the impulse and s are 0.
    fn solve(&self, mu: R, v: [R; N], lambda: [R; N], guess: R, lanes: R::Mask) -> ([R; N], R);

    /// Impulse by the weaker update, in the lanes `active`. The result has no meaning in other lanes. The weaker update changes the impulse
    /// less than [`LocalSolver::solve`], so that sweeps (Gauss-Seidel iterations) cycle less.
    ///
    /// The update changes the normal impulse at constant tangential impulse. Then it projects the tangential impulse on the disc of the new
    /// normal impulse.
    fn relax(&self, mu: R, v: [R; N], lambda: [R; N], active: R::Mask) -> [R; N];

    /// Directions of the tangential impulse, among the principal axes of the tangential problem, in which no impulse moves the contact.
    /// `None` if there are none in any lane.
    ///
    /// Each direction has an entry in the two results, from index 1 on. The first result has its velocity offset, m/s, with the normal
    /// impulse that stops the normal row. The second has its coupling G_tn / G_nn to the normal row. The entries of other directions are 0.
    /// `g` has the offsets of the rows, m/s, and `trace` is the trace of the contact's block of the Delassus matrix, 1/kg.
    fn fixed_directions(&self, g: [R; N], trace: R) -> Option<[[R; N]; 2]>;

    /// Mean diagonal entry of the contact's block of the Delassus matrix before elimination of equality rows, 1/kg. `step` is the step of
    /// the contact's natural map.
    fn mobility(&self, step: &NaturalStep<R>) -> R;

    /// Adds a compliance, 1/kg, to all rows of the contact, and updates the step of its natural map (`NaturalStep`).
    fn damp(&mut self, compliance: R, step: &mut NaturalStep<R>);

    /// Adds a compliance, 1/kg, to the normal row alone; the natural map does not change. Returns the ratio of the normal row's previous
    /// diagonal entry to the new one.
    fn add_normal_compliance(&mut self, compliance: R) -> R;
}

/// Step length rho of a contact's natural map, lambda - P_K(lambda - rho u) for the impulse lambda and the velocity u. P_K is the
/// projection on the admissible impulses. The map is zero at the solution.
#[derive(Clone, Copy, Debug)]
pub struct NaturalStep<R> {
    /// Step length rho = N / trace(G_ii), kg. N is the contact's number of rows, and G_ii its block of the Delassus matrix before
    /// elimination of equality rows.
    pub(super) rho: R,
    /// Inverse 1 / rho of the step length, 1/kg.
    pub(crate) inv_rho: R,
    /// Mobility of the contact before the elimination of equality rows, divided by that after it, at least 1. The mobility is trace(G_ii).
    pub(super) mobility_ratio: R,
}

impl<R: Real> NaturalStep<R> {
    /// Step of a contact with `N` rows, whose block of the Delassus matrix has the trace `trace`, 1/kg.
    #[inline(always)]
    pub(super) fn of_trace<const N: usize>(trace: R) -> Self {
        Self { rho: R::of(N as f64) / trace, inv_rho: trace * R::of(1.0 / N as f64), mobility_ratio: R::one() }
    }

    /// Step before elimination of equality rows, from `self`, which is the step after it. Before elimination, the trace of the contact's
    /// block of the Delassus matrix was larger by the factor `ratio`.
    #[inline(always)]
    pub(super) fn with_mobility_ratio(self, ratio: R) -> Self {
        Self { rho: self.rho / ratio, inv_rho: self.inv_rho * ratio, mobility_ratio: ratio }
    }
}

/// Least tangential mobility of a contact whose block of the Delassus matrix has the trace `trace`, 1/kg.
///
/// A direction in which the contact cannot move (in a planar mechanism) has zero mobility. The floor, a fraction of the trace, gives it
/// zero impulse instead of 0/0. The floor is far below most physical mobilities, and far above the rounding of the entries. The floor
/// bounds the change of the impulse in a sweep, and does not change the solution. Directions with less mobility than the floor take more
/// sweeps. For a cylinder that brakes in line with both of its axes, a floor of 2e-11 of the trace gave impulses of 1e8 N s, which were
/// rounding error.
///
/// Measured in 32 bits on 64 quadrupeds that step on flat ground: a floor of 1.2e-2 of the trace takes 8.7 sweeps per step. A foot moves a
/// hundred times more easily across its leg than along it. A floor of 1.2e-4 takes 2.6 sweeps, and 64 bits with 1e-8 take 3.1.
#[inline(always)]
pub(super) fn least_tangent<R: Real>(trace: R) -> R {
    trace * R::of(f64::max(1e-8, <R::Scalar as Scalar>::EPSILON.to_f64() * 1e3))
}

/// Largest number of iterations for the friction multiplier of a slipping contact. Each is a Newton step, or a bisection where a Newton
/// step would leave the interval that contains the solution. One to three iterations are usual; bisections from a poor start take more.
const MAX_NEWTON: usize = 24;

/// Relative error below which the Newton search for the impulse of a slipping contact makes its last step. The error is the distance of the
/// tangential impulse from the edge of the friction disc, divided by the tangential impulse.
///
/// A Newton step squares this distance. An accuracy of about the square root of the rounding error is therefore enough before the last
/// step.
#[inline(always)]
fn near<R: Real>() -> R {
    R::of(4.0 * <R::Scalar as Scalar>::EPSILON.to_f64().sqrt())
}

/// Multiplier s > 0 of the friction disc of a slipping contact, for which |x(s)| = mu n(s). Here x is the tangential and n the normal
/// impulse.
///
/// Newton's method solves mu n / |x| = 1 in the lanes `todo`, inside a bracket and from `guess`. A bisection replaces a Newton step that
/// leaves the bracket; while the bracket has no upper end, 2 s + `widening` replaces it. Once the relative error is below [`near`], the
/// method makes one more step and does not test the error again. The function `sliding` of s returns |x|^2, n, and `|x|^3 / mu` times the
/// derivative of `mu n / |x|` with respect to s.
#[inline(always)]
pub(super) fn slip_multiplier<R: Real>(mu: R, guess: R, widening: R, mut todo: R::Mask, sliding: impl Fn(R) -> [R; 3]) -> R {
    let near = near::<R>();
    let unbounded = R::of(f64::INFINITY);
    let (mut lo, mut hi, mut s) = (R::zero(), unbounded, guess);
    for _ in 0..MAX_NEWTON {
        let [square, n, slope] = sliding(s);
        let length = square.sqrt();
        let excess = mu * n - length;
        let low = excess.lt(R::zero());
        lo = R::select(low, s, lo);
        hi = R::select(low, hi, s);
        let newton = s - excess * square / (mu * slope);
        let bisect = R::select(hi.lt(unbounded), (lo + hi) * R::of(0.5), s + s + widening);
        let inside = newton.ge(lo).and(newton.le(hi)).and(newton.lt(unbounded));
        s = R::select(todo, R::select(inside, newton, bisect), s);
        todo = todo.and_not(excess.abs().le(near * length));
        if todo.none() {
            break;
        }
    }
    s
}

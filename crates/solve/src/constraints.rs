//! Kinds of constraints. Each is a set of rows with its own data and local solver, and one implementation of [`ConstraintSet`].

pub(crate) mod friction;
pub(crate) mod orthogonalisation;
pub(crate) mod rolling;
pub(crate) mod scalar;
pub(crate) mod sliding;

use crate::lane_map::LaneMap;
use stepper_real::{Mask, Real};

/// Lanes that take part in a sweep.
#[derive(Clone, Copy)]
pub(crate) struct SweepLanes<R: Real> {
    /// Lanes whose impulses change.
    pub(crate) running: R::Mask,
    /// Lanes in which a contact's own problem is solved exactly; the others make the weaker update.
    pub(crate) exact: R::Mask,
}

/// Unknowns that a sweep over one kind of constraint changes.
pub(crate) struct Unknowns<'a, R, I> {
    /// Impulse of every constraint of the kind.
    pub(crate) impulses: &'a mut [I],
    /// Start of every contact's local solve: the multiplier of its friction disc. Empty for scalar rows.
    pub(crate) multipliers: &'a mut [R],
    /// Scaled velocity change.
    pub(crate) w: &'a mut [R],
}

/// Damping of what positions demand.
#[derive(Clone, Copy, Debug)]
pub struct Damping<R> {
    /// Ratio of a row's compliance to its mobility.
    pub ratio: R,
    /// Growth of that ratio per velocity that a contact corrects, s/m.
    pub bending: R,
}

/// Normal impulses and demands of a reference solution, for one kind of constraint.
#[derive(Clone, Copy)]
pub(crate) struct ReferenceRows<'a, R> {
    /// Normal impulse of every constraint.
    pub(crate) lambda: &'a [R],
    /// Undamped demand g of every normal row.
    pub(crate) g: &'a [R],
}

/// Operations of one kind of constraint on all constraints of that kind. Results that run over all kinds (a sum, a maximum) are handed from
/// one kind to the next, so that the order of the arithmetic is that of the rows.
pub(crate) trait ConstraintSet<R: Real> {
    /// Impulse of one constraint: a number, or one for each row of a contact.
    type Impulse: Copy;
    /// Set of the same kind in half the lanes.
    type Half: ConstraintSet<R::Half>;
    /// Removes all constraints.
    fn clear(&mut self);

    /// Gathers some lanes of all constraints into `out`.
    fn gather(&self, map: &LaneMap, out: &mut Self::Half);

    /// Calls `f` for every constraint that exists in a lane with the coordinates that it touches there, ascending.
    fn for_each_support(&self, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>));

    /// w += Y lambda.
    fn add_impulses(&self, impulses: &[Self::Impulse], w: &mut [R]);

    /// Visits every constraint once: each takes the impulse that solves it while the others stand. Returns the larger of `change` and the
    /// largest change of a velocity, m/s.
    fn sweep(&self, unknowns: Unknowns<'_, R, Self::Impulse>, lanes: SweepLanes<R>, change: R) -> R;

    /// The larger of `worst` and the largest natural-map residual, m/s; see [`residual`](crate::residual()).
    fn residual(&self, impulses: &[Self::Impulse], w: &[R], worst: R) -> R;

    /// `sum` plus the magnitudes of all normal impulses.
    fn sum_normal_impulses(&self, impulses: &[Self::Impulse], sum: R) -> R;

    /// Exchanges what the rows demand for `demands`, a number for each row; see
    /// [`Problem::exchange_demands`](crate::Problem::exchange_demands).
    fn exchange_demands(&mut self, demands: &mut [R]);

    /// Damps what the rows demand, counted from `impulses`, which are appended to the reference; see
    /// [`Problem::damp`](crate::Problem::damp).
    fn damp(&mut self, impulses: &[Self::Impulse], damping: Damping<R>, floors: &[R], before: &[R], reference: [&mut Vec<R>; 2]);

    /// The larger of `most` and the largest velocity that damping keeps a normal row from what it demands, m/s or rad/s.
    fn shortfall(&self, impulses: &[Self::Impulse], before: &[R], most: R) -> R;

    /// The larger of `most` and the largest velocity that is demanded where nothing can move, m/s or rad/s.
    fn immovable_demand(&self, most: R) -> R;

    /// Adds J^T z of a witness of infeasibility to `momentum`, scaled; returns `lack` - z . u, J. See
    /// [`Problem::witness`](crate::Problem::witness).
    fn witness(&self, impulses: &[Self::Impulse], reference: ReferenceRows<'_, R>, w: &[R], momentum: &mut [R], lack: R) -> R;
}

/// Whether any lane's impulse changes: many limits and contacts stay open from sweep to sweep. Adding their zeros would change nothing,
/// since no sum is ever -0.
#[inline(always)]
pub(crate) fn is_nonzero<R: Real>(d: R) -> bool {
    !d.eq(R::zero()).all()
}

/// Larger of two numbers; a NaN on the right wins, so that it is never hidden.
#[inline(always)]
pub(crate) fn worse<R: Real>(a: R, b: R) -> R {
    R::select(b.le(a), a, b)
}

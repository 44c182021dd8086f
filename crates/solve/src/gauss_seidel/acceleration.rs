//! Anderson's acceleration on top of sweeps (Anderson 1965; the type II form of Walker & Ni 2011, equation 2.2).
//!
//! A sweep takes x to T(x). With f = T(x) - x, the next sweep starts from `T(x) - sum_j c_j dT_j`, where c minimises `|f - sum_j c_j df_j|`
//! over the changes of f and of T(x) between the last sweeps. Lengths are those of w, so |f|^2 is twice the kinetic energy of the change. A
//! lane whose sweeps change more than the one before forgets the past.

use crate::constraints::constraint_set::Impulse;
use crate::constraints::each_kind;
use crate::gauss_seidel::history::MEMORY;
use crate::iterate::Iterate;
use crate::problem::Problem;
use stepper_real::{Mask, Real};

/// Resets the history before the first sweep, or after a pause of all lanes.
#[inline(always)]
pub(super) fn reset_history<R: Real>(iterate: &mut Iterate<R>) {
    let mut n = iterate.w.len();
    each_kind!([impulses: &iterate] => n += Impulse::<R>::flatten(impulses).len());
    let past = &mut iterate.history;
    past.start.copy_from_slice(&iterate.w);
    past.length = R::of(f64::INFINITY);
    past.ran = R::Mask::splat(false);
    past.known = [R::Mask::splat(false); MEMORY];
    past.image.resize(n, R::zero());
    for dt in &mut past.dt {
        dt.resize(n, R::zero());
    }
}

/// Computes w from the impulses in the lanes `lanes`; the others keep every bit.
#[inline(always)]
pub(super) fn recompute_w<R: Real>(iterate: &mut Iterate<R>, problem: &Problem<R>, lanes: R::Mask) {
    std::mem::swap(&mut iterate.w, &mut iterate.history.start);
    iterate.compute_w(problem);
    for (w, &before) in iterate.w.iter_mut().zip(&iterate.history.start) {
        *w = R::select(lanes, *w, before);
    }
}

/// Replaces the unknowns that a sweep left by those from which the next one starts, in the lanes `running`. Returns the lanes in which they
/// differ: there, w and the impulses are summed separately, so that w is no longer the sum over the impulses to the last bit.
#[inline(always)]
pub(super) fn accelerate<R: Real>(iterate: &mut Iterate<R>, running: R::Mask) -> R::Mask {
    match iterate.record_sweep(running) {
        0 => {}
        1 => iterate.extrapolate::<1>(),
        2 => iterate.extrapolate::<2>(),
        3 => iterate.extrapolate::<3>(),
        _ => iterate.extrapolate::<MEMORY>(),
    }
    let Iterate { w, history, .. } = iterate;
    history.start.copy_from_slice(w);
    history.known[0]
}

impl<R: Real> Iterate<R> {
    /// Records the change of a sweep of the lanes `running`. Returns the number of changes that are known in any lane.
    #[inline(always)]
    fn record_sweep(&mut self, running: R::Mask) -> usize {
        let past = &mut self.history;
        past.shift();
        let mut length = R::zero();
        for (((w, start), f), df) in self.w.iter().zip(&past.start).zip(&mut past.f).zip(&mut past.df[0]) {
            let now = *w - *start;
            length += now * now;
            *df = now - *f;
            *f = now;
        }
        let goes = running.and(length.le(past.length));
        past.length = R::select(running, length, past.length);
        for known in &mut past.known[1..] {
            *known = known.and(goes);
        }
        past.known[0] = past.ran.and(goes);
        past.ran = running;
        let mut at = 0;
        past.record(&self.w, &mut at);
        each_kind!([impulses: &self] => past.record(Impulse::flatten(impulses), &mut at));
        past.known.iter().take_while(|known| known.any()).count()
    }

    /// Subtracts the combination of the last `N` changes from the unknowns that the sweep left.
    #[inline(always)]
    fn extrapolate<const N: usize>(&mut self) {
        let c = self.history.coefficients::<N>();
        let mut at = 0;
        self.history.extrapolate(&c, &mut self.w, &mut at);
        each_kind!([impulses: &mut self] => self.history.extrapolate(&c, Impulse::flatten_mut(impulses), &mut at));
    }
}

//! Anderson's acceleration of Gauss-Seidel iterations, called sweeps (Anderson 1965; the type II form of Walker & Ni 2011, equation 2.2).
//!
//! A sweep maps the unknowns x to T(x). With f = T(x) - x, the next sweep starts from `T(x) - sum_j c_j dT_j`. Here c minimises `|f - sum_j
//! c_j df_j|` over the changes dT of T(x) and df of f between the last sweeps. A length counts only the entries of w, so that |f|^2 is
//! twice the kinetic energy of the change. A lane discards its history if a sweep makes a larger change than the previous one.

use crate::gauss_seidel::history::{MEMORY, SweepChange};
use crate::iterate::Iterate;
use stepper_real::{Mask, Real};

/// Clears the stored differences between sweeps of all lanes, from which the acceleration extrapolates.
#[inline(always)]
pub(super) fn reset_history<R: Real>(iterate: &mut Iterate<R>) {
    let n = iterate.w.len() + iterate.scalars.len() + iterate.contacts.len();
    let past = &mut iterate.history;
    past.start.copy_from_slice(&iterate.w);
    past.length = R::of(f64::INFINITY);
    past.swept = R::Mask::splat(false);
    past.stored = [R::Mask::splat(false); MEMORY];
    past.image.resize(n, R::zero());
    for dt in &mut past.dt {
        dt.resize(n, R::zero());
    }
}

/// Extrapolates the unknowns (scaled velocity change w and all impulses) after a sweep to those from which the next sweep starts, in the
/// lanes `running`. Returns the lanes that were extrapolated.
///
/// In these lanes w and the impulses are summed separately, so that w is no longer the sum over the impulses to the last bit.
#[inline(always)]
pub(super) fn accelerate<R: Real>(iterate: &mut Iterate<R>, running: R::Mask) -> R::Mask {
    let Iterate { w, history, .. } = iterate;
    history.shift();
    let change = match history.stored_differences() {
        0 => history.record_change::<0>(w),
        1 => history.record_change::<1>(w),
        2 => history.record_change::<2>(w),
        3 => history.record_change::<3>(w),
        _ => history.record_change::<MEMORY>(w),
    };
    match history.discard_worse(running, change.length) {
        0 => iterate.extrapolate::<0>(&change),
        1 => iterate.extrapolate::<1>(&change),
        2 => iterate.extrapolate::<2>(&change),
        3 => iterate.extrapolate::<3>(&change),
        _ => iterate.extrapolate::<MEMORY>(&change),
    }
    iterate.history.stored[0]
}

impl<R: Real> Iterate<R> {
    /// Stores the unknowns after a sweep (Gauss-Seidel iteration), and extrapolates them by Anderson's acceleration with the last `N`
    /// differences between sweeps. `change` is the change by the sweep.
    #[inline(always)]
    fn extrapolate<const N: usize>(&mut self, change: &SweepChange<R>) {
        let c = self.history.coefficients::<N>(change);
        let mut at = 0;
        self.history.extrapolate(&c, &mut self.w, &mut at);
        self.history.start.copy_from_slice(&self.w);
        self.history.extrapolate(&c, &mut self.scalars, &mut at);
        self.history.extrapolate(&c, &mut self.contacts, &mut at);
    }
}

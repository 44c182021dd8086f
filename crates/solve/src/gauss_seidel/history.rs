//! History of Anderson's acceleration: the changes of the last sweeps, and the least-squares problem over them.

use crate::cone::masked;
use stepper_real::{Mask, Real, Scalar};

/// Number of differences between sweeps that Anderson's acceleration stores.
///
/// Measured on 128 dm_control humanoids at 5 ms, with sweeps alone and at most 50 of them, under random control and then at rest. Entries
/// are the mean number of sweeps and the unsolved steps in %.
///
/// | differences | random control | at rest |
/// |---|---|---|
/// | none, but nonlinear conjugate gradients | 12.5, 2.5 | 26.8, 20.7 |
/// | 1 | 7.5, 1.5 | 19.5, 10.2 |
/// | 2 | 6.3, 0.8 | 15.7, 6.4 |
/// | 3 | 6.0, 0.8 | 13.8, 4.9 |
/// | 4 | 6.0, 0.8 | 13.2, 4.3 |
/// | 6 | 6.0, 0.7 | 12.5, 3.5 |
///
/// The solver discards the history when the change by a sweep exceeds that by the previous sweep. A limit of four times the previous change
/// gives no gain.
pub(super) const MEMORY: usize = 4;

/// History of the sweeps (Gauss-Seidel iterations) of each lane, for Anderson's acceleration. It begins when the lane last started to run.
#[derive(Clone, Debug)]
pub(crate) struct History<R: Real> {
    /// Scaled velocity change w by all impulses before the current sweep, in coordinates in which its kinetic energy is |w|^2 / 2.
    pub(crate) start: Vec<R>,
    /// Change f of the scaled velocity change w by the previous sweep.
    pub(super) f: Vec<R>,
    /// Squared length |f|^2 of the change of w (scaled velocity change) by the previous sweep.
    pub(super) length: R,
    /// Unknowns (scaled velocity change w and all impulses) after the previous sweep.
    pub(super) image: Vec<R>,
    /// Lanes that took part in the previous sweep.
    pub(super) swept: R::Mask,
    /// Differences between the changes of w (scaled velocity change) by consecutive sweeps, the newest first.
    pub(super) df: [Vec<R>; MEMORY],
    /// Differences between the unknowns (scaled velocity change w and all impulses) after consecutive sweeps, the newest first.
    pub(super) dt: [Vec<R>; MEMORY],
    /// Lanes in which each of the differences `df` and `dt` is stored.
    pub(super) stored: [R::Mask; MEMORY],
    /// Dot products of the differences `df` (between the changes of w by consecutive sweeps) with each other, where w is the scaled
    /// velocity change.
    pub(super) gram: [[R; MEMORY]; MEMORY],
}

/// Change f of the scaled velocity change w by the current sweep, with its dot products.
pub(super) struct SweepChange<R> {
    /// Squared length |f|^2 of the change f of the scaled velocity change w by the current sweep.
    pub(super) length: R,
    /// Dot products of the newest difference `df` with the stored differences, beginning with itself. Here f is the change of the scaled
    /// velocity change w by a sweep.
    with_newest: [R; MEMORY],
    /// Dot products of f with the last differences `df` of f between sweeps. Here f is the change of the scaled velocity change w by the
    /// current sweep.
    with_f: [R; MEMORY],
}

impl<R: Real> History<R> {
    /// Empty history with memory for `dimension` coordinates of the scaled velocity change w, and for `unknowns` unknowns (w and all
    /// impulses).
    pub(crate) fn new(dimension: usize, unknowns: usize) -> Self {
        let unknowns = || Vec::with_capacity(unknowns);
        let coordinates = || vec![R::zero(); dimension];
        Self {
            start: coordinates(),
            f: coordinates(),
            length: R::zero(),
            image: unknowns(),
            swept: R::Mask::splat(false),
            df: std::array::from_fn(|_| coordinates()),
            dt: std::array::from_fn(|_| unknowns()),
            stored: [R::Mask::splat(false); MEMORY],
            gram: [[R::zero(); MEMORY]; MEMORY],
        }
    }

    /// Moves every stored difference between sweeps to the next older index, so that the newest can be overwritten.
    #[inline(always)]
    pub(super) fn shift(&mut self) {
        for k in (1..MEMORY).rev() {
            self.df.swap(k, k - 1);
            self.dt.swap(k, k - 1);
            self.stored[k] = self.stored[k - 1];
            for j in (k..MEMORY).rev() {
                self.gram[k][j] = self.gram[k - 1][j - 1];
            }
        }
    }

    /// Number of differences between sweeps that are stored in any lane, including that of the current sweep.
    #[inline(always)]
    pub(super) fn stored_differences(&self) -> usize {
        if self.swept.any() { 1 + self.stored[1..].iter().take_while(|stored| stored.any()).count() } else { 0 }
    }

    /// Stores the change f of w (scaled velocity change) by a sweep whose result is `w`. Returns |f|^2, and the dot products of f and of
    /// its newest difference with the last `N` differences of f between sweeps.
    #[inline(always)]
    pub(super) fn record_change<const N: usize>(&mut self, w: &[R]) -> SweepChange<R> {
        let Self { start, f, df: [newest, older @ ..], .. } = self;
        let (start, f, newest) = (&start[..w.len()], &mut f[..w.len()], &mut newest[..w.len()]);
        let older = older.each_ref().map(|df| &df[..w.len()]);
        let mut change = SweepChange { length: R::zero(), with_newest: [R::zero(); MEMORY], with_f: [R::zero(); MEMORY] };
        for i in 0..w.len() {
            let now = w[i] - start[i];
            change.length += now * now;
            let difference = now - f[i];
            f[i] = now;
            if N > 0 {
                newest[i] = difference;
            }
            for j in 0..N {
                let df = if j == 0 { difference } else { older[j - 1][i] };
                change.with_newest[j] += difference * df;
                change.with_f[j] += df * now;
            }
        }
        change
    }

    /// Discards the history of lanes that are not `running`, and of lanes whose last sweep made a larger change than the previous one.
    /// `length` is the squared change of the scaled velocity change w by the last sweep. Returns the number of differences between sweeps
    /// that are stored in any lane.
    #[inline(always)]
    pub(super) fn discard_worse(&mut self, running: R::Mask, length: R) -> usize {
        let keeps = running.and(length.le(self.length));
        self.length = R::select(running, length, self.length);
        for stored in &mut self.stored[1..] {
            *stored = stored.and(keeps);
        }
        self.stored[0] = self.swept.and(keeps);
        self.swept = running;
        self.stored.iter().take_while(|stored| stored.any()).count()
    }

    /// Stores a part of the unknowns after a sweep, and extrapolates it: subtracts its last `N` differences between sweeps, each times its
    /// coefficient in `c`.
    ///
    /// `at` is the index of the part's first number among all unknowns. It becomes the index after the last.
    #[inline(always)]
    pub(super) fn extrapolate<const N: usize>(&mut self, c: &[R; N], part: &mut [R], at: &mut usize) {
        let (stored, place) = (self.stored[0], *at..*at + part.len());
        *at = place.end;
        let [newest, older @ ..] = &mut self.dt;
        let (image, newest) = (&mut self.image[place.clone()], &mut newest[place.clone()]);
        let older = older.each_ref().map(|dt| &dt[place.clone()]);
        for (i, x) in part.iter_mut().enumerate() {
            let now = *x;
            if N > 0 {
                // Lanes without this difference get zero, and never NaN.
                newest[i] = masked(stored, now - image[i]);
                // The sum starts from +0 and is never -0, so that a longer history of another lane changes nothing.
                let mut sum = R::zero();
                for k in 0..N {
                    sum += c[k] * if k == 0 { newest[i] } else { older[k - 1][i] };
                }
                *x -= sum;
            }
            image[i] = now;
        }
    }

    /// Coefficients c of Anderson's acceleration, which minimise |f - sum_j c_j df_j|. Here f is the change of the scaled velocity change w
    /// by the last sweep, and df_j are the last `N` differences of f between consecutive sweeps. A coefficient is 0 in lanes in which its
    /// difference is not stored.
    #[inline(always)]
    pub(super) fn coefficients<const N: usize>(&mut self, change: &SweepChange<R>) -> [R; N] {
        let Self { stored, gram, .. } = self;
        let one = R::one();
        let mut c = [R::zero(); N];
        c.copy_from_slice(&change.with_f[..N]);
        gram[0][..N].copy_from_slice(&change.with_newest[..N]);
        // Elimination starts with the newest difference. A difference that is nearly a linear combination of newer ones is left out,
        // because its large c would magnify rounding. A difference whose square underflows (1e-19 in 32 bits) is left out too: sweeps stall
        // above the tolerance there, and the inverse is not finite.
        let mut a = *gram;
        let epsilon = <R::Scalar as Scalar>::EPSILON.to_f64();
        let least = if epsilon > 1e-12 { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
        let (rounding, least) = (R::of(epsilon.sqrt()), R::of(least));
        for i in 0..N {
            let good = stored[i].and(a[i][i].gt((rounding * gram[i][i]).max(least)));
            let inverse = one / R::select(good, a[i][i], one);
            c[i] = masked(good, c[i]);
            for j in i + 1..N {
                a[i][j] = masked(good.and(stored[j]), a[i][j]);
                let factor = a[i][j] * inverse;
                for k in j..N {
                    a[j][k] -= factor * masked(stored[k], a[i][k]);
                }
                c[j] -= factor * c[i];
            }
            a[i][i] = inverse;
        }
        for i in (0..N).rev() {
            let mut rest = c[i];
            for j in i + 1..N {
                rest -= a[i][j] * c[j];
            }
            c[i] = rest * a[i][i];
        }
        c
    }
}

//! Memory of Anderson's acceleration: the changes of the last sweeps, and the least-squares problem over them.

use crate::cone::masked;
use crate::lane_map::LaneMap;
use stepper_real::{Mask, Real, Scalar};

/// Number of stored changes.
///
/// Measured on 128 dm_control humanoids at 5 ms, sweeps alone, at most 50 (mean sweeps, unsolved %), under random control and then at rest.
///
/// | changes | random control | at rest |
/// |---|---|---|
/// | none, but nonlinear conjugate gradients | 12.5, 2.5 | 26.8, 20.7 |
/// | 1 | 7.5, 1.5 | 19.5, 10.2 |
/// | 2 | 6.3, 0.8 | 15.7, 6.4 |
/// | 3 | 6.0, 0.8 | 13.8, 4.9 |
/// | 4 | 6.0, 0.8 | 13.2, 4.3 |
/// | 6 | 6.0, 0.7 | 12.5, 3.5 |
///
/// Discarding the history only when a sweep changes four times as much as the last one gains nothing.
pub(super) const MEMORY: usize = 4;

/// Changes of the last sweeps, the newest first. The history of a lane begins when the lane last started to run.
#[derive(Clone, Debug)]
pub(crate) struct History<R: Real> {
    /// Scaled velocity change w before the sweep.
    pub(super) start: Vec<R>,
    /// Change f of w by the previous sweep.
    pub(super) f: Vec<R>,
    /// Squared length |f|^2 of that change.
    pub(super) length: R,
    /// Unknowns (w and all impulses) after the previous sweep.
    pub(super) image: Vec<R>,
    /// Lanes that made the previous sweep.
    pub(super) ran: R::Mask,
    /// Changes of f.
    pub(super) df: [Vec<R>; MEMORY],
    /// Changes of all unknowns.
    pub(super) dt: [Vec<R>; MEMORY],
    /// Lanes that have each of these changes.
    pub(super) known: [R::Mask; MEMORY],
    /// Products df . df.
    pub(super) gram: [[R; MEMORY]; MEMORY],
}

/// Change of w by a sweep.
pub(super) struct SweepChange<R> {
    /// Squared length |f|^2 of the change f.
    pub(super) length: R,
    /// Products of the newest change of f with the last ones, itself first.
    with_newest: [R; MEMORY],
    /// Products of f with the last changes of it.
    with_f: [R; MEMORY],
}

impl<R: Real> History<R> {
    /// Reserves memory for `dimension` coordinates of w, and `unknowns` unknowns, w included.
    pub(crate) fn new(dimension: usize, unknowns: usize) -> Self {
        let unknowns = || Vec::with_capacity(unknowns);
        let coordinates = || vec![R::zero(); dimension];
        Self {
            start: coordinates(),
            f: coordinates(),
            length: R::zero(),
            image: unknowns(),
            ran: R::Mask::splat(false),
            df: std::array::from_fn(|_| coordinates()),
            dt: std::array::from_fn(|_| unknowns()),
            known: [R::Mask::splat(false); MEMORY],
            gram: [[R::zero(); MEMORY]; MEMORY],
        }
    }

    /// Gathers the history of some lanes, as far as any of them has it.
    #[inline(always)]
    pub(crate) fn gather(&self, map: &LaneMap, out: &mut History<R::Half>) {
        map.gather_slice(&self.start, &mut out.start);
        map.gather_slice(&self.f, &mut out.f);
        map.gather_slice(&self.image, &mut out.image);
        out.length = map.gather(self.length);
        out.ran = map.gather_mask::<R>(self.ran);
        for k in 0..MEMORY {
            out.known[k] = map.gather_mask::<R>(self.known[k]);
            out.gram[k] = map.gather_array(&self.gram[k]);
            if out.known[k].any() {
                map.gather_slice(&self.df[k], &mut out.df[k]);
                map.gather_slice(&self.dt[k], &mut out.dt[k]);
            } else {
                out.dt[k].resize(self.dt[k].len(), R::Half::zero());
            }
        }
    }

    /// Shifts every change to the next older place.
    #[inline(always)]
    pub(super) fn shift(&mut self) {
        for k in (1..MEMORY).rev() {
            self.df.swap(k, k - 1);
            self.dt.swap(k, k - 1);
            self.known[k] = self.known[k - 1];
            for j in (k..MEMORY).rev() {
                self.gram[k][j] = self.gram[k - 1][j - 1];
            }
        }
    }

    /// Number of changes that any lane has, with that of the present sweep.
    #[inline(always)]
    pub(super) fn remembered(&self) -> usize {
        if self.ran.any() { 1 + self.known[1..].iter().take_while(|known| known.any()).count() } else { 0 }
    }

    /// Records the change of a sweep that left `w`, with its products with the last `N` changes of f.
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

    /// Clears the history of lanes that are not `running`, and of those whose sweep changed more than the previous one. Returns the number
    /// of changes in any lane.
    #[inline(always)]
    pub(super) fn forget(&mut self, running: R::Mask, length: R) -> usize {
        let goes = running.and(length.le(self.length));
        self.length = R::select(running, length, self.length);
        for known in &mut self.known[1..] {
            *known = known.and(goes);
        }
        self.known[0] = self.ran.and(goes);
        self.ran = running;
        self.known.iter().take_while(|known| known.any()).count()
    }

    /// Records the unknowns `part` after a sweep, and subtracts the combination `c` of the last `N` changes from them.
    ///
    /// `at` is their place among all unknowns; it becomes the place after them.
    #[inline(always)]
    pub(super) fn extrapolate<const N: usize>(&mut self, c: &[R; N], part: &mut [R], at: &mut usize) {
        let (known, place) = (self.known[0], *at..*at + part.len());
        *at = place.end;
        let [newest, older @ ..] = &mut self.dt;
        let (image, newest) = (&mut self.image[place.clone()], &mut newest[place.clone()]);
        let older = older.each_ref().map(|dt| &dt[place.clone()]);
        for (i, x) in part.iter_mut().enumerate() {
            let now = *x;
            if N > 0 {
                // Zero, and never NaN, in lanes without this change.
                newest[i] = masked(known, now - image[i]);
                // The sum starts from +0, never -0, so that a longer history of a neighbour changes nothing.
                let mut sum = R::zero();
                for k in 0..N {
                    sum += c[k] * if k == 0 { newest[i] } else { older[k - 1][i] };
                }
                *x -= sum;
            }
            image[i] = now;
        }
    }

    /// Least-squares coefficients c over the last `N` changes; 0 for a change that a lane does not have.
    #[inline(always)]
    pub(super) fn coefficients<const N: usize>(&mut self, change: &SweepChange<R>) -> [R; N] {
        let Self { known, gram, .. } = self;
        let one = R::one();
        let mut c = [R::zero(); N];
        c.copy_from_slice(&change.with_f[..N]);
        gram[0][..N].copy_from_slice(&change.with_newest[..N]);
        // Elimination, the newest first. A change that is nearly a sum of newer ones is left out, because its large c would magnify
        // rounding. So is one whose square underflows (1e-19 in 32 bits), where sweeps stall above the tolerance and the inverse is not
        // finite.
        let mut a = *gram;
        let epsilon = <R::Scalar as Scalar>::EPSILON.to_f64();
        let least = if epsilon > 1e-12 { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
        let (rounding, least) = (R::of(epsilon.sqrt()), R::of(least));
        for i in 0..N {
            let good = known[i].and(a[i][i].gt((rounding * gram[i][i]).max(least)));
            let inverse = one / R::select(good, a[i][i], one);
            c[i] = masked(good, c[i]);
            for j in i + 1..N {
                a[i][j] = masked(good.and(known[j]), a[i][j]);
                let factor = a[i][j] * inverse;
                for k in j..N {
                    a[j][k] -= factor * masked(known[k], a[i][k]);
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

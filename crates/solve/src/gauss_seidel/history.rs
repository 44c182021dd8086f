//! Memory of Anderson's acceleration: the changes of the last sweeps, and the least-squares problem over them.

use crate::cone::masked;
use crate::lane_map::LaneMap;
use stepper_real::{Mask, Real, Scalar};

/// Number of changes that are remembered.
///
/// Measured on 128 dm_control humanoids at 5 ms, sweeps alone, at most 50 (mean sweeps, unsolved %), under random control and then at rest:
/// none of this but nonlinear conjugate gradients 12.5, 2.5 and 26.8, 20.7; one change 7.5, 1.5 and 19.5, 10.2; two 6.3, 0.8 and 15.7, 6.4;
/// three 6.0, 0.8 and 13.8, 4.9; four 6.0, 0.8 and 13.2, 4.3; six 6.0, 0.7 and 12.5, 3.5. Forgetting later, when a sweep changes four times
/// what the last one did, gains nothing.
pub(super) const MEMORY: usize = 4;

/// Changes of the last sweeps, the newest first. A lane's own history is as old as it has been running without a break.
#[derive(Clone, Debug)]
pub(crate) struct History<R: Real> {
    /// Scaled velocity change w before the sweep.
    pub(super) start: Vec<R>,
    /// Change f of w by the sweep before.
    pub(super) f: Vec<R>,
    /// Squared length |f|^2 of that change.
    pub(super) length: R,
    /// Unknowns (w and all impulses) after the sweep before.
    pub(super) image: Vec<R>,
    /// Lanes that made the sweep before.
    pub(super) ran: R::Mask,
    /// Changes of f.
    pub(super) df: [Vec<R>; MEMORY],
    /// Changes of all unknowns.
    pub(super) dt: [Vec<R>; MEMORY],
    /// Lanes in which each of these changes is known.
    pub(super) known: [R::Mask; MEMORY],
    /// Products df . df.
    pub(super) gram: [[R; MEMORY]; MEMORY],
}

impl<R: Real> History<R> {
    /// Reserves memory for so many coordinates of w, and so many unknowns, w included.
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

    /// Gathers some lanes, as far as any of them remembers.
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

    /// Records the unknowns `part`, which a sweep left, at the place `at` among all unknowns, which becomes the place after
    /// them.
    #[inline(always)]
    pub(super) fn record(&mut self, part: &[R], at: &mut usize) {
        let (known, place) = (self.known[0], *at..*at + part.len());
        for ((x, image), dt) in part.iter().zip(&mut self.image[place.clone()]).zip(&mut self.dt[0][place.clone()]) {
            // Zero, and never what is not a number, where a lane is not to use it.
            *dt = masked(known, *x - *image);
            *image = *x;
        }
        *at = place.end;
    }

    /// Subtracts the combination `c` of the last `N` changes from the unknowns `part`, which are at the place `at` among all, which becomes
    /// the place after them.
    #[inline(always)]
    pub(super) fn extrapolate<const N: usize>(&self, c: &[R; N], part: &mut [R], at: &mut usize) {
        let place = *at..*at + part.len();
        *at = place.end;
        let mut dt = self.dt.iter().map(|dt| &dt[place.clone()]);
        let dt: [&[R]; N] = std::array::from_fn(|_| dt.next().expect("N is at most MEMORY"));
        for (i, x) in part.iter_mut().enumerate() {
            // From zero, which is no -0: where a neighbour remembers more, nothing changes.
            let mut sum = R::zero();
            for k in 0..N {
                sum += c[k] * dt[k][i];
            }
            *x -= sum;
        }
    }

    /// Coefficients c of least squares over the last `N` changes; 0 for a change that a lane does not know.
    #[inline(always)]
    pub(super) fn coefficients<const N: usize>(&mut self) -> [R; N] {
        let Self { f, df, known, gram, .. } = self;
        let (zero, one) = (R::zero(), R::one());
        let (mut own, mut c) = ([zero; N], [zero; N]);
        for i in 0..f.len() {
            for j in 0..N {
                let older = df[j][i];
                own[j] += df[0][i] * older;
                c[j] += older * f[i];
            }
        }
        gram[0][..N].copy_from_slice(&own);
        // Elimination, the newest first; a change that is nearly a sum of newer ones is left out: its large c would magnify rounding.
        let mut a = *gram;
        let rounding = R::of(<R::Scalar as Scalar>::EPSILON.to_f64().sqrt());
        for i in 0..N {
            let good = known[i].and(a[i][i].gt(rounding * gram[i][i]));
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

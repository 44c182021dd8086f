//! Anderson's acceleration on top of sweeps (Anderson 1965; the type II form of Walker & Ni 2011, equation 2.2).
//!
//! A sweep takes x to T(x). With f = T(x) - x, the next sweep starts from `T(x) - sum_j c_j dT_j`, where c minimises `|f - sum_j c_j df_j|`
//! over the changes of f and of T(x) between the last sweeps. Lengths are those of w, so |f|^2 is twice the kinetic energy of the change. A lane
//! whose sweeps change more than the one before forgets the past.

use crate::aside::Order;
use crate::cone::keep;
use crate::{Capacity, Iterate, Problem};
use stepper_real::{Mask, Real, Scalar};

/// Changes that are remembered.
///
/// Measured on 128 dm_control humanoids at 5 ms, sweeps alone, at most 50 (mean sweeps, unsolved %), under random control and then at rest:
/// none of this but nonlinear conjugate gradients 12.5, 2.5 and 26.8, 20.7; one change 7.5, 1.5 and 19.5, 10.2; two 6.3, 0.8 and 15.7, 6.4;
/// three 6.0, 0.8 and 13.8, 4.9; four 6.0, 0.8 and 13.2, 4.3; six 6.0, 0.7 and 12.5, 3.5. Forgetting later, when a sweep changes four times
/// what the last one did, gains nothing.
const MEMORY: usize = 4;

/// What the last sweeps did, the newest first. A lane's own history is as old as it has been running without a break.
#[derive(Clone, Debug)]
pub(crate) struct History<R: Real> {
    /// w before the sweep.
    start: Vec<R>,
    /// f of the sweep before.
    f: Vec<R>,
    /// |f|^2 of the sweep before.
    length: R,
    /// All unknowns after the sweep before.
    image: Vec<R>,
    /// Lanes that made the sweep before.
    ran: R::Mask,
    /// Changes of f.
    df: [Vec<R>; MEMORY],
    /// Changes of all unknowns.
    dt: [Vec<R>; MEMORY],
    /// Lanes that have them.
    known: [R::Mask; MEMORY],
    /// df . df
    gram: [[R; MEMORY]; MEMORY],
}

impl<R: Real> History<R> {
    pub(crate) fn new(room: &Capacity) -> Self {
        let unknowns = || Vec::with_capacity(room.dimension + room.scalars + 3 * room.contacts + 6 * room.wide);
        let coordinates = || vec![R::zero(); room.dimension];
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
}

/// Forgets everything before the first sweep, or after a pause of all lanes.
#[inline(always)]
pub(crate) fn begin<R: Real>(iterate: &mut Iterate<R>) {
    let n = iterate.w.len() + iterate.scalars.len() + 3 * iterate.contacts.len() + 6 * iterate.wide.len();
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

/// Makes w consistent with the impulses in the lanes `lanes`; the others keep every bit.
#[inline(always)]
pub(crate) fn settle<R: Real>(iterate: &mut Iterate<R>, problem: &Problem<R>, lanes: R::Mask) {
    std::mem::swap(&mut iterate.w, &mut iterate.history.start);
    iterate.start(problem);
    for (w, &before) in iterate.w.iter_mut().zip(&iterate.history.start) {
        *w = R::select(lanes, *w, before);
    }
}

/// Replaces what a sweep left by where the next one starts, in the lanes `running`. Returns the lanes in which that is elsewhere: there, w and the
/// impulses are added up apart.
#[inline(always)]
pub(crate) fn accelerate<R: Real>(iterate: &mut Iterate<R>, running: R::Mask) -> R::Mask {
    match iterate.note(running) {
        0 => {}
        1 => iterate.leap::<1>(),
        2 => iterate.leap::<2>(),
        3 => iterate.leap::<3>(),
        _ => iterate.leap::<MEMORY>(),
    }
    let Iterate { w, history, .. } = iterate;
    history.start.copy_from_slice(w);
    history.known[0]
}

impl<R: Real> Iterate<R> {
    /// Writes down what a sweep of the lanes `running` did. Returns how many changes are known in any lane.
    #[inline(always)]
    fn note(&mut self, running: R::Mask) -> usize {
        let Self { w, scalars, contacts, wide, history: past, .. } = self;
        past.shift();
        let mut length = R::zero();
        for (((w, start), f), df) in w.iter().zip(&past.start).zip(&mut past.f).zip(&mut past.df[0]) {
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
        let known = past.known[0];
        let mut at = 0;
        for part in [&w[..], scalars, contacts.as_flattened(), wide.as_flattened()] {
            let end = at + part.len();
            for ((x, image), dt) in part.iter().zip(&mut past.image[at..end]).zip(&mut past.dt[0][at..end]) {
                // Zero, and never what is not a number, where a lane is not to use it.
                *dt = keep(known, *x - *image);
                *image = *x;
            }
            at = end;
        }
        past.known.iter().take_while(|known| known.any()).count()
    }

    /// Takes the last `N` changes out of what the sweep left.
    #[inline(always)]
    fn leap<const N: usize>(&mut self) {
        let c = self.history.coefficients::<N>();
        let Self { w, scalars, contacts, wide, history: past, .. } = self;
        let mut at = 0;
        for part in [&mut w[..], scalars, contacts.as_flattened_mut(), wide.as_flattened_mut()] {
            let end = at + part.len();
            let mut dt = past.dt.iter().map(|dt| &dt[at..end]);
            let dt: [&[R]; N] = std::array::from_fn(|_| dt.next().expect("N is at most MEMORY"));
            for (i, x) in part.iter_mut().enumerate() {
                // From zero, which is no -0: where a neighbour remembers more, nothing changes.
                let mut sum = R::zero();
                for k in 0..N {
                    sum += c[k] * dt[k][i];
                }
                *x -= sum;
            }
            at = end;
        }
    }
}

impl<R: Real> History<R> {
    /// The part of some lanes, as far as any of them remembers.
    #[inline(always)]
    pub(crate) fn pick(&self, order: &Order, out: &mut History<R::Half>) {
        order.pick_numbers(&self.start, &mut out.start);
        order.pick_numbers(&self.f, &mut out.f);
        order.pick_numbers(&self.image, &mut out.image);
        out.length = order.pick(self.length);
        out.ran = order.pick_mask::<R>(self.ran);
        for k in 0..MEMORY {
            out.known[k] = order.pick_mask::<R>(self.known[k]);
            out.gram[k] = order.pick_each(&self.gram[k]);
            if out.known[k].any() {
                order.pick_numbers(&self.df[k], &mut out.df[k]);
                order.pick_numbers(&self.dt[k], &mut out.dt[k]);
            } else {
                out.dt[k].resize(self.dt[k].len(), R::Half::zero());
            }
        }
    }

    /// Makes everything a sweep older.
    #[inline(always)]
    fn shift(&mut self) {
        for k in (1..MEMORY).rev() {
            self.df.swap(k, k - 1);
            self.dt.swap(k, k - 1);
            self.known[k] = self.known[k - 1];
            for j in (k..MEMORY).rev() {
                self.gram[k][j] = self.gram[k - 1][j - 1];
            }
        }
    }

    /// The c of least squares over the last `N` changes; 0 for what a lane does not know.
    #[inline(always)]
    fn coefficients<const N: usize>(&mut self) -> [R; N] {
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
            c[i] = keep(good, c[i]);
            for j in i + 1..N {
                a[i][j] = keep(good.and(known[j]), a[i][j]);
                let factor = a[i][j] * inverse;
                for k in j..N {
                    a[j][k] -= factor * keep(known[k], a[i][k]);
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

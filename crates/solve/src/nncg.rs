//! Nonlinear nonsmooth conjugate gradients on top of sweeps (Silcowitz, Niebe & Erleben 2010, algorithm 2).
//!
//! With d the change that a sweep made and `beta = |d_k|^2 / |d_(k-1)|^2`: where beta <= 1, `lambda += beta p` and `p = beta p + d`; else
//! p = 0. Lengths are those of w, so |d|^2 is twice the kinetic energy of the change. It costs about one axpy a sweep.

use crate::{Capacity, Iterate};
use stepper_real::{Mask, Real};

/// The search direction p, and the iterate that the next sweep starts from.
#[derive(Clone, Debug)]
pub(crate) struct Direction<R: Real> {
    /// |d|^2 of the sweep before.
    length: R,
    before: Unknowns<R>,
    p: Unknowns<R>,
}

/// Numbers for every unknown of an [`Iterate`].
#[derive(Clone, Debug)]
struct Unknowns<R> {
    w: Vec<R>,
    scalars: Vec<R>,
    contacts: Vec<[R; 3]>,
    wide: Vec<[R; 6]>,
}

impl<R: Real> Direction<R> {
    pub(crate) fn new(room: &Capacity) -> Self {
        let unknowns = || Unknowns {
            w: vec![R::zero(); room.dimension],
            scalars: Vec::with_capacity(room.scalars),
            contacts: Vec::with_capacity(room.contacts),
            wide: Vec::with_capacity(room.wide),
        };
        Self { length: R::zero(), before: unknowns(), p: unknowns() }
    }
}

/// Starts without a direction.
#[inline(always)]
pub(crate) fn begin<R: Real>(iterate: &mut Iterate<R>) {
    let Direction { length, before, p } = &mut iterate.direction;
    *length = R::of(f64::INFINITY);
    before.w.copy_from_slice(&iterate.w);
    before.scalars.clear();
    before.scalars.extend_from_slice(&iterate.scalars);
    before.contacts.clear();
    before.contacts.extend_from_slice(&iterate.contacts);
    before.wide.clear();
    before.wide.extend_from_slice(&iterate.wide);
    p.w.fill(R::zero());
    p.scalars.clear();
    p.scalars.resize(iterate.scalars.len(), R::zero());
    p.contacts.clear();
    p.contacts.resize(iterate.contacts.len(), [R::zero(); 3]);
    p.wide.clear();
    p.wide.resize(iterate.wide.len(), [R::zero(); 6]);
}

/// Goes further along the direction after a sweep, in the lanes `running`.
#[inline(always)]
pub(crate) fn accelerate<R: Real>(iterate: &mut Iterate<R>, running: R::Mask) {
    let Direction { length, before, p } = &mut iterate.direction;
    let mut now = R::zero();
    for (&w, &before) in iterate.w.iter().zip(&before.w) {
        now += (w - before).square();
    }
    let beta = now / *length;
    let go = running.and(beta.le(R::one()));
    let step = Step { beta: R::select(go, beta, R::zero()), go, running };
    *length = R::select(running, now, *length);
    for ((x, before), p) in iterate.w.iter_mut().zip(&mut before.w).zip(&mut p.w) {
        step.take(x, before, p);
    }
    for ((x, before), p) in iterate.scalars.iter_mut().zip(&mut before.scalars).zip(&mut p.scalars) {
        step.take(x, before, p);
    }
    for ((x, before), p) in iterate.contacts.iter_mut().zip(&mut before.contacts).zip(&mut p.contacts) {
        for k in 0..3 {
            step.take(&mut x[k], &mut before[k], &mut p[k]);
        }
    }
    for ((x, before), p) in iterate.wide.iter_mut().zip(&mut before.wide).zip(&mut p.wide) {
        for k in 0..6 {
            step.take(&mut x[k], &mut before[k], &mut p[k]);
        }
    }
}

struct Step<R: Real> {
    beta: R,
    /// Lanes that go on along p.
    go: R::Mask,
    /// Lanes that go on at all; the others keep every bit.
    running: R::Mask,
}

impl<R: Real> Step<R> {
    #[inline(always)]
    fn take(&self, x: &mut R, before: &mut R, p: &mut R) {
        let d = *x - *before;
        let along = self.beta * *p;
        *x = R::select(self.go, *x + along, *x);
        *p = R::select(self.running, R::select(self.go, along + d, R::zero()), *p);
        *before = R::select(self.running, *x, *before);
    }
}

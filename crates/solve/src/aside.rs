//! Few lanes go on by themselves, in half the registers.
//!
//! The lanes of a group need different numbers of sweeps. Once those that are left fit into half the registers, their part of the problem is
//! copied there, with all that the sweeps so far have left behind: what they do next is the same to the bit, at half the cost.

use crate::pgs::Run;
use crate::{Capacity, Iterate, Problem};
use stepper_real::{Mask, Real};

/// Room for half of the lanes.
#[derive(Clone, Debug)]
pub(crate) struct Aside<R: Real> {
    problem: Problem<R>,
    iterate: Iterate<R>,
}

/// The lanes that are picked: where each comes from.
#[derive(Clone, Copy)]
pub(crate) struct Order {
    /// One for every lane of the half; those beyond the count are whatever comes first.
    from: [u32; 16],
    count: usize,
}

impl Order {
    #[inline(always)]
    fn of(mut bits: u32) -> Self {
        let mut order = Self { from: [0; 16], count: 0 };
        while bits != 0 {
            order.from[order.count] = bits.trailing_zeros();
            order.count += 1;
            bits &= bits - 1;
        }
        order
    }

    #[inline(always)]
    pub(crate) fn pick<R: Real>(&self, x: R) -> R::Half {
        x.gather_lanes(&self.from)
    }

    #[inline(always)]
    pub(crate) fn pick_each<R: Real, const N: usize>(&self, x: &[R; N]) -> [R::Half; N] {
        let mut picked = [R::Half::zero(); N];
        for k in 0..N {
            picked[k] = self.pick(x[k]);
        }
        picked
    }

    /// Into a list that has room.
    #[inline(always)]
    pub(crate) fn pick_all<R: Real, const N: usize>(&self, from: &[[R; N]], to: &mut Vec<[R::Half; N]>) {
        to.resize(from.len(), [R::Half::zero(); N]);
        for (to, from) in to.iter_mut().zip(from) {
            *to = self.pick_each(from);
        }
    }

    #[inline(always)]
    pub(crate) fn pick_numbers<R: Real>(&self, from: &[R], to: &mut Vec<R::Half>) {
        to.resize(from.len(), R::Half::zero());
        for (to, &from) in to.iter_mut().zip(from) {
            *to = self.pick(from);
        }
    }

    #[inline(always)]
    pub(crate) fn pick_mask<R: Real>(&self, m: R::Mask) -> <R::Half as Real>::Mask {
        self.pick(R::select(m, R::one(), R::zero())).gt(R::Half::zero())
    }

    /// Puts back what was picked.
    #[inline(always)]
    fn place<R: Real>(&self, from: R::Half, to: &mut R) {
        for (i, &l) in self.from[..self.count].iter().enumerate() {
            to.set_lane(l as usize, from.lane(i));
        }
    }

    #[inline(always)]
    fn place_all<R: Real>(&self, from: &[R::Half], to: &mut [R]) {
        for (to, &from) in to.iter_mut().zip(from) {
            self.place(from, to);
        }
    }
}

impl<R: Real> Aside<R> {
    /// None where the lanes are in one register.
    pub(crate) fn new<Whole: Real<Half = R>>(room: &Capacity) -> Option<Box<Self>> {
        (Whole::LANES > R::LANES).then(|| Box::new(Self { problem: Problem::new(room), iterate: Iterate::new(room) }))
    }
}

/// Sweeps until the lanes that are running have paused, if they fit into half the registers.
#[inline(always)]
pub(crate) fn pause<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, run: &mut Run<R>) -> bool {
    if R::LANES == R::Half::LANES {
        return false;
    }
    let running = run.running.bits();
    if running.count_ones() as usize > R::Half::LANES {
        return false;
    }
    let order = Order::of(running);
    let Some(mut aside) = iterate.aside.take() else { return false };
    let Aside { problem: part, iterate: own } = &mut *aside;
    problem.pick(&order, part);
    iterate.pick(&order, own);
    let mut half = Run::<R::Half> {
        running: <R::Half as Real>::Mask::from_bits((1 << order.count) - 1),
        threshold: order.pick(run.threshold),
        sweeps: order.pick(run.sweeps),
        most: run.most,
        apart: order.pick_mask::<R>(run.apart),
    };
    R::Half::vectorize(
        #[inline(always)]
        || {
            while half.running.any() {
                half.sweep(part, own);
            }
        },
    );
    order.place_all(&own.w, &mut iterate.w);
    order.place_all(&own.scalars, &mut iterate.scalars);
    order.place_all(own.contacts.as_flattened(), iterate.contacts.as_flattened_mut());
    order.place_all(own.wide.as_flattened(), iterate.wide.as_flattened_mut());
    order.place_all(&own.slip, &mut iterate.slip);
    order.place_all(&own.wide_slip, &mut iterate.wide_slip);
    order.place(half.sweeps, &mut run.sweeps);
    let mut apart = R::select(run.apart, R::one(), R::zero());
    order.place(R::Half::select(half.apart, R::Half::one(), R::Half::zero()), &mut apart);
    run.apart = apart.gt(R::zero());
    run.running = R::Mask::splat(false);
    iterate.aside = Some(aside);
    true
}

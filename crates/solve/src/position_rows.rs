//! Rows of the position solve: copies of those of a problem, with damped demands, so that positions are corrected as far as moderate motion
//! can do it.
//!
//! Demands of positions (gaps to close, overlaps to undo) may contradict one another, or be such that only an absurd motion meets them: a
//! normal that passes a hinge at a micrometre, a chain that is stretched. With a compliance R on the diagonal of G their solution is that
//! of damped least squares (Levenberg 1944; for manipulators Nakamura & Hanafusa 1986 and Wampler 1986): a demand d along a row of mobility
//! G is met as G / (G + R), the scaled motion is at most d / (2 sqrt(R)), and where demands contradict one another what is left of them is
//! as small as it can be in the mean square. Impulses that hold already cost nothing: compliance counts from them.
//!
//! Whether demands cannot be met at all is proven by Farkas' lemma: impulses z >= 0 of the rows with `-z . u > sum_d |J^T z|_d c_d`, u
//! being what the rows lack at the motion that there is. No change of the velocities within the bounds c gives them as much (weak duality).

use crate::capacity::Capacity;
use crate::constraints::constraint_set::{ConstraintSet, Damping, ReferenceRows, Rows};
use crate::constraints::{by_kind, each_kind, make_kinds};
use crate::iterate::Iterate;
use crate::problem::{Problem, System};
use crate::reference::Reference;
use stepper_real::{Mask, Real};

by_kind! {
    /// Rows as the position solve reads them: those of a [`Problem`], which stays as it is, with other demands and more compliance.
    #[derive(Clone, Debug)]
    pub struct PositionRows[R: Real] {} each own_rows
}

impl<R: Real> PositionRows<R> {
    /// Reserves memory for the rows of a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        make_kinds!(Self {} [count: capacity] => Rows::with_capacity(count))
    }

    /// Copies the rows of a problem; their demands are those of the velocity solve until they are exchanged.
    #[inline(always)]
    pub fn copy(&mut self, problem: &Problem<R>) {
        each_kind!([own: &mut self] [set: &problem] => own.copy(set.rows()));
    }

    /// System of these rows, which were copied from `problem`.
    #[inline(always)]
    pub fn system<'a>(&'a self, problem: &'a Problem<R>) -> System<'a, R> {
        make_kinds!(System { problem, certified: true, } [own: &self] => own)
    }

    /// Takes up a scaled change of the free velocity, as [`Problem::shift`] does.
    #[inline(always)]
    pub fn shift(&mut self, problem: &Problem<R>, change: &[R], lanes: R::Mask) {
        each_kind!([own: &mut self] [set: &problem] => set.shift(own, change, lanes));
    }

    /// Shifts what one contact demands in the velocity solve, as [`Problem::shift_contact`] does.
    #[inline(always)]
    pub fn shift_contact(&mut self, problem: &Problem<R>, i: usize, change: &[R], lanes: R::Mask, weights: [R; 2]) {
        match i.checked_sub(self.contacts.items.len()) {
            None => problem.contacts.shift_contact(&mut self.contacts.items[i], change, lanes, weights),
            Some(i) => problem.rolling_contacts.shift_contact(&mut self.rolling_contacts.items[i], change, lanes, weights),
        }
    }

    /// Takes contact `i`, counted over those of three rows and then of six, out of the lanes `lanes`.
    #[inline(always)]
    pub fn leave_out_contact(&mut self, i: usize, lanes: R::Mask) {
        let active = match i.checked_sub(self.contacts.items.len()) {
            None => &mut self.contacts.items[i].active,
            Some(i) => &mut self.rolling_contacts.items[i].active,
        };
        *active = active.and_not(lanes);
    }

    /// Exchanges the two demands of every row: g for that of the position solve, or back.
    #[inline(always)]
    pub fn exchange_targets(&mut self) {
        each_kind!([own: &mut self] => own.exchange_targets());
    }

    /// Damps what the rows demand, counted from the impulses and the motion of `iterate`, which are kept in `reference`. The compliance of
    /// a scalar row is the damping ratio of its mobility; that of a contact refers to its mobility and its floor (`floors`, 1/kg, one for
    /// each constraint), and grows with what it corrects: the difference of its two demands. Rows that correct nothing stay hard.
    #[inline(always)]
    pub fn damp(
        &mut self,
        problem: &Problem<R>,
        iterate: &Iterate<R>,
        damping: Damping<R>,
        mut floors: &[R],
        reference: &mut Reference<R>,
    ) {
        let Reference { w, lambda, g, .. } = reference;
        w.clone_from(&iterate.w);
        lambda.clear();
        g.clear();
        each_kind!([own: &mut self] [set: &problem] [impulses: &iterate] => {
            let floors = take(&mut floors, own.items.len());
            set.damp(own, impulses, damping, floors, [&mut *lambda, &mut *g]);
        });
    }
}

impl<R: Real> System<'_, R> {
    /// Largest velocity that damping keeps a row from what it demands, m/s or rad/s.
    #[inline(always)]
    pub fn shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>) -> R {
        let (mut most, mut before) = (R::zero(), &reference.lambda[..]);
        each_kind!([set: &self.problem] [rows: self] [impulses: &iterate] => {
            most = set.shortfall(rows, impulses, take(&mut before, rows.items.len()), most);
        });
        most
    }

    /// Largest velocity that rows and contacts demand where nothing can move, m/s or rad/s.
    #[inline(always)]
    pub fn immovable_target(&self) -> R {
        let mut most = R::zero();
        each_kind!([set: &self.problem] [rows: self] => most = set.immovable_target(rows, most));
        most
    }

    /// Largest velocity that rows and contacts demand of the velocities, without any correction of positions, where nothing can move, m/s
    /// or rad/s: a part of the residual that no impulse can change. Of a problem, not of its position rows.
    #[inline(always)]
    pub fn unmet_velocity(&self) -> R {
        let mut most = R::zero();
        each_kind!([set: &self.problem] [rows: self] => most = set.unmet_velocity(rows, most));
        most
    }

    /// Witness of infeasibility: the impulses z that were added to those of the reference. Leaves the scaled J^T z in the reference's
    /// momentum, and returns -z . u (J), the work that they say the rows lack at its motion. Friction and springs have no part in it, nor
    /// have contacts and limits that push less than before.
    #[inline(always)]
    pub fn witness(&self, iterate: &Iterate<R>, reference: &mut Reference<R>) -> R {
        let Reference { w, lambda, g, momentum } = reference;
        momentum.clear();
        momentum.resize(w.len(), R::zero());
        let (mut lambda, mut g, mut lack) = (&lambda[..], &g[..], R::zero());
        each_kind!([set: &self.problem] [rows: self] [impulses: &iterate] => {
            let n = rows.items.len();
            let before = ReferenceRows { lambda: take(&mut lambda, n), g: take(&mut g, n) };
            lack = set.witness(rows, impulses, before, w, momentum, lack);
        });
        lack
    }
}

/// Takes the first `n` numbers of a list that has one for every constraint, by kind.
#[inline(always)]
fn take<'a, R>(list: &mut &'a [R], n: usize) -> &'a [R] {
    let (first, rest) = list.split_at(n);
    *list = rest;
    first
}

//! Damped demands: positions are corrected as far as moderate motion can do it.
//!
//! Demands of positions (gaps to close, overlaps to undo) may contradict one another, or be such that only an absurd motion meets them: a
//! normal that passes a hinge at a micrometre, a chain that is stretched. With a compliance R on the diagonal of G their solution is that
//! of damped least squares (Levenberg 1944; for manipulators Nakamura & Hanafusa 1986 and Wampler 1986): a demand d along a row of mobility
//! G is met as G / (G + R), the scaled motion is at most d / (2 sqrt(R)), and where demands contradict one another what is left of them is
//! as small as it can be in the mean square. Impulses that hold already cost nothing: compliance counts from them.
//!
//! Whether demands cannot be met at all is proven by Farkas' lemma: impulses z >= 0 of the rows with `-z . u > sum_d |J^T z|_d c_d`, u
//! being what the rows lack at the motion that there is. No change of the velocities within the bounds c gives them as much (weak duality).

use crate::constraints::{ConstraintSet, Damping, ReferenceRows};
use crate::iterate::Iterate;
use crate::problem::Problem;
use crate::reference::Reference;
use stepper_real::Real;

impl<R: Real> Problem<R> {
    /// Exchanges what the rows demand, g, for `demands`: one for every scalar row; for every contact, of three rows and then of six, g of
    /// the normal row and a change of g of the others. A second exchange undoes the first.
    #[inline(always)]
    pub fn exchange_demands(&mut self, demands: &mut [R]) {
        let (scalars, contacts) = demands.split_at_mut(self.scalars.len());
        let (contacts, rolling_contacts) = contacts.split_at_mut(3 * self.contacts.len());
        self.scalars.exchange_demands(scalars);
        self.contacts.exchange_demands(contacts);
        self.rolling_contacts.exchange_demands(rolling_contacts);
    }

    /// Damps what the rows demand, counted from the impulses and the motion of `iterate`, which are kept in `reference`. The compliance of
    /// a scalar row is the damping ratio of its mobility; that of a contact refers to its mobility and its floor (`floors`, 1/kg, one for
    /// each contact), and grows with what it corrects. Rows that correct nothing stay hard: `before` is what was exchanged for their
    /// demands.
    #[inline(always)]
    pub fn damp(&mut self, iterate: &Iterate<R>, damping: Damping<R>, floors: &[R], before: &[R], reference: &mut Reference<R>) {
        let Reference { w, lambda, g, .. } = reference;
        w.clone_from(&iterate.w);
        lambda.clear();
        g.clear();
        let (floors, rolling_floors) = floors.split_at(self.contacts.len());
        let (before, contacts_before) = before.split_at(self.scalars.len());
        let (contacts_before, rolling_before) = contacts_before.split_at(3 * self.contacts.len());
        self.scalars.damp(&iterate.scalars, damping, &[], before, [&mut *lambda, &mut *g]);
        self.contacts.damp(&iterate.contacts, damping, floors, contacts_before, [&mut *lambda, &mut *g]);
        self.rolling_contacts.damp(&iterate.rolling_contacts, damping, rolling_floors, rolling_before, [lambda, g]);
    }

    /// Largest velocity that damping keeps a row from what it demands, m/s or rad/s.
    #[inline(always)]
    pub fn shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>) -> R {
        let [scalars, contacts, rolling_contacts] = self.split_by_kind(&reference.lambda);
        let mut most = self.scalars.shortfall(&iterate.scalars, scalars, R::zero());
        most = self.contacts.shortfall(&iterate.contacts, contacts, most);
        self.rolling_contacts.shortfall(&iterate.rolling_contacts, rolling_contacts, most)
    }

    /// Largest velocity that rows and contacts demand where nothing can move, m/s or rad/s.
    #[inline(always)]
    pub fn immovable_demand(&self) -> R {
        let most = self.contacts.immovable_demand(self.scalars.immovable_demand(R::zero()));
        self.rolling_contacts.immovable_demand(most)
    }

    /// Witness of infeasibility: the impulses z that were added to those of the reference. Leaves the scaled J^T z in the reference's
    /// momentum, and returns -z . u (J), the work that they say the rows lack at its motion. Friction and springs have no part in it, nor
    /// have contacts and limits that push less than before.
    #[inline(always)]
    pub fn witness(&self, iterate: &Iterate<R>, reference: &mut Reference<R>) -> R {
        let Reference { w, lambda, g, momentum } = reference;
        momentum.clear();
        momentum.resize(w.len(), R::zero());
        let (lambda, g) = (self.split_by_kind(lambda), self.split_by_kind(g));
        let rows = |kind: usize| ReferenceRows { lambda: lambda[kind], g: g[kind] };
        let mut lack = R::zero();
        lack = self.scalars.witness(&iterate.scalars, rows(0), w, momentum, lack);
        lack = self.contacts.witness(&iterate.contacts, rows(1), w, momentum, lack);
        self.rolling_contacts.witness(&iterate.rolling_contacts, rows(2), w, momentum, lack)
    }

    /// A list with one number for every constraint, by kind.
    #[inline(always)]
    fn split_by_kind<'a>(&self, list: &'a [R]) -> [&'a [R]; 3] {
        let (scalars, contacts) = list.split_at(self.scalars.len());
        let (contacts, rolling_contacts) = contacts.split_at(self.contacts.len());
        [scalars, contacts, rolling_contacts]
    }
}

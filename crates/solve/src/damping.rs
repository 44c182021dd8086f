//! Damped demands: what is asked of positions is met as far as moderate motion can meet it.
//!
//! Demands of positions (gaps to close, overlaps to undo) may contradict one another, or be such that only an absurd motion meets them: a normal
//! that passes a hinge at a micrometre, a chain that is stretched. With a compliance R on the diagonal of G their solution is that of damped
//! least squares (Levenberg 1944; for manipulators Nakamura & Hanafusa 1986 and Wampler 1986): a demand d along a row of mobility G is met as
//! G / (G + R), the scaled motion is at most d / (2 sqrt(R)), and where demands contradict one another what is left of them is as small as it can be
//! in the mean square. Impulses that hold already cost nothing: compliance counts from them.
//!
//! Whether demands cannot be met at all is proven by Farkas' lemma: impulses z >= 0 of the rows with `-z . u > sum_d |J^T z|_d c_d`, u being what
//! the rows lack at the motion that there is. No change of the velocities within the bounds c gives them as much (weak duality).

use crate::cone::keep;
use crate::{Capacity, Iterate, Problem, ScalarRow};
use stepper_real::{Mask, Real};

/// The solution that a second one starts from.
#[derive(Clone, Debug, Default)]
pub struct Reference<R> {
    /// w of it.
    w: Vec<R>,
    /// Normal impulses, of the scalar rows, the contacts and those with six rows.
    lambda: Vec<R>,
    /// What their rows demand: velocity g, undamped.
    g: Vec<R>,
    /// J^T z of the witness, scaled.
    momentum: Vec<R>,
}

impl<R: Real> ScalarRow<R> {
    /// The part of a `correction` of the velocity that damping leaves: to be given to a row that others reckon with, which [`Problem::damp`]
    /// then leaves alone.
    #[inline(always)]
    pub fn damp_correction(&mut self, share: R, correction: R) -> R {
        let stiffness = self.diagonal + share * self.mobility;
        let met = correction * (self.diagonal / R::select(stiffness.gt(R::zero()), stiffness, R::one()));
        let met = R::select(share.gt(R::zero()), met, correction);
        self.lack = R::select(self.held, correction, correction - met);
        met
    }
}

impl<R: Real> Problem<R> {
    /// Exchanges what the rows demand, g, for `demands`: one for every scalar row; for every contact, then for every one with six rows, g of the normal
    /// row and what is added to g of the others. A second exchange undoes the first.
    #[inline(always)]
    pub fn exchange(&mut self, demands: &mut [R]) {
        let (scalars, contacts) = demands.split_at_mut(self.scalars.len());
        let (contacts, wide) = contacts.split_at_mut(3 * self.contacts.len());
        for (row, g) in self.scalars.iter_mut().zip(scalars) {
            std::mem::swap(&mut row.g, g);
        }
        for (block, g) in self.contacts.iter_mut().zip(contacts.as_chunks_mut().0) {
            exchange(&mut block.g, g);
        }
        for (block, g) in self.wide.iter_mut().zip(wide.as_chunks_mut().0) {
            exchange(&mut block.g, g);
        }
    }

    /// Damps what the rows demand, counted from the impulses and the motion of `iterate`, which are kept in `reference`. The compliance of a row is
    /// `share` of its mobility; for contacts, then for those with six rows, `share` of that and of `floors` (1/kg), with `bend` (s/m) of it for
    /// every m/s that it corrects. Rows that correct nothing stay hard: `before` is what was exchanged for their demands.
    #[inline(always)]
    pub fn damp(&mut self, iterate: &Iterate<R>, [share, bend]: [R; 2], floors: &[R], before: &[R], reference: &mut Reference<R>) {
        reference.w.clone_from(&iterate.w);
        reference.lambda.clear();
        reference.g.clear();
        for (k, (row, &lambda)) in self.scalars.iter_mut().zip(&iterate.scalars).enumerate() {
            reference.lambda.push(lambda);
            reference.g.push(row.g + row.lack);
            // Separate rows are damped when they are made: other rows reckon with what they will do.
            if k >= self.separate {
                let corrects = row.g.eq(before[k]).not();
                let compliance = keep(corrects, share * row.mobility);
                row.g -= compliance * lambda;
                row.compliance += compliance;
                row.diagonal += compliance;
                row.inv_diagonal = R::one() / R::select(row.diagonal.gt(R::zero()), row.diagonal, R::one());
            }
        }
        let (floors, wide_floors) = floors.split_at(self.contacts.len());
        let (before, wide_before) = before[self.scalars.len()..].split_at(3 * self.contacts.len());
        let contacts = self.contacts.iter_mut().zip(&iterate.contacts).zip(floors).zip(before.chunks_exact(3));
        for (((block, &lambda), &floor), before) in contacts {
            reference.lambda.push(lambda[0]);
            reference.g.push(block.g[0]);
            block.damp(compliance([share, bend], before[0] - block.g[0], block.mobility() + floor), lambda);
        }
        let wide = self.wide.iter_mut().zip(&iterate.wide).zip(wide_floors).zip(wide_before.chunks_exact(6));
        for (((block, &lambda), &floor), before) in wide {
            reference.lambda.push(lambda[0]);
            reference.g.push(block.g[0]);
            block.damp(compliance([share, bend], before[0] - block.g[0], block.mobility() + floor), lambda);
        }
        self.damped = true;
    }

    /// Largest velocity that damping keeps a row from what it demands, m/s or rad/s.
    #[inline(always)]
    pub fn shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>) -> R {
        let mut most = R::zero();
        for (k, (row, &now)) in self.scalars.iter().zip(&iterate.scalars).enumerate() {
            let change = now - reference.lambda[k];
            let give = if k < self.separate { R::zero() } else { row.compliance * change };
            // The compliance of a spring is its own law.
            most = most.max(keep(row.active.and(row.mobility.gt(R::zero())), give.abs().max(row.lack.abs())));
        }
        let (before, wide_before) = reference.lambda[self.scalars.len()..].split_at(self.contacts.len());
        for ((block, now), &before) in self.contacts.iter().zip(&iterate.contacts).zip(before) {
            most = most.max(keep(block.active, (block.compliance * (now[0] - before)).abs()));
        }
        for ((block, now), &before) in self.wide.iter().zip(&iterate.wide).zip(wide_before) {
            most = most.max(keep(block.active, (block.compliance * (now[0] - before)).abs()));
        }
        most
    }

    /// What rows and contacts that nothing can move demand, m/s or rad/s.
    #[inline(always)]
    pub fn held_demand(&self) -> R {
        let mut most = R::zero();
        for row in &self.scalars {
            most = most.max(keep(row.held, row.lack.abs()));
        }
        for block in &self.contacts {
            most = most.max(keep(block.held, -block.g[0]));
        }
        for block in &self.wide {
            most = most.max(keep(block.held, -block.g[0]));
        }
        most
    }

    /// The impulses z that were added to those of the reference as a witness: leaves the scaled J^T z in its `momentum`, and returns -z . u (J), what
    /// they say the rows lack at its motion. Friction and springs have no part in it, nor have contacts and limits that push less than before.
    #[inline(always)]
    pub fn witness(&self, iterate: &Iterate<R>, reference: &mut Reference<R>) -> R {
        let Reference { w, lambda, g, momentum } = reference;
        momentum.clear();
        momentum.resize(w.len(), R::zero());
        let mut lack = R::zero();
        let infinite = R::of(f64::INFINITY);
        for ((row, &now), (&before, &g)) in self.scalars.iter().zip(&iterate.scalars).zip(lambda.iter().zip(&*g)) {
            let change = now - before;
            let unbounded = row.active.and(row.mobility.gt(R::zero())).and(row.hi.ge(infinite));
            let z = keep(unbounded, R::select(row.lo.le(-infinite), change, change.max(R::zero())));
            let u = self.scalar_velocity(row, w) - row.g + g;
            lack -= z * u;
            self.add_scalar(row, z, momentum);
        }
        let ((lambda, wide_lambda), (g, wide_g)) = {
            let (scalars, contacts) = (self.scalars.len(), self.contacts.len());
            (lambda[scalars..].split_at(contacts), g[scalars..].split_at(contacts))
        };
        for ((block, now), (&before, &g)) in self.contacts.iter().zip(&iterate.contacts).zip(lambda.iter().zip(g)) {
            let z = keep(block.active, (now[0] - before).max(R::zero()));
            let u = self.contact_velocity(block, w)[0] - block.g[0] + g;
            lack -= z * u;
            self.add_contact(block, [z, R::zero(), R::zero()], momentum);
        }
        for ((block, now), (&before, &g)) in self.wide.iter().zip(&iterate.wide).zip(wide_lambda.iter().zip(wide_g)) {
            let z = keep(block.active, (now[0] - before).max(R::zero()));
            let u = self.wide_velocity(block, w)[0] - block.g[0] + g;
            lack -= z * u;
            let mut d = [R::zero(); 6];
            d[0] = z;
            self.add_wide(block, d, momentum);
        }
        lack
    }
}

impl<R: Real> Reference<R> {
    /// Room for the solution of a problem with that room.
    pub fn new(room: &Capacity) -> Self {
        let rows = room.scalars + room.contacts + room.wide;
        let reserve = |n: usize| Vec::with_capacity(n);
        Self { w: reserve(room.dimension), lambda: reserve(rows), g: reserve(rows), momentum: reserve(room.dimension) }
    }

    /// The momentum of the last witness, scaled as w is: [`Problem::witness`].
    pub fn momentum(&mut self) -> &mut [R] {
        &mut self.momentum
    }
}

#[inline(always)]
fn exchange<R: Real, const N: usize>(g: &mut [R; N], demands: &mut [R; N]) {
    std::mem::swap(&mut g[0], &mut demands[0]);
    for k in 1..N {
        g[k] += demands[k];
        demands[k] = -demands[k];
    }
}

/// Compliance of a contact of that mobility that corrects so many m/s: none where it corrects nothing.
#[inline(always)]
fn compliance<R: Real>([share, bend]: [R; 2], correction: R, mobility: R) -> R {
    keep(correction.gt(R::zero()), (share + bend * correction) * mobility)
}

//! Contacts with Coulomb friction, of any number of rows: the normal row first, then the tangential ones.
//!
//! All contacts are in one list. A [`FrictionContact`] has the numbers that do not depend on the number of rows. The others are in
//! [`FrictionRows`], of which there is one list for each number of rows. A [`LocalSolver`] solves one contact, with the contact's block of
//! the Delassus matrix G.
//!
//! w is the scaled velocity change: the change of velocity by the impulses, in coordinates in which the mass matrix is the identity.

use std::ops::Deref;

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::{masked, movable, project};
use crate::constraints::constraint_set::{
    ConstraintBase, ConstraintList, ConstraintSet, Damping, LaneConstraint, RowEntries, SavedConstraint, SweepLanes, add_transposed,
    is_nonzero, multiply, number_of,
};
use crate::constraints::local_solver::{LocalSolver, NaturalStep};
use crate::constraints::orthogonalisation::velocity_rounding;
use crate::constraints::rolling::RollingSolver;
use crate::constraints::sliding::SlidingSolver;
use stepper_real::{Mask, Real, kernel};

/// Largest number of rows of a contact.
pub const MAX_CONTACT_ROWS: usize = 6;

/// Contact with friction, without the numbers that depend on its number of rows.
#[derive(Clone, Copy, Debug)]
pub struct FrictionContact<R: Real> {
    /// Place of the contact, and the lanes in which it is active and in which it is immovable.
    common: ConstraintBase<R>,
    /// Number of rows, and index of the contact among the contacts with this number.
    index: RowsIndex,
    /// Lanes in which the contact is deferred: the solver ignores its rows until they are activated.
    deferred: R::Mask,
    /// Friction coefficient of the scaled rows; 0 for a frictionless contact.
    pub mu: R,
    /// Compliance R >= 0 of the normal row: velocity per unit of impulse, 1/kg. It is 0 for a hard contact.
    compliance: R,
    /// Factor G_nn / (G_nn + R) that multiplies the normal row's residual. It removes the part due to the contact's spring, so that an
    /// error of the velocity remains. G_nn is the row's diagonal entry of the Delassus matrix and R its compliance. The factor is 1 for a
    /// hard contact.
    rigid_fraction: R,
    /// Compliance that damps all rows of the contact in the position solve, 1/kg.
    damping: R,
    /// Step of the contact's natural map, which scales its residual.
    pub(crate) step: NaturalStep<R>,
}

/// Number of rows of a contact, and index among the contacts with this number.
#[derive(Clone, Copy, Debug)]
pub enum RowsIndex {
    /// Contact with sliding friction: rows (n, t1, t2).
    Three(usize),
    /// Contact with torsional friction: rows (n, t1, t2, spin).
    Four(usize),
    /// Contact with rolling friction: rows (n, t1, t2, spin, roll1, roll2).
    Six(usize),
}

/// Evaluates an expression for the rows of one contact of a list. `with_rows!([rows: &list] of contact => rows.velocity(..))` binds `rows`
/// to a reference to the contact's [`FrictionRows`].
macro_rules! with_rows {
    ([$rows:ident: $($list:tt)+] of $contact:expr => $value:expr) => {
        match $contact.index {
            RowsIndex::Three(i) => {
                let $rows = $($list)+.three[i];
                $value
            }
            RowsIndex::Four(i) => {
                let $rows = $($list)+.four[i];
                $value
            }
            RowsIndex::Six(i) => {
                let $rows = $($list)+.six[i];
                $value
            }
        }
    };
}

/// Rows of one contact: `N` offsets, and the solver `L` of the contact at constant other impulses.
#[derive(Clone, Copy, Debug)]
pub struct FrictionRows<R: Real, const N: usize, L> {
    /// Velocity g of each row of the contact before any impulse, plus its bias (the negated velocity target), m/s. This value is for the
    /// velocity solve; `position_g` is for the position solve.
    g: [R; N],
    /// Offset of each row in the position solve, m/s. For the normal row it replaces g. For the tangential rows it is added to g.
    position_g: [R; N],
    /// Solver of this contact at constant other impulses.
    local: L,
}

/// Possible number `N` of rows of a contact, as the type `[R; N]`.
pub trait RowCount<R: Real, const N: usize> {
    /// Solver of a contact with `N` rows.
    type Solver: LocalSolver<R, N>;

    /// Appends the rows of a contact to a list. Returns their index.
    fn push(list: &mut ContactList<R>, rows: FrictionRows<R, N, Self::Solver>) -> RowsIndex;
}

impl<R: Real> RowCount<R, 3> for [R; 3] {
    type Solver = SlidingSolver<R>;

    #[inline(always)]
    fn push(list: &mut ContactList<R>, rows: FrictionRows<R, 3, Self::Solver>) -> RowsIndex {
        list.three.push(rows);
        RowsIndex::Three(list.three.len() - 1)
    }
}

impl<R: Real> RowCount<R, 4> for [R; 4] {
    type Solver = RollingSolver<R, 4, 3>;

    #[inline(always)]
    fn push(list: &mut ContactList<R>, rows: FrictionRows<R, 4, Self::Solver>) -> RowsIndex {
        list.four.push(rows);
        RowsIndex::Four(list.four.len() - 1)
    }
}

impl<R: Real> RowCount<R, 6> for [R; 6] {
    type Solver = RollingSolver<R, 6, 5>;

    #[inline(always)]
    fn push(list: &mut ContactList<R>, rows: FrictionRows<R, 6, Self::Solver>) -> RowsIndex {
        list.six.push(rows);
        RowsIndex::Six(list.six.len() - 1)
    }
}

impl<R: Real, const N: usize, L: LocalSolver<R, N>> FrictionRows<R, N, L> {
    /// Velocity y . w + g of each row at the scaled velocity change `w`, m/s. The velocity due to the compliance is not included.
    #[inline(always)]
    fn velocity(&self, (columns, y): RowEntries<'_, R>, w: &[R]) -> [R; N] {
        let mut v = multiply(columns, y.as_chunks().0, w);
        for k in 0..N {
            v[k] += self.g[k];
        }
        v
    }

    /// Velocity of each row under the impulse `lambda`, including the velocity due to the compliance, m/s. `compliant` is whether any
    /// contact of the list may have a compliance.
    #[inline(always)]
    fn velocity_under(
        &self,
        contact: &FrictionContact<R>,
        entries: RowEntries<'_, R>,
        w: &[R],
        compliant: bool,
        lambda: &[R; N],
    ) -> [R; N] {
        let mut v = self.velocity(entries, w);
        if compliant {
            v[0] += (contact.damping + contact.compliance) * lambda[0];
            for k in 1..N {
                v[k] += contact.damping * lambda[k];
            }
        }
        v
    }

    /// Updates the impulse `lambda` and the multiplier of one contact in a Gauss-Seidel iteration, see [`FrictionContacts::sweep`], in
    /// those `lanes` that run. Returns the largest change of an impulse.
    #[inline(always)]
    fn update(
        &self,
        contact: &FrictionContact<R>,
        (columns, y): RowEntries<'_, R>,
        compliant: bool,
        (impulse, multiplier, w): (&mut [R], &mut R, &mut [R]),
        lanes: SweepLanes<R>,
    ) -> R {
        let SweepLanes { running: lanes, exact } = lanes;
        let lambda = *rows_of(impulse);
        let v = self.velocity_under(contact, (columns, y), w, compliant, &lambda);
        let (mut next, s) = self.local.solve(contact.mu, v, lambda, *multiplier, lanes);
        if lanes.and_not(exact).any() {
            let weak = self.local.relax(contact.mu, v, lambda, contact.active);
            for k in 0..N {
                next[k] = R::select(exact, next[k], weak[k]);
            }
        }
        let mut d = lambda;
        for k in 0..N {
            d[k] = masked(lanes, next[k] - lambda[k]);
            impulse[k] = R::select(lanes, next[k], lambda[k]);
        }
        *multiplier = R::select(lanes, s, *multiplier);
        let mut most = d[0].abs();
        for k in 1..N {
            most = most.max(d[k].abs());
        }
        if is_nonzero(most) {
            add_transposed(columns, y.as_chunks().0, d, w);
        }
        most
    }

    /// Residual of one contact, see [`ConstraintList::residual`].
    #[inline(always)]
    fn residual(&self, contact: &FrictionContact<R>, entries: RowEntries<'_, R>, w: &[R], compliant: bool, lambda: &[R]) -> R {
        let lambda = rows_of(lambda);
        let v = self.velocity_under(contact, entries, w, compliant, lambda);
        let (mu, rho) = (contact.mu, contact.step.rho);
        let mut moved = *lambda;
        for k in 1..N {
            moved[k] -= rho * v[k];
        }
        moved[0] -= rho * (v[0] + mu * tangential_speed(&v));
        let image = project(moved, mu);
        let mut apart = ((lambda[0] - image[0]) * contact.rigid_fraction).square();
        for k in 1..N {
            apart += (lambda[k] - image[k]).square();
        }
        apart.sqrt() * contact.step.inv_rho
    }

    /// Adds a compliance that damps the position target of one contact, see [`ConstraintList::damp`].
    #[inline(always)]
    fn damp(&mut self, contact: &mut FrictionContact<R>, lambda: &[R], damping: Damping<R>, added_mobility: R) {
        let mobility = self.local.mobility(&contact.step) + added_mobility;
        let correction = self.position_g[0] - self.g[0];
        let compliance = masked(correction.gt(damping.negligible), (damping.ratio + damping.bending * correction) * mobility);
        contact.damping += compliance;
        for k in 0..N {
            self.g[k] -= compliance * lambda[k];
        }
        self.local.damp(compliance, &mut contact.step);
    }

    /// Prepares the solver of a contact again, which moves in more lanes than before. The rows have the entries `y`.
    #[inline(always)]
    fn prepare(&mut self, contact: &mut FrictionContact<R>, y: &[R]) {
        let mut gram = [[R::zero(); N]; N];
        for y in y.as_chunks().0 {
            add_products(&mut gram, y);
        }
        let (local, trace) = L::new(&gram, contact.active);
        self.local = local;
        contact.step = NaturalStep::of_trace::<N>(trace);
    }

    /// Lanes in which a contact is self-locking, see [`FrictionContacts::is_self_locking`].
    #[inline(always)]
    fn is_self_locking(&self, contact: &FrictionContact<R>) -> R::Mask {
        let (FrictionContact { common, mu, step, .. }, g) = (contact, &self.g);
        let trace = step.inv_rho * R::of(N as f64);
        let Some([p, c]) = self.local.fixed_directions(*g, trace) else { return R::Mask::splat(false) };
        let (mut along, mut square, mut across, mut sizes) = (R::zero(), R::zero(), R::zero(), R::zero());
        for i in 0..N {
            along += c[i] * p[i];
            square += c[i] * c[i];
            sizes += g[i].abs();
            for j in 0..i {
                across += (c[j] * p[i] - c[i] * p[j]).square();
            }
        }
        let length = square.sqrt();
        // Largest power against the offsets g, times |c|, of the impulses (n, x) with |x| = 1 on the edge of the friction cone.
        let turned = ((*mu * length).square() - R::one()).max(R::zero()).sqrt();
        let power = along + across.sqrt() * turned;
        common.active.and((*mu * length).gt(R::one())).and(power.gt(sizes * length * R::of(velocity_rounding::<R>())))
    }
}

/// Contacts of one solve, in the order in which they were appended.
#[derive(Clone, Debug)]
pub struct ContactList<R: Real> {
    items: Vec<FrictionContact<R>>,
    /// Rows of the contacts with three rows.
    three: Vec<FrictionRows<R, 3, SlidingSolver<R>>>,
    /// Rows of the contacts with four rows. These rows are scaled so that all have the same friction coefficient.
    four: Vec<FrictionRows<R, 4, RollingSolver<R, 4, 3>>>,
    /// Rows of the contacts with six rows, scaled in the same way.
    six: Vec<FrictionRows<R, 6, RollingSolver<R, 6, 5>>>,
    /// Whether any contact of the list may have a compliance, so that the solver must read it.
    compliant: bool,
}

impl<R: Real> ContactList<R> {
    /// Offset g of each row of contact `i` in the velocity solve, and its stored offset for the position solve, mutable.
    #[inline(always)]
    fn offsets_mut(&mut self, i: usize) -> [&mut [R]; 2] {
        with_rows!([rows: &mut self] of self.items[i] => [&mut rows.g, &mut rows.position_g])
    }
}

/// Contacts of a problem, in the order in which they were appended.
pub type FrictionContacts<R> = ConstraintSet<R, ContactList<R>>;

impl<R: Real> FrictionContacts<R> {
    /// Appends a contact whose `N` rows have the entries `y` at the coordinates `columns`, ascending.
    ///
    /// The contact exists in the lanes `exists`, and `mu` is its friction coefficient. `g` has the offset of each row, m/s: the row's
    /// velocity before any impulse, plus its bias (minus the target velocity). A contact is immovable if its normal mobility is below
    /// `least`, 1/kg, or a tiny fraction of its mobility in all directions.
    #[inline(always)]
    pub fn push<const N: usize>(&mut self, columns: &[u32], y: impl Fn(usize) -> [R; N], exists: R::Mask, mu: R, g: [R; N], least: R)
    where
        [R; N]: RowCount<R, N>,
    {
        let mut gram = [[R::zero(); N]; N];
        let span = self.push_entries(
            columns,
            y,
            #[inline(always)]
            |y| add_products(&mut gram, y),
        );
        let active = movable(exists, gram[0][0], gram[0][0] + gram[1][1] + gram[2][2], least);
        let (local, trace) = <[R; N] as RowCount<R, N>>::Solver::new(&gram, active);
        let mut position_g = [R::zero(); N];
        position_g[0] = g[0];
        let index = <[R; N] as RowCount<R, N>>::push(&mut self.rows, FrictionRows { g, position_g, local });
        self.rows.items.push(FrictionContact {
            common: ConstraintBase { span, active, immovable: exists.and_not(active) },
            index,
            deferred: R::Mask::splat(false),
            mu,
            compliance: R::zero(),
            rigid_fraction: R::one(),
            damping: R::zero(),
            step: NaturalStep::of_trace::<N>(trace),
        });
    }

    /// Lanes in which the last contact of the list is self-locking: no impulse of the friction cone makes it stick with its velocity
    /// offsets g. The caller must call the function before it sets the mobility ratio and the compliance of the contact.
    ///
    /// If fewer degrees of freedom move the contact than it has rows, there is an impulse that changes no velocity. If the friction cone
    /// contains such an impulse, the impulse can grow without bound, and the contact carries any load. Offsets that the joints cannot
    /// produce then have no solution.
    ///
    /// Let `x` be a tangential impulse along the directions without mobility ([`LocalSolver::fixed_directions`]), and `c` the coupling of
    /// these directions to the normal row. Together with the normal impulse `n = -c . x`, it changes no velocity. The impulse (n, x) is in
    /// the friction cone if the angle between `x` and `-c` is at most `acos(1 / (mu |c|))`.
    pub fn is_self_locking(&self) -> R::Mask {
        kernel!(R, || {
            let Some(contact) = self.rows.items.last() else { return R::Mask::splat(false) };
            with_rows!([rows: &self.rows] of contact => rows.is_self_locking(contact))
        })
    }

    /// Makes the last contact of the list movable along its normal in the lanes `lanes`, in which it was immovable. The caller must do
    /// this before setting the mobility ratio and the compliance of the contact.
    pub fn make_movable(&mut self, lanes: R::Mask) {
        kernel!(R, || {
            let Some(contact) = self.rows.items.last_mut() else { return };
            let released = lanes.and(contact.immovable);
            contact.common.active = contact.active.or(released);
            contact.common.immovable = contact.immovable.and_not(released);
            let y = self.y.range(contact.entries());
            with_rows!([rows: &mut self.rows] of contact => rows.prepare(contact, y));
        })
    }

    /// Clears a small approach speed of contact `i`: sets the offset g of its normal row to zero, m/s.
    ///
    /// The function changes lanes in which no impulse can move the contact along its normal, and the approach speed is at most
    /// `negligible`, m/s.
    pub fn clear_negligible_approach(&mut self, i: usize, negligible: R) {
        kernel!(R, || {
            let immovable = self[i].immovable;
            let g = &mut self.offsets_mut(i)[0];
            *g = R::select(immovable.and((-*g).le(negligible)), g.max(R::zero()), *g);
        })
    }

    /// Sets the mobility ratio of the last contact of the list: its mobility trace(G_ii) before the elimination of equality rows, divided
    /// by that after it. The step of the residual uses the mobility before the elimination.
    #[inline(always)]
    pub fn set_mobility_ratio(&mut self, ratio: R) {
        if let Some(contact) = self.rows.items.last_mut() {
            contact.step = contact.step.with_mobility_ratio(ratio);
        }
    }

    /// Sets the offsets of the last contact of the list for the position solve, m/s. By default they are those of the velocity solve.
    ///
    /// The first number is the offset of the normal row. The others are added to the offsets `g` of the tangential rows.
    #[inline(always)]
    pub fn set_position_offset(&mut self, position_g: &[R]) {
        if let Some(last) = self.len().checked_sub(1) {
            self.rows.offsets_mut(last)[1].copy_from_slice(position_g);
        }
    }

    /// Sets the compliance R >= 0 of the normal row of the last contact of the list, 1/kg: that of a spring and a damper between the
    /// surfaces.
    #[inline(always)]
    pub fn set_compliance(&mut self, compliance: R) {
        if let Some(contact) = self.rows.items.last_mut() {
            contact.compliance = compliance;
            // A lane without a spring must not depend on the other lanes: the ratio is 1 except for rounding.
            let ratio = with_rows!([rows: &mut self.rows] of contact => rows.local.add_normal_compliance(compliance));
            contact.rigid_fraction = R::select(compliance.gt(R::zero()), ratio, R::one());
            self.rows.compliant = true;
        }
    }

    /// Offset g of each row of contact `i` in the velocity solve, m/s.
    #[inline(always)]
    pub fn offsets_mut(&mut self, i: usize) -> &mut [R] {
        let [g, _] = self.rows.offsets_mut(i);
        g
    }

    /// Activates the rows of contact `i` in those lanes of `lanes` in which they are deferred. Returns these lanes.
    #[inline(always)]
    pub fn activate(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        let contact = &mut self.rows.items[i];
        let lanes = lanes.and(contact.deferred);
        contact.deferred = contact.deferred.and_not(lanes);
        contact.common.active = contact.active.or(lanes);
        lanes
    }

    /// Defers the rows of contact `i` in those lanes of `lanes` in which they are active: the solver ignores them until they are activated.
    /// In these lanes they must have no impulse.
    #[inline(always)]
    pub fn defer(&mut self, i: usize, lanes: R::Mask) {
        let contact = &mut self.rows.items[i];
        contact.deferred = contact.deferred.or(lanes.and(contact.active));
        contact.common.active = contact.active.and_not(lanes);
    }

    /// Velocity of each row of contact `i` under impulses that cause the scaled velocity change `w`, m/s, followed by zeros. It includes
    /// the bias, so that the normal velocity is 0 at the contact's target velocity.
    #[inline(always)]
    pub fn velocity(&self, i: usize, w: &[R]) -> [R; MAX_CONTACT_ROWS] {
        let (contact, mut out) = (&self[i], [R::zero(); MAX_CONTACT_ROWS]);
        with_rows!([rows: &self.rows] of contact => {
            let v = rows.velocity(self.entries(contact), w);
            out[..v.len()].copy_from_slice(&v);
        });
        out
    }

    /// Normal velocity of contact `i`, m/s, under impulses that cause the scaled velocity change `w`. It includes the bias, so that it is 0
    /// at the contact's target velocity.
    #[inline(always)]
    pub fn normal_velocity_above_target(&self, i: usize, w: &[R]) -> R {
        self.rows.normal_velocity(i, self.entries(&self[i]), w)
    }

    /// Calls `f` with each coordinate at which contact `i` has entries in the lane `lane`, and with the entries of its rows there, followed
    /// by zeros.
    pub fn for_each_entry(&self, i: usize, lane: usize, mut f: impl FnMut(u32, [f64; MAX_CONTACT_ROWS])) {
        let (columns, y) = self.entries(&self[i]);
        for (&c, y) in columns.iter().zip(y.chunks_exact(self[i].span.num_rows)) {
            if y.iter().any(|y| y.lane(lane) != R::Scalar::default()) {
                let mut entries = [0.0; MAX_CONTACT_ROWS];
                entries.iter_mut().zip(y).for_each(|(to, &y)| *to = number_of(y, lane));
                f(c, entries);
            }
        }
    }

    /// Sets the impulse of contact `i` to the first numbers of `lambda` in the lanes `lanes`, where it must be zero before, and updates the
    /// scaled velocity change `w`.
    #[inline(always)]
    pub(crate) fn set_first_impulse(&self, i: usize, lanes: R::Mask, lambda: [R; MAX_CONTACT_ROWS], impulses: &mut [R], w: &mut [R]) {
        let (impulse, mut d) = (&mut impulses[self[i].rows()], lambda);
        for (k, x) in impulse.iter_mut().enumerate() {
            d[k] = masked(lanes, lambda[k]);
            *x = R::select(lanes, lambda[k], *x);
        }
        self.add(i, &d[..impulse.len()], w);
    }

    /// Appends a constraint that was read from a file, with the same numbers in every lane.
    pub(crate) fn load(&mut self, saved: &SavedConstraint) {
        match saved.g.len() {
            3 => self.push_saved::<3>(saved),
            4 => self.push_saved::<4>(saved),
            _ => self.push_saved::<6>(saved),
        }
        self.set_position_offset(&saved.position_g.iter().map(|&g| R::of(g)).collect::<Vec<R>>());
        self.set_mobility_ratio(R::of(saved.mobility_ratio));
        if saved.compliance > 0.0 {
            self.set_compliance(R::of(saved.compliance));
        }
    }

    /// Appends the `N` rows of a contact that was read from a file.
    fn push_saved<const N: usize>(&mut self, saved: &SavedConstraint)
    where
        [R; N]: RowCount<R, N>,
    {
        let least = R::of(if saved.immovable { f64::INFINITY } else { 0.0 });
        let (y, g) = (|c| saved.entries::<R, N>(c), std::array::from_fn(|k| R::of(saved.g[k])));
        self.push(&saved.columns, y, R::Mask::splat(true), R::of(saved.set[0]), g, least);
    }

    /// Makes one Gauss-Seidel iteration over the contacts: each in turn gets the impulse that solves this contact at constant other
    /// impulses. Lanes outside `lanes.exact` get the weaker update of [`LocalSolver::relax`]. `multipliers` has the multiplier of the
    /// friction disc of each contact, from which its local solution starts.
    ///
    /// Returns the larger of `change` and the largest change of a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(
        &self,
        rows: &ContactList<R>,
        impulses: &mut [R],
        multipliers: &mut [R],
        w: &mut [R],
        lanes: SweepLanes<R>,
        mut change: R,
    ) -> R {
        for (contact, multiplier) in rows.items.iter().zip(multipliers) {
            let lanes = SweepLanes { running: lanes.running.and(contact.active), ..lanes };
            // In late sweeps few lanes still run, and many contacts exist in none of them.
            if lanes.running.none() {
                continue;
            }
            let (entries, unknowns) = (self.entries(contact), (&mut impulses[contact.rows()], multiplier, &mut *w));
            let most = with_rows!([own: &rows] of contact => own.update(contact, entries, rows.compliant, unknowns, lanes));
            change = change.max(most * contact.step.inv_rho);
        }
        change
    }

    /// Largest tangential speed of all contacts with a positive normal impulse, m/s.
    #[inline(always)]
    pub(crate) fn fastest_slip(&self, rows: &ContactList<R>, impulses: &[R], w: &[R]) -> R {
        let mut most = R::zero();
        for contact in &rows.items {
            let speed = with_rows!([own: &rows] of contact => tangential_speed(&own.velocity(self.entries(contact), w)));
            most = most.max(masked(contact.active.and(impulses[contact.span.first_row].gt(R::zero())), speed));
        }
        most
    }
}

/// Numbers of the `N` rows of one contact, from a list with a number for each row.
#[inline(always)]
fn rows_of<R, const N: usize>(numbers: &[R]) -> &[R; N] {
    numbers.first_chunk().expect("a number for each row")
}

/// Adds the products of the entries of a contact's rows at one coordinate to the upper triangle of its block of the Delassus matrix.
#[inline(always)]
fn add_products<R: Real, const N: usize>(gram: &mut [[R; N]; N], y: &[R; N]) {
    for i in 0..N {
        for j in i..N {
            gram[i][j] += y[i] * y[j];
        }
    }
}

/// Length of the tangential part of a contact's velocity, m/s.
#[inline(always)]
fn tangential_speed<R: Real, const N: usize>(v: &[R; N]) -> R {
    let mut square = v[1] * v[1];
    for &v in &v[2..] {
        square += v * v;
    }
    square.sqrt()
}

impl<R: Real> Deref for FrictionContact<R> {
    type Target = ConstraintBase<R>;

    #[inline(always)]
    fn deref(&self) -> &ConstraintBase<R> {
        &self.common
    }
}

impl<R: Real> ConstraintList<R> for ContactList<R> {
    type Item = FrictionContact<R>;

    fn with_capacity(capacity: &Capacity) -> Self {
        Self {
            items: Vec::with_capacity(capacity.all_contacts()),
            three: Vec::with_capacity(capacity.contacts),
            four: Vec::with_capacity(capacity.torsional_contacts),
            six: Vec::with_capacity(capacity.rolling_contacts),
            compliant: false,
        }
    }

    #[inline(always)]
    fn items(&self) -> &[FrictionContact<R>] {
        &self.items
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.items.clear();
        self.three.clear();
        self.four.clear();
        self.six.clear();
        self.compliant = false;
    }

    #[inline(always)]
    fn copy(&mut self, from: &Self) {
        self.items.clone_from(&from.items);
        self.three.clone_from(&from.three);
        self.four.clone_from(&from.four);
        self.six.clone_from(&from.six);
        self.compliant = from.compliant;
    }

    #[inline(always)]
    fn offsets(&self, i: usize) -> [&[R]; 2] {
        with_rows!([rows: &self] of self.items[i] => [&rows.g, &rows.position_g])
    }

    #[inline(always)]
    fn exchange_offsets(&mut self, lanes: R::Mask) {
        for i in 0..self.items.len() {
            let [g, position_g] = self.offsets_mut(i);
            (g[0], position_g[0]) = (R::select(lanes, position_g[0], g[0]), R::select(lanes, g[0], position_g[0]));
            for (g, position_g) in g[1..].iter_mut().zip(&mut position_g[1..]) {
                *g = R::select(lanes, *g + *position_g, *g);
                *position_g = R::select(lanes, -*position_g, *position_g);
            }
        }
    }

    fn lane_constraint(&self, i: usize, lane: usize) -> LaneConstraint {
        let (contact, number) = (&self.items[i], |x: R| number_of(x, lane));
        LaneConstraint {
            set: AdmissibleSet::Cone { mu: number(contact.mu) },
            compliance: number(contact.damping),
            normal_compliance: number(contact.compliance),
            mobility_ratio: number(contact.step.mobility_ratio),
        }
    }

    fn save(&self, i: usize, lane: usize) -> SavedConstraint {
        let FrictionContact { mu, compliance, step, .. } = self.items[i];
        let [mu, compliance, mobility_ratio] = [mu, compliance, step.mobility_ratio].map(|x| number_of(x, lane));
        SavedConstraint { set: [mu; 2], compliance, mobility_ratio, ..SavedConstraint::default() }
    }

    #[inline(always)]
    fn push_velocity(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], out: &mut Vec<R>) {
        let contact = &self.items[i];
        with_rows!([rows: &self] of contact => {
            out.extend_from_slice(&rows.velocity_under(contact, entries, w, self.compliant, rows_of(lambda)));
        });
    }

    #[inline(always)]
    fn normal_velocity(&self, i: usize, (columns, y): RowEntries<'_, R>, w: &[R]) -> R {
        let mut v = R::zero();
        for (&c, y) in columns.iter().zip(y.chunks_exact(self.items[i].span.num_rows)) {
            v += y[0] * w[c as usize];
        }
        v + self.offsets(i)[0][0]
    }

    #[inline(always)]
    fn add(&self, i: usize, (columns, y): RowEntries<'_, R>, lambda: &[R], w: &mut [R]) {
        match self.items[i].index {
            RowsIndex::Three(_) => add_transposed::<R, 3>(columns, y.as_chunks().0, *rows_of(lambda), w),
            RowsIndex::Four(_) => add_transposed::<R, 4>(columns, y.as_chunks().0, *rows_of(lambda), w),
            RowsIndex::Six(_) => add_transposed::<R, 6>(columns, y.as_chunks().0, *rows_of(lambda), w),
        }
    }

    #[inline(always)]
    fn residual(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], _has_eliminated: bool) -> R {
        let contact = &self.items[i];
        with_rows!([rows: &self] of contact => rows.residual(contact, entries, w, self.compliant, lambda))
    }

    #[inline(always)]
    fn add_potential(&self, i: usize, lambda: &[R], mut sum: R) -> R {
        sum += self.items[i].compliance * R::of(0.5) * lambda[0].square();
        for (&g, &lambda) in self.offsets(i)[0].iter().zip(lambda) {
            sum += g * lambda;
        }
        sum
    }

    #[inline(always)]
    fn shift(&mut self, i: usize, entries: RowEntries<'_, R>, change: &[R]) {
        with_rows!([rows: &mut self] of self.items[i] => {
            let moved = rows.velocity(entries, change);
            rows.position_g[0] += moved[0] - rows.g[0];
            rows.g = moved;
        });
    }

    #[inline(always)]
    fn damping_deficit(&self, _i: usize) -> R {
        R::zero()
    }

    #[inline(always)]
    fn damp(&mut self, i: usize, lambda: &[R], damping: Damping<R>, added_mobility: R) {
        self.compliant = true;
        let contact = &mut self.items[i];
        with_rows!([rows: &mut self] of contact => rows.damp(contact, lambda, damping, added_mobility));
    }

    #[inline(always)]
    fn shortfall(&self, i: usize, change: R) -> R {
        (self.items[i].damping * change).abs()
    }

    #[inline(always)]
    fn unmet(&self, _i: usize, _missed: R, g: R) -> R {
        -g
    }

    #[inline(always)]
    fn witness(&self, i: usize, now: R, before: R) -> R {
        let contact = &self.items[i];
        // A compliant row can always meet its target.
        let hard = contact.active.and_not(contact.compliance.gt(R::zero()));
        masked(hard, (now - before).max(R::zero()))
    }
}

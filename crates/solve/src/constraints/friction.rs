//! Contacts with Coulomb friction, of any number of rows: the normal row first, then the tangential ones.
//!
//! This file has the parts that do not depend on the number of rows. A [`LocalSolver`] solves one contact, with the contact's block of
//! the Delassus matrix G.
//!
//! w is the scaled velocity change: the change of velocity by the impulses, in coordinates in which the mass matrix is the identity.

use std::fmt::Debug;

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::{masked, movable, project};
use crate::constraints::constraint_set::{
    ConstraintSet, Damping, LaneConstraint, Row, Rows, SavedConstraint, Span, SweepLanes, Unknowns, is_nonzero, multiply, number_of,
};
use crate::constraints::orthogonalisation::velocity_rounding;
use stepper_real::{Mask, Real, Scalar, kernel};

/// Solver of one contact with friction, while the impulses of all other constraints stay constant. The admissible impulses are the circular
/// cone of Coulomb's law.
pub trait LocalSolver<R: Real, const N: usize>: Copy + Debug + Sized {
    /// Solver of a contact whose block of the Delassus matrix is `gram`, in the lanes `active`. The solver of other lanes is a placeholder.
    /// Only the upper triangle is read.
    ///
    /// Also returns the trace of the block, 1/kg.
    fn new(gram: &[[R; N]; N], active: R::Mask) -> (Self, R);

    /// Impulse that solves this contact, and the multiplier s of its friction disc (slip velocity divided by friction impulse, 1/kg), which
    /// is 0 for a contact that sticks or opens.
    ///
    /// `v` is the contact's velocity under the impulse `lambda`, including the velocity due to its compliance. `mu` is the friction
    /// coefficient. The search for s starts at `guess`. Outside the lanes `lanes`, the impulse and s are 0.
    fn solve(&self, mu: R, v: [R; N], lambda: [R; N], guess: R, lanes: R::Mask) -> ([R; N], R);

    /// Impulse by the weaker update, in the lanes `active`. The result has no meaning in other lanes. The weaker update changes the impulse
    /// less than [`LocalSolver::solve`], so that sweeps (Gauss-Seidel iterations) cycle less.
    ///
    /// It updates the normal impulse at constant tangential impulse. Then it projects the tangential impulse on the disc of the new normal
    /// impulse.
    fn relax(&self, mu: R, v: [R; N], lambda: [R; N], active: R::Mask) -> [R; N];

    /// Directions of the tangential impulse, among the principal axes of the tangential problem, in which no impulse moves the contact.
    /// `None` if there are none in any lane.
    ///
    /// Each direction has an entry in the two results, from index 1 on. The first result has its velocity offset, m/s, with the normal
    /// impulse that stops the normal row. The second has its coupling G_tn / G_nn to the normal row. The entries of other directions are 0.
    /// `g` has the offsets of the rows, m/s, and `trace` is the trace of the contact's block of the Delassus matrix, 1/kg.
    fn fixed_directions(&self, g: [R; N], trace: R) -> Option<[[R; N]; 2]>;

    /// Mean diagonal entry of the contact's block of the Delassus matrix before elimination of equality rows, 1/kg. `step` is the step of
    /// the contact's natural map.
    fn mobility(&self, step: &NaturalStep<R>) -> R;

    /// Adds a compliance, 1/kg, to all rows of the contact, and updates the step of its natural map (`NaturalStep`).
    fn damp(&mut self, compliance: R, step: &mut NaturalStep<R>);

    /// Adds a compliance, 1/kg, to the normal row alone; the natural map does not change. Returns the ratio of the normal row's previous
    /// diagonal entry to the new one.
    fn add_normal_compliance(&mut self, compliance: R) -> R;
}

/// Step length rho of a contact's natural map, lambda - P_K(lambda - rho u) for the impulse lambda and the velocity u. P_K is the
/// projection on the admissible impulses. The map is zero at the solution.
#[derive(Clone, Copy, Debug)]
pub struct NaturalStep<R> {
    /// Step length rho = N / trace(G_ii), kg. N is the contact's number of rows, and G_ii its block of the Delassus matrix before
    /// elimination of equality rows.
    pub(super) rho: R,
    /// Inverse 1 / rho of the step length, 1/kg.
    pub(super) inv_rho: R,
    /// Mobility of the contact before the elimination of equality rows, divided by that after it, at least 1. The mobility is trace(G_ii).
    pub(super) mobility_ratio: R,
}

impl<R: Real> NaturalStep<R> {
    /// Step of a contact with `N` rows, whose block of the Delassus matrix has the trace `trace`, 1/kg.
    #[inline(always)]
    pub(super) fn of_trace<const N: usize>(trace: R) -> Self {
        Self { rho: R::of(N as f64) / trace, inv_rho: trace * R::of(1.0 / N as f64), mobility_ratio: R::one() }
    }

    /// Step before elimination of equality rows, from `self`, which is the step after it. Before elimination, the trace of the contact's
    /// block of the Delassus matrix was larger by the factor `ratio`.
    #[inline(always)]
    pub(super) fn with_mobility_ratio(self, ratio: R) -> Self {
        Self { rho: self.rho / ratio, inv_rho: self.inv_rho * ratio, mobility_ratio: ratio }
    }
}

/// Contact with friction in `N` rows: the normal row and the tangential rows. `L` solves the friction problem of the contact alone.
#[derive(Clone, Copy, Debug)]
pub struct FrictionContact<R: Real, const N: usize, L> {
    /// Place of the contact's coordinates and Jacobian entries in the lists of its set.
    span: Span,
    /// Lanes in which the solver reads the contact: it exists there, is movable along its normal, and is not deferred.
    pub active: R::Mask,
    /// Lanes in which no impulse can move the contact along its normal. The contact has no rows in these lanes, and its impulse does not
    /// change.
    pub(super) immovable: R::Mask,
    /// Lanes in which the contact is deferred: the solver ignores its rows until they are activated.
    deferred: R::Mask,
    /// Friction coefficient of the scaled rows; 0 for a frictionless contact.
    pub mu: R,
    /// Velocity g of each row of the contact before any impulse, plus its bias (the negated velocity target), m/s. This value is for the
    /// velocity solve; `position_g` is for the position solve.
    pub g: [R; N],
    /// Offset of each row in the position solve, m/s. For the normal row it replaces g. For the tangential rows it is added to g.
    pub position_g: [R; N],
    /// Compliance R >= 0 of the normal row: velocity per unit of impulse, 1/kg. It is 0 for a hard contact.
    pub(crate) compliance: R,
    /// Factor G_nn / (G_nn + R) that multiplies the normal row's residual. It removes the part due to the contact's spring, so that an
    /// error of the velocity remains. G_nn is the row's diagonal entry of the Delassus matrix and R its compliance. The factor is 1 for a
    /// hard contact.
    rigid_fraction: R,
    /// Compliance that damps all rows of the contact in the position solve, 1/kg.
    damping: R,
    /// Step of the contact's natural map, which scales its residual.
    step: NaturalStep<R>,
    /// Solver of this contact at constant other impulses.
    pub(super) local: L,
}

impl<R: Real, const N: usize, L: LocalSolver<R, N>> FrictionContact<R, N, L> {
    /// Hard contact with the friction coefficient `mu`, the offsets `g`, and the block `gram` of the Delassus matrix. Of the lanes in
    /// which the contact exists, `active` are those in which an impulse can move it along its normal, and `immovable` the others.
    #[inline(always)]
    fn new(span: Span, [active, immovable]: [R::Mask; 2], mu: R, g: [R; N], gram: &[[R; N]; N]) -> Self {
        let (local, trace) = L::new(gram, active);
        let mut position_g = [R::zero(); N];
        position_g[0] = g[0];
        Self {
            span,
            active,
            immovable,
            deferred: R::Mask::splat(false),
            mu,
            g,
            position_g,
            compliance: R::zero(),
            rigid_fraction: R::one(),
            damping: R::zero(),
            step: NaturalStep::of_trace::<N>(trace),
            local,
        }
    }
}

/// Contacts with `N` rows each.
pub type FrictionContacts<R, const N: usize, L> = ConstraintSet<R, FrictionContact<R, N, L>>;

impl<R: Real, const N: usize, L: LocalSolver<R, N>> FrictionContacts<R, N, L> {
    /// Appends a contact whose rows have the entries `y` at the coordinates `columns`, ascending.
    ///
    /// The contact exists in the lanes `exists`, and `mu` is its friction coefficient. `g` has the offset of each row, m/s: the row's
    /// velocity before any impulse, plus its bias (minus the target velocity). A contact is immovable if its normal mobility is below
    /// `least`, 1/kg, or a tiny fraction of its mobility in all directions.
    #[inline(always)]
    pub fn push(&mut self, columns: &[u32], y: impl Fn(usize) -> [R; N], exists: R::Mask, mu: R, g: [R; N], least: R) {
        let mut gram = [[R::zero(); N]; N];
        let span = self.push_entries(
            columns,
            y,
            #[inline(always)]
            |y| add_products(&mut gram, &y),
        );
        let movable = movable(exists, gram[0][0], gram[0][0] + gram[1][1] + gram[2][2], least);
        self.rows.items.push(FrictionContact::new(span, [movable, exists.and_not(movable)], mu, g, &gram));
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
            let never = R::Mask::splat(false);
            let Some(FrictionContact { active, mu, g, step, local, .. }) = self.rows.items.last() else { return never };
            let trace = step.inv_rho * R::of(N as f64);
            let Some([p, c]) = local.fixed_directions(*g, trace) else { return never };
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
            active.and((*mu * length).gt(R::one())).and(power.gt(sizes * length * R::of(velocity_rounding::<R>())))
        })
    }

    /// Lanes in which the last contact of the list is immovable along its normal.
    #[inline(always)]
    pub fn last_is_immovable(&self) -> R::Mask {
        self.rows.items.last().map_or(R::Mask::splat(false), |contact| contact.immovable)
    }

    /// Makes the last contact of the list movable along its normal in the lanes `lanes`, in which it was immovable. The caller must do
    /// this before setting the mobility ratio and the compliance of the contact.
    pub fn make_movable(&mut self, lanes: R::Mask) {
        kernel!(R, || {
            let Some(contact) = self.rows.items.last_mut() else { return };
            let released = lanes.and(contact.immovable);
            contact.active = contact.active.or(released);
            contact.immovable = contact.immovable.and_not(released);
            let mut gram = [[R::zero(); N]; N];
            for y in self.y.row(contact.span.y, contact.span.num_columns) {
                add_products(&mut gram, y);
            }
            let (local, trace) = L::new(&gram, contact.active);
            contact.local = local;
            contact.step = NaturalStep::of_trace::<N>(trace);
        })
    }

    /// Clears a small approach speed of the last contact of the list: sets the offset g of its normal row to zero, m/s.
    ///
    /// The function changes lanes in which no impulse can move the contact along its normal, and the approach speed is at most
    /// `negligible`, m/s.
    pub fn clear_negligible_approach(&mut self, negligible: R) {
        kernel!(R, || {
            let Some(contact) = self.rows.items.last_mut() else { return };
            let none = contact.immovable.and((-contact.g[0]).le(negligible));
            contact.g[0] = R::select(none, contact.g[0].max(R::zero()), contact.g[0]);
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
    pub fn set_position_offset(&mut self, position_g: [R; N]) {
        if let Some(contact) = self.rows.items.last_mut() {
            contact.position_g = position_g;
        }
    }

    /// Defers the rows of the last contact of the list in the lanes `lanes`: the solver ignores them until they are activated.
    #[inline(always)]
    pub fn defer(&mut self, lanes: R::Mask) {
        if let Some(contact) = self.rows.items.last_mut() {
            contact.deferred = lanes.and(contact.active);
            contact.active = contact.active.and_not(lanes);
        }
    }

    /// Normal velocity of contact `i`, m/s, under impulses that cause the scaled velocity change `w`. It includes the bias, so that it is 0
    /// at the contact's target velocity.
    #[inline(always)]
    pub(crate) fn normal_velocity_above_target(&self, i: usize, w: &[R]) -> R {
        let contact = &self.rows.items[i];
        let (columns, y) = self.entries(contact);
        let mut v = R::zero();
        for (&c, y) in columns.iter().zip(y) {
            v += y[0] * w[c as usize];
        }
        v + contact.g[0]
    }

    /// Work of the friction of contact `i`, J: its friction impulse times the mean of the slip velocities before and after all impulses.
    #[inline(always)]
    pub(crate) fn friction_work(&self, i: usize, impulses: &[[R; N]], w: &[R]) -> R {
        let contact = &self.rows.items[i];
        let velocity = self.velocity(contact, w);
        let mut work = R::zero();
        for k in 1..N {
            work += impulses[i][k] * (velocity[k] + contact.g[k]);
        }
        work * R::of(0.5)
    }

    /// Rounding error of the normal impulse of contact `i`, as a velocity, m/s. The residual of the contact cannot be smaller.
    #[inline(always)]
    pub(crate) fn impulse_rounding(&self, i: usize, impulses: &[[R; N]]) -> R {
        impulses[i][0] * self.rows.items[i].step.inv_rho * R::of(R::Scalar::EPSILON.to_f64())
    }

    /// Velocity of contact `i` under impulses that cause the scaled velocity change `w`, m/s, as six numbers. The last three are zeros for
    /// a contact with three rows.
    #[inline(always)]
    pub(crate) fn padded_velocity(&self, i: usize, w: &[R]) -> [R; 6] {
        padded(&self.velocity(&self.rows.items[i], w))
    }

    /// Calls `f` with each coordinate at which contact `i` has entries in the lane `lane`, and with the entries of its rows there, as six
    /// numbers.
    #[inline(always)]
    pub(crate) fn for_each_entry(&self, i: usize, lane: usize, mut f: impl FnMut(u32, [f64; 6])) {
        let (columns, y) = self.entries(&self.rows.items[i]);
        for (&c, y) in columns.iter().zip(y).filter(|(_, y)| y.iter().any(|y| y.lane(lane) != R::Scalar::default())) {
            let mut entries = [0.0; 6];
            entries.iter_mut().zip(y).for_each(|(to, &y)| *to = number_of(y, lane));
            f(c, entries);
        }
    }

    /// Activates the rows of contact `i` in those lanes of `lanes` in which they are deferred. Returns these lanes.
    #[inline(always)]
    pub(crate) fn activate(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        let contact = &mut self.rows.items[i];
        let lanes = lanes.and(contact.deferred);
        contact.deferred = contact.deferred.and_not(lanes);
        contact.active = contact.active.or(lanes);
        lanes
    }

    /// Defers the rows of contact `i` in the lanes `lanes`: the solver ignores them until they are activated. In these lanes they must be
    /// active and have no impulse.
    #[inline(always)]
    pub(crate) fn defer_contact(&mut self, i: usize, lanes: R::Mask) {
        let contact = &mut self.rows.items[i];
        contact.active = contact.active.and_not(lanes);
        contact.deferred = contact.deferred.or(lanes);
    }

    /// Sets the impulse of contact `i` to zero in the lanes `lanes`, and updates the scaled velocity change `w`. Returns the previous
    /// impulse in all lanes as six numbers, N s or N m s; the last three are zeros for a contact with three rows.
    #[inline(always)]
    pub(crate) fn take_impulse(&self, i: usize, lanes: R::Mask, impulses: &mut [[R; N]], w: &mut [R]) -> [R; 6] {
        let (mut before, mut change) = ([R::zero(); 6], [R::zero(); N]);
        for k in 0..N {
            before[k] = impulses[i][k];
            change[k] = -masked(lanes, before[k]);
            impulses[i][k] = R::select(lanes, R::zero(), before[k]);
        }
        self.add(&self.rows.items[i], change, w);
        before
    }

    /// Sets the impulse of contact `i` to the first numbers of `lambda` in the lanes `lanes`, where it must be zero before, and updates the
    /// scaled velocity change `w`.
    #[inline(always)]
    pub(crate) fn set_first_impulse(&self, i: usize, lanes: R::Mask, lambda: [R; 6], impulses: &mut [[R; N]], w: &mut [R]) {
        let mut d = [R::zero(); N];
        for k in 0..N {
            d[k] = masked(lanes, lambda[k]);
            impulses[i][k] = R::select(lanes, lambda[k], impulses[i][k]);
        }
        self.add(&self.rows.items[i], d, w);
    }

    /// Sets the compliance R >= 0 of the normal row of the last contact of the list, 1/kg: that of a spring and a damper between the
    /// surfaces.
    #[inline(always)]
    pub fn set_compliance(&mut self, compliance: R) {
        if let Some(contact) = self.rows.items.last_mut() {
            contact.compliance = compliance;
            // A lane without a spring must not depend on the other lanes: the ratio is 1 except for rounding.
            let ratio = contact.local.add_normal_compliance(compliance);
            contact.rigid_fraction = R::select(compliance.gt(R::zero()), ratio, R::one());
            self.rows.compliant = true;
        }
    }

    /// Appends a constraint that was read from a file, with the same numbers in every lane.
    pub(crate) fn load(&mut self, saved: &SavedConstraint) {
        let least = R::of(if saved.immovable { f64::INFINITY } else { 0.0 });
        let (y, g) = (|c| saved.entries(c), std::array::from_fn(|k| R::of(saved.g[k])));
        self.push(&saved.columns, y, R::Mask::splat(true), R::of(saved.set[0]), g, least);
        self.set_position_offset(std::array::from_fn(|k| R::of(saved.position_g[k])));
        self.set_mobility_ratio(R::of(saved.mobility_ratio));
        if saved.compliance > 0.0 {
            self.set_compliance(R::of(saved.compliance));
        }
    }

    /// Makes one Gauss-Seidel iteration over the contacts: each in turn gets the impulse that solves this contact at constant other
    /// impulses. Lanes outside `lanes.exact` get the weaker update of [`LocalSolver::relax`].
    ///
    /// Returns the larger of `change` and the largest change of a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(
        &self,
        rows: &Rows<FrictionContact<R, N, L>>,
        unknowns: Unknowns<'_, R, [R; N]>,
        lanes: SweepLanes<R>,
        mut change: R,
    ) -> R {
        let Unknowns { impulses, multipliers, w } = unknowns;
        let SweepLanes { running, exact } = lanes;
        for (i, contact) in rows.items.iter().enumerate() {
            let lanes = running.and(contact.active);
            // In late sweeps few lanes still run, and many contacts exist in none of them.
            if lanes.none() {
                continue;
            }
            let lambda = impulses[i];
            let v = self.velocity_under(contact, rows.compliant, w, lambda);
            let (mut next, multiplier) = contact.local.solve(contact.mu, v, lambda, multipliers[i], lanes);
            if lanes.and_not(exact).any() {
                let weak = contact.local.relax(contact.mu, v, lambda, contact.active);
                for k in 0..N {
                    next[k] = R::select(exact, next[k], weak[k]);
                }
            }
            let mut d = lambda;
            for k in 0..N {
                d[k] = masked(lanes, next[k] - lambda[k]);
                impulses[i][k] = R::select(lanes, next[k], lambda[k]);
            }
            multipliers[i] = R::select(lanes, multiplier, multipliers[i]);
            let mut most = d[0].abs();
            for k in 1..N {
                most = most.max(d[k].abs());
            }
            if is_nonzero(most) {
                self.add(contact, d, w);
            }
            change = change.max(most * contact.step.inv_rho);
        }
        change
    }

    /// Largest tangential speed of all contacts with a positive normal impulse, m/s.
    #[inline(always)]
    pub(crate) fn fastest_slip(&self, rows: &Rows<FrictionContact<R, N, L>>, impulses: &[[R; N]], w: &[R]) -> R {
        let mut most = R::zero();
        for (contact, lambda) in rows.items.iter().zip(impulses) {
            let v = self.velocity(contact, w);
            most = most.max(masked(contact.active.and(lambda[0].gt(R::zero())), tangential_speed(&v)));
        }
        most
    }
}

/// Numbers of the rows of a contact, followed by zeros.
#[inline(always)]
pub(crate) fn padded<R: Real, const N: usize>(numbers: &[R; N]) -> [R; 6] {
    let mut out = [R::zero(); 6];
    out[..N].copy_from_slice(numbers);
    out
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

impl<R: Real, const N: usize, L: LocalSolver<R, N>> Row<R> for FrictionContact<R, N, L> {
    type Impulse = [R; N];

    fn num_entries(contacts: usize, capacity: &Capacity) -> usize {
        contacts * capacity.columns_per_contact
    }

    fn blank() -> Self {
        Self::new(Span::default(), [R::Mask::splat(false); 2], R::zero(), [R::zero(); N], &[[R::zero(); N]; N])
    }

    #[inline(always)]
    fn span(&self) -> Span {
        self.span
    }

    #[inline(always)]
    fn active(&self) -> R::Mask {
        self.active
    }

    #[inline(always)]
    fn immovable(&self) -> R::Mask {
        self.immovable
    }

    #[inline(always)]
    fn offsets(&self) -> [[R; N]; 2] {
        [self.g, self.position_g]
    }

    #[inline(always)]
    fn exchange_offsets(&mut self, lanes: R::Mask) {
        let Self { g, position_g, .. } = self;
        (g[0], position_g[0]) = (R::select(lanes, position_g[0], g[0]), R::select(lanes, g[0], position_g[0]));
        for k in 1..N {
            g[k] = R::select(lanes, g[k] + position_g[k], g[k]);
            position_g[k] = R::select(lanes, -position_g[k], position_g[k]);
        }
    }

    fn lane_constraint(&self, lane: usize) -> LaneConstraint {
        let number = |x: R| number_of(x, lane);
        LaneConstraint {
            set: AdmissibleSet::Cone { mu: number(self.mu) },
            compliance: number(self.damping),
            normal_compliance: number(self.compliance),
            mobility_ratio: number(self.step.mobility_ratio),
        }
    }

    fn save(&self, lane: usize) -> SavedConstraint {
        let [mu, compliance, mobility_ratio] = [self.mu, self.compliance, self.step.mobility_ratio].map(|x| number_of(x, lane));
        SavedConstraint { set: [mu; 2], compliance, mobility_ratio, ..SavedConstraint::default() }
    }

    #[inline(always)]
    fn velocity(&self, columns: &[u32], y: &[[R; N]], w: &[R]) -> [R; N] {
        let mut v = multiply(columns, y, w);
        for k in 0..N {
            v[k] += self.g[k];
        }
        v
    }

    #[inline(always)]
    fn add_compliance(&self, mut v: [R; N], compliant: bool, lambda: [R; N]) -> [R; N] {
        if compliant {
            v[0] += (self.damping + self.compliance) * lambda[0];
            for k in 1..N {
                v[k] += self.damping * lambda[k];
            }
        }
        v
    }

    fn uniform_compliance(&self) -> R {
        self.damping
    }

    #[inline(always)]
    fn residual(&self, v: [R; N], lambda: [R; N], _has_eliminated: bool) -> R {
        let (mu, rho) = (self.mu, self.step.rho);
        let slip = mu * tangential_speed(&v);
        let mut moved = lambda;
        for k in 1..N {
            moved[k] -= rho * v[k];
        }
        // The two forms are the same sum in different orders, with different rounding.
        if N == 3 {
            moved[0] -= rho * (v[0] + slip);
        } else {
            moved[0] -= rho * v[0];
            moved[0] -= rho * slip;
        }
        let image = project(moved, mu);
        let mut apart = ((lambda[0] - image[0]) * self.rigid_fraction).square();
        for k in 1..N {
            apart += (lambda[k] - image[k]).square();
        }
        apart.sqrt() * self.step.inv_rho
    }

    #[inline(always)]
    fn normal_impulse(lambda: [R; N]) -> R {
        lambda[0]
    }

    #[inline(always)]
    fn add_potential(&self, lambda: [R; N], mut sum: R) -> R {
        sum += self.compliance * R::of(0.5) * lambda[0].square();
        for k in 0..N {
            sum += self.g[k] * lambda[k];
        }
        sum
    }

    #[inline(always)]
    fn shift(&mut self, moved: [R; N]) {
        self.position_g[0] += moved[0] - self.g[0];
        self.g = moved;
    }

    #[inline(always)]
    fn undamped_offset(&self) -> R {
        self.g[0]
    }

    #[inline(always)]
    fn damp(&mut self, lambda: [R; N], damping: Damping<R>, added_mobility: R) {
        let mobility = self.local.mobility(&self.step) + added_mobility;
        let correction = self.position_g[0] - self.g[0];
        let compliance = masked(correction.gt(damping.negligible), (damping.ratio + damping.bending * correction) * mobility);
        self.damping += compliance;
        for k in 0..N {
            self.g[k] -= compliance * lambda[k];
        }
        self.local.damp(compliance, &mut self.step);
    }

    #[inline(always)]
    fn shortfall(&self, change: R) -> R {
        (self.damping * change).abs()
    }

    #[inline(always)]
    fn immovable_target(&self) -> R {
        -self.g[0]
    }

    #[inline(always)]
    fn unmet_velocity(&self) -> R {
        -(self.g[0].max(self.position_g[0]))
    }

    #[inline(always)]
    fn witness(&self, now: R, before: R) -> R {
        // A compliant row can always meet its target.
        let hard = self.active.and_not(self.compliance.gt(R::zero()));
        masked(hard, (now - before).max(R::zero()))
    }
}

/// Least tangential mobility of a contact whose block of the Delassus matrix has the trace `trace`, 1/kg.
///
/// A direction in which the contact cannot move (in a planar mechanism) has zero mobility. The floor, a fraction of the trace, gives it
/// zero impulse instead of 0/0. The floor is far below most physical mobilities, and far above the rounding of the entries. The floor
/// bounds the change of the impulse in a sweep, and does not change the solution. Directions with less mobility than the floor take more
/// sweeps. For a cylinder that brakes in line with both of its axes, a floor of 2e-11 of the trace gave impulses of 1e8 N s, which were
/// rounding error.
///
/// Measured in 32 bits on 64 quadrupeds that step on flat ground: a floor of 1.2e-2 of the trace takes 8.7 sweeps per step. A foot moves a
/// hundred times more easily across its leg than along it. A floor of 1.2e-4 takes 2.6 sweeps, and 64 bits with 1e-8 take 3.1.
#[inline(always)]
pub(super) fn least_tangent<R: Real>(trace: R) -> R {
    trace * R::of(f64::max(1e-8, <R::Scalar as Scalar>::EPSILON.to_f64() * 1e3))
}

/// Largest number of iterations for the friction multiplier of a slipping contact. Each is a Newton step, or a bisection where a Newton
/// step would leave the interval that contains the solution. One to three iterations are usual; bisections from a poor start take more.
const MAX_NEWTON: usize = 24;

/// Relative error below which the Newton search for the impulse of a slipping contact makes its last step. The error is the distance of the
/// tangential impulse from the edge of the friction disc, divided by the tangential impulse.
///
/// A Newton step squares this distance. An accuracy of about the square root of the rounding error is therefore enough before the last
/// step.
#[inline(always)]
fn near<R: Real>() -> R {
    R::of(4.0 * <R::Scalar as Scalar>::EPSILON.to_f64().sqrt())
}

/// Multiplier s > 0 of the friction disc of a slipping contact, for which |x(s)| = mu n(s). Here x is the tangential and n the normal
/// impulse.
///
/// Newton's method solves mu n / |x| = 1 in the lanes `todo`, inside a bracket and from `guess`. A bisection replaces a Newton step that
/// leaves the bracket; while the bracket has no upper end, 2 s + `widening` replaces it. Once the relative error is below [`near`], the
/// method makes one more step and does not test the error again. The function `sliding` of s returns |x|^2, n, and `|x|^3 / mu` times the
/// derivative of `mu n / |x|` with respect to s.
#[inline(always)]
pub(super) fn slip_multiplier<R: Real>(mu: R, guess: R, widening: R, mut todo: R::Mask, sliding: impl Fn(R) -> [R; 3]) -> R {
    let near = near::<R>();
    let unbounded = R::of(f64::INFINITY);
    let (mut lo, mut hi, mut s) = (R::zero(), unbounded, guess);
    for _ in 0..MAX_NEWTON {
        let [square, n, slope] = sliding(s);
        let length = square.sqrt();
        let excess = mu * n - length;
        let low = excess.lt(R::zero());
        lo = R::select(low, s, lo);
        hi = R::select(low, hi, s);
        let newton = s - excess * square / (mu * slope);
        let bisect = R::select(hi.lt(unbounded), (lo + hi) * R::of(0.5), s + s + widening);
        let inside = newton.ge(lo).and(newton.le(hi)).and(newton.lt(unbounded));
        s = R::select(todo, R::select(inside, newton, bisect), s);
        todo = todo.and_not(excess.abs().le(near * length));
        if todo.none() {
            break;
        }
    }
    s
}

//! Iterate of a solve: the impulses, and the scaled velocity change that they cause.

use crate::capacity::Capacity;
use crate::cone::masked;
use crate::constraints::constraint_set::{Impulse, Impulses, SweepLanes, Unknowns};
use crate::constraints::friction::padded;
use crate::constraints::{at_contact, by_kind, each_kind, make_kinds};
use crate::gauss_seidel::history::History;
use crate::problem::{Problem, System};
use stepper_real::{Mask, Real, Scalar, kernel};

by_kind! {
    /// Unknowns of a problem, with the history of sweeps. Impulses are in N s, those of angular rows in N m s.
    #[derive(Clone, Debug)]
    pub struct Iterate[R: Real] {
        /// Scaled velocity change w = sum_i y_i lambda_i by the impulses lambda_i, where y_i are the rows of the scaled Jacobian. Its
        /// kinetic energy is |w|^2 / 2.
        pub w: Vec<R>,
        /// Multiplier of the friction disc of each contact (slip velocity divided by friction impulse, 1/kg), from which its next local
        /// solution starts; 0 while the contact sticks or is open.
        pub(crate) multipliers: Multipliers<R>,
        /// History of Anderson's acceleration.
        pub(crate) history: History<R>,
        /// Copy of the impulses, which is restored if a further pass (sweeps and Newton steps) makes the residual larger.
        pub(crate) snapshot: Snapshot<R>,
    } each Impulses[R]
}

by_kind! {
    /// Multipliers of friction discs (slip velocity divided by friction impulse, 1/kg): one number per contact.
    #[derive(Clone, Debug)]
    pub(crate) struct Multipliers[R] {} each same Vec<R>
}

by_kind! {
    /// Copy of all impulses, and of the scaled velocity change w by them, that can be restored.
    #[derive(Clone, Debug)]
    pub struct Snapshot[R: Real] {
        w: Vec<R>,
    } each Impulses[R]
}

impl<R: Real> Default for Snapshot<R> {
    fn default() -> Self {
        Self::new(&Capacity::default())
    }
}

impl<R: Real> Snapshot<R> {
    /// Snapshot without impulses, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let w = Vec::with_capacity(capacity.dimension);
        make_kinds!(Self { w, } [count: capacity] => Vec::with_capacity(count))
    }

    /// Copies the impulses of an iterate in all lanes. Does nothing if `lanes`, the lanes that the caller may restore, is empty.
    pub fn save(&mut self, iterate: &Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            self.w.clone_from(&iterate.w);
            each_kind!([own: &mut self] [impulses: &iterate] => own.clone_from(impulses));
        }
    }

    /// Copies the saved impulses back, in the lanes `lanes`.
    pub fn restore(&self, iterate: &mut Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            kernel!(R, || {
                copy_lanes(&self.w, &mut iterate.w, lanes);
                each_kind!([own: &self] [impulses: &mut iterate] => copy_lanes(Impulse::flatten(own), Impulse::flatten_mut(impulses), lanes));
            });
        }
    }

    /// Sets the impulse of contact `i` of `problem` to `lambda` in the lanes `lanes`, where it must be zero before, and updates the scaled
    /// velocity change w.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction). A contact with three rows
    /// reads the first three numbers. Does nothing if the snapshot has no impulse of this contact.
    #[inline(always)]
    pub fn set_first_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask, lambda: [R; 6]) {
        if i < self.contacts.len() + self.rolling_contacts.len() && self.contacts.len() == problem.contacts.len() {
            at_contact!(i of problem.contacts.len(), [set: &problem] [impulses: &mut self] =>
                set.set_first_impulse(i, lanes, lambda, impulses, &mut self.w));
        }
    }
}

/// Relative difference of two energies below which they count as equal. The energy is near its minimum, where a relative error of 1e-3 in
/// the velocities changes it by about this much.
const NEGLIGIBLE_ENERGY: f64 = 1e-6;

impl<R: Real> Snapshot<R> {
    /// Lanes in which the saved impulses are at least about as close to the solution as those of `iterate`.
    ///
    /// The measure is the energy `|w|^2 / 2 + g . lambda + R lambda^2 / 2`, which the solution minimises except for De Saxce's terms mu
    /// |v_t|. The energy of the saved impulses may exceed that of `iterate` by at most a millionth.
    pub fn is_as_close(&self, problem: &Problem<R>, iterate: &Iterate<R>) -> R::Mask {
        kernel!(R, || {
            let [mut saved, mut now] = [energy(&self.w), energy(&iterate.w)];
            each_kind!([set: &problem] [impulses: &self] => saved = set.add_potential(impulses, saved));
            each_kind!([set: &problem] [impulses: &iterate] => now = set.add_potential(impulses, now));
            saved.le(now + now.abs() * R::of(NEGLIGIBLE_ENERGY))
        })
    }
}

/// Kinetic energy |w|^2 / 2 of a scaled velocity change, J.
#[inline(always)]
pub(crate) fn energy<R: Real>(w: &[R]) -> R {
    let mut square = R::zero();
    for &w in w {
        square += w * w;
    }
    square * R::of(0.5)
}

/// Copies the numbers of the lanes `lanes` from one list to another.
#[inline(always)]
fn copy_lanes<R: Real>(from: &[R], to: &mut [R], lanes: R::Mask) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = R::select(lanes, from, *to);
    }
}

/// Number of rows per constraint, from the type of a list of impulses.
pub(crate) fn rows_of<R: Real, I: Impulse<R>>(_: &[I]) -> usize {
    I::ROWS
}

impl<R: Real> Iterate<R> {
    /// Iterate without impulses, with memory for `dimension` coordinates, `scalars` scalar rows and `contacts` contacts with three rows.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        Self::new(&Capacity { dimension, scalars, contacts, ..Capacity::default() })
    }

    /// Iterate without impulses, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let (snapshot, mut unknowns) = (Snapshot::new(capacity), capacity.dimension);
        each_kind!([count: capacity] [impulses: &snapshot] => unknowns += count * rows_of::<R, _>(impulses));
        make_kinds!(Self {
            w: vec![R::zero(); capacity.dimension],
            multipliers: make_kinds!(Multipliers {} [count: capacity] => Vec::with_capacity(count)),
            history: History::new(capacity.dimension, unknowns),
            snapshot,
        } [count: capacity] => Vec::with_capacity(count))
    }

    /// Removes all impulses. The caller then pushes a warm start (or zeros) for every row, and calls [`Iterate::compute_w`].
    #[inline(always)]
    pub fn clear(&mut self) {
        each_kind!([own: &mut self] [multipliers: &mut self.multipliers] => {
            own.clear();
            multipliers.clear();
        });
    }

    /// Sets all impulses and the scaled velocity change w by them to zero in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn clear_impulses(&mut self, lanes: R::Mask) {
        for w in &mut self.w {
            *w = masked(lanes.not(), *w);
        }
        each_kind!([own: &mut self] => for lambda in Impulse::<R>::flatten_mut(own) {
            *lambda = masked(lanes.not(), *lambda);
        });
    }

    /// Sets the impulse of contact `i` of `problem` to `lambda` in the lanes `lanes`, where it must be zero before, and updates the scaled
    /// velocity change w.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction). A contact with three rows
    /// reads the first three numbers.
    #[inline(always)]
    pub fn set_first_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask, lambda: [R; 6]) {
        at_contact!(i of problem.contacts.len(), [set: &problem] [impulses: &mut self] =>
            set.set_first_impulse(i, lanes, lambda, impulses, &mut self.w));
    }

    /// Sets the impulse of contact `i` to zero in the lanes `lanes`, and updates the scaled velocity change w. Returns the previous impulse
    /// as six numbers, N s or N m s; the last three are zeros for a contact with three rows.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn take_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask) -> [R; 6] {
        at_contact!(i of problem.contacts.len(), [set: &problem] [impulses: &mut self] => set.take_impulse(i, lanes, impulses, &mut self.w))
    }

    /// Impulse of contact `i`, N s or N m s, as six numbers. The last three are zeros for a contact with three rows.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn contact_impulse(&self, i: usize) -> [R; 6] {
        at_contact!(i of self.contacts.len(), [impulses: &self] => padded(&impulses[i]))
    }

    /// Sets the impulse of contact `i` in the lane `lane`. The scaled velocity change w is not updated. A contact with three rows reads the
    /// first three numbers.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn set_contact_impulse(&mut self, i: usize, lane: usize, lambda: &[f64; 6]) {
        at_contact!(i of self.contacts.len(), [impulses: &mut self] => {
            impulses[i].iter_mut().zip(lambda).for_each(|(row, &x)| row.set_lane(lane, Scalar::from_f64(x)));
        });
    }

    /// Work of the friction of contact `i`, J: its friction impulse times the mean of the slip velocities before and after all impulses.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn friction_work(&self, problem: &Problem<R>, i: usize) -> R {
        at_contact!(i of problem.contacts.len(), [set: &problem] [impulses: &self] => set.friction_work(i, impulses, &self.w))
    }

    /// Rounding error of the normal impulse of contact `i`, as a velocity, m/s.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn impulse_rounding(&self, problem: &Problem<R>, i: usize) -> R {
        at_contact!(i of problem.contacts.len(), [set: &problem] [impulses: &self] => set.impulse_rounding(i, impulses))
    }

    /// Sets the impulses of all contacts to zero in the lanes `lanes`, and recomputes the scaled velocity change w there. `scratch` is a
    /// buffer of the length of w.
    pub fn clear_contacts(&mut self, problem: &Problem<R>, lanes: R::Mask, scratch: &mut [R]) {
        kernel!(R, || {
            for impulse in self.contacts.as_flattened_mut().iter_mut().chain(self.rolling_contacts.as_flattened_mut()) {
                *impulse = R::select(lanes, R::zero(), *impulse);
            }
            scratch.copy_from_slice(&self.w);
            self.compute_w(problem);
            for (w, &kept) in self.w.iter_mut().zip(&*scratch) {
                *w = R::select(lanes, *w, kept);
            }
        });
    }

    /// Whether the impulses change any velocity in any lane.
    #[inline(always)]
    pub fn changes_velocity(&self) -> bool {
        self.w.iter().any(
            #[inline(always)]
            |w| !w.eq(R::zero()).all(),
        )
    }

    /// Solves the eliminated rows (equalities that no other row influences) exactly, in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn solve_eliminated(&mut self, system: System<'_, R>, lanes: R::Mask) {
        system.problem.scalars.solve_eliminated(system.scalars, &mut self.scalars, &mut self.w, lanes);
    }

    /// Computes the scaled velocity change w from the impulses.
    #[inline(always)]
    pub fn compute_w(&mut self, problem: &Problem<R>) {
        self.w.fill(R::zero());
        each_kind!([set: &problem] [impulses: &self] => set.add_impulses(impulses, &mut self.w));
        self.multipliers.contacts.resize(problem.contacts.len(), R::zero());
        self.multipliers.rolling_contacts.resize(problem.rolling_contacts.len(), R::zero());
    }

    /// Makes one Gauss-Seidel iteration over all rows, except the eliminated equalities, which are solved separately. Returns the largest
    /// change of a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(&mut self, system: System<'_, R>, lanes: SweepLanes<R>) -> R {
        let mut change = R::zero();
        each_kind!([set: &system.problem] [rows: system] [impulses: &mut self] [multipliers: &mut self.multipliers] => {
            change = set.sweep(rows, Unknowns { impulses, multipliers, w: &mut self.w }, lanes, change);
        });
        change
    }
}

//! Iterate of a solve: the impulses, and the scaled velocity change that they cause.

use crate::capacity::Capacity;
use crate::cone::masked;
use crate::constraints::constraint_set::{ConstraintList, SweepLanes};
use crate::constraints::friction::MAX_CONTACT_ROWS;
use crate::gauss_seidel::history::History;
use crate::problem::{Problem, System};
use stepper_real::{Mask, Real, Scalar, kernel};

/// Unknowns of a problem, with the history of sweeps. Impulses are in N s, those of angular rows in N m s.
#[derive(Clone, Debug)]
pub struct Iterate<R: Real> {
    /// Scaled velocity change w = sum_i y_i lambda_i by the impulses lambda_i, where y_i are the rows of the scaled Jacobian. Its
    /// kinetic energy is |w|^2 / 2.
    pub w: Vec<R>,
    /// Impulse of each scalar row.
    pub scalars: Vec<R>,
    /// Impulses of the rows of all contacts, one contact after the other.
    pub contacts: Vec<R>,
    /// Multiplier of the friction disc of each contact (slip velocity divided by friction impulse, 1/kg), from which its next local
    /// solution starts; 0 while the contact sticks or is open.
    pub(crate) multipliers: Vec<R>,
    /// History of Anderson's acceleration.
    pub(crate) history: History<R>,
    /// Copy of the impulses, which is restored if a further pass (sweeps and Newton steps) makes the residual larger.
    pub(crate) snapshot: Snapshot<R>,
}

/// Copy of all impulses, and of the scaled velocity change w by them, that can be restored.
#[derive(Clone, Debug)]
pub struct Snapshot<R: Real> {
    w: Vec<R>,
    scalars: Vec<R>,
    contacts: Vec<R>,
}

impl<R: Real> Default for Snapshot<R> {
    fn default() -> Self {
        Self::new(&Capacity::default())
    }
}

impl<R: Real> Snapshot<R> {
    /// Snapshot without impulses, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let [w, scalars, contacts] = [capacity.dimension, capacity.scalars, capacity.contact_rows()].map(Vec::with_capacity);
        Self { w, scalars, contacts }
    }

    /// Copies the impulses of an iterate in all lanes. Does nothing if `lanes`, the lanes that the caller may restore, is empty.
    #[inline(always)]
    pub fn save(&mut self, iterate: &Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            self.w.clone_from(&iterate.w);
            self.scalars.clone_from(&iterate.scalars);
            self.contacts.clone_from(&iterate.contacts);
        }
    }

    /// Copies the saved impulses back, in the lanes `lanes`.
    pub fn restore(&self, iterate: &mut Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            kernel!(R, || {
                copy_lanes(&self.w, &mut iterate.w, lanes);
                copy_lanes(&self.scalars, &mut iterate.scalars, lanes);
                copy_lanes(&self.contacts, &mut iterate.contacts, lanes);
            });
        }
    }

    /// Sets the impulse of contact `i` of `problem` to `lambda` in the lanes `lanes`, where it must be zero before, and updates the scaled
    /// velocity change w.
    ///
    /// A contact reads as many numbers as it has rows. Does nothing if the snapshot has no impulse of this contact.
    #[inline(always)]
    pub fn set_first_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask, lambda: [R; MAX_CONTACT_ROWS]) {
        if problem.contacts[i].rows().end <= self.contacts.len() {
            problem.contacts.set_first_impulse(i, lanes, lambda, &mut self.contacts, &mut self.w);
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
            saved = problem.contacts.add_potential(&self.contacts, problem.scalars.add_potential(&self.scalars, saved));
            now = problem.contacts.add_potential(&iterate.contacts, problem.scalars.add_potential(&iterate.scalars, now));
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

impl<R: Real> Iterate<R> {
    /// Iterate without impulses, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let Snapshot { scalars, contacts, .. } = Snapshot::new(capacity);
        Self {
            w: vec![R::zero(); capacity.dimension],
            scalars,
            contacts,
            multipliers: Vec::with_capacity(capacity.all_contacts()),
            history: History::new(capacity.dimension, capacity.dimension + capacity.scalars + capacity.contact_rows()),
            snapshot: Snapshot::new(capacity),
        }
    }

    /// Removes all impulses. The caller then pushes a warm start (or zeros) for every row, and calls [`Iterate::compute_w`].
    #[inline(always)]
    pub fn clear(&mut self) {
        self.scalars.clear();
        self.contacts.clear();
        self.multipliers.clear();
    }

    /// Sets all impulses and the scaled velocity change w by them to zero in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn clear_impulses(&mut self, lanes: R::Mask) {
        for numbers in [&mut self.w, &mut self.scalars, &mut self.contacts] {
            for x in numbers {
                *x = masked(lanes.not(), *x);
            }
        }
    }

    /// Sets the impulse of contact `i` of `problem` to `lambda` in the lanes `lanes`, where it must be zero before, and updates the scaled
    /// velocity change w.
    ///
    /// A contact reads as many numbers as it has rows.
    #[inline(always)]
    pub fn set_first_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask, lambda: [R; MAX_CONTACT_ROWS]) {
        problem.contacts.set_first_impulse(i, lanes, lambda, &mut self.contacts, &mut self.w);
    }

    /// Sets the impulse of contact `i` to zero in the lanes `lanes`, and updates the scaled velocity change w. Returns the previous impulse
    /// of each row, N s or N m s, followed by zeros.
    #[inline(always)]
    pub fn take_impulse(&mut self, problem: &Problem<R>, i: usize, lanes: R::Mask) -> [R; MAX_CONTACT_ROWS] {
        let lambda = &mut self.contacts[problem.contacts[i].rows()];
        let [mut before, mut change] = [[R::zero(); MAX_CONTACT_ROWS]; 2];
        for (k, lambda) in lambda.iter_mut().enumerate() {
            before[k] = *lambda;
            change[k] = -masked(lanes, *lambda);
            *lambda = R::select(lanes, R::zero(), *lambda);
        }
        problem.contacts.add(i, &change[..lambda.len()], &mut self.w);
        before
    }

    /// Impulse of each row of contact `i`, N s or N m s.
    #[inline(always)]
    pub fn contact_impulse(&self, problem: &Problem<R>, i: usize) -> &[R] {
        &self.contacts[problem.contacts[i].rows()]
    }

    /// Sets the impulse of contact `i` in the lane `lane`. The scaled velocity change w is not updated. A contact reads as many numbers as
    /// it has rows.
    #[inline(always)]
    pub fn set_contact_impulse(&mut self, problem: &Problem<R>, i: usize, lane: usize, lambda: &[f64; MAX_CONTACT_ROWS]) {
        let impulse = &mut self.contacts[problem.contacts[i].rows()];
        impulse.iter_mut().zip(lambda).for_each(|(row, &x)| row.set_lane(lane, Scalar::from_f64(x)));
    }

    /// Work of the friction of contact `i`, J: its friction impulse times the mean of the slip velocities before and after all impulses.
    #[inline(always)]
    pub fn friction_work(&self, problem: &Problem<R>, i: usize) -> R {
        let (velocity, [g, _]) = (problem.contacts.velocity(i, &self.w), problem.contacts.rows.offsets(i));
        let (lambda, mut work) = (self.contact_impulse(problem, i), R::zero());
        for k in 1..lambda.len() {
            work += lambda[k] * (velocity[k] + g[k]);
        }
        work * R::of(0.5)
    }

    /// Rounding error of the normal impulse of contact `i`, as a velocity, m/s. The residual of the contact cannot be smaller.
    #[inline(always)]
    pub fn impulse_rounding(&self, problem: &Problem<R>, i: usize) -> R {
        let contact = &problem.contacts[i];
        self.contacts[contact.rows().start] * contact.step.inv_rho * R::of(R::Scalar::EPSILON.to_f64())
    }

    /// Sets the impulses of all contacts to zero in the lanes `lanes`, and recomputes the scaled velocity change w there.
    pub fn clear_contacts(&mut self, problem: &Problem<R>, lanes: R::Mask) {
        kernel!(R, || {
            for impulse in &mut self.contacts {
                *impulse = R::select(lanes, R::zero(), *impulse);
            }
            self.recompute_w(problem, lanes);
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
        problem.scalars.add_impulses(&self.scalars, &mut self.w);
        problem.contacts.add_impulses(&self.contacts, &mut self.w);
        self.multipliers.resize(problem.contacts.len(), R::zero());
    }

    /// Recomputes the scaled velocity change w from the impulses in the lanes `lanes`. The other lanes keep all bits. The history of sweeps
    /// must be reset before the next sweep.
    #[inline(always)]
    pub(crate) fn recompute_w(&mut self, problem: &Problem<R>, lanes: R::Mask) {
        std::mem::swap(&mut self.w, &mut self.history.start);
        self.compute_w(problem);
        for (w, &before) in self.w.iter_mut().zip(&self.history.start) {
            *w = R::select(lanes, *w, before);
        }
    }

    /// Makes one Gauss-Seidel iteration over all rows, except the eliminated equalities, which are solved separately. Returns the largest
    /// change of a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(&mut self, system: System<'_, R>, lanes: SweepLanes<R>) -> R {
        let System { problem, scalars, contacts, .. } = system;
        let change = problem.scalars.sweep(scalars, &mut self.scalars, &mut self.w, lanes, R::zero());
        problem.contacts.sweep(contacts, &mut self.contacts, &mut self.multipliers, &mut self.w, lanes, change)
    }
}

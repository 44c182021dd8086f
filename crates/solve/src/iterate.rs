//! The iterate: impulses, and the scaled velocity change that they make.

use crate::capacity::Capacity;
use crate::constraints::{ConstraintSet, SweepLanes, Unknowns};
use crate::gauss_seidel::history::History;
use crate::lane_map::LaneMap;
use crate::problem::Problem;
use stepper_real::{Mask, Real};

/// Unknowns of a problem, and what sweeps remember of them.
#[derive(Clone, Debug)]
pub struct Iterate<R: Real> {
    /// Scaled velocity change w = sum_i y_i lambda_i.
    pub w: Vec<R>,
    /// Impulses of the scalar rows, N s or N m s.
    pub scalars: Vec<R>,
    /// Impulses of the contacts with sliding friction in their frames (n, t1, t2), N s.
    pub contacts: Vec<[R; 3]>,
    /// Impulses of the contacts with torsional or rolling friction, as their rows are scaled, N s.
    pub rolling_contacts: Vec<[R; 6]>,
    /// Multiplier of the friction disc in each contact, the start of the next local solve; 0 while it sticks.
    pub(crate) multipliers: Vec<R>,
    pub(crate) rolling_multipliers: Vec<R>,
    pub(crate) history: History<R>,
    /// Half of the lanes in half the registers; none where all lanes are in one register.
    pub(crate) compacted: Option<Box<Compacted<R::Half>>>,
    /// Impulses that a further pass may not make worse.
    pub(crate) snapshot: Snapshot<R>,
}

/// Problem and iterate of gathered lanes.
#[derive(Clone, Debug)]
pub(crate) struct Compacted<R: Real> {
    pub(crate) problem: Problem<R>,
    pub(crate) iterate: Iterate<R>,
}

/// Copy of impulses and w that can be restored.
#[derive(Clone, Debug, Default)]
pub struct Snapshot<R> {
    w: Vec<R>,
    scalars: Vec<R>,
    contacts: Vec<[R; 3]>,
    rolling_contacts: Vec<[R; 6]>,
}

impl<R: Real> Snapshot<R> {
    /// Reserves memory for the unknowns of a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        Self {
            w: Vec::with_capacity(capacity.dimension),
            scalars: Vec::with_capacity(capacity.scalars),
            contacts: Vec::with_capacity(capacity.contacts),
            rolling_contacts: Vec::with_capacity(capacity.rolling_contacts),
        }
    }

    /// Saves the impulses of an iterate, if any lane of `lanes` may restore them.
    pub fn save(&mut self, iterate: &Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            self.w.clone_from(&iterate.w);
            self.scalars.clone_from(&iterate.scalars);
            self.contacts.clone_from(&iterate.contacts);
            self.rolling_contacts.clone_from(&iterate.rolling_contacts);
        }
    }

    /// Restores the impulses of the lanes `lanes`.
    pub fn restore(&self, iterate: &mut Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            R::vectorize(
                #[inline(always)]
                || iterate.copy_lanes(self, lanes),
            );
        }
    }
}

impl<R: Real> Iterate<R> {
    /// Reserves memory for the unknowns of a problem with so many rows.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        Self::new(&Capacity { dimension, scalars, contacts, ..Capacity::default() })
    }

    /// Reserves memory for the unknowns of a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let compacted = || Box::new(Compacted { problem: Problem::new(capacity), iterate: Iterate::new(capacity) });
        Self {
            w: vec![R::zero(); capacity.dimension],
            scalars: Vec::with_capacity(capacity.scalars),
            contacts: Vec::with_capacity(capacity.contacts),
            rolling_contacts: Vec::with_capacity(capacity.rolling_contacts),
            multipliers: Vec::with_capacity(capacity.contacts),
            rolling_multipliers: Vec::with_capacity(capacity.rolling_contacts),
            history: History::new(capacity),
            compacted: (R::LANES > R::Half::LANES).then(compacted),
            snapshot: Snapshot::new(capacity),
        }
    }

    /// Gathers some lanes into `out`.
    #[inline(always)]
    pub(crate) fn gather(&self, map: &LaneMap, out: &mut Iterate<R::Half>) {
        map.gather_slice(&self.w, &mut out.w);
        map.gather_slice(&self.scalars, &mut out.scalars);
        map.gather_slice(&self.multipliers, &mut out.multipliers);
        map.gather_slice(&self.rolling_multipliers, &mut out.rolling_multipliers);
        map.gather_arrays(&self.contacts, &mut out.contacts);
        map.gather_arrays(&self.rolling_contacts, &mut out.rolling_contacts);
        self.history.gather(map, &mut out.history);
    }

    /// Scatters the unknowns of gathered lanes back; the history stays as it was.
    #[inline(always)]
    pub(crate) fn scatter(&mut self, map: &LaneMap, from: &Iterate<R::Half>) {
        map.scatter_slice(&from.w, &mut self.w);
        map.scatter_slice(&from.scalars, &mut self.scalars);
        map.scatter_slice(from.contacts.as_flattened(), self.contacts.as_flattened_mut());
        map.scatter_slice(from.rolling_contacts.as_flattened(), self.rolling_contacts.as_flattened_mut());
        map.scatter_slice(&from.multipliers, &mut self.multipliers);
        map.scatter_slice(&from.rolling_multipliers, &mut self.rolling_multipliers);
    }

    /// Copies impulses and w of the lanes `lanes`.
    #[inline(always)]
    fn copy_lanes(&mut self, from: &Snapshot<R>, lanes: R::Mask) {
        let Snapshot { w, scalars, contacts, rolling_contacts } = from;
        let lists = [
            (&mut self.w[..], &w[..]),
            (&mut self.scalars[..], &scalars[..]),
            (self.contacts.as_flattened_mut(), contacts.as_flattened()),
            (self.rolling_contacts.as_flattened_mut(), rolling_contacts.as_flattened()),
        ];
        for (to, from) in lists {
            for (to, &from) in to.iter_mut().zip(from) {
                *to = R::select(lanes, from, *to);
            }
        }
    }

    /// Removes all impulses; the caller pushes a warm start (or zeros) for every row, then calls [`Iterate::compute_w`].
    #[inline(always)]
    pub fn clear(&mut self) {
        self.scalars.clear();
        self.contacts.clear();
        self.multipliers.clear();
        self.rolling_contacts.clear();
        self.rolling_multipliers.clear();
    }

    /// Whether the impulses change any velocity.
    #[inline(always)]
    pub fn changes_velocity(&self) -> bool {
        self.w.iter().any(
            #[inline(always)]
            |w| !w.eq(R::zero()).all(),
        )
    }

    /// Solves the separate rows in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn solve_separate(&mut self, problem: &Problem<R>, lanes: R::Mask) {
        problem.scalars.solve_separate(&mut self.scalars, &mut self.w, lanes);
    }

    /// Computes w from the impulses.
    #[inline(always)]
    pub fn compute_w(&mut self, problem: &Problem<R>) {
        self.w.fill(R::zero());
        problem.scalars.add_impulses(&self.scalars, &mut self.w);
        problem.contacts.add_impulses(&self.contacts, &mut self.w);
        problem.rolling_contacts.add_impulses(&self.rolling_contacts, &mut self.w);
        self.multipliers.resize(problem.contacts.len(), R::zero());
        self.rolling_multipliers.resize(problem.rolling_contacts.len(), R::zero());
    }

    /// Visits every row that is not separate once; returns the largest change as a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(&mut self, problem: &Problem<R>, lanes: SweepLanes<R>) -> R {
        let Self { w, scalars, contacts, rolling_contacts, multipliers, rolling_multipliers, .. } = self;
        let mut change = problem.scalars.sweep(Unknowns { impulses: scalars, multipliers: &mut [], w }, lanes, R::zero());
        change = problem.contacts.sweep(Unknowns { impulses: contacts, multipliers, w }, lanes, change);
        if problem.rolling_contacts.is_empty() {
            return change;
        }
        let unknowns = Unknowns { impulses: rolling_contacts, multipliers: rolling_multipliers, w };
        change.max(problem.rolling_contacts.sweep(unknowns, lanes, R::zero()))
    }
}

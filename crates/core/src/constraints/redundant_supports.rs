//! Redundant supports: contacts whose forces the equations of motion do not determine, such as four legs of a table. The solver distributes
//! the load evenly over them.
//!
//! Three contacts between two bodies have nine unknown force components; a rigid body gives six equations. While all points stick, the
//! motion is the same for all solutions. When they slip, the torque of friction depends on how the points share the load. Gauss-Seidel
//! iterations load the contacts that they visit first, and such forces rotate a box that two fingers hold.
//!
//! Three or more contacts between the same two bodies form a contact group, if one of the bodies floats freely (is alone on a free joint).
//! Groups that act on a common degree of freedom form a cluster, whose loads are shared together. Example: a box between two fingers has
//! two groups in one cluster. Among all nonnegative normal impulses with the same effect on the joints, the impulses of least norm are
//! used. Friction of a slipping contact is recomputed as mu times the normal impulse, against the motion. If a group slips without
//! rotating, this changes no velocity. If it rotates, its friction torque changes, and the solver continues from the shared loads.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Iterate, Problem};

use crate::collision::contact_set::Contacts;
use crate::compile::ModelStructure;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::spatial::*;
use crate::tuning::{DEPENDENT_LENGTH, MAX_NEW_CONTACTS, MAX_SHARED_CONTACTS, MIN_SHARE_CHANGE, MIN_SHARED_CONTACTS, SLIP_SPEED};

/// Contact groups of all lanes.
#[derive(Clone, Debug)]
pub(crate) struct ContactGroups<R> {
    /// Slots of the contacts of all groups in the contact set, group by group. A slot has up to one contact per lane.
    slots: Vec<usize>,
    /// Contact groups of all lanes, lane by lane.
    groups: Vec<ContactGroup>,
    /// Workspace of the search for contact groups in one lane: the two bodies of each group, and its number of contacts.
    pairs: Vec<([usize; 2], usize)>,
    /// Workspace of the search for contact groups in one lane: index of the group of every contact.
    of_contact: Vec<usize>,
    /// Contacts of the cluster whose loads are being shared (groups that move a common coordinate).
    points: Vec<Point>,
    /// Matrix of the load sharing. Its entries are the effects of a unit normal impulse of each contact (column) on each coordinate of the
    /// solver's velocity w (row).
    rows: Vec<f64>,
    /// For each row of `rows`, sum of the effects of all normal impulses on the row's coordinate, in the scale of the row. Load sharing
    /// must not change it.
    sums: Vec<f64>,
    /// Index of the coordinate of each row of `rows`.
    coordinates: Vec<u32>,
    /// Whether each row of `rows` has already been orthonormalised.
    done: Vec<bool>,
    /// For each coordinate, index of a contact group that moves it. Groups with a common coordinate belong to the same cluster.
    owners: Vec<usize>,
    /// Velocities of all contacts of the problem, m/s.
    velocities: Vec<V3<R>>,
}

/// Contact group: three or more contacts between the same two bodies in one lane. At least one of the bodies floats freely.
#[derive(Clone, Copy, Debug)]
struct ContactGroup {
    lane: usize,
    /// Range of the group's contacts in the list of slots.
    slots: [usize; 2],
    /// Cluster of the group (groups that move a common coordinate), given as the index of one of its groups.
    cluster: usize,
    /// Whether any contact of the group slips under load.
    slips: bool,
}

impl ContactGroup {
    /// Indices of the group's contacts in the problem. The iterator leaves out contacts that have six rows, are immovable, or are deferred
    /// in the group's lane.
    fn contacts<'a, R: Real>(
        &self,
        slots: &'a [usize],
        assembled: &'a [(usize, R::Mask)],
        problem: &'a Problem<R>,
    ) -> impl Iterator<Item = usize> + 'a {
        let lane = self.lane;
        let index = move |k: &usize| assembled.binary_search_by_key(k, |slot| slot.0).ok();
        let exists = move |i: &usize| problem.contacts[*i].active.bits() >> lane & 1 == 1;
        slots[self.slots[0]..self.slots[1]].iter().filter_map(index).filter(exists)
    }
}

/// Contact in the cluster whose loads are being shared.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Index of the contact in the problem.
    contact: usize,
    /// Velocity of the contact along the normal and the tangents, m/s.
    velocity: [f64; 3],
    /// Normal impulse of the contact before the loads are shared, N s.
    before: f64,
    /// Normal impulse of the contact after the loads are shared, N s.
    shared: f64,
    /// Whether load sharing may give the contact a nonzero normal impulse.
    free: bool,
}

impl<R: Real> ContactGroups<R> {
    /// Workspace for `max_contacts` contacts per environment.
    pub(crate) fn new(max_contacts: usize) -> Self {
        let n = max_contacts;
        Self {
            slots: Vec::with_capacity(n * R::LANES),
            groups: Vec::with_capacity(n.div_ceil(MIN_SHARED_CONTACTS) * R::LANES),
            pairs: Vec::with_capacity(n),
            of_contact: Vec::with_capacity(n),
            points: Vec::with_capacity(n.min(MAX_SHARED_CONTACTS)),
            rows: vec![],
            sums: vec![],
            coordinates: vec![],
            done: vec![],
            owners: vec![],
            velocities: Vec::with_capacity(n),
        }
    }

    /// Finds the contact groups in the lanes `lanes` (bits).
    pub(crate) fn find(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, lanes: u32) {
        self.slots.clear();
        self.groups.clear();
        if compiled.floating.is_empty() {
            return;
        }
        for lane in (0..R::LANES).filter(|l| lanes >> l & 1 == 1 && contacts.count[*l] >= MIN_SHARED_CONTACTS) {
            self.pairs.clear();
            self.of_contact.clear();
            for k in 0..contacts.count[lane] {
                let pair = contacts.ids[k][lane].pair();
                // Springs determine how the loads of this contact are shared.
                if compiled.has_contact_springs && compiled.pair(pair).spring.is_some() {
                    self.of_contact.push(usize::MAX);
                    continue;
                }
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                let frames = geoms.map(|g| compiled.geoms[g].frame);
                let known = self.pairs.iter().rposition(|(pair, _)| *pair == frames);
                let group = known.unwrap_or_else(|| {
                    self.pairs.push((frames, 0));
                    self.pairs.len() - 1
                });
                self.pairs[group].1 += 1;
                self.of_contact.push(group);
            }
            for (group, (frames, count)) in self.pairs.iter().enumerate() {
                let loose = |&f: &usize| f > 0 && compiled.floating.get(f - 1) == Some(&true);
                if *count >= MIN_SHARED_CONTACTS && frames.iter().any(loose) {
                    let start = self.slots.len();
                    self.slots.extend((0..contacts.count[lane]).filter(|&k| self.of_contact[k] == group));
                    let cluster = self.groups.len();
                    self.groups.push(ContactGroup { lane, slots: [start, self.slots.len()], cluster, slips: false });
                }
            }
        }
    }

    /// Lanes with a contact group.
    #[inline(always)]
    pub(crate) fn lanes(&self) -> R::Mask {
        R::Mask::from_bits(self.groups.iter().fold(0, |bits, p| bits | 1 << p.lane))
    }

    /// Newly loaded lanes: those with a contact group that has no normal impulses yet, and one of whose contacts has a normal velocity
    /// below its target. Lanes with more than [`MAX_NEW_CONTACTS`] contacts are left out.
    ///
    /// The first impulses of such a group must have the least norm. Gauss-Seidel iterations would load the contacts that they visit first.
    #[inline(always)]
    pub(crate) fn newly_loaded_lanes(
        &self,
        contacts: &Contacts<R>,
        assembled_slots: &[(usize, R::Mask)],
        problem: &Problem<R>,
        iterate: &Iterate<R>,
    ) -> R::Mask {
        let mut lanes = 0;
        for group in self.groups.iter().filter(|p| contacts.count[p.lane] <= MAX_NEW_CONTACTS) {
            let own = || group.contacts::<R>(&self.slots, assembled_slots, problem);
            let unloaded = |i: usize| iterate.contacts[i][0].lane(group.lane) <= R::Scalar::default();
            let closes = |i: usize| problem.contacts.velocity(&problem.contacts[i], &iterate.w)[0].lane(group.lane) < R::Scalar::default();
            if lanes >> group.lane & 1 == 0 && own().all(unloaded) && own().any(closes) {
                lanes |= 1 << group.lane;
            }
        }
        R::Mask::from_bits(lanes)
    }

    /// Finds the contact groups in the lanes `lanes` that slip under load. Returns the lanes with such a group.
    #[inline(always)]
    pub(crate) fn find_slips(&mut self, assembled: &ConstraintProblem<R>, iterate: &Iterate<R>, lanes: R::Mask) -> R::Mask {
        if lanes.none() {
            return lanes;
        }
        let (contacts, velocities) = (&assembled.rows.contacts, &mut self.velocities);
        velocities.clear();
        kernel!(R, || {
            for contact in contacts.iter() {
                velocities.push(contacts.velocity(contact, &iterate.w));
            }
        });
        let (all, mut slipping) = (lanes.bits(), 0);
        let Self { groups, slots, velocities, .. } = self;
        for group in groups.iter_mut().filter(|p| all >> p.lane & 1 == 1) {
            let lane = group.lane;
            let slips = |i: usize| iterate.contacts[i][0].lane(lane).to_f64() > 0.0 && slip(of_lane(&velocities[i], lane)) > SLIP_SPEED;
            group.slips = group.contacts::<R>(slots, &assembled.sliding_slots, &assembled.rows).any(slips);
            slipping |= u32::from(group.slips) << lane;
        }
        R::Mask::from_bits(slipping)
    }

    /// Shares the loads evenly in those clusters of contact groups that [`ContactGroups::find_slips`] found to slip, in the lanes `lanes`.
    /// Returns the lanes in which a load changed.
    ///
    /// The function recomputes `iterate.w`, which may change by rounding in other lanes.
    #[inline(always)]
    pub(crate) fn share(&mut self, assembled: &ConstraintProblem<R>, iterate: &mut Iterate<R>, lanes: R::Mask) -> R::Mask {
        let (mut start, mut shared) = (0, 0);
        while start < self.groups.len() {
            let lane = self.groups[start].lane;
            let end = start + self.groups[start..].iter().take_while(|p| p.lane == lane).count();
            if lanes.bits() >> lane & 1 == 1 && self.share_lane(start..end, assembled, iterate) {
                shared |= 1 << lane;
            }
            start = end;
        }
        if shared != 0 {
            kernel!(R, || iterate.compute_w(&assembled.rows));
        }
        R::Mask::from_bits(shared)
    }

    /// Shares the loads in the contact groups with the indices `groups`, all in one lane. Returns whether any load has changed.
    fn share_lane(&mut self, groups: Range<usize>, assembled: &ConstraintProblem<R>, iterate: &mut Iterate<R>) -> bool {
        let lane = self.groups[groups.start].lane;
        self.find_clusters(groups.clone(), assembled);
        let mut changed = false;
        for cluster in groups.clone() {
            self.points.clear();
            let mut slips = false;
            for p in groups.clone() {
                if self.groups[p].cluster == cluster {
                    self.gather(p, assembled, iterate);
                    slips |= self.groups[p].slips;
                }
            }
            if slips && self.points.len() <= MAX_SHARED_CONTACTS && self.distribute(lane, &assembled.rows) {
                self.scatter(lane, &assembled.rows, iterate);
                changed = true;
            }
        }
        changed
    }

    /// Appends the contacts of group number `group` that have three rows to the list `points`.
    fn gather(&mut self, group: usize, assembled: &ConstraintProblem<R>, iterate: &Iterate<R>) {
        let Self { slots, groups, points, velocities, .. } = self;
        let lane = groups[group].lane;
        for i in groups[group].contacts::<R>(slots, &assembled.sliding_slots, &assembled.rows) {
            let (velocity, before) = (of_lane(&velocities[i], lane), iterate.contacts[i][0].lane(lane).to_f64());
            points.push(Point { contact: i, velocity, before, shared: 0.0, free: before > 0.0 || velocity[0] <= SLIP_SPEED });
        }
    }

    /// Finds clusters among the contact groups with the indices `groups`: groups that move a common coordinate get the same cluster.
    fn find_clusters(&mut self, groups: Range<usize>, assembled: &ConstraintProblem<R>) {
        let Self { slots, groups: all, owners, .. } = self;
        owners.clear();
        owners.resize(assembled.rows.dimension(), usize::MAX);
        let lane = all[groups.start].lane;
        let contacts = &assembled.rows.contacts;
        for p in groups.clone() {
            for contact in all[p].contacts::<R>(slots, &assembled.sliding_slots, &assembled.rows).map(|i| &contacts[i]) {
                let (columns, y) = contacts.entries(contact);
                for (&c, _) in columns.iter().zip(y).filter(|(_, y)| y.iter().any(|y| y.lane(lane) != R::Scalar::default())) {
                    let (owner, cluster) = (owners[c as usize], all[p].cluster);
                    if owner == usize::MAX {
                        owners[c as usize] = cluster;
                    } else if owner != cluster {
                        // The cluster of that group may have changed since it was stored.
                        let known = all[owner].cluster;
                        all[groups.clone()].iter_mut().filter(|other| other.cluster == cluster).for_each(|other| other.cluster = known);
                    }
                }
            }
        }
    }

    /// Redistributes the load of the contacts in `points`.
    ///
    /// The function finds the nonnegative normal impulses of least norm with the same effect on all coordinates. Returns false if there are
    /// no such impulses, or if no load would change by more than a tolerance.
    fn distribute(&mut self, lane: usize, problem: &Problem<R>) -> bool {
        let (total, most) = self.points.iter().fold((0.0, 0.0_f64), |(sum, most), p| (sum + p.before, most.max(p.before)));
        for _ in 0..self.points.len() {
            self.make_rows(lane, problem);
            if !self.least_norm(total) {
                return false;
            }
            let mut negative = false;
            for p in self.points.iter_mut().filter(|p| p.shared < 0.0) {
                (p.free, p.shared, negative) = (false, 0.0, true);
            }
            if !negative {
                return self.points.iter().any(|p| (p.shared - p.before).abs() > MIN_SHARE_CHANGE[precision::<R>()] * most);
            }
        }
        false
    }

    /// Computes `rows` and `sums` from the contacts in `points`.
    ///
    /// Each coordinate that a contact in `points` moves gets a row in `rows`, with zeros for contacts that are not free. The row is scaled
    /// to unit length. `sums` gets the effect of all normal impulses on the coordinate, in the same scale.
    fn make_rows(&mut self, lane: usize, problem: &Problem<R>) {
        let Self { points, rows, sums, coordinates, .. } = self;
        coordinates.clear();
        sums.clear();
        rows.clear();
        let n = points.len();
        for (k, p) in points.iter().enumerate() {
            let (columns, y) = problem.contacts.entries(&problem.contacts[p.contact]);
            for (&c, y) in columns.iter().zip(y) {
                let y = y[0].lane(lane).to_f64();
                if y == 0.0 {
                    continue;
                }
                let row = coordinates.iter().position(|&known| known == c).unwrap_or_else(|| {
                    coordinates.push(c);
                    sums.push(0.0);
                    rows.resize(rows.len() + n, 0.0);
                    coordinates.len() - 1
                });
                sums[row] += y * p.before;
                rows[row * n + k] = if p.free { y } else { 0.0 };
            }
        }
        for (row, sum) in rows.chunks_exact_mut(n).zip(sums) {
            let size = row.iter().map(|y| y * y).sum::<f64>().sqrt();
            if size > 0.0 {
                row.iter_mut().for_each(|y| *y /= size);
                *sum /= size;
            }
        }
    }

    /// Computes normal impulses of least norm for the free contacts in `points`, with the effects in `sums`, and stores them in `shared`.
    ///
    /// The rows become orthonormal one by one (modified Gram-Schmidt), and the sums with them. `total` is the sum of the normal impulses
    /// before the sharing, N s. Returns false if the free contacts cannot give the sums, up to a fraction of `total`.
    fn least_norm(&mut self, total: f64) -> bool {
        let Self { points, rows, sums, done, .. } = self;
        let (n, m) = (points.len(), sums.len());
        let dependent = DEPENDENT_LENGTH[precision::<R>()];
        points.iter_mut().for_each(|p| p.shared = 0.0);
        done.clear();
        done.resize(m, false);
        for _ in 0..m.min(n) {
            let size = |r: usize| rows[r * n..(r + 1) * n].iter().map(|y| y * y).sum::<f64>();
            let longest = (0..m).filter(|&r| !done[r]).map(|r| (r, size(r))).max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((r, square)) = longest.filter(|(_, square)| *square > dependent * dependent) else { break };
            done[r] = true;
            let inverse = 1.0 / square.sqrt();
            sums[r] *= inverse;
            rows[r * n..(r + 1) * n].iter_mut().for_each(|y| *y *= inverse);
            for other in (0..m).filter(|&o| !done[o]) {
                let part: f64 = (0..n).map(|k| rows[r * n + k] * rows[other * n + k]).sum();
                sums[other] -= part * sums[r];
                (0..n).for_each(|k| rows[other * n + k] -= part * rows[r * n + k]);
            }
            points.iter_mut().enumerate().for_each(|(k, p)| p.shared += rows[r * n + k] * sums[r]);
        }
        (0..m).all(|r| done[r] || sums[r].abs() <= 10.0 * dependent * total)
    }

    /// Writes the shared normal impulses of `points` to `iterate`, with friction impulses that match them.
    fn scatter(&self, lane: usize, problem: &Problem<R>, iterate: &mut Iterate<R>) {
        for p in &self.points {
            let lambda = &mut iterate.contacts[p.contact];
            let most = p.shared * problem.contacts[p.contact].mu.lane(lane).to_f64();
            let slip = slip(p.velocity);
            let friction = if slip > SLIP_SPEED {
                [-p.velocity[1] / slip * most, -p.velocity[2] / slip * most]
            } else {
                let friction_before = [lambda[1].lane(lane).to_f64(), lambda[2].lane(lane).to_f64()];
                let size = friction_before[0].hypot(friction_before[1]);
                friction_before.map(|x| if size > most { x * (most / size) } else { x })
            };
            for (row, x) in lambda.iter_mut().zip([p.shared, friction[0], friction[1]]) {
                row.set_lane(lane, Scalar::from_f64(x));
            }
        }
    }
}

/// Index into tables of tolerances: 0 for 64-bit lanes, 1 for 32-bit lanes.
fn precision<R: Real>() -> usize {
    usize::from(R::Scalar::IS_SINGLE)
}

/// Slip speed of a contact, m/s, from its velocity along normal and tangents.
fn slip(velocity: [f64; 3]) -> f64 {
    velocity[1].hypot(velocity[2])
}

//! Redundant supports: contacts whose forces the equations of motion do not determine, such as four legs of a table. The solver distributes
//! the load evenly over them.
//!
//! Three contacts between two bodies have nine unknown force components; a rigid body gives six equations. While all points stick, the
//! motion is the same for all solutions. When they slip, the torque of friction depends on how the points share the load. Gauss-Seidel
//! iterations load the contacts that they visit first, and such forces rotate a box that two fingers hold.
//!
//! Three or more contacts between the same two bodies form a contact group, if one of the bodies floats freely (is alone on a free joint).
//! So do two contacts, if that body has more contacts and the environment has few. Groups that act on a common degree of freedom form a
//! cluster, whose loads are shared together. Examples: a box between two fingers has two groups of four contacts in one cluster. An upright
//! cylinder between them has two groups of two. Among all impulses with the same effect on the joints, the impulses of least norm are used,
//! as far as the friction cones allow.
//!
//! * If a loaded contact of the cluster slips, the normal impulses are shared. Friction of a slipping contact is recomputed as mu times the
//!   normal impulse, against the motion. If a group slips without rotating, this changes no velocity. If it rotates, its friction torque
//!   changes, and the solver continues from the shared loads.
//! * If the cluster sticks and moves, all impulses are shared in about one step in eight. With a smaller tolerance than the default, they
//!   are shared in every step. This changes no velocity. Without it the residuals of many steps would move load from contact to contact,
//!   until some contacts reach their cones and the cluster slips.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Iterate, MAX_CONTACT_ROWS, Problem};

use crate::collision::contact_set::Contacts;
use crate::compile::ModelStructure;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::tuning::{
    DEPENDENT_LENGTH, MAX_NEW_CONTACTS, MAX_SHARE_ROUNDS, MAX_SHARED_CONTACTS, MAX_STICKING_WORK, MIN_SHARE_CHANGE, MIN_SHARED_CONTACTS,
    STEPS_PER_SHARE,
};

/// Contact groups of all lanes.
#[derive(Clone, Debug)]
pub(crate) struct ContactGroups<R> {
    /// Indices in the problem of the contacts of all groups, group by group. Immovable contacts are absent.
    members: Vec<usize>,
    /// Contact groups of all lanes, lane by lane.
    groups: Vec<ContactGroup>,
    /// Workspace of the search for contact groups in one lane: the two bodies of each group, and its number of contacts.
    pairs: Vec<([usize; 2], usize)>,
    /// Workspace of the search for contact groups in one lane: index of the group of every contact.
    of_contact: Vec<usize>,
    /// For each coordinate, index of a contact group that moves it. Groups with a common coordinate belong to the same cluster.
    owners: Vec<usize>,
    /// Velocities of all contacts of the problem, m/s.
    velocities: Vec<[R; MAX_CONTACT_ROWS]>,
    /// Contacts of the cluster whose loads are being shared (groups that move a common coordinate).
    points: Vec<Point>,
    /// Loads of the cluster whose loads are being shared.
    loads: Loads,
}

/// Contact group: two or more contacts between the same two bodies in one lane. At least one of the bodies floats freely, and has three or
/// more contacts in all.
#[derive(Clone, Copy, Debug)]
struct ContactGroup {
    lane: usize,
    /// Range of the group's contacts in the list of members.
    members: [usize; 2],
    /// Cluster of the group (groups that move a common coordinate), given as the index of one of its groups.
    cluster: usize,
    /// Whether any contact of the group slips under load.
    slips: bool,
}

impl ContactGroup {
    /// Indices of the group's contacts in the problem, without those that are deferred in the group's lane. `members` is the list of
    /// members.
    #[inline(always)]
    fn contacts<'a, R: Real>(&self, members: &'a [usize], problem: &'a ConstraintProblem<R>) -> impl Iterator<Item = usize> + 'a {
        let lane = self.lane;
        members[self.members[0]..self.members[1]].iter().copied().filter(
            #[inline(always)]
            move |&i| problem.rows.contacts[i].active.bits() >> lane & 1 == 1,
        )
    }
}

/// Clusters whose loads [`ContactGroups::share`] shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Clusters {
    /// Clusters in which a loaded contact slips. Their normal impulses are shared, and friction impulses follow from these.
    Slipping,
    /// Clusters in which no loaded contact slips. All their impulses are shared.
    Sticking,
}

/// Contact in the cluster whose loads are being shared.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Index of the contact in the problem.
    contact: usize,
    /// Friction coefficient of the contact's rows.
    mu: f64,
    /// Velocity of the contact along the normal and the tangents, m/s.
    velocity: [f64; MAX_CONTACT_ROWS],
    /// Whether load sharing may change the impulse of the contact.
    free: bool,
}

impl Point {
    /// Replaces the friction impulse in `lambda` by one that belongs to the normal impulse. If the contact moves faster than `slip_speed`,
    /// it is mu times the normal impulse, against the motion, otherwise at most mu times the normal impulse.
    fn set_friction(&self, slip_speed: f64, lambda: &mut [f64; MAX_CONTACT_ROWS]) {
        // Rounding can make the normal impulse negative.
        let (most, slip) = (self.mu * lambda[0].max(0.0), slip(&self.velocity));
        let (sign, direction, size) = if slip > slip_speed { (-1.0, self.velocity, slip) } else { (1.0, *lambda, self::slip(lambda)) };
        let scale = if slip > slip_speed || size > most { sign * most / size } else { 1.0 };
        (1..6).for_each(|i| lambda[i] = direction[i] * scale);
    }
}

/// Impulses of a cluster with the matrix of their effects, and those of least norm with the same effects.
///
/// A cluster has `width` impulses per contact: the normal impulse, or the impulses of all rows. Zeros fill the lists up to a multiple of
/// [`PARTS`].
#[derive(Clone, Debug)]
struct Loads {
    /// Number of impulses per contact.
    width: usize,
    /// Impulses, N s, contact by contact.
    impulses: Vec<f64>,
    /// Impulses of least norm with the same effects, N s.
    targets: Vec<f64>,
    /// Matrix of the effects of a unit impulse (column) on each coordinate of the solver's velocity w (row).
    rows: Vec<f64>,
    /// Index of the coordinate of each row of `rows`.
    coordinates: Vec<u32>,
    /// Index of the row of each coordinate; `u32::MAX` for coordinates without a row.
    row_of: Vec<u32>,
    /// Squared length of each row of `rows`, without its parts along the rows that are already orthonormal; 0 for the latter.
    squares: Vec<f64>,
}

/// Number of partial sums of a scalar product.
const PARTS: usize = 4;

impl Loads {
    /// Workspace for problems with `dimension` coordinates.
    fn new(dimension: usize) -> Self {
        let list = || Vec::with_capacity(6 * MAX_SHARED_CONTACTS);
        Self {
            width: 1,
            impulses: list(),
            targets: list(),
            rows: Vec::with_capacity((dimension * MAX_SHARED_CONTACTS).max((6 * MAX_SHARED_CONTACTS * MAX_STICKING_WORK).isqrt())),
            coordinates: Vec::with_capacity(dimension),
            row_of: vec![u32::MAX; dimension],
            squares: Vec::with_capacity(dimension),
        }
    }

    /// Computes `rows` from the free contacts in `points`: one row for each coordinate that they move. Returns whether `max_rows` rows are
    /// enough.
    fn make_rows<R: Real>(&mut self, points: &[Point], lane: usize, problem: &Problem<R>, max_rows: usize) -> bool {
        let Self { width, impulses, rows, coordinates, row_of, .. } = self;
        let (width, stride) = (*width, impulses.len());
        let mut enough = true;
        coordinates.drain(..).for_each(|c| row_of[c as usize] = u32::MAX);
        rows.clear();
        for (k, p) in points.iter().enumerate().filter(|(_, p)| p.free) {
            let used = if p.mu > 0.0 { width } else { 1 };
            problem.contacts.for_each_entry(p.contact, lane, |c, y| {
                if y[..used].iter().all(|&y| y == 0.0) {
                    return;
                }
                let row = &mut row_of[c as usize];
                if *row == u32::MAX {
                    if coordinates.len() == max_rows {
                        enough = false;
                        return;
                    }
                    *row = coordinates.len() as u32;
                    coordinates.push(c);
                    rows.resize(rows.len() + stride, 0.0);
                }
                rows[*row as usize * stride + k * width..][..used].copy_from_slice(&y[..used]);
            });
        }
        enough
    }

    /// Computes `targets`: the projection of `impulses` on the space of the rows.
    ///
    /// The rows become orthonormal one by one (modified Gram-Schmidt), the longest first. Rows shorter than the fraction `dependent` of the
    /// longest one are left out.
    #[inline(always)]
    fn find_targets(&mut self, dependent: f64) {
        let Self { impulses, targets, rows, coordinates, squares, .. } = self;
        let stride = impulses.len();
        targets.clear();
        targets.resize(stride, 0.0);
        squares.clear();
        squares.extend(rows.chunks_exact(stride).map(|row| dot(row, row)));
        let least = squares.iter().copied().fold(0.0, f64::max) * dependent * dependent;
        for _ in 0..coordinates.len() {
            let longest = squares.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((r, square)) = longest.filter(|(_, square)| *square > least) else { break };
            squares[r] = 0.0;
            let (before, rest) = rows.split_at_mut(r * stride);
            let (row, after) = rest.split_at_mut(stride);
            let inverse = 1.0 / square.sqrt();
            row.iter_mut().for_each(|y| *y *= inverse);
            add_scaled(targets, row, dot(row, impulses));
            let (lower, upper) = squares.split_at_mut(r);
            let others = before.chunks_exact_mut(stride).zip(lower).chain(after.chunks_exact_mut(stride).zip(&mut upper[1..]));
            for (other, square) in others.filter(|(_, square)| **square > 0.0) {
                add_scaled(other, row, -dot(row, other));
                *square = dot(other, other);
            }
        }
    }

    /// Moves the impulses of the free contacts in `points` towards their targets, until one of them is on its friction cone. Returns the
    /// index of this contact; `None` if all reach their targets.
    fn move_to_targets(&mut self, points: &[Point]) -> Option<usize> {
        let Self { width, impulses, targets, .. } = self;
        let (mut step, mut first) = (1.0, None);
        for (k, p) in points.iter().enumerate().filter(|(_, p)| p.free) {
            let range = k * *width..(k + 1) * *width;
            let reach = cone_exit(p.mu, &impulses[range.clone()], &targets[range]);
            if reach < step {
                (step, first) = (reach, Some(k));
            }
        }
        for (k, _) in points.iter().enumerate().filter(|(_, p)| p.free) {
            for i in k * *width..(k + 1) * *width {
                impulses[i] += step * (targets[i] - impulses[i]);
            }
        }
        first
    }
}

/// Fraction of the way from the impulse `from` to the impulse `to` at which it leaves the friction cone, at most 1. The first number of an
/// impulse is normal. The impulse `from` is in the cone, except for rounding.
fn cone_exit(mu: f64, from: &[f64], to: &[f64]) -> f64 {
    // The impulse at the fraction s is in the cone if a s^2 + 2 b s + c >= 0 and its normal part is not negative.
    let change = to[0] - from[0];
    let (mut a, mut b, mut c) = ((mu * change).powi(2), mu * mu * from[0] * change, (mu * from[0]).powi(2));
    for (x, to) in from.iter().zip(to).skip(1) {
        let d = to - x;
        (a, b, c) = (a - d * d, b - x * d, c - x * x);
    }
    let c = c.max(0.0);
    let root = (b * b - a * c).max(0.0).sqrt();
    let exit = match (b < 0.0, a < 0.0) {
        (true, _) => c / (root - b),
        (false, true) => (b + root) / -a,
        (false, false) => 1.0,
    };
    let opens = if to[0] < 0.0 { from[0].max(0.0) / -change } else { 1.0 };
    exit.min(opens).min(1.0)
}

impl<R: Real> ContactGroups<R> {
    /// Workspace for problems with `dimension` coordinates and `max_contacts` contacts per environment.
    pub(crate) fn new(dimension: usize, max_contacts: usize) -> Self {
        let n = max_contacts;
        Self {
            members: Vec::with_capacity(n * R::LANES),
            groups: Vec::with_capacity(n.div_ceil(2) * R::LANES),
            pairs: Vec::with_capacity(n),
            of_contact: Vec::with_capacity(n),
            owners: Vec::with_capacity(dimension),
            velocities: Vec::with_capacity(n),
            points: Vec::with_capacity(n),
            loads: Loads::new(dimension),
        }
    }

    /// Finds the contact groups among the contacts of the problem, in the lanes `lanes` (bits).
    pub(crate) fn find(
        &mut self,
        compiled: &ModelStructure<R::Scalar>,
        contacts: &Contacts<R>,
        problem: &ConstraintProblem<R>,
        lanes: u32,
    ) {
        self.members.clear();
        self.groups.clear();
        if compiled.floating.is_empty() {
            return;
        }
        kernel!(R, || {
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
                let Self { members, groups, pairs, of_contact, .. } = &mut *self;
                let contacts_of =
                    |frame: &usize| pairs.iter().filter(|(pair, _)| pair.contains(frame)).map(|(_, count)| count).sum::<usize>();
                for (group, (frames, count)) in pairs.iter().enumerate() {
                    let floats = |&f: &usize| f > 0 && compiled.floating.get(f - 1) == Some(&true);
                    let is_pair = *count == 2 && contacts.count[lane] <= MAX_NEW_CONTACTS;
                    let is_redundant =
                        |f: &usize| floats(f) && (*count >= MIN_SHARED_CONTACTS || is_pair && contacts_of(f) >= MIN_SHARED_CONTACTS);
                    if frames.iter().any(is_redundant) {
                        let start = members.len();
                        let slots = (0..contacts.count[lane]).filter(|&k| of_contact[k] == group);
                        members.extend(slots.filter_map(|k| problem.contact_in_slot(k, lane)));
                        let cluster = groups.len();
                        groups.push(ContactGroup { lane, members: [start, members.len()], cluster, slips: false });
                    }
                }
            }
        });
    }

    /// Lanes with a contact group.
    #[inline(always)]
    pub(crate) fn lanes(&self) -> R::Mask {
        R::Mask::from_bits(self.groups.iter().fold(0, |bits, p| bits | 1 << p.lane))
    }

    /// Lanes of `lanes` in which sticking clusters share their loads in this step: about one step in [`STEPS_PER_SHARE`].
    ///
    /// A hash of the normal impulses decides, like a random draw. Loads that stay the same to the last bit do not drift, so that they need
    /// no sharing. A count of steps would be one more number in the state.
    pub(crate) fn due_lanes(&self, problem: &ConstraintProblem<R>, iterate: &Iterate<R>, lanes: R::Mask) -> R::Mask {
        kernel!(R, || {
            let (all, mut bits) = (lanes.bits(), [0_u64; MAX_LANES]);
            for group in self.groups.iter().filter(|group| all >> group.lane & 1 == 1) {
                for i in group.contacts(&self.members, problem) {
                    bits[group.lane] ^= iterate.contact_impulse(&problem.rows, i)[0].lane(group.lane).to_f64().to_bits();
                }
            }
            // The high bits of the product depend on all bits (multiplication by 2^64 divided by the golden ratio).
            let is_due = |bits: u64| bits != 0 && bits.wrapping_mul(0x9E37_79B9_7F4A_7C15) < u64::MAX / STEPS_PER_SHARE;
            R::Mask::from_bits(each_of(all).filter(|&lane| is_due(bits[lane])).fold(0, |due, lane| due | 1 << lane))
        })
    }

    /// Newly loaded lanes: those with a contact group that has no normal impulses yet, and one of whose contacts has a normal velocity
    /// below its target. Lanes with more than [`MAX_NEW_CONTACTS`] contacts are left out.
    ///
    /// The first impulses of such a group must have the least norm. Gauss-Seidel iterations would load the contacts that they visit first.
    #[inline(always)]
    pub(crate) fn newly_loaded_lanes(&self, contacts: &Contacts<R>, problem: &ConstraintProblem<R>, iterate: &Iterate<R>) -> R::Mask {
        let mut lanes = 0;
        for group in self.groups.iter().filter(|p| contacts.count[p.lane] <= MAX_NEW_CONTACTS) {
            let (own, lane) = (|| group.contacts(&self.members, problem), group.lane);
            let unloaded = |i: usize| iterate.contact_impulse(&problem.rows, i)[0].lane(lane) <= R::Scalar::default();
            let closes = |i: usize| problem.rows.contacts.normal_velocity_above_target(i, &iterate.w).lane(lane) < R::Scalar::default();
            if lanes >> lane & 1 == 0 && own().all(unloaded) && own().any(closes) {
                lanes |= 1 << lane;
            }
        }
        R::Mask::from_bits(lanes)
    }

    /// Finds the contact groups in the lanes `lanes` that slip under load: a loaded contact moves faster than `slip_speed`, m/s. Returns
    /// the lanes with such a group.
    #[inline(always)]
    pub(crate) fn find_slips(&mut self, problem: &ConstraintProblem<R>, iterate: &Iterate<R>, lanes: R::Mask, slip_speed: R) -> R::Mask {
        if lanes.none() {
            return lanes;
        }
        let Self { groups, members, velocities, .. } = self;
        velocities.clear();
        kernel!(R, || {
            for i in 0..problem.rows.contacts.len() {
                velocities.push(problem.rows.contacts.velocity(i, &iterate.w));
            }
        });
        let (all, mut slipping) = (lanes.bits(), 0);
        for group in groups.iter_mut().filter(|p| all >> p.lane & 1 == 1) {
            let (lane, most) = (group.lane, slip_speed.lane(group.lane).to_f64());
            let loaded = |i: usize| iterate.contact_impulse(&problem.rows, i)[0].lane(lane).to_f64() > 0.0;
            group.slips = group.contacts(members, problem).any(|i| loaded(i) && slip(&numbers_of(&velocities[i], lane)) > most);
            slipping |= u32::from(group.slips) << lane;
        }
        R::Mask::from_bits(slipping)
    }

    /// Shares the loads of the clusters `clusters` evenly, in the lanes `lanes`. [`ContactGroups::find_slips`] has found which contact
    /// groups slip, at the same `slip_speed`. Returns the lanes in which a load changed.
    ///
    /// The scaled velocity change w of `iterate` is not updated.
    #[inline(always)]
    pub(crate) fn share(
        &mut self,
        clusters: Clusters,
        problem: &ConstraintProblem<R>,
        iterate: &mut Iterate<R>,
        lanes: R::Mask,
        slip_speed: R,
    ) -> R::Mask {
        let (mut start, mut shared) = (0, 0);
        while start < self.groups.len() {
            let lane = self.groups[start].lane;
            let end = start + self.groups[start..].iter().take_while(|p| p.lane == lane).count();
            if lanes.bits() >> lane & 1 == 1 && self.share_lane(clusters, start..end, problem, iterate, slip_speed.lane(lane).to_f64()) {
                shared |= 1 << lane;
            }
            start = end;
        }
        R::Mask::from_bits(shared)
    }

    /// Shares the loads in the clusters of the contact groups with the indices `groups`, all in one lane. Returns whether a load changed.
    fn share_lane(
        &mut self,
        clusters: Clusters,
        groups: Range<usize>,
        problem: &ConstraintProblem<R>,
        iterate: &mut Iterate<R>,
        slip_speed: f64,
    ) -> bool {
        let lane = self.groups[groups.start].lane;
        self.find_clusters(groups.clone(), problem);
        let mut changed = false;
        for cluster in groups.clone() {
            let Self { members, groups: all, points, velocities, .. } = &mut *self;
            points.clear();
            let mut slips = false;
            for group in all[groups.clone()].iter().filter(|group| group.cluster == cluster) {
                slips |= group.slips;
                points.extend(group.contacts(members, problem).map(|i| {
                    let (velocity, mu) = (numbers_of(&velocities[i], lane), problem.rows.contacts[i].mu.lane(lane).to_f64());
                    let loaded = iterate.contact_impulse(&problem.rows, i)[0].lane(lane).to_f64() > 0.0;
                    Point { contact: i, mu, velocity, free: loaded || velocity[0] <= slip_speed }
                }));
            }
            let wanted = slips == (clusters == Clusters::Slipping) && (MIN_SHARED_CONTACTS..=MAX_SHARED_CONTACTS).contains(&points.len());
            changed |= wanted && self.share_cluster(clusters, lane, &problem.rows, iterate, slip_speed);
        }
        changed
    }

    /// Shares the loads of the contacts in `points`. Returns whether a load changed.
    fn share_cluster(&mut self, clusters: Clusters, lane: usize, problem: &Problem<R>, iterate: &mut Iterate<R>, slip_speed: f64) -> bool {
        let Self { points, loads, .. } = self;
        loads.width = match clusters {
            Clusters::Slipping => 1,
            Clusters::Sticking => points.iter().map(|p| problem.contacts[p.contact].rows().len()).max().unwrap_or(1),
        };
        let width = loads.width;
        loads.impulses.clear();
        points.iter().for_each(|p| loads.impulses.extend(&numbers_of(iterate.contact_impulse(problem, p.contact), lane)[..width]));
        let max_rows = match clusters {
            Clusters::Slipping => usize::MAX,
            Clusters::Sticking => (MAX_STICKING_WORK / (width * points.len())).isqrt(),
        };
        let largest = loads.impulses.iter().step_by(width).copied().fold(0.0, f64::max);
        loads.impulses.resize(loads.impulses.len().next_multiple_of(PARTS), 0.0);
        for _ in 0..MAX_SHARE_ROUNDS {
            if !loads.make_rows(points, lane, problem, max_rows) {
                return false;
            }
            kernel!(R, || loads.find_targets(DEPENDENT_LENGTH[precision::<R>()]));
            match loads.move_to_targets(points) {
                Some(first) => points[first].free = false,
                None => break,
            }
        }
        let least = MIN_SHARE_CHANGE[precision::<R>()] * largest;
        let mut changed = false;
        for (p, shared) in points.iter().zip(loads.impulses.chunks_exact(width)) {
            let before = numbers_of(iterate.contact_impulse(problem, p.contact), lane);
            changed |= before.iter().zip(shared).any(|(before, shared)| (shared - before).abs() > least);
        }
        if changed {
            for (p, shared) in points.iter().zip(loads.impulses.chunks_exact(width)) {
                let mut lambda = numbers_of(iterate.contact_impulse(problem, p.contact), lane);
                lambda[..width].copy_from_slice(shared);
                if clusters == Clusters::Slipping {
                    p.set_friction(slip_speed, &mut lambda);
                }
                iterate.set_contact_impulse(problem, p.contact, lane, &lambda);
            }
        }
        changed
    }

    /// Finds clusters among the contact groups with the indices `groups`: groups that move a common coordinate get the same cluster.
    fn find_clusters(&mut self, groups: Range<usize>, problem: &ConstraintProblem<R>) {
        let Self { members, groups: all, owners, .. } = self;
        owners.clear();
        owners.resize(problem.rows.dimension, usize::MAX);
        let lane = all[groups.start].lane;
        for p in groups.clone() {
            for i in all[p].contacts(members, problem) {
                problem.rows.contacts.for_each_entry(i, lane, |c, _| {
                    let (owner, cluster) = (owners[c as usize], all[p].cluster);
                    if owner == cluster {
                        return;
                    }
                    if owner == usize::MAX {
                        owners[c as usize] = cluster;
                    } else {
                        // The cluster of that group may have changed since it was stored.
                        let known = all[owner].cluster;
                        all[groups.clone()].iter_mut().filter(|other| other.cluster == cluster).for_each(|other| other.cluster = known);
                    }
                });
            }
        }
    }
}

/// Index into tables of tolerances: 0 for 64-bit lanes, 1 for 32-bit lanes.
fn precision<R: Real>() -> usize {
    usize::from(R::Scalar::IS_SINGLE)
}

/// Numbers of the rows of a contact in the lane `lane`, followed by zeros.
fn numbers_of<R: Real>(numbers: &[R], lane: usize) -> [f64; MAX_CONTACT_ROWS] {
    let mut out = [0.0; MAX_CONTACT_ROWS];
    out.iter_mut().zip(numbers).for_each(|(to, x)| *to = x.lane(lane).to_f64());
    out
}

/// Length of the tangential part of a contact's velocity, m/s, or of its impulse, N s.
fn slip(numbers: &[f64; MAX_CONTACT_ROWS]) -> f64 {
    numbers[1..].iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Scalar product of two lists whose length is a multiple of [`PARTS`].
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; PARTS];
    for (a, b) in a.chunks_exact(PARTS).zip(b.chunks_exact(PARTS)) {
        for i in 0..PARTS {
            sums[i] += a[i] * b[i];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Adds `factor` times the list `from` to the list `to`.
#[inline(always)]
fn add_scaled(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

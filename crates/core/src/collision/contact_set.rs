//! Contacts of one step: slot k of lane l is the k-th contact of that lane's environment. One slot may have different geoms in different
//! lanes.

use stepper_geometry::pairs::{ContactPoint, DISTANCE_ROUNDINGS};
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::*;

/// Change of a unit tangent, as a vector, above which the tangent that [`contact_frame`] chooses counts as having jumped. Between the
/// nearby states of a finite difference, tangents change far less.
const TANGENT_JUMP: f64 = 1e-2;

/// Largest error of a normal force by rounded gaps, as a fraction of the body's weight, that [`Contacts::close_rounded_gaps`] tolerates.
const FORCE_ERROR: f64 = 0.01;

/// Largest gap that closes if the only other contact of its pair touches, as a multiple of the rounding error of a gap.
///
/// Two contacts of a finger and a cylinder differ by rounding. If one of them were open, the other would bear the whole force of the
/// finger, and the cylinder would turn. In pairs with more contacts this cannot happen, and a wall that stands would take 1.5 times as
/// long. Evidence: of 288 upright cylinders that are carried and shaken for 6 s, 9 slip by up to 1 mm with a factor of 1, and none by more
/// than 0.05 mm with 4 (the scenes of tests/laws/test_grasps.py).
const PAIR_ROUNDING_RATIO: f64 = 4.0;

/// Identity of a contact from step to step: index of its pair in the compiled model (high 32 bits) and feature of the pair (low 32 bits).
/// The contacts of an environment are sorted by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ContactId(pub u64);

impl ContactId {
    /// Identity of the contact at feature `feature` of the pair with index `pair`.
    #[inline(always)]
    pub const fn new(pair: usize, feature: u32) -> Self {
        Self((pair as u64) << 32 | feature as u64)
    }

    /// Index of the contact's pair in the compiled model.
    #[inline(always)]
    pub const fn pair(self) -> usize {
        (self.0 >> 32) as usize
    }

    /// Feature of the pair: a number of the contact point, such as that of a corner. Its meaning depends on the function of the narrow
    /// phase.
    #[cfg(test)]
    const fn feature(self) -> u32 {
        self.0 as u32
    }
}

/// Slot of contacts: the k-th contact of every lane with more than k contacts.
#[derive(Clone, Copy, Debug)]
pub struct Slot<R> {
    /// Point, normal and distance of the contact. The distance is the gap of the shapes minus the pair's margin, m.
    pub point: ContactPoint<R>,
    /// First tangent, a unit vector in world axes; the second is normal x tangent.
    pub tangent: V3<R>,
    /// Coefficient of sliding friction.
    pub mu: R,
    /// Coefficient of restitution.
    pub restitution: R,
    /// Impulse along normal, first and second tangent, N s.
    pub impulse: V3<R>,
    /// Lanes (bits) in which the contact belongs to a ball that hits no edge, because it stays over one face of the other geom during two
    /// steps. On a surface of triangles, neighbours in or above the plane of the triangle count as the same face.
    pub over_face: u32,
}

/// Vector with the coordinates `v` in the frame `from`, in the coordinates of the frame `to`.
#[inline(always)]
fn in_frame<R: Real>([to, from]: [[V3<R>; 3]; 2], [n, a, b]: V3<R>) -> V3<R> {
    let world = add_scaled(add_scaled(scale(from[0], n), from[1], a), from[2], b);
    [dot(to[0], world), dot(to[1], world), dot(to[2], world)]
}

impl<R: Real> Slot<R> {
    /// Copies lane `l` of the slot `from` to this slot, except the tangent and the impulse.
    #[inline(always)]
    fn copy_lane(&mut self, from: &Self, l: usize) {
        self.set_lane(l, &from.point, from.mu, from.restitution, from.over_face);
    }

    /// Sets lane `l` of the slot, except its tangent and impulse, to lane `l` of the given values.
    #[inline(always)]
    fn set_lane(&mut self, l: usize, point: &ContactPoint<R>, mu: R, restitution: R, over_face: u32) {
        self.point.distance.set_lane(l, point.distance.lane(l));
        copy_lane(&mut self.point.pos, &point.pos, l);
        copy_lane(&mut self.point.normal, &point.normal, l);
        self.mu.set_lane(l, mu.lane(l));
        self.restitution.set_lane(l, restitution.lane(l));
        self.over_face = self.over_face & !(1 << l) | over_face & 1 << l;
    }
}

/// Contacts of a group of environments, one environment per lane.
#[derive(Clone, Debug)]
pub struct Contacts<R: Real> {
    /// Number of contacts of each lane.
    pub count: Box<[usize; MAX_LANES]>,
    /// Identities of the contacts: for each slot, one per lane.
    pub ids: Vec<[ContactId; MAX_LANES]>,
    /// Slots of contacts. Only the first `slots()` are in use.
    pub data: Vec<Slot<R>>,
    /// Angular impulse of torsional and rolling friction in each slot, about normal, first and second tangent, N m s. Empty if the scene
    /// has no such friction.
    pub torque: Vec<V3<R>>,
    /// Lanes (bits) in which detection found more contacts than there are slots.
    pub full: u32,
}

impl<R: Real> Contacts<R> {
    /// Contact buffers for `capacity` contacts per environment.
    pub fn new(capacity: usize) -> Self {
        let z = R::zero();
        let up = [z, z, R::one()];
        let point = ContactPoint { distance: z, pos: [z; 3], normal: up };
        let empty = Slot { point, tangent: [R::one(), z, z], mu: z, restitution: z, impulse: [z; 3], over_face: 0 };
        Self {
            count: Box::new([0; MAX_LANES]),
            ids: vec![[ContactId::default(); MAX_LANES]; capacity],
            data: vec![empty; capacity],
            torque: vec![],
            full: 0,
        }
    }

    /// Adds buffers for angular impulses if `any` is true, and returns the contact buffers. `any` is whether the scene has torsional or
    /// rolling friction.
    pub fn with_torques(mut self, any: bool) -> Self {
        self.torque = vec![zero(); if any { self.data.len() } else { 0 }];
        self
    }

    /// Removes all contacts, and clears `full`.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count[..R::LANES].fill(0);
        self.full = 0;
    }

    /// Number of slots that any lane uses.
    #[inline(always)]
    pub fn slots(&self) -> usize {
        self.count[..R::LANES].iter().copied().max().unwrap_or(0)
    }

    /// Lanes (bits) that have a contact in slot `k`.
    #[inline(always)]
    pub fn lanes_of(&self, k: usize) -> u32 {
        (0..R::LANES).fold(0, |bits, l| bits | (u32::from(self.count[l] > k) << l))
    }

    /// Lanes in which the contact in slot `k` is elastic: its coefficient of restitution is above zero.
    #[inline(always)]
    pub fn elastic(&self, k: usize) -> R::Mask {
        self.data[k].restitution.gt(R::zero()).and(R::Mask::from_bits(self.lanes_of(k)))
    }

    /// Iterator over the pairs of geoms in slot `k`, in the lanes `lanes` (bits). It returns each pair once, with its lanes (bits).
    #[inline(always)]
    pub fn pairs(&self, k: usize, lanes: u32) -> SlotPairs<'_> {
        SlotPairs { ids: &self.ids[k][..R::LANES], rest: lanes }
    }

    /// Adds a contact in the lanes `bits`. Lanes that have no free slot do not get the contact, and are marked in `full`. `over_face` are
    /// bits of [`Slot::over_face`].
    ///
    /// The caller adds pairs in ascending order. The features of a pair may have any order; this function sorts them.
    #[inline(always)]
    pub fn push(&mut self, [bits, over_face]: [u32; 2], id: ContactId, point: &ContactPoint<R>, mu: R, restitution: R) {
        for l in each_of(bits) {
            if self.count[l] == self.data.len() {
                self.full |= 1 << l;
                continue;
            }
            let k = self.open_slot(l, id);
            self.ids[k][l] = id;
            self.data[k].set_lane(l, point, mu, restitution, over_face);
        }
    }

    /// Makes a free slot for the contact `id` in lane `l`: contacts with a larger identity move up by one slot. Returns the index of the
    /// free slot.
    #[inline(always)]
    fn open_slot(&mut self, l: usize, id: ContactId) -> usize {
        let mut k = self.count[l];
        self.count[l] = k + 1;
        while k > 0 && self.ids[k - 1][l] > id {
            self.ids[k][l] = self.ids[k - 1][l];
            let (before, after) = self.data.split_at_mut(k);
            after[0].copy_lane(&before[k - 1], l);
            k -= 1;
        }
        k
    }

    /// Removes the contacts of lane `l` for which `keeps` returns false. Its arguments are the slot, the slot's index and the identity of a
    /// contact. The order of the remaining contacts does not change.
    pub(crate) fn retain(&mut self, l: usize, mut keeps: impl FnMut(&Slot<R>, usize, ContactId) -> bool) {
        let mut to = 0;
        for from in 0..self.count[l] {
            if !keeps(&self.data[from], from, self.ids[from][l]) {
                continue;
            }
            if to < from {
                self.move_contact(l, from, to);
            }
            to += 1;
        }
        self.count[l] = to;
    }

    /// Moves a contact of lane `l`, with its impulse, from slot `from` to slot `to`.
    fn move_contact(&mut self, l: usize, from: usize, to: usize) {
        self.ids[to][l] = self.ids[from][l];
        let Slot { point, tangent, mu, restitution, impulse, over_face } = self.data[from];
        self.data[to].set_lane(l, &point, mu, restitution, over_face);
        copy_lane(&mut self.data[to].tangent, &tangent, l);
        copy_lane(&mut self.data[to].impulse, &impulse, l);
        if let Some(&torque) = self.torque.get(from) {
            copy_lane(&mut self.torque[to], &torque, l);
        }
    }

    /// Keeps those contacts of the lanes `lanes` whose gap is at most `most`, m, and sets their gaps and overlaps to zero.
    #[cold]
    pub(crate) fn keep_touching(&mut self, lanes: R::Mask, most: R) {
        for l in each_of(lanes.bits()) {
            self.retain(l, |slot, _, _| slot.point.distance.lane(l) <= most.lane(l));
            for slot in &mut self.data[..self.count[l]] {
                slot.point.distance.set_lane(l, R::Scalar::ZERO);
            }
        }
    }

    /// Sets gaps that are smaller than their rounding error to zero, in single precision.
    ///
    /// The rounding of positions can open a gap under a body at rest. In the next step the body would fall through this gap, and its normal
    /// force would be too small. The error, as a fraction of the force, is the ratio of the gap to `drop`. `drop` is the distance that
    /// gravity covers in the step, g h^2, m.
    ///
    /// The rounding error is that of [`rounded_gap`]. If a pair has two contacts and one of them touches, the other one closes a gap of up
    /// to [`PAIR_ROUNDING_RATIO`] rounding errors.
    pub(crate) fn close_rounded_gaps(&mut self, drop: R) {
        if !R::Scalar::IS_SINGLE {
            return;
        }
        kernel!(R, || {
            let mut slightly_open = R::Mask::splat(false);
            for k in 0..self.slots() {
                let lanes = R::Mask::from_bits(self.lanes_of(k));
                let point = &mut self.data[k].point;
                let error = rounded_gap(point, drop);
                point.distance = R::select(opens_by_less(point, error), R::zero(), point.distance);
                slightly_open = slightly_open.or(opens_by_less(point, error * R::of(PAIR_ROUNDING_RATIO)).and(lanes));
            }
            if slightly_open.none() {
                return;
            }
            for k in 0..self.slots() {
                let point = &self.data[k].point;
                let open = opens_by_less(point, rounded_gap(point, drop) * R::of(PAIR_ROUNDING_RATIO));
                for l in each_of(open.bits() & self.lanes_of(k)) {
                    if self.other_of_two_touches(k, l) {
                        self.data[k].point.distance.set_lane(l, R::Scalar::from_f64(0.0));
                    }
                }
            }
        })
    }

    /// Whether the pair of slot `k` has two contacts in lane `l`, of which the other one touches or overlaps.
    fn other_of_two_touches(&self, k: usize, l: usize) -> bool {
        let pair = self.ids[k][l].pair();
        let of_pair = |&other: &usize| self.ids[other][l].pair() == pair;
        // Contacts are sorted by pair.
        let (before, after) = ((0..k).rev().take_while(of_pair), (k + 1..self.count[l]).take_while(of_pair));
        let mut others = before.chain(after);
        let touches = others.next().is_some_and(|other| self.data[other].point.distance.lane(l) <= R::Scalar::from_f64(0.0));
        touches && others.next().is_none()
    }

    /// Chooses the tangents of every contact from its normal, and sets all impulses to 0.
    pub fn choose_tangents(&mut self) {
        kernel!(R, || {
            for k in 0..self.slots() {
                self.data[k].tangent = contact_frame(self.data[k].point.normal)[1];
                self.data[k].impulse = zero();
            }
            self.torque.iter_mut().for_each(|torque| *torque = zero());
        })
    }

    /// Chooses the tangents of every contact from its normal, and copies its impulse from the same contact in `last`, the contacts of the
    /// previous step. The impulse of a new contact is 0.
    ///
    /// Impulses are copied as vectors in world coordinates, so that they do not depend on the tangents in either set. The function
    /// overwrites `last`.
    pub fn prepare(&mut self, last: &mut Self) {
        if self.slots() == 0 {
            return;
        }
        kernel!(R, || {
            // The old impulses become vectors in world coordinates.
            for k in 0..last.slots() {
                let slot = &mut last.data[k];
                let [n, t1, t2] = contact_frame(slot.point.normal);
                let [x, a, b] = slot.impulse;
                slot.impulse = add_scaled(add_scaled(scale(n, x), t1, a), t2, b);
                if let Some(torque) = last.torque.get_mut(k) {
                    let [x, a, b] = *torque;
                    *torque = add_scaled(add_scaled(scale(n, x), t1, a), t2, b);
                }
            }
            for k in 0..self.slots() {
                self.data[k].impulse = zero();
            }
            self.torque.iter_mut().for_each(|torque| *torque = zero());
            for l in 0..R::LANES {
                self.match_lane(last, l);
            }
            // The copied impulses become components along the new normal and tangents.
            for k in 0..self.slots() {
                let slot = &mut self.data[k];
                let axes = contact_frame(slot.point.normal);
                slot.tangent = axes[1];
                slot.impulse = [dot(axes[0], slot.impulse), dot(axes[1], slot.impulse), dot(axes[2], slot.impulse)];
                if let Some(torque) = self.torque.get_mut(k) {
                    *torque = [dot(axes[0], *torque), dot(axes[1], *torque), dot(axes[2], *torque)];
                }
            }
        })
    }

    /// Copies all contacts of `from`, which has the same capacity.
    pub(crate) fn copy_from(&mut self, from: &Self) {
        let n = from.slots();
        self.count.copy_from_slice(&from.count[..]);
        self.ids[..n].copy_from_slice(&from.ids[..n]);
        self.data[..n].copy_from_slice(&from.data[..n]);
        if !self.torque.is_empty() {
            self.torque[..n].copy_from_slice(&from.torque[..n]);
        }
        self.full = from.full;
    }

    /// Copies the contacts of `from` in the lanes `lanes` (bits).
    pub(crate) fn copy_lanes(&mut self, from: &Self, lanes: u32) {
        for l in each_of(lanes) {
            self.count[l] = from.count[l];
            for k in 0..from.count[l] {
                self.take_contact(from, [k, k], l);
            }
        }
        self.full = self.full & !lanes | from.full & lanes;
    }

    /// Multiplies all impulses by `factor`.
    pub(crate) fn scale_impulses(&mut self, factor: R) {
        for k in 0..self.slots() {
            self.data[k].impulse = scale(self.data[k].impulse, factor);
        }
        self.torque.iter_mut().for_each(|torque| *torque = scale(*torque, factor));
    }

    /// Lanes (bits) in which the contact in slot `k` has an impulse.
    pub(crate) fn bearing(&self, k: usize) -> u32 {
        self.data[k].impulse[0].gt(R::zero()).bits() & self.lanes_of(k)
    }

    /// Adds the contacts of `from` that are not in this set, in the lanes `lanes` (bits). `takes` returns whether it adds the contact of a
    /// slot and a lane.
    pub(crate) fn add_missing(&mut self, from: &Self, lanes: u32, takes: impl Fn(usize, usize) -> bool) {
        for l in each_of(lanes) {
            for at in 0..from.count[l] {
                let id = from.ids[at][l];
                if !takes(at, l) || self.find(l, at, id).is_some() {
                    continue;
                }
                if self.count[l] == self.data.len() {
                    self.full |= 1 << l;
                    continue;
                }
                let mut k = self.count[l];
                self.count[l] = k + 1;
                while k > 0 && self.ids[k - 1][l] > id {
                    self.move_contact(l, k - 1, k);
                    k -= 1;
                }
                self.take_contact(from, [k, at], l);
            }
        }
    }

    /// Adds the impulses of the same contacts in `earlier`, as vectors in world axes, in the lanes `lanes` (bits).
    pub(crate) fn add_impulses(&mut self, earlier: &Self, lanes: u32) {
        kernel!(R, || {
            for k in 0..self.slots() {
                let axes = contact_frame(self.data[k].point.normal);
                for l in each_of(lanes & self.lanes_of(k)) {
                    let Some(at) = earlier.find(l, k, self.ids[k][l]) else { continue };
                    let frames = [axes, contact_frame(earlier.data[at].point.normal)];
                    let sum = add(self.data[k].impulse, in_frame(frames, earlier.data[at].impulse));
                    copy_lane(&mut self.data[k].impulse, &sum, l);
                    if let Some(torque) = self.torque.get_mut(k) {
                        let sum = add(*torque, in_frame(frames, earlier.torque[at]));
                        copy_lane(torque, &sum, l);
                    }
                }
            }
        })
    }

    /// Removes jumps of the tangents relative to `solved`, the contacts of a nearby state.
    ///
    /// [`Contacts::prepare`] chooses tangents from normals, and its choice jumps at some normals. A tangent that jumped is replaced by the
    /// tangent of the same contact in `solved`, projected on the present tangent plane. Other tangents do not change, because target
    /// velocities may depend on them.
    pub(crate) fn follow_tangents(&mut self, solved: &Self) {
        kernel!(R, || {
            for k in 0..self.slots() {
                let own = self.data[k].tangent;
                let mut tangent = own;
                for l in 0..R::LANES {
                    if let Some(at) = solved.find(l, k, self.ids[k][l]).filter(|_| k < self.count[l]) {
                        copy_lane(&mut tangent, &solved.data[at].tangent, l);
                    }
                }
                let n = self.data[k].point.normal;
                let flat = add_scaled(tangent, n, -dot(tangent, n));
                let jumped = norm(sub(own, tangent)).gt(R::of(TANGENT_JUMP));
                self.data[k].tangent = select(jumped, scale(flat, R::one() / norm(flat)), own);
            }
        })
    }

    /// Index of the slot of the contact `id` in lane `l`; `None` if the lane does not have it. The search begins at slot `k`, the most
    /// likely one.
    #[inline(always)]
    pub(crate) fn find(&self, l: usize, k: usize, id: ContactId) -> Option<usize> {
        let is_it = |&k: &usize| self.ids[k][l] == id;
        Some(k).filter(|&k| k < self.count[l]).filter(is_it).or_else(|| (0..self.count[l]).find(is_it))
    }

    /// Copies the impulses of lane `l` from the contacts in `last` with the same identity. Both lists are sorted by identity.
    ///
    /// Identities of contacts between two faces may change when the faces tilt by rounding errors. A new contact therefore takes the
    /// impulse of the first contact of its pair whose identity is gone ([`Self::first_lost`]).
    #[inline(always)]
    fn match_lane(&mut self, last: &mut Self, l: usize) {
        let (mut old, mut matched) = (0, 0);
        for k in 0..self.count[l] {
            let id = self.ids[k][l];
            while old < last.count[l] && last.ids[old][l] < id {
                old += 1;
            }
            if old < last.count[l] && last.ids[old][l] == id {
                self.take_impulse(last, [k, old], l);
                matched += 1;
            }
        }
        if matched == self.count[l].min(last.count[l]) {
            return;
        }
        for k in 0..self.count[l] {
            if last.find(l, k, self.ids[k][l]).is_none()
                && let Some(old) = self.first_lost(last, k, l)
            {
                self.take_impulse(last, [k, old], l);
                copy_lane(&mut last.data[old].impulse, &zero(), l);
            }
        }
    }

    /// Slot of the first contact in `last` of the same pair as the contact of lane `l` in slot `k`, if its identity is gone. Its impulse
    /// must push along the normal of the new contact. The state has no positions of the contacts of the last step, so that none can count.
    fn first_lost(&self, last: &Self, k: usize, l: usize) -> Option<usize> {
        let normal = of_lane(&self.data[k].point.normal, l);
        (0..last.count[l]).find(|&old| {
            let id = last.ids[old][l];
            let lost = id.pair() == self.ids[k][l].pair() && self.find(l, old, id).is_none();
            lost && dot(of_lane(&last.data[old].impulse, l), normal) > 0.0
        })
    }

    /// Copies the contact of lane `l`, with its impulse, from slot `at` of `from` to slot `k`.
    fn take_contact(&mut self, from: &Self, [k, at]: [usize; 2], l: usize) {
        self.ids[k][l] = from.ids[at][l];
        self.data[k].copy_lane(&from.data[at], l);
        copy_lane(&mut self.data[k].tangent, &from.data[at].tangent, l);
        self.take_impulse(from, [k, at], l);
    }

    /// Copies the impulse of lane `l` from slot `old` of `last` to slot `k`.
    #[inline(always)]
    fn take_impulse(&mut self, last: &Self, [k, old]: [usize; 2], l: usize) {
        copy_lane(&mut self.data[k].impulse, &last.data[old].impulse, l);
        if let Some(torque) = self.torque.get_mut(k) {
            copy_lane(torque, &last.torque[old], l);
        }
    }
}

/// Iterator over the pairs of one slot and their lanes (bits), from [`Contacts::pairs`].
#[derive(Clone, Debug)]
pub struct SlotPairs<'a> {
    ids: &'a [ContactId],
    rest: u32,
}

impl Iterator for SlotPairs<'_> {
    type Item = (usize, u32);

    #[inline(always)]
    fn next(&mut self) -> Option<(usize, u32)> {
        if self.rest == 0 {
            return None;
        }
        let pair = self.ids[self.rest.trailing_zeros() as usize].pair();
        let mut same = 0;
        for (l, id) in self.ids.iter().enumerate() {
            same |= u32::from(id.pair() == pair) << l;
        }
        same &= self.rest;
        self.rest &= !same;
        Some((pair, same))
    }
}

/// Copies lane `l` of the vector `from` to the vector `to`.
#[inline(always)]
fn copy_lane<R: Real>(to: &mut V3<R>, from: &V3<R>, l: usize) {
    for i in 0..3 {
        to[i].set_lane(l, from[i].lane(l));
    }
}

/// Lanes in which the gap of a contact is open by less than `limit`, m.
#[inline(always)]
fn opens_by_less<R: Real>(point: &ContactPoint<R>, limit: R) -> R::Mask {
    point.distance.gt(R::zero()).and(point.distance.lt(limit))
}

/// Upper bound of the rounding error of a gap in single precision, m.
///
/// Joint angles are rounded too: a point 1 m from the joint moves by the rounding error of a coordinate of 1 m. This second error is
/// added only where it matters. For both errors, the function uses an upper bound of [`DISTANCE_ROUNDINGS`] units in the last place; a
/// typical error is one unit. The second error matters where the typical sum of both exceeds [`FORCE_ERROR`] times `drop`, the distance
/// that gravity covers in the step.
#[inline(always)]
fn rounded_gap<R: Real>(point: &ContactPoint<R>, drop: R) -> R {
    let (rounding, rounding_at_a_metre) = (point.rounding(), R::of(DISTANCE_ROUNDINGS) * R::splat(R::Scalar::EPSILON));
    let allows_for_angles = (rounding + rounding_at_a_metre).gt(drop * R::of(DISTANCE_ROUNDINGS * FORCE_ERROR));
    rounding + R::select(allows_for_angles, rounding_at_a_metre, R::zero())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_offered_out_of_order_are_sorted_with_their_numbers() {
        let mut contacts = Contacts::<f64>::new(5);
        let ids = [(0, 3), (2, 7), (2, u32::MAX), (2, 1), (2, 5), (3, 0)].map(|(pair, feature)| ContactId::new(pair, feature));
        for id in ids {
            let distance = id.0 as f64;
            contacts.push([1, 0], id, &ContactPoint { distance, pos: [distance; 3], normal: [0.0, 0.0, 1.0] }, distance, 0.0);
        }
        assert_eq!((contacts.count[0], contacts.full), (5, 1), "the last one was left out");
        let found: Vec<_> = contacts.ids.iter().map(|ids| (ids[0].pair(), ids[0].feature())).collect();
        assert_eq!(found, [(0, 3), (2, 1), (2, 5), (2, 7), (2, u32::MAX)]);
        for (slot, ids) in contacts.data.iter().zip(&contacts.ids) {
            let x = ids[0].0 as f64;
            assert_eq!((slot.point.distance, slot.point.pos, slot.mu), (x, [x; 3], x));
        }
    }
}

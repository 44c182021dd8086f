//! The contacts of one step, packed per lane: slot k of lane l is that lane's k-th contact, whichever geoms it joins.

use stepper_real::Real;

use crate::spatial::*;

/// The most lanes a group can have.
pub const MAX_LANES: usize = 16;

/// Identity of a contact from step to step: which pair of the plan, which feature of the pair. Ascending within an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ContactId(pub u32);

impl ContactId {
    const FEATURES: u32 = 8;

    /// Feature `feature` of pair `pair`.
    #[inline(always)]
    pub fn new(pair: usize, feature: usize) -> Self {
        Self(pair as u32 * Self::FEATURES + feature as u32)
    }

    /// Index of the pair in the plan.
    #[inline(always)]
    pub fn pair(self) -> usize {
        (self.0 / Self::FEATURES) as usize
    }
}

/// Geometry of one contact: what a narrow-phase function finds.
#[derive(Clone, Copy, Debug)]
pub struct ContactPoint<R> {
    /// Signed distance, negative where the geoms overlap, m.
    pub distance: R,
    /// Halfway between the surfaces, m.
    pub pos: V3<R>,
    /// Unit normal from the first geom to the second.
    pub normal: V3<R>,
}

/// One slot: a contact in each lane that has so many.
#[derive(Clone, Copy, Debug)]
pub struct Slot<R> {
    /// Geometry; the distance is measured from the pair's margin.
    pub point: ContactPoint<R>,
    /// First tangent; the second is normal x tangent.
    pub tangent: V3<R>,
    /// Coefficient of friction.
    pub mu: R,
    /// Coefficient of restitution.
    pub restitution: R,
    /// Impulse along normal, first and second tangent, N s.
    pub impulse: V3<R>,
}

/// All contacts of a group of environments.
#[derive(Clone, Debug)]
pub struct Contacts<R: Real> {
    /// Contacts of each lane.
    pub count: [usize; MAX_LANES],
    /// Identity of every lane's contact in every slot.
    pub ids: Vec<[ContactId; MAX_LANES]>,
    /// The slots in use are the first `slots()`.
    pub data: Vec<Slot<R>>,
    /// Lanes (bits) that had more contacts than slots.
    pub full: u32,
}

impl<R: Real> Contacts<R> {
    /// Room for so many contacts per environment.
    pub fn new(capacity: usize) -> Self {
        let z = R::zero();
        let up = [z, z, R::one()];
        let point = ContactPoint { distance: z, pos: [z; 3], normal: up };
        let empty = Slot { point, tangent: [R::one(), z, z], mu: z, restitution: z, impulse: [z; 3] };
        Self { count: [0; MAX_LANES], ids: vec![[ContactId::default(); MAX_LANES]; capacity], data: vec![empty; capacity], full: 0 }
    }

    /// Forgets all contacts.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count = [0; MAX_LANES];
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

    /// Appends the contact to the lanes in `bits`; lanes without room are marked in `full`.
    #[inline(always)]
    pub fn push(&mut self, bits: u32, id: ContactId, point: &ContactPoint<R>, mu: R, restitution: R) {
        let mut rest = bits;
        while rest != 0 {
            let l = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let k = self.count[l];
            if k == self.data.len() {
                self.full |= 1 << l;
                continue;
            }
            self.count[l] = k + 1;
            self.ids[k][l] = id;
            let slot = &mut self.data[k];
            slot.point.distance.set_lane(l, point.distance.lane(l));
            for i in 0..3 {
                slot.point.pos[i].set_lane(l, point.pos[i].lane(l));
                slot.point.normal[i].set_lane(l, point.normal[i].lane(l));
            }
            slot.mu.set_lane(l, mu.lane(l));
            slot.restitution.set_lane(l, restitution.lane(l));
        }
    }

    /// Chooses the tangents of every slot from its normal, and takes over the impulses of the same contacts in `last`, which is used up.
    ///
    /// An impulse is carried over as a vector of the world, so that the choice of tangents does not matter.
    pub fn prepare(&mut self, last: &mut Self) {
        R::vectorize(
            #[inline(always)]
            || {
                for k in 0..last.slots() {
                    let slot = &mut last.data[k];
                    let [n, t1, t2] = frame(slot.point.normal);
                    let [x, a, b] = slot.impulse;
                    slot.impulse = add_scaled(add_scaled(scale(n, x), t1, a), t2, b);
                }
                for k in 0..self.slots() {
                    self.data[k].impulse = zero();
                }
                for l in 0..R::LANES {
                    self.match_lane(last, l);
                }
                for k in 0..self.slots() {
                    let slot = &mut self.data[k];
                    let axes = frame(slot.point.normal);
                    slot.tangent = axes[1];
                    slot.impulse = [dot(axes[0], slot.impulse), dot(axes[1], slot.impulse), dot(axes[2], slot.impulse)];
                }
            },
        )
    }

    /// Copies the impulses of the contacts of one lane that were there before. Both lists ascend.
    #[inline(always)]
    fn match_lane(&mut self, last: &Self, l: usize) {
        let mut old = 0;
        for k in 0..self.count[l] {
            let id = self.ids[k][l];
            while old < last.count[l] && last.ids[old][l] < id {
                old += 1;
            }
            if old < last.count[l] && last.ids[old][l] == id {
                for i in 0..3 {
                    self.data[k].impulse[i].set_lane(l, last.data[old].impulse[i].lane(l));
                }
            }
        }
    }
}

/// The axes of a contact with unit normal `n`: (n, t1, t2), right-handed.
#[inline(always)]
pub fn frame<R: Real>(n: V3<R>) -> [V3<R>; 3] {
    let t = tangent(n);
    [n, t, cross(n, t)]
}

/// A unit vector at right angles to the unit normal `n`: the world's y axis, or z where the normal is near y, made orthogonal (the rule
/// of MuJoCo's `mju_makeFrame`).
#[inline(always)]
fn tangent<R: Real>(n: V3<R>) -> V3<R> {
    let (z, one) = (R::zero(), R::one());
    let near_y = n[1].abs().ge(R::of(0.5));
    let seed = select(near_y, [z, z, one], [z, one, z]);
    let t = add_scaled(seed, n, -dot(seed, n));
    scale(t, one / norm(t))
}

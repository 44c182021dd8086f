//! Overlaps of contacts and limits in a solution whose derivative is computed by finite differences.
//!
//! The target velocity of a contact or limit has a corner, or with MuJoCo's law a jump, where its gap closes. A robot at rest has gaps of
//! 1e-17 m of either sign, so that even a tiny displacement can cross a corner. At displaced states, contacts and limits therefore stay on
//! the side of the corner on which the solution has them.

use stepper_real::{Real, Scalar, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::math::lanes::each_of;

/// Record of the contacts and limits of a solution, with their distances, for derivatives by finite differences.
#[derive(Clone, Debug)]
pub(crate) struct SolvedOverlaps<R: Real> {
    contacts: Contacts<R>,
    /// Distance of each limited joint to the nearer end of its range in the solution, m or rad.
    pub(crate) limits: Vec<R>,
}

impl<R: Real> SolvedOverlaps<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        Self {
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            limits: vec![R::zero(); compiled.limits.len()],
        }
    }

    /// Stores the contacts of a solution, and the distances of limits at its configuration `q`.
    pub(crate) fn keep(&mut self, compiled: &LaneModel<R>, contacts: &Contacts<R>, q: &[R]) {
        self.contacts.clone_from(contacts);
        for (i, gap) in self.limits.iter_mut().enumerate() {
            *gap = limit_gap(compiled, i, q);
        }
    }

    /// Distance, in the solution, of the contacts in slot `k` of a displaced state (one contact per lane), m. It is infinite for contacts
    /// that the solution does not have.
    #[inline(never)]
    pub(crate) fn distance(&self, contacts: &Contacts<R>, k: usize) -> R {
        let mut distance = R::of(f64::INFINITY);
        for lane in each_of(contacts.lanes_of(k)) {
            if let Some(solved) = self.contacts.find(lane, k, contacts.ids[k][lane]) {
                distance.set_lane(lane, self.contacts.data[solved].point.distance.lane(lane));
            }
        }
        distance
    }

    /// Lanes of `lanes` (bits) in which a displaced state has all contacts that overlap in the solution.
    pub(crate) fn found(&self, contacts: &Contacts<R>, lanes: u32) -> u32 {
        let overlaps = |lane: usize, k: usize| self.contacts.data[k].point.distance.lane(lane).to_f64() < 0.0;
        let has = |lane: usize, k: usize| contacts.find(lane, k, self.contacts.ids[k][lane]).is_some();
        each_of(lanes)
            .filter(|&lane| (0..self.contacts.count[lane]).all(|k| !overlaps(lane, k) || has(lane, k)))
            .fold(0, |found, lane| found | 1 << lane)
    }

    /// Calls `visit` for every gap of a displaced state with the configuration `q`. Its arguments are: whether the gap belongs to a limit,
    /// distance in the solution, distance at the displaced state, and lanes (bits) that have the gap.
    pub(crate) fn each_gap(&self, compiled: &LaneModel<R>, contacts: &Contacts<R>, q: &[R], mut visit: impl FnMut(bool, R, R, u32)) {
        for k in 0..contacts.slots() {
            visit(false, self.distance(contacts, k), contacts.data[k].point.distance, contacts.lanes_of(k));
        }
        for (i, &solved) in self.limits.iter().enumerate() {
            visit(true, solved, limit_gap(compiled, i, q), u32::MAX);
        }
    }
}

/// Distance of limited joint `i` to the nearer end of its range at the configuration `q`, m or rad; negative outside the range.
pub(crate) fn limit_gap<R: Real>(compiled: &LaneModel<R>, i: usize, q: &[R]) -> R {
    kernel!(R, || {
        let [lowest, highest] = compiled.params.limit(i);
        let q = q[compiled.limits[i].q];
        (q - lowest).min(highest - q)
    })
}

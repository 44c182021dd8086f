//! Stage 10: what the step says of itself.

use stepper_real::{Mask, Real};

use crate::constraints::Constraints;
use crate::contacts::Contacts;
use crate::kinematics::quat_at;
use crate::plan::LanePlan;
use crate::spatial::*;

/// Overlap of a contact above which a step is [`Status::DEEP`], m: a hundred times the default slop, more than any contact that is solved keeps,
/// and what an eye sees between a foot and the floor.
pub const DEEP: f64 = 1e-3;

/// Distance beyond its range above which a joint is [`Status::OVER_LIMIT`], rad or m: half a degree, which a hard stop does not give, and the
/// distance from which on the limit has a row in every step.
pub const OVER_LIMIT: f64 = 1e-2;

/// Outcome of a step in one environment, as bits; 0 is a step to be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status(pub u32);

impl Status {
    /// Solved to the tolerance, finite, every contact held.
    pub const OK: Self = Self(0);
    /// The residual is above the tolerance.
    pub const NOT_CONVERGED: Self = Self(1);
    /// The step was not finite; the environment keeps its last finite state.
    pub const NON_FINITE: Self = Self(2);
    /// There were more contacts than room; the ones found last were left out.
    pub const CONTACTS_FULL: Self = Self(4);
    /// The step was too long for the motion, or impulses threw a joint by half a turn: inertial forces of its velocities were left out, and its energy was
    /// kept from growing.
    pub const UNRESOLVED: Self = Self(8);
    /// Something moved so fast that it may have passed through something thin.
    pub const TUNNELLED: Self = Self(16);
    /// What constraints demand cannot be met, and impulses prove it: they move nothing, or so little that no motion within the bounds of a
    /// correction gives what they ask for. What can be met of it is.
    pub const INFEASIBLE: Self = Self(32);
    /// A contact overlapped by more than [`DEEP`].
    pub const DEEP: Self = Self(64);
    /// A joint or tendon was farther beyond its range than [`OVER_LIMIT`] after a step.
    pub const OVER_LIMIT: Self = Self(128);
}

/// The record of one step, lane by lane.
#[derive(Clone, Copy, Debug)]
pub struct Record<R: Real> {
    /// Residual, m/s.
    pub residual: R,
    /// Sweeps and Newton steps of the solver, together.
    pub iterations: R,
    /// Deepest overlap of the step's contacts beyond their margins, m, where the step was taken.
    pub depth: R,
    /// Farthest that a joint or tendon is beyond its range after the step, rad or m.
    pub overshoot: R,
    /// Lanes whose residual is above the tolerance.
    pub not_converged: R::Mask,
    /// Lanes that kept their last finite state.
    pub non_finite: R::Mask,
    /// Lanes (bits) that left contacts out.
    pub contacts_full: u32,
    /// Lanes whose motion was too fast for the step.
    pub unresolved: R::Mask,
    /// Lanes in which something may have passed through something thin.
    pub tunnelled: R::Mask,
    /// Lanes in which a witness proves that what constraints demand cannot be met.
    pub infeasible: R::Mask,
    /// Lanes whose `depth` is above [`DEEP`].
    pub deep: R::Mask,
    /// Lanes whose `overshoot` is above [`OVER_LIMIT`].
    pub over_limit: R::Mask,
}

impl<R: Real> Record<R> {
    /// Flags of one lane.
    #[inline(always)]
    pub fn status(&self, lane: usize) -> Status {
        let flag = |bits: u32, status: Status| if bits >> lane & 1 == 1 { status.0 } else { 0 };
        Status(
            flag(self.not_converged.bits(), Status::NOT_CONVERGED)
                | flag(self.non_finite.bits(), Status::NON_FINITE)
                | flag(self.contacts_full, Status::CONTACTS_FULL)
                | flag(self.unresolved.bits(), Status::UNRESOLVED)
                | flag(self.tunnelled.bits(), Status::TUNNELLED)
                | flag(self.infeasible.bits(), Status::INFEASIBLE)
                | flag(self.deep.bits(), Status::DEEP)
                | flag(self.over_limit.bits(), Status::OVER_LIMIT),
        )
    }
}

/// Deepest overlap of the contacts beyond their margins, m, in the lanes `lanes`; 0 where none overlaps.
pub fn depth<R: Real>(constraints: &Constraints<R>, contacts: &Contacts<R>, lanes: R::Mask) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let mut deepest = R::zero();
            let slots = constraints.slots.iter().map(|slot| (slot.0, slot.1));
            for (k, here) in slots.chain(constraints.wide_slots.iter().map(|slot| (slot.0, slot.1))) {
                deepest = R::select(here, deepest.max(-contacts.data[k].point.distance), deepest);
            }
            R::select(lanes, deepest, R::zero())
        },
    )
}

/// Farthest that a joint or tendon is beyond its range at the configuration `q`, rad or m; 0 where all are inside.
pub fn limit_overshoot<R: Real>(plan: &LanePlan<R>, q: &[R]) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let mut farthest = R::zero();
            for (i, limit) in plan.limits.iter().enumerate() {
                let [lowest, highest] = plan.params.limit(i);
                farthest = farthest.max(lowest - q[limit.q]).max(q[limit.q] - highest);
            }
            for (i, limit) in plan.ball_limits.iter().enumerate() {
                farthest = farthest.max(norm(quat_log(quat_at(q, limit.q))) - plan.params.ball_limit(i));
            }
            for tendon in &plan.tendons {
                if let Some([lowest, highest]) = tendon.range {
                    let length = tendon.length.value(q);
                    farthest = farthest.max(R::splat(lowest) - length).max(length - R::splat(highest));
                }
            }
            farthest
        },
    )
}

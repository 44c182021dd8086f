//! Stage 10: record of how well the step was solved, and status flags.

use std::fmt;

use bitflags::bitflags;
use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, PathLengths};
use crate::dynamics::kinematics::quat_at;
use crate::math::lanes::each_of;
use crate::math::spatial::*;

/// Overlap of a contact above which a step gets the flag [`Status::DEEP`], m.
///
/// The value is a hundred times the default slop, above the overlap of any solved contact, and visible between a foot and the floor.
pub const DEEP: f64 = 1e-3;

/// Distance beyond its range above which a joint or tendon gets the flag [`Status::OVER_LIMIT`], rad or m.
///
/// The value is half a degree, more than a hard stop yields. Above this distance, the limit has a row in every step.
pub const OVER_LIMIT: f64 = 1e-2;

/// Position error of an equality above which a step gets the flag [`Status::EQUALITY_VIOLATED`], m or rad.
///
/// Evidence: linkages whose bodies rotate by up to 0.03 rad a step have errors of 2e-4. A four-bar linkage with 0.17 rad a step has 2.3e-3.
pub const EQUALITY_VIOLATED: f64 = 1e-3;

bitflags! {
    /// Flags of a step in one environment. A step without flags has the status [`Status::OK`] and can be trusted.
    ///
    /// ```
    /// use stepper_core::Status;
    ///
    /// let status = Status::NOT_CONVERGED | Status::DEEP;
    /// assert!(status.contains(Status::DEEP) && !status.is_empty());
    /// assert_eq!(status.to_string(), "NOT_CONVERGED | DEEP");
    /// assert_eq!(Status::OK.to_string(), "OK");
    /// ```
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct Status: u32 {
        /// The residual is above the tolerance. Or it is below, but the impulses cancel so strongly that they do not determine the energy
        /// (`stepper_solve::energy_is_ambiguous`).
        const NOT_CONVERGED = 1;
        /// The next state of some bodies was not finite. These bodies, and those to which constraints connect them, keep their last state.
        const NON_FINITE = 2;
        /// The step found more contacts than the capacity, and left out those that it found last.
        const CONTACTS_FULL = 4;
        /// The step was too long for the motion.
        ///
        /// In two cases speed and kinetic energy were bounded: velocity-dependent inertial forces were left out, or impulses turned a joint
        /// by more than half a turn. In the third case nothing was bounded: the error of the step added so much energy that the kinetic
        /// energy would double within 0.1 s. In the fourth case elastic impacts became inelastic, because Newton's law has no plausible
        /// solution. In the fifth case the active bounds of stiff servos still changed after the last solve. In the sixth case explicit
        /// forces diverged, with Euler's rule or MuJoCo's contact law, or a number of the state exceeds 1e10.
        const UNRESOLVED = 8;
        /// A geom moved so fast that it may have passed through a thin geom.
        const TUNNELLED = 16;
        /// Constraints contradict each other: no motion within the speed bounds of the correction removes as much of the position errors as
        /// the options request. The step has found impulses that prove this (by weak duality), and corrects the errors as far as possible.
        const INFEASIBLE = 32;
        /// A contact overlapped by more than 1 mm: a hundred times the default slop.
        const DEEP = 64;
        /// A joint or tendon was farther beyond its range than 0.01 rad or m after a step.
        const OVER_LIMIT = 128;
        /// The position error of an equality was above 1 mm or 1 mrad after a step: a loop has opened, or a coupling has slipped.
        const EQUALITY_VIOLATED = 256;
        /// The estimated error of a step exceeded [`Options::error`](crate::Options::error).
        const INACCURATE = 512;
    }
}

impl Status {
    /// No flag: the step is solved to the tolerance, its state is finite, and no contact was left out.
    pub const OK: Self = Self::empty();
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() { f.write_str("OK") } else { bitflags::parser::to_writer(self, f) }
    }
}

/// Record of one step: residual, iterations, largest errors and status flags of each lane.
#[derive(Clone, Copy, Debug)]
pub struct Record<R: Real> {
    /// Largest of three numbers, m/s. The first is the solver's residual, the second the largest target velocity of an immovable row (one
    /// that no degree of freedom moves). The third is the largest velocity by which a constraint misses its position target, in infeasible
    /// lanes. Infinite if the step was not finite.
    pub residual: R,
    /// Number of Gauss-Seidel iterations (sweeps).
    pub sweeps: R,
    /// Number of Newton iterations, summed over all islands.
    pub newton_steps: R,
    /// Largest overlap of the step's contacts beyond their margins at the evaluation point, m.
    pub depth: R,
    /// Largest distance of a joint or tendon beyond its range after the step, rad or m.
    pub overshoot: R,
    /// Largest position error of an equality after the step, m or rad.
    pub equality_violation: R,
    /// Estimated error of the positions, m or rad, in steps that keep an error; otherwise 0.
    pub error: R,
    /// Number of parts of a step that impacts or an error bound divide; otherwise 0.
    pub substeps: R,
    /// Status flags, with the lanes (bits) that have them.
    pub flags: [(Status, u32); 10],
}

impl<R: Real> Record<R> {
    /// Record of no part yet, to which [`Record::add`] adds parts.
    pub(crate) fn none() -> Self {
        let (zero, mut flags) = (R::zero(), Status::all().iter().map(|flag| (flag, 0)));
        Self {
            residual: zero,
            sweeps: zero,
            newton_steps: zero,
            depth: zero,
            overshoot: zero,
            equality_violation: zero,
            error: zero,
            substeps: zero,
            flags: std::array::from_fn(|_| flags.next().expect("ten flags")),
        }
    }

    /// Adds the record of a part in the lanes `lanes`: sums of iterations, largest errors and all flags.
    pub(crate) fn add(&mut self, part: &Self, lanes: R::Mask) {
        kernel!(R, || {
            let take = |new: R, old: R| R::select(lanes, new, old);
            self.residual = take(part.residual.max(self.residual), self.residual);
            self.sweeps = take(part.sweeps + self.sweeps, self.sweeps);
            self.newton_steps = take(part.newton_steps + self.newton_steps, self.newton_steps);
            self.depth = take(part.depth.max(self.depth), self.depth);
            self.overshoot = take(part.overshoot.max(self.overshoot), self.overshoot);
            self.equality_violation = take(part.equality_violation.max(self.equality_violation), self.equality_violation);
            self.substeps = take(part.substeps + self.substeps, self.substeps);
            for (flag, all) in &mut self.flags {
                *all |= part.lanes(*flag) & lanes.bits();
            }
        });
    }

    /// Replaces the record in the lanes `lanes`.
    pub(crate) fn replace(&mut self, other: &Self, lanes: R::Mask) {
        kernel!(R, || {
            let take = |new: R, old: R| R::select(lanes, new, old);
            *self = Self {
                residual: take(other.residual, self.residual),
                sweeps: take(other.sweeps, self.sweeps),
                newton_steps: take(other.newton_steps, self.newton_steps),
                depth: take(other.depth, self.depth),
                overshoot: take(other.overshoot, self.overshoot),
                equality_violation: take(other.equality_violation, self.equality_violation),
                error: take(other.error, self.error),
                substeps: take(other.substeps, self.substeps),
                flags: self.flags.map(|(flag, all)| (flag, all & !lanes.bits() | other.lanes(flag) & lanes.bits())),
            };
        });
    }

    /// Adds the error estimate of an accepted interval in the lanes `lanes`.
    pub(crate) fn add_error(&mut self, error: R, lanes: R::Mask) {
        kernel!(R, || self.error = R::select(lanes, self.error + error, self.error));
    }

    /// Sets the flag [`Status::INACCURATE`] in the lanes of `lanes` whose error estimate exceeds `error`, m or rad.
    pub(crate) fn flag_inaccurate(&mut self, error: f64, lanes: R::Mask) {
        let exceeds = kernel!(R, || lanes.and_not(self.error.le(R::of(error))));
        self.add_flag(Status::INACCURATE, exceeds.bits());
    }

    /// Sets a flag in the lanes `lanes` (bits).
    pub(crate) fn add_flag(&mut self, flag: Status, lanes: u32) {
        self.flags.iter_mut().filter(|(own, _)| *own == flag).for_each(|(_, all)| *all |= lanes);
    }

    /// Lanes (bits) that have any of the status flags `status`.
    pub fn lanes(&self, status: Status) -> u32 {
        self.flags.iter().filter(|(flag, _)| status.contains(*flag)).fold(0, |all, (_, lanes)| all | lanes)
    }

    /// Adds the flags of every lane to `statuses`, which has the bits of one [`Status`] per lane.
    pub fn add_flags(&self, statuses: &mut [u32]) {
        for (flag, lanes) in self.flags {
            for lane in each_of(lanes) {
                statuses[lane] |= flag.bits();
            }
        }
    }
}

/// Largest overlap of the contacts beyond their margins in the lanes `lanes`, m; 0 without contacts.
pub fn depth<R: Real>(contacts: &Contacts<R>, lanes: R::Mask) -> R {
    kernel!(R, || {
        let mut deepest = R::zero();
        for k in 0..contacts.slots() {
            // A difference has no negative zero, whose sign would depend on the order of maxima.
            let here = R::Mask::from_bits(contacts.lanes_of(k));
            deepest = R::select(here, deepest.max(R::zero() - contacts.data[k].point.distance), deepest);
        }
        R::select(lanes, deepest, R::zero())
    })
}

/// Largest distance of a joint or tendon beyond its range at the configuration `q`, with the path lengths `paths` there, rad or m; 0 if all
/// are within their ranges.
pub fn limit_overshoot<R: Real>(compiled: &LaneModel<R>, q: &[R], paths: &PathLengths<R>) -> R {
    kernel!(R, || {
        let mut farthest = R::zero();
        for (i, limit) in compiled.limits.iter().enumerate() {
            let [lowest, highest] = compiled.params.limit(i);
            farthest = farthest.max(lowest - q[limit.q]).max(q[limit.q] - highest);
        }
        for (i, limit) in compiled.ball_limits.iter().enumerate() {
            farthest = farthest.max(norm(quat_log(quat_at(q, limit.q))) - compiled.params.ball_limit(i));
        }
        for tendon in &compiled.tendons {
            if let Some([lowest, highest]) = tendon.range {
                let length = tendon.length.value(q, paths);
                farthest = farthest.max(R::splat(lowest) - length).max(length - R::splat(highest));
            }
        }
        farthest
    })
}

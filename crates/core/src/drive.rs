//! Forces of actuators and springs, and what they add to the mass matrix: what stage 1 hands to stage 2.
//!
//! A step of length h takes the force of a spring k and a damper d, on a coordinate x = a . q with moment a, at the end of what the step
//! itself does to x, to first order:
//!
//! ```text
//! midpoint:  f = -k (x_mid + h/4 a.dv - x0) - d (xdot + 1/2 a.dv)     (M + (h/2 d + h^2/4 k) a a^T) dv = h (...)
//! implicit:  f = -k (x + h xdot + h a.dv - x0) - d (xdot + a.dv)      (M + (h d + h^2 k) a a^T) dv = h (...)
//! ```
//!
//! with dv = v+ - v. The first is the implicit midpoint rule (A-stable, and energy of linear springs is conserved: Hairer, Lubich & Wanner
//! 2006, theorem IV.2.1), the second is backward Euler's (L-stable). The matrix keeps the tree's sparsity as long as the dofs of a
//! moment lie on one chain; otherwise a a^T is replaced by the diagonal matrix |a_i| sum_j |a_j|, which is not smaller (Gershgorin): an added
//! inertia, with which the same stability holds.
//!
//! A servo at a bound of its force contributes the bound and no stiffness. Whether it is there is decided by the force at the end of the
//! step that is to be expected: without constraints but for the impulses of the last step.

use stepper_real::{Mask, Real};

use crate::plan::{ActuatorPlan, LanePlan, Plan};
use crate::spatial::*;

/// Which shares of damping and stiffness go into the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct Theta<R> {
    /// Time by which damping is multiplied, s.
    pub damping: R,
    /// Squared time by which stiffness is multiplied, s^2; zero takes springs and servos explicitly.
    pub stiffness: R,
}

/// What the mass matrix holds besides M.
#[derive(Clone, Copy, Debug)]
pub struct Implicit<'a, R: Real> {
    /// Shares of damping and stiffness.
    pub theta: Theta<R>,
    /// Weights of servos; none takes them explicitly.
    pub servos: &'a [R],
    /// Velocity before the step, at which drag of the medium is linearised; none takes it explicitly.
    pub drag_at: Option<&'a [R]>,
}

impl<R: Real> Implicit<'_, R> {
    /// Nothing: the mass matrix itself.
    pub fn none() -> Self {
        Self { theta: Theta { damping: R::zero(), stiffness: R::zero() }, servos: &[], drag_at: None }
    }
}

/// Where forces are taken.
#[derive(Clone, Copy, Debug)]
pub struct At<'a, R: Real> {
    /// Configuration of springs and servos.
    pub q: &'a [R],
    /// Velocity before the step.
    pub v: &'a [R],
    /// Velocity at which what is not implicit is taken.
    pub v_at: &'a [R],
    /// Activations.
    pub act: &'a [R],
    /// Controls.
    pub ctrl: &'a [R],
}

impl<'a, R: Real> At<'a, R> {
    /// A state as it is.
    pub fn state(q: &'a [R], v: &'a [R], act: &'a [R], ctrl: &'a [R]) -> Self {
        Self { q, v, v_at: v, act, ctrl }
    }
}

/// Forces of one group of lanes.
#[derive(Clone, Debug)]
pub struct Drive<R: Real> {
    /// Generalized forces of actuators and springs, N or N m. Joint damping is not here: stage 2 takes it implicitly.
    pub tau: Vec<R>,
    /// Force of every actuator, where its servo is taken explicitly.
    pub force: Vec<R>,
    /// What every servo adds to the mass matrix along its moment.
    pub weight: Vec<R>,
    /// Lanes in which a servo is at a bound of its force.
    saturated: Vec<R::Mask>,
    /// Lanes in which the sum of actuator forces on a dof is at its bound, for every such dof.
    bounded: Vec<R::Mask>,
    implied: Vec<R>,
}

impl<R: Real> Drive<R> {
    /// Room for a plan.
    pub fn new(plan: &Plan<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let never = |n: usize| vec![R::Mask::splat(false); n];
        Self {
            tau: zeros(plan.nv),
            force: zeros(plan.actuators.len()),
            weight: zeros(plan.servos.len()),
            saturated: never(plan.servos.len()),
            bounded: never(plan.actuator_force_ranges.len()),
            implied: zeros(if plan.servos_are_bounded { plan.actuators.len() } else { 0 }),
        }
    }

    /// Forgets which servos are at their bounds.
    #[inline(always)]
    pub fn release(&mut self) {
        self.saturated.fill(R::Mask::splat(false));
        self.bounded.fill(R::Mask::splat(false));
    }

    /// Takes over the implicit force of a servo, in the lanes in which it is not at a bound.
    #[inline(always)]
    pub(crate) fn set_servo(&mut self, actuator: usize, servo: usize, force: R, weight: R) {
        let held = self.saturated[servo];
        self.force[actuator] = R::select(held, self.force[actuator], force);
        self.weight[servo] = R::select(held, R::zero(), weight);
    }

    /// Sum of the actuators' forces on every dof, within the bounds of joints.
    #[inline(always)]
    pub(crate) fn gather(&mut self, plan: &LanePlan<R>, implicit: bool) {
        self.tau.fill(R::zero());
        for (actuator, &force) in plan.actuators.iter().zip(&self.force) {
            for &(_, dof, arm) in &actuator.moment {
                self.tau[dof] += R::splat(arm) * force;
            }
        }
        for (range, &bounded) in plan.actuator_force_ranges.iter().zip(&self.bounded) {
            let tau = &mut self.tau[range.dof];
            let clamped = within(*tau, Some(range.bounds));
            *tau = if implicit && range.has_servos { R::select(bounded, clamped, *tau) } else { clamped };
        }
    }

    /// Finds servos whose force at the end of the step would exceed its bounds, if the velocity changed by `dv`: they keep to the bound and
    /// lose their stiffness. Returns the lanes in which there is a new one; [`Drive::gather`] must follow.
    pub fn saturate(&mut self, plan: &LanePlan<R>, dv: &[R], h: R) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                self.implied.copy_from_slice(&self.force);
                for (servo, &weight) in plan.servos.iter().zip(&self.weight) {
                    let along = along(&plan.actuators[servo.actuator], dv);
                    self.implied[servo.actuator] -= weight / h * along;
                }
                let mut new = R::Mask::splat(false);
                for (k, servo) in plan.servos.iter().enumerate() {
                    let Some(bounds) = plan.actuators[servo.actuator].force_range else { continue };
                    let beyond = outside(self.implied[servo.actuator], bounds).and_not(self.saturated[k]);
                    new = new.or(beyond);
                    self.stop(plan, k, beyond);
                }
                for (r, range) in plan.actuator_force_ranges.iter().enumerate() {
                    if !range.has_servos {
                        continue;
                    }
                    let mut sum = R::zero();
                    for &(actuator, arm) in &range.actuators {
                        sum += R::splat(arm) * self.implied[actuator];
                    }
                    let beyond = outside(sum, range.bounds).and_not(self.bounded[r]);
                    new = new.or(beyond);
                    self.bounded[r] = self.bounded[r].or(beyond);
                    for &(actuator, _) in &range.actuators {
                        if let Some(k) = plan.actuators[actuator].servo {
                            self.stop(plan, k, beyond.and_not(self.saturated[k]));
                        }
                    }
                }
                new
            },
        )
    }

    /// Fixes the force of servo `k` at what is implied, within its bounds, in `lanes`.
    #[inline(always)]
    fn stop(&mut self, plan: &LanePlan<R>, k: usize, lanes: R::Mask) {
        let actuator = plan.servos[k].actuator;
        let held = within(self.implied[actuator], plan.actuators[actuator].force_range);
        self.force[actuator] = R::select(lanes, held, self.force[actuator]);
        self.implied[actuator] = R::select(lanes, held, self.implied[actuator]);
        self.weight[k] = R::select(lanes, R::zero(), self.weight[k]);
        self.saturated[k] = self.saturated[k].or(lanes);
    }
}

/// a . x along an actuator's moment.
#[inline(always)]
pub(crate) fn along<R: Real>(actuator: &ActuatorPlan<R::Scalar>, x: &[R]) -> R {
    let mut sum = R::zero();
    for &(_, dof, arm) in &actuator.moment {
        sum += R::splat(arm) * x[dof];
    }
    sum
}

/// `x` within a range. A NaN must not turn into a bound: it stays, and the environment is refused in stage 6.
#[inline(always)]
pub(crate) fn within<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R {
    match range {
        Some(range) => {
            let [lo, hi] = splat(range);
            R::select(x.eq(x), x.clamp(lo, hi), x)
        }
        None => x,
    }
}

#[inline(always)]
fn outside<R: Real>(x: R, range: [R::Scalar; 2]) -> R::Mask {
    let [lo, hi] = splat(range);
    x.lt(lo).or(x.gt(hi))
}

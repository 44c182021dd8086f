//! One step of a group of environments, read aloud.

use stepper_real::{Mask, Real};

use crate::constraints::{Constraints, Moment};
use crate::contacts::Contacts;
use crate::kinematics::{Kinematics, advance, all_finite, combine, displace};
use crate::options::{Integrator, Options};
use crate::plan::Plan;
use crate::rk4::Rk4;
use crate::spatial::*;
use crate::stages::s01_actuate::{actuate, advance_activation};
use crate::stages::s02_smooth::Smooth;
use crate::stages::s03_detect::{GeomPoses, detect};
use crate::stages::s05_solve::solve;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::stabilise;
use crate::stages::s10_record::Record;

/// What the user says to a step.
#[derive(Clone, Debug)]
pub struct Inputs<R> {
    /// Controls, nu.
    pub ctrl: Vec<R>,
    /// Forces on the joints, nv, N or N m; empty when there are none.
    pub qfrc: Vec<R>,
    /// Wrenches on the bodies (force, torque), 6 nbody, N and N m; empty when there are none.
    pub xfrc: Vec<R>,
}

/// State of a group of lanes while it steps, and room to work. Made once per thread, used for every group.
#[derive(Clone, Debug)]
pub struct Scratch<R: Real> {
    /// Configuration.
    pub q: Vec<R>,
    /// Velocity.
    pub v: Vec<R>,
    /// Activations.
    pub act: Vec<R>,
    /// Contacts of the last step: the warm start of the next.
    pub contacts: Contacts<R>,
    /// Constraints, and the impulses of limits and dry friction of the last step.
    pub constraints: Constraints<R>,
    /// Lanes that are environments.
    pub alive: R::Mask,
    /// Poses at which the dynamics are taken.
    pub kinematics: Kinematics<R>,
    pub(crate) inputs: Inputs<R>,
    new_contacts: Contacts<R>,
    smooth: Smooth<R>,
    v_free: Vec<R>,
    poses: GeomPoses<R>,
    rk4: Option<Rk4<R>>,
    tau: Vec<R>,
    applied: Vec<R>,
    q_eval: Vec<R>,
    v_mean: Vec<R>,
    act_eval: Vec<R>,
    q_next: Vec<R>,
    v_next: Vec<R>,
    act_next: Vec<R>,
}

impl<R: Real> Scratch<R> {
    /// Room for a plan.
    pub fn new(plan: &Plan<R::Scalar>, options: &Options, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            q: zeros(plan.nq),
            v: zeros(plan.nv),
            act: zeros(plan.na),
            contacts: Contacts::new(max_contacts),
            constraints: Constraints::new(plan, max_contacts),
            alive: R::Mask::splat(true),
            kinematics: Kinematics::new(plan),
            inputs: Inputs {
                ctrl: zeros(plan.actuators.len()),
                qfrc: Vec::with_capacity(plan.nv),
                xfrc: Vec::with_capacity(6 * plan.bodies.len()),
            },
            new_contacts: Contacts::new(max_contacts),
            smooth: Smooth::new(plan),
            v_free: zeros(plan.nv),
            poses: GeomPoses::new(plan),
            rk4: (options.integrator == Integrator::Rk4).then(|| Rk4::new(plan)),
            tau: zeros(plan.nv),
            applied: zeros(plan.nv),
            q_eval: zeros(plan.nq),
            v_mean: zeros(plan.nv),
            act_eval: zeros(plan.na),
            q_next: zeros(plan.nq),
            v_next: zeros(plan.nv),
            act_next: zeros(plan.na),
        }
    }
}

/// One step of `options.timestep` seconds: state and inputs in, next state and its record out.
///
/// This is ordinary code that calls kernels: each stage is compiled once for every lane type and CPU level.
pub fn step<R: Real>(plan: &Plan<R::Scalar>, options: &Options, s: &mut Scratch<R>) -> Record<R> {
    let midpoint = options.integrator != Integrator::Euler;
    let h = R::of(options.timestep);
    // Moreau's rule takes everything in the middle of the step, Euler's at its beginning.
    let (lead, rest) = if midpoint { (R::of(0.5 * options.timestep), R::of(0.5 * options.timestep)) } else { (R::zero(), h) };

    // Where the step is taken.
    place(plan, midpoint, lead, s);
    // 1 actuate, 2 smooth dynamics
    free_motion(plan, midpoint, h, s);
    // 3 detect
    detect(plan, &s.kinematics, &s.v_free, h, s.alive, &mut s.poses, &mut s.new_contacts);
    s.new_contacts.prepare(&mut s.contacts);
    // 4 assemble
    let moment = Moment { q: &s.q_eval, v: &s.v, v_free: &s.v_free, h, alive: s.alive };
    s.constraints.assemble(plan, options, &s.kinematics, &s.smooth.mass, &moment, &mut s.new_contacts);
    if midpoint {
        // 1 and 2 again, with what stage 4 knows of the velocity to come
        correct_forces(plan, h, s);
    }
    // 5 solve
    let outcome = solve(options, &s.v, &mut s.constraints, &mut s.new_contacts);
    // 6 integrate velocity
    integrate_velocity(plan, &s.smooth.mass, &s.v_free, &mut s.constraints.iterate.w, &mut s.v_next);
    // 7 integrate position
    integrate_position(plan, &s.q_eval, &s.v_next, rest, &mut s.q_next);
    advance_activation(plan, &s.act, &s.act_eval, &s.inputs.ctrl, h, &mut s.act_next);
    // 8 stabilise
    let work = [&mut s.v_mean[..], &mut s.q_eval[..]];
    stabilise(plan, options, &s.smooth.mass, &mut s.constraints, &s.v_free, &s.v_next, h, work, &mut s.q_next);
    if let Some(rk4) = &mut s.rk4 {
        // Lanes that nothing touched take the higher order.
        rk4.step(plan, &s.inputs, [&s.q, &s.v, &s.act], h);
        rk4.take(s.alive.and_not(s.constraints.constrained), [&mut s.q_next, &mut s.v_next, &mut s.act_next]);
    }

    let finite = accept(plan, s);
    Record {
        residual: outcome.residual,
        iterations: outcome.sweeps,
        not_converged: s.alive.and_not(outcome.residual.le(R::of(options.tolerance))),
        non_finite: s.alive.and_not(finite),
        contacts_full: s.contacts.full,
    }
}

/// The configuration and activations at which forces are taken.
fn place<R: Real>(plan: &Plan<R::Scalar>, midpoint: bool, lead: R, s: &mut Scratch<R>) {
    if midpoint {
        displace(plan, &s.q, &s.v, lead, &mut s.q_eval);
        advance_activation(plan, &s.act, &s.act, &s.inputs.ctrl, lead, &mut s.act_eval);
    } else {
        s.q_eval.copy_from_slice(&s.q);
        s.act_eval.copy_from_slice(&s.act);
    }
    s.kinematics.update(plan, &s.q_eval);
}

/// Stages 1 and 2: the velocity at the end of the step if nothing were in the way.
fn free_motion<R: Real>(plan: &Plan<R::Scalar>, midpoint: bool, h: R, s: &mut Scratch<R>) {
    s.smooth.factor_mass(plan, &s.kinematics, if midpoint { h * R::of(0.5) } else { h });
    apply_forces(plan, s);
    actuate(plan, &s.q_eval, &s.v, &s.act_eval, &s.inputs.ctrl, &mut s.tau);
    s.smooth.acceleration(plan, &s.kinematics, [&s.tau, &s.applied], &s.v, &s.v);
    advance(&s.v, &s.smooth.acc, h, &mut s.v_free);
}

/// Stages 1 and 2 again, with the forces that depend on the velocity taken at the mean of v and the velocity to be expected at the end of the
/// step: one corrector pass, which keeps the midpoint rule's second order.
///
/// What is to be expected includes the impulses of the last step, so that a robot at rest feels no force of a motion that its contacts prevent.
fn correct_forces<R: Real>(plan: &Plan<R::Scalar>, h: R, s: &mut Scratch<R>) {
    s.constraints.warm_change(plan, &s.smooth.mass, &mut s.v_mean);
    combine(&s.v_free, &s.v_mean, R::one(), &mut s.v_next);
    combine(&s.v, &s.v_next, R::of(0.5), &mut s.v_mean);
    actuate(plan, &s.q_eval, &s.v_mean, &s.act_eval, &s.inputs.ctrl, &mut s.tau);
    s.smooth.acceleration(plan, &s.kinematics, [&s.tau, &s.applied], &s.v, &s.v_mean);
    advance(&s.v, &s.smooth.acc, h, &mut s.v_next);
    advance(&s.v_next, &s.v_free, -R::one(), &mut s.v_mean);
    std::mem::swap(&mut s.v_free, &mut s.v_next);
    s.constraints.shift(plan, &s.smooth.mass, &mut s.v_mean);
}

/// Forces that the user applies, as generalized forces.
fn apply_forces<R: Real>(plan: &Plan<R::Scalar>, s: &mut Scratch<R>) {
    if s.inputs.qfrc.is_empty() {
        s.applied.fill(R::zero());
    } else {
        s.applied.copy_from_slice(&s.inputs.qfrc);
    }
    if !s.inputs.xfrc.is_empty() {
        s.smooth.add_wrenches(plan, &s.kinematics, &s.inputs.xfrc, &mut s.applied);
    }
}

/// Takes the next state over in the lanes where it is finite; the others stay where they were and start cold. Returns those lanes.
fn accept<R: Real>(plan: &Plan<R::Scalar>, s: &mut Scratch<R>) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let mut finite = all_finite(&s.q_next).and(all_finite(&s.v_next)).and(all_finite(&s.act_next));
            // A pose that the user gave and that is none would hide its contacts: the step is refused instead.
            for m in &plan.mocap {
                finite = finite.and(all_finite(&s.kinematics.pos[m.frame])).and(all_finite(&s.kinematics.mat[m.frame]));
            }
            let moves = finite.and(s.alive);
            for (old, new) in [(&mut s.q, &s.q_next), (&mut s.v, &s.v_next), (&mut s.act, &s.act_next)] {
                for (old, &new) in old.iter_mut().zip(new) {
                    *old = R::select(moves, new, *old);
                }
            }
            if s.alive.and_not(finite).any() {
                for lambda in &mut s.constraints.scalar_impulse {
                    *lambda = R::select(finite, *lambda, R::zero());
                }
                for l in 0..R::LANES {
                    if s.alive.and_not(finite).bits() >> l & 1 == 1 {
                        s.new_contacts.count[l] = 0;
                    }
                }
                for slot in &mut s.new_contacts.data {
                    slot.impulse = select(finite, slot.impulse, zero());
                }
            }
            std::mem::swap(&mut s.contacts, &mut s.new_contacts);
            finite
        },
    )
}

//! One step of a group of environments, read aloud.

mod impact;

use stepper_real::{Mask, Real};

use crate::constraints::{Constraints, Moment};
use crate::contacts::Contacts;
use crate::drive::{At, Drive, Implicit, Implied, Theta, Train};
use crate::kinematics::{Kinematics, advance, all_finite, blend, displace};
use crate::lanes::each_of;
use crate::limit::{Limit, slow_down, thrown, unresolved};
use crate::mocap::{self, Way};
use crate::options::{Integrator, StepSettings};
use crate::plan::{LanePlan, Plan};
use crate::rk4::Rk4;
use crate::spatial::*;
use crate::spin;
use crate::stages::s01_actuate::{actuate, advance_activation, regather};
use crate::stages::s02_smooth::Smooth;
use crate::stages::s03_detect::{GeomPoses, detect, may_have_passed};
use crate::stages::s05_solve::{estimate, forget_estimate, solve};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::{Solved, restrain, stabilise};
use crate::stages::s10_record::{DEEP, OVER_LIMIT, Record, depth, limit_overshoot};

/// What the user says to a step.
#[derive(Clone, Debug)]
pub struct Inputs<R> {
    /// Controls, nu, as drive trains hand them on.
    pub ctrl: Vec<R>,
    /// Drive trains that act within a step.
    pub trains: Vec<Train<R>>,
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
    /// Impulse of all constraints of the last step on the joints, if a servo's bounds ask for it.
    pub impulse: Vec<R>,
    /// Lanes that are environments.
    pub alive: R::Mask,
    /// Whether all of the above is the state of the group that is worked on: then it need not be loaded again.
    pub(crate) current: bool,
    /// Poses at which the dynamics are taken.
    pub kinematics: Kinematics<R>,
    pub(crate) inputs: Inputs<R>,
    /// Controls as the user gave them, nu; drive trains make `inputs` of them.
    pub(crate) given: Vec<R>,
    /// Ways of the mocap bodies during this call, and the time of it that has passed, s.
    pub(crate) ways: Vec<Way<R>>,
    pub(crate) elapsed: f64,
    new_contacts: Contacts<R>,
    smooth: Smooth<R>,
    v_free: Vec<R>,
    pub(crate) poses: GeomPoses<R>,
    rk4: Option<Rk4<R>>,
    pub(crate) drive: Drive<R>,
    applied: Vec<R>,
    q_eval: Vec<R>,
    q_ahead: Vec<R>,
    v_mean: Vec<R>,
    act_eval: Vec<R>,
    /// Velocity after the step with which inertial forces are taken.
    expected: Vec<R>,
    change: Vec<R>,
    /// Impacts of the step, and room for the velocity before them.
    impacts: impact::Impacts<R>,
    before_impact: Vec<R>,
    limit: Limit<R>,
    unresolved: R::Mask,
    q_next: Vec<R>,
    v_next: Vec<R>,
    act_next: Vec<R>,
}

impl<R: Real> Scratch<R> {
    /// Room for a plan.
    pub fn new(plan: &Plan<R::Scalar>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            q: zeros(plan.nq),
            v: zeros(plan.nv),
            act: zeros(plan.na),
            contacts: Contacts::new(max_contacts).with_torques(plan.wide),
            constraints: Constraints::new(plan, max_contacts),
            impulse: zeros(if plan.servos_are_bounded { plan.nv } else { 0 }),
            alive: R::Mask::splat(true),
            current: false,
            kinematics: Kinematics::new(plan),
            inputs: Inputs {
                ctrl: zeros(plan.actuators.len()),
                trains: vec![Train::default(); plan.trains],
                qfrc: Vec::with_capacity(plan.nv),
                xfrc: Vec::with_capacity(6 * plan.bodies.len()),
            },
            given: zeros(plan.actuators.len()),
            ways: plan.mocap.iter().map(|m| Way::at(splat(m.pos), splat(m.quat))).collect(),
            elapsed: 0.0,
            new_contacts: Contacts::new(max_contacts).with_torques(plan.wide),
            smooth: Smooth::new(plan),
            v_free: zeros(plan.nv),
            poses: GeomPoses::new(plan),
            rk4: (options.integrator == Integrator::Rk4).then(|| Rk4::new(plan)),
            drive: Drive::new(plan),
            applied: zeros(plan.nv),
            q_eval: zeros(plan.nq),
            q_ahead: zeros(plan.nq),
            v_mean: zeros(plan.nv),
            act_eval: zeros(plan.na),
            expected: zeros(plan.nv),
            change: zeros(plan.nv),
            impacts: impact::Impacts::new(plan),
            before_impact: zeros(plan.nv),
            limit: Limit::new(plan),
            unresolved: R::Mask::splat(false),
            q_next: zeros(plan.nq),
            v_next: zeros(plan.nv),
            act_next: zeros(plan.na),
        }
    }
}

impl<R: Real> Scratch<R> {
    /// Takes up parameters that are read before a step: where the geoms of the world are.
    pub(crate) fn settle(&mut self, plan: &LanePlan<R>) {
        self.poses.settle(plan);
    }
}

/// The integrator as numbers.
#[derive(Clone, Copy, Debug)]
struct Rule<R> {
    integrator: Integrator,
    /// Time step, s.
    h: R,
    /// From the configuration before the step to that at which everything is taken, s.
    lead: R,
    /// From there to the configuration after the step, s.
    rest: R,
    /// From there to where springs and servos are taken, s; what lies beyond is in the mass matrix.
    reach: R,
    /// Shares of damping and stiffness in the mass matrix.
    theta: Theta<R>,
    /// Where velocity-dependent forces are taken, from 0 at the velocity before the step to 1 at that after it.
    share: R,
    /// Whether springs and servos are implicit, and velocity-dependent forces are taken again at the velocity to be expected.
    corrects: bool,
}

impl<R: Real> Rule<R> {
    fn new(options: &StepSettings) -> Self {
        let (h, half, none) = (R::of(options.timestep), R::of(0.5 * options.timestep), R::zero());
        let share = R::of(0.5);
        let integrator = options.integrator;
        match integrator {
            Integrator::Midpoint | Integrator::Rk4 => {
                let theta = Theta { damping: half, stiffness: half * half, step: h };
                Self { integrator, h, lead: half, rest: half, reach: none, theta, share, corrects: true }
            }
            Integrator::Implicit => {
                let theta = Theta { damping: h, stiffness: h * h, step: none };
                Self { integrator, h, lead: none, rest: h, reach: h, theta, share: R::one(), corrects: true }
            }
            Integrator::Euler => {
                let theta = Theta { damping: h, stiffness: none, step: none };
                Self { integrator, h, lead: none, rest: h, reach: none, theta, share: none, corrects: false }
            }
        }
    }

    /// The part of a gap that may close in a step: the next step is to meet the surface exactly in its middle, instead of beyond it. That is two thirds
    /// where the midpoint rule is taken at the beginning of a step; `impacts` are taken anywhere.
    fn closing(&self, at_beginning: R::Mask, impacts: R::Mask) -> R {
        let whole = R::select(at_beginning, R::of(2.0 / 3.0), R::one());
        if impacts.none() {
            return whole;
        }
        R::vectorize(
            #[inline(always)]
            || R::select(impacts, self.h / (self.rest + self.h * R::of(0.5)), whole),
        )
    }

    /// How stage 1 takes servos. Euler's rule takes those of drive trains alone implicitly, as it does the joints' damping.
    fn servos(&self) -> Option<Implied<R>> {
        Some(Implied { theta: self.theta, all: self.corrects })
    }

    /// Shares of the joints' own damping and stiffness: Euler's rule takes damping explicitly where the model asks for it.
    fn joints(&self, plan: &LanePlan<R>) -> Theta<R> {
        let explicit = plan.explicit_damping && self.integrator == Integrator::Euler;
        Theta { damping: if explicit { R::zero() } else { self.theta.damping }, ..self.theta }
    }

    /// The configuration at which springs and servos are taken.
    fn springs_at<'a>(&self, here: &'a [R], ahead: &'a [R]) -> &'a [R] {
        if self.integrator == Integrator::Implicit { ahead } else { here }
    }

    /// Where forces are taken: configurations of the step and ahead of it, velocities before the step and where what is not implicit is taken.
    fn forces_at<'a>(&self, [here, ahead]: [&'a [R]; 2], [v, v_at]: [&'a [R]; 2], act: &'a [R], inputs: &'a Inputs<R>) -> At<'a, R> {
        At { q: self.springs_at(here, ahead), v, v_at, act, ctrl: &inputs.ctrl, trains: &inputs.trains }
    }
}

/// One step of `options.timestep` seconds: state and inputs in, next state and its record out.
///
/// This is ordinary code that calls kernels: each stage is compiled once for every lane type and CPU level.
pub fn step<R: Real>(plan: &LanePlan<R>, options: &StepSettings, s: &mut Scratch<R>) -> Record<R> {
    let mut rule = Rule::new(options);
    let h = rule.h;
    s.poses.begin();

    // Where the step is taken: Moreau's rule takes everything in the middle of the step, Euler's at its beginning.
    place(plan, &rule, s);
    // 1 actuate, 2 smooth dynamics
    free_motion(plan, &rule, s);
    // 3 detect
    let too_far = find_contacts(plan, &rule, s);
    if too_far.any() {
        // What is so fast that it may be through something thin in the middle of the step is taken at its beginning.
        rule.lead = R::select(too_far, R::zero(), rule.lead);
        rule.rest = R::select(too_far, h, rule.rest);
        place(plan, &rule, s);
        free_motion(plan, &rule, s);
        find_contacts(plan, &rule, s);
    }
    if rule.integrator.in_the_middle() {
        impact::place_at_impacts(plan, options, &mut rule, s);
    }
    s.new_contacts.prepare(&mut s.contacts);
    // 4 assemble
    assemble(plan, options, &rule, s, too_far);
    let bounded = plan.servos_are_bounded && (rule.corrects || plan.trains > 0);
    if bounded && s.constraints.constrained.any() && reconsider_servos(plan, &rule, s) {
        // 1, 2 and 4 again, where servos reach their bounds, or leave them, by impulses of this step
        free_motion(plan, &rule, s);
        assemble(plan, options, &rule, s, too_far);
        // Where nothing was wrong, this repeats the bits of the estimate before.
        estimate(&s.v, h, s.constraints.constrained, &mut s.constraints);
        forget_estimate(s.constraints.constrained, &mut s.constraints);
    }
    if rule.corrects {
        // 1 and 2 again, at the velocity that an estimate of stage 5 leads to
        correct_forces(plan, &rule, s);
    }
    // 5 solve, 6 integrate velocity
    let mut outcome = solve(options, &s.v, s.constraints.constrained, &mut s.constraints, &mut s.new_contacts);
    let pushed = integrate_velocity(plan, &s.smooth.mass, &s.v_free, &s.constraints, &mut s.v_next);
    if rule.integrator.in_the_middle() {
        // 2, 5 and 6 again where the velocity jumped
        outcome = impact::solve_impacts(plan, options, &rule, s, outcome);
    }
    keep_impulse(plan, s);
    let solved = Solved { mass: &s.smooth.mass, contacts: &s.new_contacts, v_free: &s.v_free, h };
    let mut infeasible = restrain(plan, options, &solved, &mut s.constraints, &mut outcome, &mut s.v_mean, &mut s.v_next);
    // Where the step is too long for the motion, or the impulses do not decide it, speed and energy are kept from growing by force.
    let undecided = undecided(options, s, outcome.residual);
    if rule.corrects && s.constraints.constrained.any() {
        s.unresolved = s.unresolved.or(s.alive.and(thrown(plan, [&s.v, &s.v_free], &s.v_next, h)));
    }
    let guarded = s.unresolved.or(undecided);
    if guarded.any() {
        slow_down(plan, guarded, h, &mut s.v_next);
    }
    // 7 integrate position
    let free = !pushed && !rule.corrects;
    let tunnelled = may_have_passed(plan, &s.kinematics, &s.v_next, free, h, s.alive, &mut s.poses);
    integrate_position(plan, &s.q_eval, &s.v_next, rule.rest, &mut s.q_next);
    advance_activation(plan, &s.act, &s.act_eval, &s.inputs.ctrl, h, &mut s.act_next);
    // 8 stabilise
    let impacts = impact::carry_positions(plan, &rule, s);
    let v_free = if impacts.any() { &s.change } else { &s.v_free };
    let work = [&mut s.v_mean[..], &mut s.q_eval[..]];
    let solved = Solved { mass: &s.smooth.mass, contacts: &s.new_contacts, v_free, h };
    infeasible = infeasible.or(stabilise(plan, options, &solved, &mut s.constraints, &s.v_next, work, &mut s.q_next));
    if let Some(rk4) = &mut s.rk4 {
        // Lanes that nothing touched take the higher order.
        rk4.step(plan, &s.kinematics, &s.inputs, [&s.q, &s.v, &s.act], h);
        let smooth = s.alive.and_not(s.constraints.constrained.or(s.unresolved));
        rk4.take(smooth, [&mut s.q_next, &mut s.v_next, &mut s.act_next]);
    }

    if guarded.any() {
        let (before, after) = ([&s.q[..], &s.v[..]], [&s.q_next[..], &s.v_next[..]]);
        s.limit.keep_energy(plan, &s.kinematics, guarded, before, after, &s.v_free, &mut s.v_mean);
        std::mem::swap(&mut s.v_next, &mut s.v_mean);
    }

    let finite = accept(plan, s);
    // 10 record
    let (depth, overshoot) = (depth(&s.constraints, &s.contacts, finite), limit_overshoot(plan, &s.q));
    Record {
        residual: outcome.residual,
        iterations: outcome.sweeps + outcome.newton_steps,
        depth,
        overshoot,
        deep: s.alive.and(depth.gt(R::of(DEEP))),
        over_limit: s.alive.and(overshoot.gt(R::of(OVER_LIMIT))),
        not_converged: undecided.or(s.alive.and_not(outcome.residual.le(R::of(options.tolerance)))),
        infeasible: s.alive.and(infeasible),
        non_finite: s.alive.and_not(finite),
        contacts_full: s.contacts.full,
        unresolved: s.unresolved,
        tunnelled,
    }
}

/// Stage 4.
fn assemble<R: Real>(plan: &LanePlan<R>, options: &StepSettings, rule: &Rule<R>, s: &mut Scratch<R>, too_far: R::Mask) {
    let moment = Moment {
        q: &s.q_eval,
        v: &s.v,
        motion: &s.smooth.work,
        v_free: &s.v_free,
        losses: &s.drive.losses,
        h: rule.h,
        lead: rule.lead,
        closing: rule.closing(too_far, s.impacts.lanes),
        alive: s.alive,
    };
    s.constraints.assemble(plan, options, &s.kinematics, &s.smooth.mass, &moment, &mut s.new_contacts);
}

/// Compares where servos are on their bounds with what an estimate of the impulses says, which takes the place of those of the last step where the two
/// differ. Returns whether they do in any lane.
fn reconsider_servos<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) -> bool {
    let lanes = s.constraints.constrained;
    estimate(&s.v, rule.h, lanes, &mut s.constraints);
    s.constraints.impulse_change(plan, &s.smooth.mass, &mut s.v_mean);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..plan.nv {
                s.v_mean[i] = (s.v_free[i] - s.v[i]) + s.v_mean[i];
            }
        },
    );
    let wrong = s.drive.misjudged(plan, &s.inputs.trains, rule.theta, &s.v_mean, rule.h).and(lanes).and(s.alive);
    if wrong.any() {
        R::vectorize(
            #[inline(always)]
            || {
                s.change.copy_from_slice(&s.constraints.iterate.w);
                s.smooth.mass.momentum(plan, &mut s.change);
                for (kept, &now) in s.impulse.iter_mut().zip(&s.change) {
                    *kept = R::select(wrong, now, *kept);
                }
            },
        );
    }
    forget_estimate(lanes, &mut s.constraints);
    wrong.any()
}

/// Stage 3. Returns the lanes that are taken too far from the beginning of the step.
fn find_contacts<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) -> R::Mask {
    detect(plan, &s.kinematics, [&s.v, &s.v_free], [rule.h, rule.lead], s.alive, &mut s.poses, &mut s.new_contacts)
}

/// The configuration and activations at which forces are taken.
fn place<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    if rule.integrator.in_the_middle() {
        displace(plan, &s.q, &s.v, rule.lead, &mut s.q_eval);
        advance_activation(plan, &s.act, &s.act, &s.inputs.ctrl, rule.lead, &mut s.act_eval);
    } else {
        s.q_eval.copy_from_slice(&s.q);
        s.act_eval.copy_from_slice(&s.act);
    }
    if rule.integrator == Integrator::Implicit {
        displace(plan, &s.q_eval, &s.v, rule.reach, &mut s.q_ahead);
    }
    mocap::place(plan, &s.ways, R::of(s.elapsed) + rule.lead, &mut s.kinematics);
    s.kinematics.update(plan, &s.q_eval);
    s.drive.transmit(plan, &s.kinematics, &s.v, rule.reach);
}

/// Stages 1 and 2: the velocity at the end of the step if nothing were in the way.
fn free_motion<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    s.smooth.apply(plan, &s.kinematics, [&s.inputs.qfrc, &s.inputs.xfrc], &mut s.applied);
    s.drive.release();
    s.smooth.assemble_mass(plan, &s.kinematics, rule.joints(plan));
    if rule.integrator.in_the_middle() && !plan.servos.is_empty() {
        s.drive.gauge(plan, &s.smooth.inertia);
    }
    let at = rule.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.v], &s.act_eval, &s.inputs);
    actuate(plan, &at, rule.servos(), &mut s.drive);
    s.smooth.complete_mass(plan, &s.kinematics, implicit(plan, rule, &s.drive, &s.v));
    s.smooth.acceleration(plan, &s.kinematics, [&s.drive.tau, &s.applied], &s.v, &s.v);
    if plan.servos_are_bounded && (rule.corrects || plan.trains > 0) {
        saturate_servos(plan, rule, s);
    }
    if plan.lossy {
        s.drive.lose(plan, &s.inputs.trains, true);
    }
    advance(&s.v, &s.smooth.acc, rule.h, &mut s.v_free);
}

/// What the mass matrix holds besides M.
fn implicit<'a, R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, drive: &'a Drive<R>, v: &'a [R]) -> Implicit<'a, R> {
    let servos: &[R] = if rule.corrects || plan.trains > 0 { &drive.weight } else { &[] };
    Implicit { theta: rule.joints(plan), servos, arms: &drive.arms, drag_at: rule.corrects.then_some(v) }
}

/// How often servos are looked at again after others have reached their bounds.
const SATURATION_PASSES: usize = 4;

/// Takes the stiffness from servos whose force would exceed its bounds, and with it the mass matrix that they had part in.
fn saturate_servos<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    for pass in 0..SATURATION_PASSES {
        // The change of velocity to be expected: by the forces, and by constraints that push as in the last step.
        s.v_next.copy_from_slice(&s.impulse);
        s.smooth.solve(plan, &mut s.v_next);
        advance(&s.v_next, &s.smooth.acc, rule.h, &mut s.v_mean);
        // Lanes in which nothing is new do it all again and find the same bits.
        if s.drive.saturate(plan, &s.inputs.trains, rule.theta, &s.v_mean, rule.h, pass).and(s.alive).none() {
            return;
        }
        regather(plan, rule.springs_at(&s.q_eval, &s.q_ahead), rule.corrects, &mut s.drive);
        s.smooth.factor_mass_again(plan, &s.kinematics, implicit(plan, rule, &s.drive, &s.v));
        s.smooth.acceleration_again(plan, [&s.drive.tau, &s.applied], &s.v);
    }
}

/// Stages 1 and 2 again, with the forces that depend on the velocity taken at the mean of v and the velocity to be expected at the end of the
/// step (or at that velocity itself): one corrector pass, which keeps the midpoint rule's second order.
///
/// What is to be expected includes the impulses of constraints, so that a robot at rest feels no force of a motion that its contacts prevent. They are
/// those of this step, so that where it ends follows from where it begins.
fn correct_forces<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    let constrained = s.constraints.constrained;
    if constrained.any() {
        estimate(&s.v, rule.h, constrained, &mut s.constraints);
    }
    s.constraints.impulse_change(plan, &s.smooth.mass, &mut s.v_mean);
    leave_out_blows(rule, &s.v_free, &mut s.v_mean);
    advance(&s.v_free, &s.v_mean, R::one(), &mut s.expected);
    blend(&s.v, &s.v_free, rule.share, &mut s.v_mean);
    // Without servos no force of stage 1 depends on the velocity.
    if !plan.servos.is_empty() {
        let at = rule.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.v_mean], &s.act_eval, &s.inputs);
        actuate(plan, &at, rule.servos(), &mut s.drive);
    }
    s.smooth.acceleration(plan, &s.kinematics, [&s.drive.tau, &s.applied], &s.v, &s.v_mean);
    advance(&s.v, &s.smooth.acc, rule.h, &mut s.v_next);
    if !plan.spinners.is_empty() && rule.integrator.in_the_middle() {
        spin::correct(plan, &s.kinematics, &s.smooth.mass, [rule.lead, rule.rest], [&s.v, &s.v_mean], &mut s.v_next);
    }
    advance(&s.v_next, &s.v_free, -R::one(), &mut s.v_mean);
    s.unresolved = unresolved(plan, &s.v, &s.v_next, &s.v_mean, rule.h).and(s.alive);
    if s.unresolved.any() {
        leave_out_inertial_forces(plan, rule, s);
    }
    std::mem::swap(&mut s.v_free, &mut s.v_next);
    s.constraints.shift(plan, &s.smooth.mass, &mut s.v_mean, R::Mask::splat(true));
    if constrained.any() {
        forget_estimate(constrained, &mut s.constraints);
    }
}

/// Turn by a blow within the step beyond which the velocity after it says nothing of the forces in it, rad.
const BLOW: f64 = 0.1;

/// Leaves the `change` by impulses out of what is to be expected in lanes in which it turns by so much that it makes the motion faster than the step
/// resolves: forces of that motion would feed it.
fn leave_out_blows<R: Real>(rule: &Rule<R>, v_free: &[R], change: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            let (mut most, mut free, mut pushed) = (R::zero(), R::zero(), R::zero());
            for (&change, &v) in change.iter().zip(v_free) {
                most = most.max(change.abs());
                free = free.max(v.abs());
                pushed = pushed.max((v + change).abs());
            }
            let blow = (rule.h * most).gt(R::of(BLOW)).and(pushed.gt(free));
            if blow.any() {
                for change in change {
                    *change = R::select(blow, R::zero(), *change);
                }
            }
        },
    )
}

/// Residual from which on impulses may be anything, m/s: energy is kept from growing by them, as in steps that are too long.
const UNSOLVED: f64 = 1e-2;

/// Lanes whose impulses do not decide what becomes of their energy: the residual is large, or it is small beside velocities but not beside what
/// enormous impulses make of it.
fn undecided<R: Real>(options: &StepSettings, s: &Scratch<R>, residual: R) -> R::Mask {
    let Constraints { problem, iterate, constrained, .. } = &s.constraints;
    R::vectorize(
        #[inline(always)]
        || {
            let unsolved = s.alive.and(residual.gt(R::of(UNSOLVED.max(10.0 * options.tolerance))));
            unsolved.or(s.alive.and(*constrained).and(stepper_solve::undecided(problem, iterate, residual)))
        },
    )
}

/// In unresolved lanes, the free velocity without velocity-dependent inertial forces, and its change by that.
fn leave_out_inertial_forces<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    // The other lanes' forces stay those of their mean velocity, to the bit: further solutions read them.
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..plan.nv {
                let mean = s.v[i] + (s.expected[i] - s.v[i]) * rule.share;
                s.change[i] = R::select(s.unresolved, s.v[i], mean);
            }
        },
    );
    let at = rule.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.change], &s.act_eval, &s.inputs);
    actuate(plan, &at, rule.servos(), &mut s.drive);
    s.smooth.acceleration(plan, &s.kinematics, [&s.drive.tau, &s.applied], &s.v, &s.limit.rest);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..plan.nv {
                let still = s.v[i] + s.smooth.acc[i] * rule.h;
                s.v_next[i] = R::select(s.unresolved, still, s.v_next[i]);
                s.v_mean[i] = R::select(s.unresolved, still - s.v_free[i], s.v_mean[i]);
            }
        },
    )
}

/// Keeps the impulse of all constraints on the joints, from the scaled velocity change of stage 5, where bounded servos need it.
fn keep_impulse<R: Real>(plan: &LanePlan<R>, s: &mut Scratch<R>) {
    if !plan.servos_are_bounded {
        return;
    }
    R::vectorize(
        #[inline(always)]
        || {
            s.impulse.copy_from_slice(&s.constraints.iterate.w);
            s.smooth.mass.momentum(plan, &mut s.impulse);
        },
    )
}

/// Takes the next state over in the lanes where it is finite; the others stay where they were and start cold. Returns those lanes.
fn accept<R: Real>(plan: &LanePlan<R>, s: &mut Scratch<R>) -> R::Mask {
    let finite = R::vectorize(
        #[inline(always)]
        || {
            let mut finite = R::Mask::splat(true);
            for x in [&s.q_next, &s.v_next, &s.act_next] {
                finite = finite.and(all_finite(x));
            }
            // A pose that the user gave and that is none would hide its contacts: the step is refused instead.
            for m in &plan.mocap {
                finite = finite.and(all_finite(&s.kinematics.pos[m.frame])).and(all_finite(&s.kinematics.mat[m.frame]));
            }
            finite
        },
    );
    if !finite.and(s.alive).all() {
        stay(s, finite);
    }
    // What was is room for the step after the next.
    std::mem::swap(&mut s.q, &mut s.q_next);
    std::mem::swap(&mut s.v, &mut s.v_next);
    std::mem::swap(&mut s.act, &mut s.act_next);
    std::mem::swap(&mut s.contacts, &mut s.new_contacts);
    finite
}

/// Lets the lanes whose next state is not finite, and those that are no environment, stay where they are; the former start cold.
#[cold]
fn stay<R: Real>(s: &mut Scratch<R>, finite: R::Mask) {
    R::vectorize(
        #[inline(always)]
        || {
            let moves = finite.and(s.alive);
            for (next, old) in [(&mut s.q_next, &s.q), (&mut s.v_next, &s.v), (&mut s.act_next, &s.act)] {
                for (next, &old) in next.iter_mut().zip(old) {
                    *next = R::select(moves, *next, old);
                }
            }
            let refused = s.alive.and_not(finite);
            if refused.none() {
                return;
            }
            for lambda in s.constraints.scalar_impulse.iter_mut().chain(&mut s.impulse) {
                *lambda = R::select(finite, *lambda, R::zero());
            }
            for l in each_of(refused.bits()) {
                s.new_contacts.count[l] = 0;
            }
            for slot in &mut s.new_contacts.data {
                slot.impulse = select(finite, slot.impulse, zero());
            }
            for torque in &mut s.new_contacts.torque {
                *torque = select(finite, *torque, zero());
            }
        },
    )
}

//! A step near one that is solved, with hard contact: impulses follow from those of the solution to first order.

use stepper_real::{Mask, Real};
use stepper_solve::Settings;
use stepper_solve::newton::{Followed, Response};

use crate::collision::contact_set::Contacts;
use crate::compile::{ActuatorParams, LaneModel};
use crate::constraints::Constraints;
use crate::constraints::restitution::any_elastic;
use crate::dynamics::kinematics::advance;
use crate::integrators::corrected_forces::take_forces_again;
use crate::integrators::evaluation::{assemble_here, evaluate};
use crate::integrators::free_motion::renew_forces;
use crate::integrators::renewed::Renewed;
use crate::integrators::scheme;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::V3;
use crate::options::StepSettings;
use crate::probe::NoProbe;
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s04_assemble::assemble_demands;
use crate::stages::s05_solve::is_estimated;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s07_integrate_position::integrate_position;

/// Number of a constraint that is none.
const NOBODY: u64 = u64::MAX;

/// Residual with which a step counts as solved, m/s: modes are certain, and what the response is wrong by is of this order.
const SOLVED: f64 = 1e-9;

/// Lanes in which a residual is that of a solution.
pub(crate) fn is_solved<R: Real>(options: &StepSettings, residual: R) -> R::Mask {
    residual.le(R::of(SOLVED.max(10.0 * options.tolerance)))
}

/// A solution with hard contact, and how its impulses follow the rows.
#[derive(Clone, Debug)]
pub(crate) struct HardResponse<R: Real> {
    /// Impulses of the step.
    solution: Response<R>,
    /// Those with which forces that depend on the velocity to come are taken, which are a solution of the same rows before these forces.
    estimate: Response<R>,
    /// Contacts of the step.
    contacts: Contacts<R>,
    /// Velocity that it expected.
    v_expected: Vec<R>,
    /// Free velocity for which the present rows are.
    v_free: Vec<R>,
    change: Vec<R>,
    /// The scheme, and the lanes that it takes at the beginning of the step.
    scheme: Scheme<R>,
    at_beginning: R::Mask,
}

/// What becomes of the impulses of a system of rows, in the lanes `lanes` (bits).
enum Pass<'a> {
    /// They are solved for, and how they follow the rows is taken up. Lanes in which they do not follow are taken out.
    Solve { lanes: u32 },
    /// They follow the rows. Lanes that have lost a constraint are taken out; `near` is called with the constraints that have come nearer
    /// to another mode in the others.
    Follow { lanes: u32, near: &'a mut dyn FnMut(Followed) },
}

impl<R: Real> HardResponse<R> {
    /// Room for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = || vec![R::zero(); compiled.nv];
        Self {
            solution: Response::default(),
            estimate: Response::default(),
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            v_expected: zeros(),
            v_free: zeros(),
            change: zeros(),
            scheme: scheme(options),
            at_beginning: R::Mask::splat(false),
        }
    }

    /// Keeps what the step that was just made says of its solution.
    pub(crate) fn keep(&mut self, s: &Workspace<R>) {
        // The step has handed its contacts on.
        self.contacts.clone_from(&s.state.contacts);
        self.v_expected.copy_from_slice(&s.free_motion.v_expected);
    }

    /// Takes up the solutions of the step that was kept in the lanes `lanes` (bits), from the state before it. Returns those of them in
    /// which impulses follow from the rows, and velocities and positions from them.
    pub(crate) fn settle(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, lanes: u32) -> u32 {
        let lanes = lanes & !s.constraints.needs_position_solve.bits();
        let lanes = self.take(compiled, options, s, Renewed::Configuration, Pass::Solve { lanes });
        if !self.scheme.corrects {
            return lanes;
        }
        let follows = is_estimated(&s.state.v, self.scheme.h).bits() | if depends_on_estimate(compiled) { 0 } else { lanes };
        lanes & follows & self.has_expected(options, s).bits()
    }

    /// Lanes in which the step expected the velocity that the estimate leads to when it is solved for: else it is not a solution, and does
    /// not follow its rows as one does.
    fn has_expected(&self, options: &StepSettings, s: &Workspace<R>) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let mut apart = R::zero();
                for (&kept, &now) in self.v_expected.iter().zip(&s.free_motion.v_expected) {
                    // Written so that a NaN stays.
                    apart = R::select((kept - now).abs().le(apart), apart, (kept - now).abs());
                }
                is_solved(options, apart)
            },
        )
    }

    /// Stages 1 to 7 near the solution, in the lanes `lanes` (bits). Returns those of them in which all constraints that pushed there are
    /// there still, and calls `near` with the constraints that have come nearer to another mode.
    pub(crate) fn follow(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        renewed: Renewed,
        lanes: u32,
        near: &mut dyn FnMut(Followed),
    ) -> u32 {
        self.take(compiled, options, s, self.rows_by(compiled, renewed), Pass::Follow { lanes, near })
    }

    /// Stages 1 to 7 with `pass` in the place of stage 5. Returns the lanes that it has left.
    fn take(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, renewed: Renewed, mut pass: Pass<'_>) -> u32 {
        let everywhere = R::Mask::splat(true);
        match renewed {
            Renewed::Configuration => {
                self.scheme = scheme(options);
                s.poses.begin();
                self.at_beginning = evaluate(compiled, options, &mut self.scheme, s, NoProbe);
                s.evaluation.contacts.follow_tangents(&self.contacts);
                assemble_here(compiled, options, &self.scheme, s, self.at_beginning);
            }
            Renewed::Velocity => {
                renew_forces(compiled, &self.scheme, s);
                assemble_here(compiled, options, &self.scheme, s, self.at_beginning);
            }
            Renewed::Forces => {
                renew_forces(compiled, &self.scheme, s);
                advance(&s.free_motion.v, &self.v_free, -R::one(), &mut self.change);
                assemble_demands(compiled, &s.free_motion.smooth.mass, &mut s.constraints, &mut self.change, None, everywhere);
            }
        }
        if self.scheme.corrects {
            pass.find_impulses(options, &mut self.estimate, &mut s.constraints, &s.evaluation.contacts);
            take_forces_again(compiled, &self.scheme, s, NoProbe);
        }
        self.v_free.copy_from_slice(&s.free_motion.v);
        pass.find_impulses(options, &mut self.solution, &mut s.constraints, &s.evaluation.contacts);
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
        integrate_position(compiled, &s.evaluation.q, &s.next.v, self.scheme.time_after, &mut s.next.q);
        advance_activation(compiled, &s.state.act, &s.evaluation.act, &s.inputs.ctrl, self.scheme.h, &mut s.next.act);
        let (Pass::Solve { lanes } | Pass::Follow { lanes, .. }) = pass;
        lanes
    }

    /// What of the rows is to be made again where so much is new. Where forces change the mass matrix that is all, as where servos are
    /// implicit, or drag at some velocity; what velocities change is else the free velocity alone, unless rows demand something of the
    /// velocity before the step.
    fn rows_by(&self, compiled: &LaneModel<R>, renewed: Renewed) -> Renewed {
        let plain = compiled.equalities.is_empty() && compiled.tendons.iter().all(|tendon| tendon.spring.is_none());
        match renewed {
            _ if compiled.actuator_dynamics > 0 || compiled.lossy => Renewed::Configuration,
            Renewed::Velocity if self.scheme.corrects => Renewed::Configuration,
            Renewed::Forces if self.scheme.corrects && !compiled.servos.is_empty() => Renewed::Configuration,
            Renewed::Velocity if plain && !compiled.has_contact_springs && !any_elastic(&self.contacts) => Renewed::Forces,
            Renewed::Forces if any_elastic(&self.contacts) => Renewed::Configuration,
            renewed => renewed,
        }
    }
}

impl Pass<'_> {
    /// Stage 5.
    fn find_impulses<R: Real>(
        &mut self,
        options: &StepSettings,
        response: &mut Response<R>,
        constraints: &mut Constraints<R>,
        contacts: &Contacts<R>,
    ) {
        let Constraints { problem, iterate, newton, owners, slots, rolling_slots, constrained, .. } = constraints;
        let name = names(owners, slots, rolling_slots, contacts);
        match self {
            Self::Solve { lanes } => {
                let [sweeps, newton_steps] = options.effort();
                let tolerance = R::of(options.tolerance);
                let settings = Settings { sweeps, newton_steps, tolerance, newton_threshold: tolerance };
                let outcome = stepper_solve::solve(&*problem, iterate, settings, *constrained, newton);
                *lanes &= is_solved(options, outcome.residual).bits();
                *lanes = response.settle(problem, iterate, *lanes, name);
            }
            Self::Follow { lanes, near } => {
                *lanes &= !response.respond(problem, iterate, *lanes, name);
                response.compare(problem, iterate, *lanes, near);
            }
        }
    }
}

/// Whether the velocity to be expected matters where all rests: inertial forces are quadratic in it, drag and what pushes with the motion
/// are not. Dampers are implicit.
fn depends_on_estimate<R: Real>(compiled: &LaneModel<R>) -> bool {
    let pushes = |k: usize| {
        let ActuatorParams { gain, bias } = compiled.params.actuator(k);
        gain[2].eq(R::zero()).and(bias[2].le(R::zero())).not().any()
    };
    !compiled.fluid.is_empty() || compiled.servos.iter().any(|servo| pushes(servo.actuator))
}

/// Which constraint a kind's constraint of some index is in a lane: the number of its owner, or of its contact.
fn names<'a, R: Real>(
    owners: &'a [usize],
    slots: &'a [(usize, R::Mask)],
    rolling_slots: &'a [(usize, R::Mask, V3<R>)],
    contacts: &'a Contacts<R>,
) -> impl Fn(usize, usize, usize) -> u64 + 'a {
    move |kind, i, lane| {
        let (k, lanes) = match kind {
            0 => return owners[i] as u64,
            1 => slots[i],
            _ => (rolling_slots[i].0, rolling_slots[i].1),
        };
        if lanes.bits() >> lane & 1 == 1 { contacts.ids[k][lane].0 } else { NOBODY }
    }
}

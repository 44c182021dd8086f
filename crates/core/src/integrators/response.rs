//! A step near one that is solved, with hard contact: impulses follow from those of the solution to first order.

use stepper_real::{Mask, Real};
use stepper_solve::newton::{Followed, Response};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::Constraints;
use crate::constraints::restitution::any_elastic;
use crate::dynamics::kinematics::advance;
use crate::integrators::evaluation::{assemble_here, assemble_rows, evaluate};
use crate::integrators::free_motion::renew_forces;
use crate::integrators::renewed::Renewed;
use crate::integrators::scheme;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::V3;
use crate::options::StepSettings;
use crate::probe::NoProbe;
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s04_assemble::assemble_demands;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s07_integrate_position::integrate_position;

/// Number of a constraint that is none.
const NOBODY: u64 = u64::MAX;

/// A solution with hard contact, and how its impulses follow the rows.
#[derive(Clone, Debug)]
pub(crate) struct HardResponse<R: Real> {
    response: Response<R>,
    /// Contacts of the solution.
    contacts: Contacts<R>,
    /// Free velocity for which the present rows are.
    v_free: Vec<R>,
    change: Vec<R>,
    /// Lanes that the scheme takes at the beginning of the step.
    at_beginning: R::Mask,
}

impl<R: Real> HardResponse<R> {
    /// Room for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        let zeros = || vec![R::zero(); compiled.nv];
        let contacts = Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction);
        Self { response: Response::default(), contacts, v_free: zeros(), change: zeros(), at_beginning: R::Mask::splat(false) }
    }

    /// Takes up the solution of the step that was just made in the lanes `lanes` (bits); returns those of them in which impulses follow
    /// from the rows, and velocities and positions from them.
    pub(crate) fn settle(&mut self, s: &Workspace<R>, lanes: u32) -> u32 {
        // The step has handed its contacts on.
        self.contacts.clone_from(&s.state.contacts);
        let Constraints { problem, iterate, owners, slots, rolling_slots, needs_position_solve, .. } = &s.constraints;
        let lanes = lanes & !needs_position_solve.bits();
        self.response.settle(problem, iterate, lanes, names(owners, slots, rolling_slots, &self.contacts))
    }

    /// Stages 1 to 7 near the solution. Returns the lanes in which a constraint that pushed there is not there any more.
    pub(crate) fn step(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        renewed: Renewed,
        lanes: u32,
    ) -> u32 {
        let mut scheme = scheme(options);
        let everywhere = R::Mask::splat(true);
        match self.rows_by(compiled, renewed) {
            Renewed::Configuration => {
                s.poses.begin();
                self.at_beginning = evaluate(compiled, options, &mut scheme, s, NoProbe);
                s.evaluation.contacts.follow_tangents(&self.contacts);
                assemble_rows(compiled, options, &scheme, s, self.at_beginning, NoProbe);
            }
            Renewed::Velocity => {
                renew_forces(compiled, &scheme, s);
                assemble_here(compiled, options, &scheme, s, self.at_beginning);
            }
            Renewed::Forces => {
                renew_forces(compiled, &scheme, s);
                advance(&s.free_motion.v, &self.v_free, -R::one(), &mut self.change);
                assemble_demands(compiled, &s.free_motion.smooth.mass, &mut s.constraints, &mut self.change, None, everywhere);
            }
        }
        self.v_free.copy_from_slice(&s.free_motion.v);
        let Constraints { problem, iterate, owners, slots, rolling_slots, .. } = &mut s.constraints;
        let lost = self.response.respond(problem, iterate, lanes, names(owners, slots, rolling_slots, &s.evaluation.contacts));
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
        integrate_position(compiled, &s.evaluation.q, &s.next.v, scheme.time_after, &mut s.next.q);
        advance_activation(compiled, &s.state.act, &s.evaluation.act, &s.inputs.ctrl, scheme.h, &mut s.next.act);
        lost
    }

    /// What of the rows is to be made again where so much is new. Where forces change the mass matrix that is all; what velocities change
    /// is the free velocity alone, unless rows demand something of the velocity before the step.
    fn rows_by(&self, compiled: &LaneModel<R>, renewed: Renewed) -> Renewed {
        let plain = compiled.equalities.is_empty() && compiled.tendons.iter().all(|tendon| tendon.spring.is_none());
        match renewed {
            _ if compiled.actuator_dynamics > 0 || compiled.lossy => Renewed::Configuration,
            Renewed::Velocity if plain && !compiled.has_contact_springs && !any_elastic(&self.contacts) => Renewed::Forces,
            Renewed::Forces if any_elastic(&self.contacts) => Renewed::Configuration,
            renewed => renewed,
        }
    }

    /// Calls `f` with the constraints that the last step has brought nearer to another mode.
    pub(crate) fn compare(&mut self, s: &Workspace<R>, lanes: u32, f: impl FnMut(Followed)) {
        self.response.compare(&s.constraints.problem, &s.constraints.iterate, lanes, f);
    }
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
